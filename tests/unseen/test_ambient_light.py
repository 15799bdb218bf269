"""Ambient light, and gloss that resembles it, on path-traced objects whose images turned lamps also seem to explain."""

import numpy as np
import pytest

from tests.unseen import patterns, run, scenes, with_fault
from tests.unseen.captures import capture


@pytest.mark.long
def test_solve_ambient_light_is_not_taken_for_turned_lamps() -> None:
    pair = with_fault.solved("turned", 63, "lambert", "ambient:0.1")
    assert with_fault.kinds(pair.faulty) == [("ambient light", True)]
    assert pair.error_ratio < 1.3


def test_solve_gloss_that_scores_as_turned_lamps_is_not_taken_for_ambient_light() -> None:
    """On six images of a sheet, turned lamps and ambient light gain likelihood, but gloss gains more than either."""
    scene = scenes.scene("sheet", 202, "ggx:0.33", with_fault.PIXELS)
    solved = run.solve(scene, capture(scene, patterns.fixed("two-rings", scene, 6, 0, 1)))
    assert with_fault.kinds(solved) == [("gloss", True)]
    assert np.mean(scene.truth.error_deg(solved.normals)[scene.truth.within_78_deg & solved.mask]) < 0.5


def test_solve_ambient_light_on_a_relief_without_shadows_is_found() -> None:
    """The true amount fits 4 % worse than none, which gives a surface of other slopes with five times the error."""
    pair = with_fault.solved("relief", 469, "lambert", "ambient:0.1", 8, pixels=scenes.PIXELS)
    assert with_fault.kinds(pair.faulty) == [("ambient light", True)]
    assert pair.error_ratio < 1.5


def test_solve_ambient_light_that_may_be_indirect_light_is_named() -> None:
    """Its score gains 500, but indirect light in shadows may be as strong: nothing is subtracted, and σ is larger."""
    pair = with_fault.solved("sheet", 592, "lambert", "ambient:0.03")
    assert with_fault.kinds(pair.sound) == []
    assert with_fault.kinds(pair.faulty) == [("ambient light", False)]
    assert np.nanmean(pair.faulty.sigma_deg) > np.nanmean(pair.sound.sigma_deg) + 3
    assert pair.faulty.findings[0].value == pytest.approx(0.03, rel=0.5)
