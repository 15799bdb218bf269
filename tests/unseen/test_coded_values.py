"""Coded values of a path-traced object that a wrong place of the object explains nearly as well."""

import numpy as np

from tests.unseen import faults, patterns, run, scenes
from tests.unseen.captures import capture

PIXELS = 48


def test_solve_coded_values_of_machined_part_are_linearised() -> None:
    scene = scenes.scene("machined", 62, "lambert", PIXELS)
    positions = patterns.fixed("two-rings", scene, 10, 0, 1)
    sound, coded = (run.solve(scene, capture(scene, positions, fault=faults.named(name))) for name in ("", "gamma"))
    assert [(finding.kind, finding.corrected) for finding in coded.findings] == [("coded values", True)]
    graded = scene.truth.within_78_deg & sound.mask & coded.mask
    errors = [np.mean(scene.truth.error_deg(solved.normals)[graded]) for solved in (sound, coded)]
    assert errors[1] < 1.1 * errors[0]
