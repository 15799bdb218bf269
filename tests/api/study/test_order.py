"""Accuracy on order without the arm: targets are met, and with hardly an image more than needed.

Each run's figures are kept in `build/order-<commit>/`, so that an interrupted series goes on where it was.
"""

import functools
import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from acquisition.types import Recipe
from api.study import scenes

ROOT = Path(__file__).parents[3]
WANTED_DEG = (1.0, 0.65, 0.5)
"""Expected mean errors, 0.886 × the target."""
DRAWS = range(6)
MATT = ("sphere", "vase", "relief", "bumps", "figure", "part")
CLEARLY = 1.15
"""Times the wanted error at which a number of images is clearly too small."""

pytestmark = [pytest.mark.long, pytest.mark.timeout(3600)]


def runs(shape: str, draw: int) -> list[dict[str, Any]]:
    """For each wanted error the images taken, the error found, and the fixed numbers of images, two and more fewer,
    that meet it too.

    Errors are over the pixels that the mean σ is over, those that straddle two surfaces included.
    """
    done = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True)
    kept = ROOT / "build" / f"order-{done.stdout.strip()}" / f"{shape}-{draw}.json"
    if not kept.exists():
        scene = scenes.Scene(scenes.Geometry(shape, 500 + draw))

        @functools.cache
        def fixed(lights: int) -> float:
            return float(np.mean(scene.run(scenes.recipe("optimal", lights, draw)).found.all_deg))

        def enough(images: int, wanted: float) -> list[int]:
            """As far down as errors are near what is wanted; with fewer images they only grow."""
            fewer: list[int] = []
            for lights in range(images - 2, 3, -1):
                if fixed(lights) > CLEARLY * wanted:
                    break
                if fixed(lights) <= wanted:
                    fewer.append(lights)
            return fewer

        told = []
        for wanted in WANTED_DEG:
            run = scene.run(Recipe(target_sigma_deg=wanted / 0.886, seed=draw))
            images = len(run.found.observations.shots)
            told.append({
                "shape": shape, "draw": draw, "wanted_deg": wanted, "found_deg": float(np.mean(run.found.all_deg)),
                "graded_deg": run.found.mean_deg, "images": images, "enough": enough(images, wanted),
                "why": run.plan.conclusion,
            })  # fmt: skip
        kept.parent.mkdir(parents=True, exist_ok=True)
        kept.write_text(json.dumps(told), encoding="utf-8")
    return json.loads(kept.read_text(encoding="utf-8"))


@pytest.mark.parametrize("draw", DRAWS)
@pytest.mark.parametrize("shape", MATT)
def test_each_run_says_why_it_stopped(shape: str, draw: int) -> None:
    for run in runs(shape, draw):
        assert run["why"].startswith(("target met", "the most lights", "no light")), run


def test_targets_are_met_with_hardly_an_image_more_than_needed() -> None:
    """The stepped part is left out: beside its steps there are errors that no variance knows of."""
    told = [run for shape in MATT if shape != "part" for draw in DRAWS for run in runs(shape, draw)]
    met = [run for run in told if run["found_deg"] <= 1.1 * run["wanted_deg"]]
    assert len(met) >= 0.9 * len(told), [run for run in told if run not in met]
    sparing = [run for run in told if not run["enough"]]
    print(f"\n{len(told)} runs: {len(met)} within a tenth of what was wanted, {len(sparing)} at most an image over")
    assert len(sparing) >= 0.9 * len(told), [run for run in told if run not in sparing]
