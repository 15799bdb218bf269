"""Turned lamps of a machined part: light from near tells, where normals have the same circulation under any turn."""

import numpy as np
import pytest

from tests.unseen import faults, patterns, run, scenes
from tests.unseen.captures import capture

PIXELS = 48


@pytest.mark.parametrize("turn_deg", [10, -45])
def test_solve_machined_part_under_turned_lamps_is_solved_as_under_stated_ones(turn_deg: int) -> None:
    scene = scenes.scene("machined", 62, "lambert", PIXELS)
    positions = patterns.fixed("two-rings", scene, 10, 0, 1)
    sound, turned = (
        run.solve(scene, capture(scene, positions, fault=faults.named(name))) for name in ("", f"turned:{turn_deg}")
    )
    assert [(finding.kind, finding.corrected) for finding in turned.findings] == [("axes of the lamps", True)]
    graded = scene.truth.within_78_deg & sound.mask & turned.mask
    errors = [np.mean(scene.truth.error_deg(solved.normals)[graded]) for solved in (sound, turned)]
    assert errors[1] < 1.1 * errors[0]
