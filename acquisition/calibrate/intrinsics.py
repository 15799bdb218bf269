"""Camera calibration: matrix, distortion and board warp by bundle adjustment from Zhang's start (OpenCV).

A user of a camera model needs its error at a place of the image, not the error of each coefficient: errors of focal
length and distortion, or of principal point and tilt, are correlated and largely cancel. `projection_sigma` gives that
error, without the rotation of the camera that a later hand–eye calibration absorbs.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from acquisition import geometry
from acquisition.calibrate.bundle_adjustment import CAMERA, Adjusted, Model, Parameters, adjust
from acquisition.calibrate.charuco import CharucoBoard, View
from acquisition.models.base import FloatArray
from acquisition.models.errors import ErrorCode, RigError

MIN_VIEWS = 5
"""Least number of views for matrix, five coefficients of distortion and the board's warp."""

MIN_TILT_DEG = 15.0
"""Least spread of the boards' normals, degrees: boards tilted alike do not separate focal length from distance."""


@dataclass(frozen=True)
class CameraFit:
    """A camera calibrated from images of `size` (width, height); the adjustment's own poses are camera from board."""

    size: tuple[int, int]
    adjusted: Adjusted


def fit(board: CharucoBoard, views: Sequence[View], size: tuple[int, int]) -> CameraFit:
    """Calibrates a camera: start by Zhang's method (`cv2.calibrateCamera`), then bundle adjustment of all corners.

    `size`: width and height of the images, pixels. Raises RigError calibration.infeasible for too few views, or views
    all tilted alike.
    """
    if len(views) < MIN_VIEWS:
        raise RigError(
            ErrorCode.CALIBRATION_INFEASIBLE, f"The board is seen in {len(views)} images: {MIN_VIEWS} are needed"
        )
    return CameraFit(size, adjust(Model(board), views, _start(board, views, size), MIN_VIEWS))


def _start(board: CharucoBoard, views: Sequence[View], size: tuple[int, int]) -> Parameters:
    points = [board.corners_m[view.corners].astype(np.float32) for view in views]
    pixels = [view.pixels.astype(np.float32).reshape(-1, 1, 2) for view in views]
    # Without an initial matrix OpenCV needs planar points, and computes one from the homographies.
    _, matrix, distortion, rotations, translations = cv2.calibrateCamera(
        points, pixels, size, np.eye(3), np.zeros(5), flags=cv2.CALIB_FIX_K3
    )
    poses = np.tile(np.eye(4), (len(views), 1, 1))
    for pose, rotation, translation in zip(poses, rotations, translations, strict=True):
        pose[:3, :3], pose[:3, 3] = cv2.Rodrigues(rotation)[0], np.ravel(translation)
    normals = poses[:, :3, 2]
    tilt_deg = np.degrees(np.arccos(np.clip(normals @ normals.T, -1, 1))).max()
    if tilt_deg < MIN_TILT_DEG:
        raise RigError(
            ErrorCode.CALIBRATION_INFEASIBLE,
            f"The board is tilted alike in all images (within {tilt_deg:.0f}°): tilt it by 20–45° to different sides",
        )
    camera = np.concatenate([[matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]], np.ravel(distortion)[:5]])
    return Parameters(camera, poses)


def projection_sigma(found: CameraFit, grid: int = 24) -> FloatArray:
    """1 σ of a direction's place in the image by the camera model (rows, columns), pixels, over a grid.

    The longer side has `grid` samples. The part of the error that a rotation of the camera explains is removed by least
    squares over the grid (after the projection uncertainty of mrcal, Kogan 2021).
    """
    remaining, shape = projection_derivatives(found.adjusted.parameters, found.size, grid)
    return projection_sigma_by(remaining, found.adjusted.covariance[CAMERA, CAMERA]).reshape(shape)


def projection_derivatives(
    parameters: Parameters, size: tuple[int, int], grid: int = 24
) -> tuple[FloatArray, tuple[int, int]]:
    """Derivatives (2K, 9) of K directions' pixels by the camera, rotations removed, and the grid's rows and columns.

    `size`: width and height of the image, pixels.
    """
    width, height = size
    step = max(width, height) / grid
    u, v = np.meshgrid(np.arange(step / 2, width, step), np.arange(step / 2, height, step))
    pixels = np.stack([u.ravel(), v.ravel()], axis=-1)
    rays = geometry.undistorted(pixels, parameters.matrix, parameters.camera[4:])
    points = np.column_stack([rays, np.ones(len(rays))])
    zero = np.zeros(3)
    _, by_all = cv2.projectPoints(points, zero, zero, parameters.matrix, parameters.camera[4:])
    rotation, camera = by_all[:, :3], by_all[:, 6:15]
    return camera - rotation @ np.linalg.lstsq(rotation, camera, rcond=None)[0], u.shape


def projection_sigma_by(derivatives: FloatArray, covariance: FloatArray) -> FloatArray:
    """1 σ (K,) of directions' places, pixels, from the covariance (9, 9) of the camera."""
    variance = np.einsum("ij,jk,ik->i", derivatives, covariance, derivatives).reshape(-1, 2).sum(axis=1)
    return np.sqrt(variance / 2)
