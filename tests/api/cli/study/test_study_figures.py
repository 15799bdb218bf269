"""The full study's figures against their bounds, on the six objects with profile `direct`.

The study's JSON is kept in `build/study-<commit>/`, so that a series that was cut off does not begin anew.
"""

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[4]
MATT_8 = {"two-rings": 0.95, "ring": 0.85, "drbohlav": 0.75, "random": 0.60}

pytestmark = [pytest.mark.long, pytest.mark.timeout(3600)]


def folder() -> Path:
    """Where the figures of this commit are kept."""
    done = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True)
    return ROOT / "build" / f"study-{done.stdout.strip()}"


def ran(place: Path, *options: str) -> dict[str, Any]:
    """The last line of a run of the study, kept in `place`."""
    kept = place / "last_line.json"
    if not kept.exists():
        arguments = ["study", "--out", str(place), "--json", *options]
        done = subprocess.run(
            [sys.executable, "-m", "api.cli", *arguments], cwd=ROOT, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr
        kept.write_text(done.stdout.splitlines()[-1], encoding="utf-8")
    return json.loads(kept.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def figures() -> dict[str, Any]:
    return ran(folder())


@pytest.mark.parametrize("rival", MATT_8)
def test_study_eight_diffuse_images_beats_other_methods(figures: dict[str, Any], rival: str) -> None:
    errors = figures["errors_deg"]
    assert errors["optimal"]["8"] <= MATT_8[rival] * errors[rival]["8"]


@pytest.mark.parametrize("lights", ["12", "20"])
def test_study_more_diffuse_images_beats_other_methods(figures: dict[str, Any], lights: str) -> None:
    errors = figures["errors_deg"]
    assert errors["optimal"][lights] <= 0.95 * errors["two-rings"][lights]


def test_study_each_object_is_not_much_worse_and_relief_gains_most(figures: dict[str, Any]) -> None:
    ours, rings = (figures["errors_by_object_deg"][method]["8"] for method in ("optimal", "two-rings"))
    assert ours["relief"] <= 0.80 * rings["relief"]
    assert {shape: ours[shape] / rings[shape] for shape in ours if ours[shape] > 1.05 * rings[shape]} == {}


def test_study_errors_above_10_degrees_are_few(figures: dict[str, Any]) -> None:
    assert {n: share for n, share in figures["over_10"]["optimal"].items() if int(n) >= 8 and share > 0.001} == {}


def test_study_mixed_pixels_are_few(figures: dict[str, Any]) -> None:
    """Only depth discontinuities and contours are excluded: fine relief stays graded."""
    most = {"part": 0.08, "figure": 0.02, "relief": 0.02}
    assert {shape: share for shape, share in figures["straddling"].items() if share > most.get(shape, 0.001)} == {}


@pytest.mark.parametrize(("lights", "bar"), [("8", 1.0), ("12", 0.95)])
def test_study_glossy_objects_beats_other_methods(figures: dict[str, Any], lights: str, bar: float) -> None:
    errors = figures["glossy_errors_deg"]
    assert errors["optimal"][lights] <= bar * errors["two-rings"][lights]


def test_study_criterion_reaches_its_bound(figures: dict[str, Any]) -> None:
    for bound, ours, best_random, best_heuristic in figures["phi_by_object"].values():
        assert bound * (1 - 1e-9) <= ours <= 1.001 * bound
        assert min(best_random, best_heuristic) >= bound


def test_study_forecast_agrees_with_observed_error(figures: dict[str, Any]) -> None:
    """Found over predicted mean error in 0.8–1.25 for nine tenths of the matt runs; the stepped part is apart."""
    study = json.loads((folder() / "study.json").read_text(encoding="utf-8"))
    ratios = [
        item["mean_deg"] / (0.886 * item["predicted_sigma_deg"])
        for item in study["samples"]
        if item["method"] == "optimal"
        and not item["glossy"]
        and item["predicted_sigma_deg"] is not None
        and item["shape"] != "part"
    ]
    right = [ratio for ratio in ratios if 0.8 <= ratio <= 1.25]
    assert len(right) >= 0.9 * len(ratios), sorted(ratios)


def test_study_same_seed_gives_same_figures_and_offline_page(tmp_path: Path) -> None:
    one, other = (ran(tmp_path / name, "--quick", "--seed", "7") for name in ("one", "other"))
    assert one == other
    text = (tmp_path / "one" / "study.html").read_text(encoding="utf-8")
    assert not re.search(r"(src|href)=|url\(|@import|<script|https?://", text)
