"""A flash in one image: its intensity tells, though the images together do not fit badly, and scaling is no cure."""

import numpy as np

from tests.unseen import faults, patterns, run, scenes
from tests.unseen.captures import capture

PIXELS = 48


def test_solve_flash_in_one_image_leaves_it_out() -> None:
    scene = scenes.scene("sheet", 62, "lambert", PIXELS)
    positions = patterns.fixed("two-rings", scene, 10, 0, 1)
    sound, lit = (run.solve(scene, capture(scene, positions, fault=faults.named(name))) for name in ("", "one-flash"))
    assert not sound.findings
    assert [(finding.kind, finding.corrected) for finding in lit.findings] == [
        ("intensities", True),
        ("bad image", True),
    ]
    graded = scene.truth.within_78_deg & sound.mask & lit.mask
    errors = [np.mean(scene.truth.error_deg(solved.normals)[graded]) for solved in (sound, lit)]
    assert errors[1] < 1.3 * errors[0]
