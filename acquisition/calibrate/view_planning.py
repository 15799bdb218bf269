"""Planning of further views: those of the candidates that lower the covariance of base from camera most (A-optimality).

The lamps of a session are chosen by optimum experimental design, and so are the views of a calibration: a view's Fisher
information depends on the arm's joints and the board's place in the image alone, both known before it is taken. Greedy
choice suffices, because after each view the estimate is made anew.
"""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from acquisition import geometry
from acquisition.calibrate.bundle_adjustment import BASE_FROM_CAMERA, Adjusted, Model, camera_from_board, information
from acquisition.calibrate.charuco import MIN_CORNERS, View
from acquisition.models.base import FloatArray

BORDER_PX = 5.0
"""Distance from the image's border within which a corner does not count as seen."""

LEVER_M = 0.3
"""Length by which rotation counts against translation, m: a rotation of the camera by σ moves a point on the object, so
far below the dome's middle or beside it, by σ times this."""


def loss(covariance: FloatArray) -> float:
    """A-optimality: mean square error, m², by a pose's covariance (6, 6), of its place and of a point LEVER_M away."""
    variance = np.diag(covariance).reshape(2, 3).sum(axis=1)
    return float(variance[0] + LEVER_M**2 * variance[1])


def predicted_view(model: Model, found: Adjusted, joints: FloatArray, size: tuple[int, int]) -> View | None:
    """Corners that a view at joints (6,) will show, by the estimate so far; none where too few are in the image."""
    flat, parameters = model.board.corners_m, found.parameters
    whole = View("candidate", np.arange(len(flat)), np.zeros((len(flat), 2)), joints)
    pose = camera_from_board(model, parameters, whole)
    points = geometry.transform(pose, flat)
    if points[:, 2].min() <= 0 or pose[2, 2] <= 0:
        return None  # behind the camera, or seen from its back
    vector = cv2.Rodrigues(pose[:3, :3])[0]
    projected = cv2.projectPoints(flat, vector, pose[:3, 3], parameters.matrix, parameters.camera[4:])[0]
    pixels = np.asarray(projected, dtype=float).reshape(-1, 2)
    inside = ((pixels > BORDER_PX) & (pixels < np.array(size) - BORDER_PX)).all(axis=1)
    if inside.sum() < MIN_CORNERS:
        return None
    return replace(whole, corners=np.flatnonzero(inside), pixels=pixels[inside])


def next_view(
    model: Model, found: Adjusted, candidates: Sequence[FloatArray], size: tuple[int, int]
) -> tuple[int, float] | None:
    """Number of the candidate joints (6,) whose view lowers `loss` most, and the loss with it, m²; none where no
    candidate would show the board."""
    free = model.free
    present = np.linalg.inv(found.covariance[np.ix_(free, free)])
    best: tuple[int, float] | None = None
    for number, joints in enumerate(candidates):
        view = predicted_view(model, found, joints, size)
        if view is None:
            continue
        more = information(model, view, found)[np.ix_(free, free)]
        covariance = np.zeros_like(found.covariance)
        covariance[np.ix_(free, free)] = np.linalg.inv(present + more)
        value = loss(covariance[BASE_FROM_CAMERA, BASE_FROM_CAMERA])
        if best is None or value < best[1]:
            best = number, value
    return best
