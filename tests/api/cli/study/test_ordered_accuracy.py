"""Target accuracy without the arm: targets are met with at most one image more than needed.

Each run's figures are kept in `build/order-<commit>/`, so that an interrupted series goes on where it was.
"""

import functools
import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from acquisition.models.recipe import Recipe
from api.cli.study import scene_geometry, simulated_scene

ROOT = Path(__file__).parents[4]
WANTED_DEG = (1.0, 0.65, 0.5)
"""Expected mean errors, 0.886 × the target."""
DRAWS = range(6)
MATT = ("sphere", "vase", "relief", "bumps", "figure", "part")
Errors = tuple[float, float]
"""Mean errors in degrees: over the pixels that the mean σ is over, those that straddle two surfaces included, and over
the others."""
ALL, ONE_SURFACE = 0, 1

pytestmark = [pytest.mark.long, pytest.mark.timeout(3600)]


def runs(shape: str, draw: int) -> list[dict[str, Any]]:
    """For each target error the number of images and the errors of the run, and of runs with fixed numbers of images,
    from four to two fewer."""
    done = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True)
    kept = ROOT / "build" / f"order-{done.stdout.strip()}" / f"{shape}-{draw}.json"
    if not kept.exists():
        scene = simulated_scene.Scene(scene_geometry.Geometry(shape, 500 + draw))

        @functools.cache
        def fixed(lights: int) -> Errors:
            return errors(scene.run(simulated_scene.recipe("optimal", lights, draw)))

        results = []
        for wanted in WANTED_DEG:
            run = scene.run(Recipe(target_sigma_deg=wanted / 0.886, seed=draw))
            images = len(run.result.observations.shots)
            results.append({
                "shape": shape, "draw": draw, "wanted_deg": wanted, "found_deg": errors(run), "images": images,
                "fixed_deg": {lights: fixed(lights) for lights in range(4, images - 1)}, "why": run.plan.conclusion,
            })  # fmt: skip
        kept.parent.mkdir(parents=True, exist_ok=True)
        kept.write_text(json.dumps(results), encoding="utf-8")
    return json.loads(kept.read_text(encoding="utf-8"))


def errors(run: simulated_scene.Run) -> Errors:
    return float(np.mean(run.result.all_error_deg)), run.result.mean_deg


@pytest.mark.parametrize("draw", DRAWS)
@pytest.mark.parametrize("shape", MATT)
def test_ordered_accuracy_each_run_states_why_it_stopped(shape: str, draw: int) -> None:
    for run in runs(shape, draw):
        assert run["why"].startswith(
            ("target met", "all lights allowed were captured", "further lights would hardly lower σ")
        ), run


def test_ordered_accuracy_targets_are_met() -> None:
    """The machined part is excluded: errors beside its depth discontinuities are outside the variance model."""
    results = all_runs()
    missed, beside = late(results, ALL), late(results, ONE_SURFACE)
    print(
        f"\n{len(results)} runs: {len(results) - len(missed)} within a tenth of what was wanted"
        f" ({len(results) - len(beside)} where pixels see one surface)"
    )
    assert len(missed) <= 0.1 * len(results), missed


def test_ordered_accuracy_uses_at_most_one_image_too_many() -> None:
    results = all_runs()
    wasteful, beside = lavish(results, ALL), lavish(results, ONE_SURFACE)
    print(
        f"\n{len(results)} runs: {len(results) - len(wasteful)} with at most an image more than the fewest that do"
        f" ({len(results) - len(beside)} where pixels see one surface)"
    )
    assert len(wasteful) <= 0.1 * len(results), wasteful


def all_runs() -> list[dict[str, Any]]:
    return [run for shape in MATT if shape != "part" for draw in DRAWS for run in runs(shape, draw)]


def late(results: list[dict[str, Any]], which: int) -> list[dict[str, Any]]:
    """The runs that exceed the target by more than a tenth, by the errors `which`."""
    return [run for run in results if run["found_deg"][which] > 1.1 * run["wanted_deg"]]


def lavish(results: list[dict[str, Any]], which: int) -> list[dict[str, Any]]:
    """The runs with at least two images more than a fixed number that meets the target, by those errors."""
    return [run for run in results if any(error[which] <= run["wanted_deg"] for error in run["fixed_deg"].values())]
