"""Where the object can be in the image: the keep-out cylinder and the table as the camera sees them.

Lives below the stages because two of them ask: capture checks a frame's exposure there, normals look for the object's
silhouette there and start from the depth of the middle of the cylinder.
"""

import cv2
import numpy as np

from acquisition import geometry
from acquisition.config import CellConfig
from acquisition.types import BoolArray, Calibration, Float32Array

_CIRCLE_POINTS = 96


def keep_out(cell: CellConfig, calibration: Calibration) -> BoolArray:
    """The pixels (H, W) that see into the keep-out cylinder, by the calibrated camera with its distortion."""
    cylinder = cell.object.keep_out
    around = np.linspace(0, 2 * np.pi, _CIRCLE_POINTS, endpoint=False)
    circle = np.stack([cylinder.radius_m * np.cos(around), cylinder.radius_m * np.sin(around)], axis=-1)
    points = np.concatenate(
        [np.column_stack([circle, np.full(len(circle), height)]) for height in (0.0, cylinder.height_m)]
    )
    base_points = geometry.transform(cylinder.base_from_object.matrix, points)
    camera_points = geometry.transform(geometry.inverse(np.array(calibration.base_from_camera)), base_points)
    pixels, _ = cv2.projectPoints(
        camera_points,
        np.zeros(3),
        np.zeros(3),
        np.array(calibration.camera_matrix),
        np.array(calibration.distortion),
    )
    # The outline of a convex body is convex but for the distortion, which the eighth of a pixel of `shift` outlives.
    outline = cv2.convexHull(np.round(pixels[:, 0] * 8).astype(np.int32))
    image = np.zeros((calibration.height, calibration.width), np.uint8)
    cv2.fillConvexPoly(image, outline, 1, shift=3)
    return image.astype(np.bool_)


def middle_depth_m(cell: CellConfig, calibration: Calibration) -> float:
    """Depth along the camera's z of the keep-out cylinder's centre: a first guess of where the object's surface is."""
    cylinder = cell.object.keep_out
    center = geometry.transform(cylinder.base_from_object.matrix, [0.0, 0.0, cylinder.height_m / 2])
    return float(geometry.transform(geometry.inverse(np.array(calibration.base_from_camera)), center)[2])


def table_depth_m(cell: CellConfig, calibration: Calibration) -> Float32Array:
    """Depth (H, W) along the camera's z of the cell's table; infinite where a pixel looks past it."""
    camera_from_base = geometry.inverse(np.array(calibration.base_from_camera))
    point = geometry.transform(camera_from_base, cell.table.point_m)
    normal = geometry.rotate(camera_from_base, cell.table.normal)
    rows, columns = np.mgrid[0 : calibration.height, 0 : calibration.width].astype(float)
    ray = cv2.undistortPoints(
        np.stack([columns, rows], axis=-1).reshape(-1, 1, 2),
        np.array(calibration.camera_matrix),
        np.array(calibration.distortion),
    ).reshape(*rows.shape, 2)
    falling = ray @ normal[:2] + normal[2]
    depth = np.full(falling.shape, np.inf)
    np.divide(normal @ point, falling, out=depth, where=falling * (normal @ point) > 0)
    return depth.astype(np.float32)
