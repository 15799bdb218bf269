"""Measures a matt plane in a ChArUco frame: its pose by the frame, and the brightness of its blank middle.

The plane lies still while the lamp moves, so all images of one placing share a pose. Their corners are averaged. The
full residual against the camera model counts as their error, because a still board is misread in the same way every
time.
"""

from collections.abc import Sequence

import cv2
import numpy as np

from acquisition import geometry, image_values
from acquisition.calibrate.charuco import CharucoBoard, View
from acquisition.calibrate.plane_shading import Placing, PlaneImage
from acquisition.models.base import FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.errors import ErrorCode, RigError

PATCHES = (12, 9)
"""Patches along the longer and the shorter side of the blank middle."""

INSET_SQUARES = 0.35
"""Distance from the blank middle's edge to the outer patches' centres, squares: keeps out the print beside it."""

PATCH_SHARE = 0.6
"""Side of the window over which a patch is averaged, relative to the distance between patches."""

CORNER_FLOOR_PX = 0.03
"""Least error of a corner's coordinate, pixels."""

MOVED_PX = 0.5
"""Distance between the corners of two images of one placing above which the plane was moved between them, pixels."""

LEAST_SHARE = 0.02
"""Share of full scale below which a patch is too dark to count."""


def placing(views: Sequence[View], board: CharucoBoard, calibration: Calibration) -> Placing:
    """Estimates the plane's pose from its corners in all images of one placing (`cv2.solvePnP`), with its covariance.

    Raises RigError calibration.infeasible naming an image in which it lies elsewhere.
    """
    first = dict(zip(views[0].corners.tolist(), views[0].pixels, strict=True))
    for view in views[1:]:
        common = [(first[n], pixel) for n, pixel in zip(view.corners.tolist(), view.pixels, strict=True) if n in first]
        if common and np.median([np.linalg.norm(a - b) for a, b in common]) > MOVED_PX:
            raise RigError(
                ErrorCode.CALIBRATION_INFEASIBLE,
                f"{view.name}: the plane is not where it is in {views[0].name}: give this image its own placing",
                image=view.name,
            )
    numbers = np.concatenate([view.corners for view in views])
    pixels = np.concatenate([view.pixels for view in views])
    seen = np.unique(numbers)
    mean = np.stack([pixels[numbers == number].mean(axis=0) for number in seen])
    points = board.corners_m[seen]
    matrix, distortion = np.array(calibration.camera_matrix), np.array(calibration.distortion)
    _, turn, shift = cv2.solvePnP(points, mean.reshape(-1, 1, 2), matrix, distortion)
    pose = geometry.pose(np.ravel(shift).astype(np.float64), np.ravel(turn).astype(np.float64))
    rest = (mean - _project(pose, points, matrix, distortion)).ravel()
    columns = list[FloatArray]()
    for which in range(6):
        step = np.zeros(6)
        step[which] = 1e-6
        moved = [pose @ geometry.pose(sign * step[:3], sign * step[3:]) for sign in (1, -1)]
        ahead, back = (_project(one, points, matrix, distortion).ravel() for one in moved)
        columns.append((ahead - back) / 2e-6)
    jacobian = np.stack(columns, axis=1)
    sigma = max(float(np.sqrt(np.mean(rest**2))), CORNER_FLOOR_PX)
    return Placing(pose, np.asarray(sigma**2 * np.linalg.inv(jacobian.T @ jacobian), np.float64))


def patches(
    name: str, lit: np.ndarray, dark: np.ndarray, exposure_s: float, where: tuple[int, Placing],
    base_from_tool: FloatArray, board: CharucoBoard, calibration: Calibration,
) -> PlaneImage:  # fmt: skip
    """Brightness of the blank middle's patches in an image and its lamp-off frame (H, W), both of `exposure_s`.

    `where`: number and pose of the placing. Clipped and dark patches are left out. Raises RigError
    calibration.infeasible if the board has no blank middle.
    """
    number, placed = where
    points, spacing_m = _grid(board)
    sensor = calibration.sensor
    matrix, distortion = np.array(calibration.camera_matrix), np.array(calibration.distortion)
    pixels = _project(placed.camera_from_board, points, matrix, distortion)
    away = float(placed.camera_from_board[2, 3])
    side = max(1, int(PATCH_SHARE * spacing_m * float(matrix[0, 0]) / away))
    at = pixels.astype(np.float32)[None]
    signal = lit.astype(np.float32) - dark.astype(np.float32)
    mean = cv2.remap(cv2.blur(signal, (side, side)), at[..., 0], at[..., 1], cv2.INTER_LINEAR).ravel().astype(float)
    clipped = (lit >= image_values.clipping_dn(sensor)).astype(np.float32)
    touched = cv2.remap(
        cv2.blur(clipped, (side, side)), at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderValue=[1.0]
    ).ravel()
    inside = ((pixels > side) & (pixels < np.array([calibration.width, calibration.height]) - 1 - side)).all(axis=1)
    good = (touched == 0) & inside & (mean > LEAST_SHARE * sensor.full_scale_dn)
    electrons = np.maximum(mean, 1.0) * sensor.gain_e_per_dn
    noise = np.sqrt(electrons + 2 * sensor.read_noise_e**2) / electrons / side
    values = mean / (sensor.full_scale_dn * exposure_s)
    return PlaneImage(name, number, base_from_tool, points[good], pixels[good], values[good], noise[good])


def _grid(board: CharucoBoard) -> tuple[FloatArray, float]:
    """Returns the patches' centres (N, 3) in the board's frame, m, and the least distance between them."""
    blank = board.blank_m
    if blank is None:
        raise RigError(
            ErrorCode.CALIBRATION_INFEASIBLE,
            "The board has no blank middle: describe the matt plane's frame by border_squares",
        )
    left, upper, right, lower = blank
    inset = INSET_SQUARES * board.square_m
    along, across = PATCHES if right - left >= lower - upper else PATCHES[::-1]
    x = np.linspace(left + inset, right - inset, along)
    y = np.linspace(upper + inset, lower - inset, across)
    u, v = np.meshgrid(x, y)
    return np.stack([u.ravel(), v.ravel(), np.zeros(u.size)], axis=1), float(min(x[1] - x[0], y[1] - y[0]))


def _project(pose: FloatArray, points: FloatArray, matrix: FloatArray, distortion: FloatArray) -> FloatArray:
    zero = np.zeros(3)
    pixels = cv2.projectPoints(geometry.transform(pose, points), zero, zero, matrix, distortion)[0]
    return np.asarray(pixels, dtype=float).reshape(-1, 2)
