"""Calibration check with views of the board on the flange: does the calibration hold, and what has moved if not?

The adjustment of the calibration in use (`basis.json`) predicts each corner, with a covariance over camera, its place,
the board's place and the joints, correlations included: even if the place is known to 0.2 mm only, corners are
predicted to hundredths of a pixel at the poses of its calibration. Views add their corners' noise and the arm's
deviation.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from acquisition.calibrate import bundle_adjustment, change_test, stated_values
from acquisition.calibrate.board_results import AdjustmentRecord
from acquisition.calibrate.bundle_adjustment import (
    BASE_FROM_CAMERA,
    CAMERA,
    FLANGE_FROM_BOARD,
    JOINT_OFFSETS,
    Adjusted,
    Model,
)
from acquisition.calibrate.change_test import ChangeTest, Group, GroupTest
from acquisition.calibrate.charuco import View
from acquisition.models.calibration import Calibration
from acquisition.models.errors import ErrorCode, RigError

CAMERA_PLACE, BOARD_PLACE, JOINTS, LENS = "camera", "board", "joints", "lens"

GROUPS = (
    Group(CAMERA_PLACE, tuple(range(BASE_FROM_CAMERA.start, BASE_FROM_CAMERA.stop))),
    Group(BOARD_PLACE, tuple(range(FLANGE_FROM_BOARD.start, FLANGE_FROM_BOARD.stop))),
    Group(JOINTS, tuple(range(JOINT_OFFSETS.start, JOINT_OFFSETS.stop))),
    Group(LENS, tuple(range(CAMERA.start, CAMERA.start + 4))),
)
"""What can change: the camera's place in the base frame, the board on the flange, the joint offsets, and the lens
(focal length and principal point)."""

LEAST_VIEWS = 4
"""Number of views from which camera, board and joints can be distinguished."""


@dataclass(frozen=True)
class BoardCheck:
    """The tests and, in the order of the views, the rms distance of each view's corners from the prediction, px."""

    found: ChangeTest
    residuals_px: tuple[float, ...]


def stated(set_folder: Path | None, calibration: Calibration) -> Adjusted:
    """Reads the adjustment on which the calibration in use rests, from the folder of its set.

    Raises RigError calibration.infeasible if there is none or if it does not belong to these values, store.corrupt.
    """
    return stated_values.adjustment(set_folder, calibration, AdjustmentRecord).adjusted


def check(model: Model, views: Sequence[View], known: Adjusted) -> BoardCheck:
    """Tests new views against the adjustment `known`. Raises RigError calibration.infeasible with too few views."""
    if len(views) < LEAST_VIEWS:
        raise RigError(
            ErrorCode.CALIBRATION_INFEASIBLE,
            f"The board is seen in {len(views)} views, and {LEAST_VIEWS} are needed: is it lit, and is it the board "
            "of the cell file?",
        )
    count = len(known.covariance)
    information, gradient = np.zeros((count, count)), np.zeros(count)
    residuals: list[float] = []
    for view in views:
        seen = bundle_adjustment.seen_by(model, view, known)
        residuals.append(float(np.sqrt(2 * np.mean(seen.residual**2))))
        information, gradient = information + seen.information, gradient + seen.gradient
    return BoardCheck(change_test.find_changes(information, gradient, known.covariance, GROUPS), tuple(residuals))


def sentence(test: GroupTest) -> str:
    """Describes a group's change, for people."""
    name, change = test.group.name, test.change
    if name == JOINTS:
        return f"the joint offsets changed by up to {math.degrees(float(np.abs(change).max())):.3f}°"
    if name == LENS:
        return (
            f"focal length changed by {float(change[:2].mean()):.2f} px and principal point by "
            f"{float(np.linalg.norm(change[2:])):.2f} px"
        )
    moved_mm, turned_deg = 1e3 * float(np.linalg.norm(change[:3])), math.degrees(float(np.linalg.norm(change[3:])))
    whose = "the camera's place in the arm's base frame" if name == CAMERA_PLACE else "the board's place on the flange"
    return f"{whose}, by {moved_mm:.2f} mm and {turned_deg:.3f}°"
