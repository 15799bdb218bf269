"""Terraced reliefs with walls narrower than a pixel: pixels mix surfaces, which no model of an image describes."""

import numpy as np
import pytest

from tests.unseen import patterns, run, scenes, with_fault
from tests.unseen.captures import capture


@pytest.mark.parametrize(
    ("seed", "pixels"),
    [
        (123, 112),
        pytest.param(123, scenes.PIXELS, marks=pytest.mark.long),
        pytest.param(141, 112, marks=pytest.mark.long),
    ],
)
def test_solve_terraces_are_not_taken_for_other_light(seed: int, pixels: int) -> None:
    """With all pixels the first seed is taken for an object in ambient light, and the other has an error of 2.1° at
    pixels that show one surface."""
    scene = scenes.scene("relief", seed, "lambert", pixels)
    solved = run.solve(scene, capture(scene, patterns.fixed("two-rings", scene, 8, seed % 4, 4)))
    assert with_fault.kinds(solved) == []
    assert np.mean(scene.truth.error_deg(solved.normals)[scene.truth.one_surface & solved.mask]) < 1.8
