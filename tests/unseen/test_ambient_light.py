"""Ambient light on a path-traced object whose images turned lamps fit better than the plain model does."""

import numpy as np

from tests.unseen import faults, patterns, run, scenes
from tests.unseen.captures import capture

PIXELS = 48


def test_solve_ambient_light_is_not_taken_for_turned_lamps() -> None:
    scene = scenes.scene("turned", 63, "lambert", PIXELS)
    positions = patterns.fixed("two-rings", scene, 10, 0, 1)
    sound, ambient = (
        run.solve(scene, capture(scene, positions, fault=faults.named(name))) for name in ("", "ambient:0.1")
    )
    assert [(finding.kind, finding.corrected) for finding in ambient.findings] == [("ambient light", True)]
    graded = scene.truth.within_78_deg & sound.mask & ambient.mask
    errors = [np.mean(scene.truth.error_deg(solved.normals)[graded]) for solved in (sound, ambient)]
    assert errors[1] < 1.3 * errors[0]
