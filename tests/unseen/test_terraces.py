"""Terraced reliefs, whose walls are narrower than a pixel, so that pixels mix what no model of an image describes."""

import numpy as np
import pytest

from acquisition.normals import alternation
from tests.unseen import patterns, run, scenes, with_fault
from tests.unseen.captures import capture


def test_solve_terraces_of_walls_narrower_than_pixels_have_no_findings() -> None:
    """With all pixels one image is taken for a bad one."""
    scene = scenes.scene("relief", 147, "lambert", 80)
    assert with_fault.kinds(run.solve(scene, capture(scene, patterns.fixed("two-rings", scene, 8, 0, 1)))) == []


@pytest.mark.long
@pytest.mark.parametrize(("seed", "most_deg"), [(123, 1.7), (146, 2.1)])
def test_solve_terraces_are_not_taken_for_ambient_light(seed: int, most_deg: float) -> None:
    """With all pixels they err by 2.5 and 2.9° where pixels see one surface, in ambient light of 20 and 30 %."""
    scene = scenes.scene("relief", seed, "lambert")
    solved = run.solve(scene, capture(scene, patterns.fixed("two-rings", scene, 8, seed % 4, 4)))
    assert with_fault.kinds(solved) == []
    assert np.mean(scene.truth.error_deg(solved.normals)[scene.truth.one_surface & solved.mask]) < most_deg


def test_pixels_that_tell_of_what_is_shared_are_neither_dark_nor_mixed_unless_too_few_are_left() -> None:
    mixed, dark = np.zeros(1000, bool), np.zeros(1000, bool)
    mixed[:400], dark[300:500] = True, True
    assert np.array_equal(np.flatnonzero(alternation.unmixed(mixed, dark)), np.arange(500, 1000))
    mixed[:] = True
    assert np.array_equal(alternation.unmixed(mixed, dark), ~dark)
