"""Cast-shadow visibility by ray marching over the reconstructed depth map.

The depth map is resampled without lens distortion, by nearest neighbours, on a grid that is coarse enough to be fast.
Outside the object, the depth is behind it. A ray's clearance is the least slope at which it passes over the surface.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from acquisition import cast_shadows, geometry, photometry
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.light_plan import Light
from acquisition.models.result import NormalMap

MAP_SIZE = 192
"""Samples of the grid along its longer side."""


@dataclass(frozen=True)
class Surface:
    """Depth map (h, w) in m of a camera with matrix `camera` (3, 3) and no distortion, and the object's least depth."""

    depth: Float32Array
    camera: FloatArray
    nearest: float

    def clearance(self, point: Float32Array, lamp: Float32Array) -> Float32Array:
        """`cast_shadows.clearance` (K, P) of the rays from points (3, P) to lamps (K, 6 or 9)."""
        affine, start = self.camera[[0, 0, 1, 1], [0, 2, 1, 2]], 1.5 / self.camera[0, 0] * self.nearest
        return cast_shadows.clearance(self.depth, affine, point, lamp, self.nearest, start)


def surface(normal_map: NormalMap, calibration: Calibration) -> Surface:
    """Resamples the depth of a normal map, which must have some finite depth."""
    solved = normal_map.mask & (normal_map.depth > 0) & np.isfinite(normal_map.depth)
    rows, columns = photometry.bounding_box(solved)
    top, bottom, left, right = rows.start, rows.stop - 1, columns.start, columns.stop - 1
    corners = rays_at(calibration, np.array([top, top, bottom, bottom]), np.array([left, right] * 2))
    low, high = corners.min(axis=1), corners.max(axis=1)
    pitch = float(np.max(high - low)) / MAP_SIZE
    size, first = np.ceil((high - low) / pitch).astype(int) + 3, low - pitch
    camera = np.array([[1 / pitch, 0, -first[0] / pitch], [0, 1 / pitch, -first[1] / pitch], [0, 0, 1]])
    columns_rows = cv2.initUndistortRectifyMap(
        np.array(calibration.camera_matrix), np.array(calibration.distortion), np.eye(3), camera, size, cv2.CV_32FC1
    )
    nearest, farthest = float(normal_map.depth[solved].min()), float(normal_map.depth[solved].max())
    background = farthest + 0.05
    filled = np.where(solved, normal_map.depth, np.float32(background)).astype(np.float32)
    depth = cv2.remap(filled, *columns_rows, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=background)
    return Surface(np.ascontiguousarray(depth, np.float32), camera, nearest)


def shaded(
    normal_map: NormalMap, lights: Sequence[Light], calibration: Calibration, pixels: tuple[np.ndarray, np.ndarray]
) -> BoolArray:
    """Returns which lights cast a shadow on which pixels (F, K); `pixels` are rows and columns (K,)."""
    rows, columns = pixels
    point = photometry.points(rays_at(calibration, rows, columns), normal_map.depth[rows, columns])
    return surface(normal_map, calibration).clearance(point, photometry.lamps(list(lights))) < 0


def rays_at(calibration: Calibration, rows: np.ndarray, columns: np.ndarray) -> Float32Array:
    """Undistorted rays (2, K) of pixels, X/Z and Y/Z in the OpenCV camera frame."""
    pixels = np.stack([columns, rows], axis=-1)
    rays = geometry.undistorted(pixels, calibration.camera_matrix, calibration.distortion)
    return np.ascontiguousarray(rays.T, dtype=np.float32)
