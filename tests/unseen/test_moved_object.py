"""A move of object or camera that leaves a sound fit."""

import numpy as np

from tests.unseen import faults, patterns, run, scenes
from tests.unseen.captures import capture

PIXELS = 48


def test_solve_cluster_moved_by_two_pixels_is_registered() -> None:
    """Its fit is sound, and its normals are three times as far off without registration."""
    scene = scenes.scene("cluster", 64, "lambert", PIXELS)
    positions = patterns.fixed("two-rings", scene, 10, 0, 1)
    sound, moved = (run.solve(scene, capture(scene, positions, fault=faults.named(name))) for name in ("", "moved:2"))
    assert [(finding.kind, finding.corrected) for finding in moved.findings] == [("moved object", True)]
    graded = scene.truth.within_78_deg & sound.mask & moved.mask
    errors = [np.mean(scene.truth.error_deg(one.normals)[graded]) for one in (sound, moved)]
    assert errors[1] < 1.7 * errors[0]
