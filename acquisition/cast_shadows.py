"""Cast shadows over a depth map: how far the rays from points to lamps clear the surface, by ray marching.

The kernel compiles at import, into numba's cache.
"""

import numba
import numpy as np

from acquisition.geometry import VIEW_FROM_CAMERA
from acquisition.models.base import Float32Array, FloatArray

HIDDEN = -2.0
"""Slope of clearance below which a ray is in shadow whatever the uncertainty of the shape. The march ends there."""


def clearance(
    depth: Float32Array, affine: FloatArray, point: Float32Array, lamp: Float32Array, nearest: float, start: float
) -> Float32Array:
    """Ray marching over a depth map (h, w) in m: least slope of clearance (K, P) of the rays from points (3, P) to
    lamps (K, 3 or more), both in m, view frame.

    `affine` (4,) has factor and offset that take rays in the OpenCV camera frame to columns, then to rows. `nearest` is
    the least depth of the object, `start` the lateral distance at which marches begin, both in m.
    """
    sign = np.diag(VIEW_FROM_CAMERA)[:3].astype(np.float32)
    out = np.empty((len(lamp), point.shape[1]), np.float32)
    _march(
        depth, affine, np.ascontiguousarray(point * sign[:, None]), np.ascontiguousarray(lamp[:, :3] * sign), nearest,
        start, out,
    )  # fmt: skip
    return out


@numba.njit(
    "void(float32[:,::1], float64[::1], float32[:,::1], float32[:,::1], float64, float64, float32[:,::1])",
    cache=True,
    parallel=True,
    error_model="numpy",
)
def _march(
    depth: Float32Array,  # (h, w) m on a grid of undistorted rays; far where there is no object
    affine: FloatArray,  # (4,) column and row as factor and offset of the rays, OpenCV camera frame
    point: Float32Array,  # (3, P) m, OpenCV camera frame
    lamp: Float32Array,  # (K, 3)
    nearest: float,  # m, the object's least depth
    start: float,  # m, where a march begins
    out: Float32Array,  # (K, P)
) -> None:
    """Least slope of clearance of each ray: depth above the surface over lateral distance. Rays certainly in shadow get
    some slope below HIDDEN, rays to lamps no nearer to the camera than the point −10."""
    height, width = depth.shape
    for k in numba.prange(lamp.shape[0]):
        for p in range(point.shape[1]):
            x, y, z = point[0, p], point[1, p], point[2, p]
            dx, dy, dz = lamp[k, 0] - x, lamp[k, 1] - y, lamp[k, 2] - z
            sideways = np.sqrt(dx * dx + dy * dy)
            least = 10.0
            if sideways > 1e-6 and dz < 0.0:
                step = z / (affine[0] * sideways)
                t = start / sideways
                while t < 1.0:
                    pz = z + t * dz
                    if pz < nearest:
                        break
                    column = (x + t * dx) / pz * affine[0] + affine[1]
                    row = (y + t * dy) / pz * affine[2] + affine[3]
                    if column < 0.0 or row < 0.0 or column >= width - 1 or row >= height - 1:
                        break
                    i, j = int(row), int(column)
                    fi, fj = row - i, column - j
                    surface = (1 - fi) * ((1 - fj) * depth[i, j] + fj * depth[i, j + 1]) + fi * (
                        (1 - fj) * depth[i + 1, j] + fj * depth[i + 1, j + 1]
                    )
                    least = min(least, (surface - pz) / (t * sideways))
                    if least < HIDDEN:
                        break
                    t += step
            elif dz >= 0.0:
                least = -10.0
            out[k, p] = least


KERNELS = (_march,)
