"""Turned lamps of a machined part, which light from near tells, and mirrored ones, which score as turned, too.

Normals of a machined part have the same circulation under any turn.
"""

import numpy as np
import pytest

from tests.unseen import faults, patterns, run, scenes
from tests.unseen.captures import capture

PIXELS = 48


@pytest.mark.parametrize(
    ("family", "fault"), [("machined", "turned:10"), ("machined", "turned:-45"), ("turned", "mirrored-x")]
)
def test_solve_under_turned_or_mirrored_lamps_is_as_under_stated_ones(family: str, fault: str) -> None:
    scene = scenes.scene(family, 62, "lambert", PIXELS)
    positions = patterns.fixed("two-rings", scene, 10, 0, 1)
    sound, turned = (run.solve(scene, capture(scene, positions, fault=faults.named(name))) for name in ("", fault))
    assert [(finding.kind, finding.corrected) for finding in turned.findings] == [("axes of the lamps", True)]
    graded = scene.truth.within_78_deg & sound.mask & turned.mask
    errors = [np.mean(scene.truth.error_deg(solved.normals)[graded]) for solved in (sound, turned)]
    assert errors[1] < 1.1 * errors[0]
