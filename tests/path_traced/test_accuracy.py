"""The whole recipe on path-traced images, against bars: five objects, three draws of 1 % intensity and 1 mm position.

Grades are means over objects of means over draws; two rings of lights. Renders are cached under build/path-traced; each
bar is an item of its own and prints its figure (`pytest -m long -s tests/path_traced`). The thresholds of lobe and
bounced light were chosen on these objects, and pixels that straddle a crease are not graded.
"""

import functools
from collections.abc import Iterator
from typing import Literal

import numpy as np
import pytest

from acquisition import normals
from acquisition.measured import NormalMap, SolveSettings
from acquisition.normals import interreflection
from acquisition.normals.lambert import Pixels
from tests.path_traced import bench, objects

pytestmark = [pytest.mark.long, pytest.mark.timeout(1800)]

PIXELS = 128
DRAWS = 3
SIGMA_DRAWS = 10
Condition = Literal["direct", "bounces", "gloss", "ggx", "gloss and bounces", "dark", "textured"]
CORRECTED: tuple[Condition, Condition] = ("direct", "bounces")


@functools.lru_cache(maxsize=8)
def images(name: str, condition: Condition, lights: int) -> np.ndarray:
    albedo: float | str = {"dark": 0.05, "textured": bench.TEXTURE}.get(condition, 0.7)
    where = bench.two_rings(lights)
    y = bench.render(name, where, pixels=PIXELS, bounces=condition not in ("direct", "gloss", "ggx"), albedo=albedo)
    if condition in ("gloss", "gloss and bounces"):
        y = y + bench.gloss(name, where, pixels=PIXELS)
    if condition == "ggx":
        y = y + bench.gloss(name, where, pixels=PIXELS, kind="ggx")
    return y


@functools.lru_cache(maxsize=256)
def solved(
    name: str, condition: Condition, lights: int, draw: int, intensity_sigma: float = 0.01
) -> tuple[NormalMap, bench.Grade]:
    true = bench.truth(name, PIXELS)
    taken = bench.capture(
        images(name, condition, lights), bench.two_rings(lights), draw, intensity_sigma=intensity_sigma
    )
    found = normals.solve_stack(
        taken.stack, taken.calibration, SolveSettings(), initial_depth_m=0.9, object_mask=true.mask
    )
    return found, bench.grade(found, true, taken.log_intensity)


def grades(name: str, condition: Condition, lights: int) -> list[bench.Grade]:
    return [solved(name, condition, lights, draw)[1] for draw in range(DRAWS)]


def show(what: str, *figures: float | np.floating) -> None:
    print(f"\n{what}:", *(f"{one:.4g}" for one in figures))


def mean_deg(condition: Condition, lights: int) -> float:
    each = [float(np.mean([one.mean_deg for one in grades(name, condition, lights)])) for name in objects.NAMES]
    show(f"{condition}, {lights} lights, mean degrees of all and of {', '.join(objects.NAMES)}", np.mean(each), *each)
    return float(np.mean(each))


@pytest.fixture
def uncorrected(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Solves as if no surface sent light to another."""

    def nothing(pixels: Pixels, values: np.ndarray, *_: object) -> np.ndarray:
        return np.zeros_like(values)

    monkeypatch.setattr(interreflection, "received", nothing)
    solved.cache_clear()
    yield
    solved.cache_clear()


@pytest.mark.parametrize(
    ("condition", "lights", "bar"),
    [
        ("direct", 8, 0.78), ("bounces", 8, 1.65), ("gloss", 8, 1.1), ("ggx", 8, 1.05), ("gloss and bounces", 8, 1.7),
        ("direct", 12, 0.59), ("bounces", 12, 1.25), ("gloss", 12, 0.8), ("gloss and bounces", 12, 1.35),
    ],
)  # fmt: skip
def test_mean_error(condition: Condition, lights: int, bar: float) -> None:
    assert mean_deg(condition, lights) <= bar


@pytest.mark.parametrize(
    "name",
    [
        "part", "animal", "bowl", "vee",
        pytest.param("rabbit", marks=pytest.mark.xfail(reason="hidden sides of its ears send light unseen")),
    ],
)  # fmt: skip
def test_most_of_what_bounced_light_costs_is_won_back(name: str, request: pytest.FixtureRequest) -> None:
    """Against the same solver that takes none of it out, beside what direct light alone leaves."""
    direct, corrected = (
        float(np.mean([one.mean_deg for one in grades(name, condition, 8)])) for condition in CORRECTED
    )
    request.getfixturevalue("uncorrected")
    without = float(np.mean([one.mean_deg for one in grades(name, "bounces", 8)]))
    show(f"{name}: direct light, bounced light corrected and not", direct, corrected, without)
    assert corrected - direct <= 0.6 * (without - direct)
    assert corrected <= 2.2 or name != "vee"


@pytest.mark.parametrize("name", objects.NAMES)
def test_dark_scenes_are_not_harmed(name: str, request: pytest.FixtureRequest) -> None:
    """Albedo 0.05: there is little to take out, and what is taken out must not be more than that."""
    corrected = float(np.mean([one.mean_deg for one in grades(name, "dark", 8)]))
    request.getfixturevalue("uncorrected")
    without = float(np.mean([one.mean_deg for one in grades(name, "dark", 8)]))
    show(f"{name}, dark, corrected and not", corrected, without)
    assert corrected <= without + 0.02


@pytest.mark.parametrize("lights", [8, 12])
def test_intensities_are_found(lights: int) -> None:
    left = [one.intensity_error for name in objects.NAMES for one in grades(name, "direct", lights)]
    show(f"intensity error left of 0.01, {lights} lights", np.mean(left))
    assert np.mean(left) <= 0.007


def test_large_intensity_errors_are_found() -> None:
    left = [solved(name, "direct", 8, draw, 0.03)[1].intensity_error for name in objects.NAMES for draw in range(DRAWS)]
    show("intensity error left of 0.03", np.mean(left))
    assert np.mean(left) <= 0.013


@pytest.mark.parametrize("condition", ["direct", "bounces", "dark"])
def test_matt_surfaces_get_no_lobe(condition: Condition) -> None:
    found = [solved(name, condition, 8, draw)[0] for name in objects.NAMES for draw in range(DRAWS)]
    strengths = [one.notes["lobe"]["strength"] for one in found]
    show(f"strongest lobe of a matt surface, {condition}", max(strengths))
    assert max(strengths) <= 0.01


@pytest.mark.parametrize("condition", ["direct", "bounces", "gloss"])
@pytest.mark.parametrize("intensity_sigma", [0.003, 0.01, 0.03])
def test_sigma_is_honest(condition: Condition, intensity_sigma: float) -> None:
    """One draw's errors move all pixels together, so many draws are needed."""
    found = {
        name: [solved(name, condition, 8, draw, intensity_sigma)[1] for draw in range(SIGMA_DRAWS)]
        for name in objects.NAMES
    }
    every = [one for several in found.values() for one in several]
    within, twice, flagged = (
        float(np.mean([getattr(one, name) for one in every])) for name in ("within", "within_two", "flagged")
    )
    show(f"{condition}, intensities {intensity_sigma:.1%}: P(e < σ), P(e < 2σ), flagged", within, twice, flagged)
    assert 0.55 <= within <= 0.75
    assert twice >= 0.92
    assert flagged <= 0.25
    for several in found.values():
        assert np.mean([one.sure_half_deg for one in several]) < np.mean([one.mean_deg for one in several])


@pytest.mark.parametrize("name", ["animal", "rabbit"])
def test_sigma_is_the_error_on_smooth_matt_objects(name: str) -> None:
    found = [solved(name, "direct", 8, draw)[1].ratio for draw in range(SIGMA_DRAWS)]
    show(f"{name}: rms of error / σ", np.mean(found))
    assert 0.85 <= np.mean(found) <= 1.25
