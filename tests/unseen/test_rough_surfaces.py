"""Rough surfaces, and what resembles them: coded values, stray light, and a poor fit without an explanation."""

import pytest

from tests.unseen import patterns, run, scenes, with_fault
from tests.unseen.captures import capture


@pytest.mark.parametrize(
    ("family", "seed", "lights"),
    [
        pytest.param("turned", 3, 8, marks=pytest.mark.long),
        pytest.param("turned", 12, 8, marks=pytest.mark.long),
        ("turned", 28, 8),
        ("sheet", 61, 10),
    ],
)
def test_solve_rough_surface_is_found_and_nothing_else(family: str, seed: int, lights: int) -> None:
    """Turned profiles whose values also seem coded, the last with little evidence of roughness; and a sheet, whose poor
    fit gives roughness a gain of four."""
    scene = scenes.scene(family, seed, "oren-nayar:0.5", with_fault.PIXELS)
    positions = patterns.fixed("two-rings", scene, lights, 0, 1)
    assert with_fault.kinds(run.solve(scene, capture(scene, positions))) == [("rough surface", True)]


@pytest.mark.long
@pytest.mark.parametrize("family", ["blob", "sheet"])
def test_solve_rough_surface_in_stray_light_is_as_without_it(family: str) -> None:
    pair = with_fault.solved(family, 60, "oren-nayar:0.5", "offset:0.03")
    assert {("rough surface", True), ("stray light", True)} <= set(with_fault.kinds(pair.faulty))
    assert pair.error_ratio < 1.2


def test_solve_rough_relief_in_stray_light_as_both() -> None:
    """No shadow shows the stray light, and roughness alone fits the images better than stray light alone."""
    pair = with_fault.solved("relief", 421, "oren-nayar:0.3", "offset:0.03")
    assert with_fault.kinds(pair.sound) == [("rough surface", True)]
    assert with_fault.kinds(pair.faulty) == [("rough surface", True), ("stray light", True)]
    assert pair.error_ratio < 1.3
