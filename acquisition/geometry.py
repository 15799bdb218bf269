"""Rigid transforms, undistorted rays, and the only conversion between the view frame and OpenCV's camera frame.

A pose `a_from_b` is a 4×4 homogeneous matrix that maps points of frame b to frame a. The photometric-stereo frame
`view` (x right, y up, z to the camera) and OpenCV's `camera` frame (x right, y down, z forward) share their origin.
Converting between them in one module only keeps the signs consistent.
"""

import math
from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

VIEW_FROM_CAMERA: FloatArray = np.diag([1.0, -1.0, -1.0, 1.0])
CAMERA_FROM_VIEW: FloatArray = VIEW_FROM_CAMERA
_SMALL_ANGLE_RAD = 1e-9
"""Rotation angle in rad below which the limits of sin(θ)/θ and (1 − cos θ)/θ² are used."""

UNDISTORTION_CRITERIA = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-6)
"""Largest number of iterations that invert a lens distortion, and error in pixels that ends them. Without criteria,
OpenCV always takes five iterations, which leaves the corners of wide lenses 3 pixels off."""


def pose(position_m: Sequence[float] | FloatArray, rotation_vector_rad: Sequence[float] | FloatArray) -> FloatArray:
    """Rodrigues' formula: (4, 4) pose from a position in m and a rotation vector in rad."""
    x, y, z = (float(value) for value in rotation_vector_rad)
    angle = math.sqrt(x * x + y * y + z * z)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    # Written with sin(θ)/θ and (1 − cos θ)/θ², which have finite limits where the axis is undefined.
    first = math.sin(angle) / angle if angle > _SMALL_ANGLE_RAD else 1.0
    second = 0.5 * (math.sin(angle / 2) / (angle / 2)) ** 2 if angle > _SMALL_ANGLE_RAD else 0.5
    matrix = np.eye(4)
    matrix[:3, :3] += first * cross + second * cross @ cross
    matrix[:3, 3] = position_m
    return matrix


def inverse(matrix: FloatArray) -> FloatArray:
    """Inverse of a rigid transform (4, 4): transposed rotation and rotated negative translation."""
    rotation = matrix[:3, :3].T
    result = np.eye(4)
    result[:3, :3] = rotation
    result[:3, 3] = -rotation @ matrix[:3, 3]
    return result


def transform(matrix: FloatArray, points: npt.ArrayLike) -> FloatArray:
    """Maps points (..., 3) from frame b to frame a by the pose `a_from_b`."""
    return np.asarray(points, dtype=float) @ matrix[:3, :3].T + matrix[:3, 3]


def rotate(matrix: FloatArray, directions: npt.ArrayLike) -> FloatArray:
    """Rotates directions (..., 3) from frame b to frame a by the pose `a_from_b`."""
    return np.asarray(directions, dtype=float) @ matrix[:3, :3].T


def base_from_view(base_from_camera: FloatArray) -> FloatArray:
    """The pose of the photometric-stereo frame in the arm's base frame."""
    return base_from_camera @ CAMERA_FROM_VIEW


def direction(slant_rad: npt.ArrayLike, azimuth_rad: npt.ArrayLike) -> FloatArray:
    """Spherical to Cartesian: unit vectors (..., 3), view frame; slant from +z (the camera), azimuth from +x to +y."""
    slant, azimuth = np.broadcast_arrays(np.asarray(slant_rad, dtype=float), np.asarray(azimuth_rad, dtype=float))
    return np.stack([np.sin(slant) * np.cos(azimuth), np.sin(slant) * np.sin(azimuth), np.cos(slant)], axis=-1)


def slant_azimuth(directions: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Cartesian to spherical: slant in [0, π] and azimuth in (−π, π], rad, of vectors (..., 3) in the view frame."""
    vectors = np.asarray(directions, dtype=float)
    return np.arctan2(np.hypot(vectors[..., 0], vectors[..., 1]), vectors[..., 2]), np.arctan2(
        vectors[..., 1], vectors[..., 0]
    )


def undistorted(pixels: npt.ArrayLike, matrix: npt.ArrayLike, distortion: npt.ArrayLike) -> FloatArray:
    """Rays (N, 2), X/Z and Y/Z in OpenCV's camera frame, through image points (N, 2), pixels, by `undistortPoints`
    until it converges; `matrix` K is (3, 3), `distortion` OpenCV's (5,)."""
    points = np.asarray(pixels, np.float64).reshape(-1, 1, 2)
    rays = cv2.undistortPoints(
        points, np.asarray(matrix, np.float64), np.asarray(distortion, np.float64), criteria=UNDISTORTION_CRITERIA
    )
    return np.asarray(rays, np.float64).reshape(-1, 2)
