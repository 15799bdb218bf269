"""Plans further views: the candidates that lower the covariance of base from camera most (A-optimality).

A session's lights are chosen by optimum experimental design, and so are the views of a calibration: a view's Fisher
information depends only on the arm's joints and the board's place in the image, both known before the view is taken.
Greedy choice suffices, because the estimate is repeated after each view.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import cv2
import numpy as np

from acquisition import geometry
from acquisition.calibrate.bundle_adjustment import BASE_FROM_CAMERA, Adjusted, Model, camera_from_board, information
from acquisition.calibrate.charuco import MIN_CORNERS, View
from acquisition.models.base import FloatArray

BORDER_PX = 5.0
"""Distance from the image's border, pixels, within which a corner does not count as seen."""

LEVER_M = 0.3
"""Length that weights rotation against translation, m: a rotation of the camera by σ moves a point on the object, this
far below the dome's middle or beside it, by σ times this length."""


def loss(covariance: FloatArray) -> float:
    """A-optimality: mean square error, m², of a place and of a point LEVER_M away, from a pose's covariance (6, 6)."""
    variance = np.diag(covariance).reshape(2, 3).sum(axis=1)
    return float(variance[0] + LEVER_M**2 * variance[1])


def predicted_view(model: Model, found: Adjusted, joints: FloatArray, size: tuple[int, int]) -> View | None:
    """Predicts the corners that a view at joints (6,) will show, by the present estimate; None if too few."""
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
    """Chooses the candidate joints (6,) whose view lowers `loss` most: number, and the loss with it, m²; None if no
    candidate would show the board."""
    chosen = plan_views(model, found, candidates, size, 1, pose_loss)
    return chosen[0] if chosen else None


def pose_loss(covariance: FloatArray) -> float:
    """Returns `loss` of base from camera, m², from the covariance (29, 29) of all parameters."""
    return loss(covariance[BASE_FROM_CAMERA, BASE_FROM_CAMERA])


def plan_views(
    model: Model, found: Adjusted, candidates: Sequence[FloatArray], size: tuple[int, int], count: int,
    criterion: Callable[[FloatArray], float],
) -> list[tuple[int, float]]:  # fmt: skip
    """Greedy design of at most `count` further views: numbers of candidate joints (6,), and the criterion with each.

    `criterion` is a function of the covariance (29, 29). Returns fewer if no other candidate would show the board.
    """
    free = np.ix_(model.free, model.free)
    present = np.linalg.inv(found.covariance[free])
    gains = {
        number: information(model, view, found)[free]
        for number, joints in enumerate(candidates)
        if (view := predicted_view(model, found, joints, size)) is not None
    }
    chosen: list[tuple[int, float]] = []
    covariance = np.zeros_like(found.covariance)
    while gains and len(chosen) < count:
        losses: dict[int, float] = {}
        for number, gain in gains.items():
            covariance[free] = np.linalg.inv(present + gain)
            losses[number] = criterion(covariance)
        best = min(losses, key=losses.__getitem__)
        chosen.append((best, losses[best]))
        present = present + gains.pop(best)
    return chosen
