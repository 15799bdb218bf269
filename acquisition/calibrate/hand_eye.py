"""Hand–eye calibration: base from camera, with the board on the flange and the camera fixed in the cell.

The closed form of Park and Martin (1994) on the views' poses starts a bundle adjustment of all corners, in which
intrinsics, the board's pose and scale and the joint offsets are unknown as well. The arm's deviations from its
kinematic model are estimated from the views, so that the covariance of base from camera is that with the real arm, not
with a perfect one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from acquisition import geometry
from acquisition.calibrate.bundle_adjustment import (
    BASE_FROM_CAMERA,
    SCALE,
    SCALE_SIGMA,
    Adjusted,
    Model,
    adjust,
)
from acquisition.calibrate.charuco import CharucoBoard, View
from acquisition.calibrate.intrinsics import CameraFit
from acquisition.models.base import FloatArray
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.rounding import percent
from acquisition.waypoints import calibrated_kinematics

MIN_VIEWS = 6
"""Least number of views, for two poses, four joint offsets and the deviations of the arm."""

MIN_TURN_DEG = 20.0
"""Least rotation of the flange about a second axis between views, degrees: rotations about one axis alone do not
determine the camera's place along it."""

MAX_ARM_SIGMA_M = 0.001
"""Deviation of the arm from its chain, m, above which something moved that should not (the board on the flange, the
camera, the arm's own mount) or joints do not belong to their image. An arm with nominal kinematics stays below half a
millimetre."""

MAX_SCALE = 0.005
"""Relative deviation of the squares from their stated side above which the side counts as wrongly measured."""


@dataclass(frozen=True)
class HandEyeFit:
    """A hand–eye calibration: the adjustment, whose own poses are the arm's deviations."""

    adjusted: Adjusted

    @property
    def base_from_camera(self) -> FloatArray:
        """Pose (4, 4) of the camera in the arm's base frame."""
        return self.adjusted.parameters.base_from_camera

    @property
    def covariance(self) -> FloatArray:
        """Covariance (6, 6) of translation, m, and rotation vector, rad, in the camera's frame."""
        return self.adjusted.covariance[BASE_FROM_CAMERA, BASE_FROM_CAMERA]

    @property
    def furthest(self) -> str | None:
        """Name of the view in which the arm deviates most from its chain, if it deviates by more than
        `MAX_ARM_SIGMA_M` over all views."""
        if self.adjusted.arm_sigma[0] <= MAX_ARM_SIGMA_M:
            return None
        deviations = np.linalg.norm(self.adjusted.parameters.own[:, :3, 3], axis=1)
        return self.adjusted.views[int(np.argmax(deviations))].name

    @property
    def sigma(self) -> tuple[float, float]:
        """1 σ of the camera's place, m, and of its rotation, rad: roots of the traces of their covariances."""
        variance = np.diag(self.covariance).reshape(2, 3).sum(axis=1)
        return float(np.sqrt(variance[0])), float(np.sqrt(variance[1]))


def fit(board: CharucoBoard, chain: FloatArray, views: Sequence[View], camera: CameraFit) -> HandEyeFit:
    """Calibrates base from camera: start by Park and Martin's closed form, then bundle adjustment of all corners.

    `chain` (6, 4) is the arm's, nominal or factory (`calibrated_kinematics.chain`); `camera` is a calibration that
    contains the views, matched by name. Raises RigError calibration.infeasible for too few views or a flange that turns
    about one axis only, calibration.board_wrong for a wrong side of the squares.
    """
    if any(view.joints is None for view in views):
        raise RigError(ErrorCode.CALIBRATION_INFEASIBLE, "The arm's joints must be stated for every image")
    own = dict(zip((view.name for view in camera.adjusted.views), camera.adjusted.parameters.own, strict=True))
    views = [view for view in views if view.name in own]  # the camera's calibration leaves out misread views
    if len(views) < MIN_VIEWS:
        raise RigError(
            ErrorCode.CALIBRATION_INFEASIBLE, f"{len(views)} views of the board on the flange: {MIN_VIEWS} are needed"
        )
    base_from_flange = calibrated_kinematics.forward(chain, np.array([view.joints for view in views]))[:, 6]
    camera_from_board = np.stack([own[view.name] for view in views])
    base_from_camera = park(base_from_flange, camera_from_board)
    start = replace(
        camera.adjusted.parameters,
        own=np.tile(np.eye(4), (len(views), 1, 1)),
        base_from_camera=base_from_camera,
        flange_from_board=_mean([
            geometry.inverse(flange) @ base_from_camera @ board
            for flange, board in zip(base_from_flange, camera_from_board, strict=True)
        ]),
    )  # fmt: skip
    found = adjust(Model(board, chain), views, start, MIN_VIEWS)
    _require_scale(found)
    return HandEyeFit(found)


def park(base_from_flange: FloatArray, camera_from_board: FloatArray) -> FloatArray:
    """Closed form of AX = XB (Park and Martin 1994): base from camera (4, 4) from poses (V, 4, 4).

    Uses the motions between all pairs of views. Raises RigError calibration.infeasible if the flange turns about one
    axis only.
    """
    pairs = [(i, j) for i in range(len(base_from_flange)) for j in range(i)]
    arm = [base_from_flange[i] @ geometry.inverse(base_from_flange[j]) for i, j in pairs]
    seen = [camera_from_board[i] @ geometry.inverse(camera_from_board[j]) for i, j in pairs]
    arm_turns = np.stack([Rotation.from_matrix(one[:3, :3]).as_rotvec() for one in arm])
    seen_turns = np.stack([Rotation.from_matrix(one[:3, :3]).as_rotvec() for one in seen])
    spread = np.linalg.svd(arm_turns, compute_uv=False) / np.sqrt(len(pairs))
    if np.degrees(spread[1]) < MIN_TURN_DEG / 2:
        raise RigError(
            ErrorCode.CALIBRATION_INFEASIBLE,
            "Between the views the flange turns about one axis only: turn the board about two axes, by at least 20°",
        )
    rotation = Rotation.align_vectors(arm_turns, seen_turns)[0].as_matrix()
    rows = np.concatenate([one[:3, :3] - np.eye(3) for one in arm])
    sides = np.concatenate([rotation @ b[:3, 3] - a[:3, 3] for a, b in zip(arm, seen, strict=True)])
    made = np.eye(4)
    made[:3, :3], made[:3, 3] = rotation, np.linalg.lstsq(rows, sides, rcond=None)[0]
    return made


def _mean(poses: Sequence[FloatArray]) -> FloatArray:
    """Mean of poses (4, 4): of their places, and of their rotations by quaternions."""
    made = np.eye(4)
    made[:3, 3] = np.mean([pose[:3, 3] for pose in poses], axis=0)
    made[:3, :3] = Rotation.from_matrix(np.stack([pose[:3, :3] for pose in poses])).mean().as_matrix()
    return made


def _require_scale(found: Adjusted) -> None:
    """Refuses a board whose squares, by the arm's motions, do not have the stated side."""
    scale, sigma = found.parameters.scale, float(found.sigma(SCALE))
    # The prior shrinks the estimate by the share of its variance that is left; undone, the arm's motions alone decide.
    larger = scale / max(1 - (sigma / SCALE_SIGMA) ** 2, 0.05)
    if abs(larger) > MAX_SCALE:
        raise RigError(
            ErrorCode.CALIBRATION_BOARD_WRONG,
            f"By the arm's motions the squares are {percent(abs(larger))} {'larger' if larger > 0 else 'smaller'} than "
            "stated: measure their side",
        )
