"""The planner's two hot loops: scanning candidates, and marching shadow rays over a depth map.

Kernels compile at import, into numba's cache.
"""

import numba
import numpy as np

from acquisition.types import Float32Array


@numba.njit(
    "void(float32[:,:,::1], float32[:,::1], float32[:,:,::1], float32[:,::1], float32[:,::1], float32[::1],"
    " float32[::1], float64, float64[::1])",
    cache=True,
    parallel=True,
    fastmath=True,
    error_model="numpy",
)
def scan(
    covariance: Float32Array,  # (S, 10, P): 00 01 02 03 11 12 13 22 23 33
    variance: Float32Array,  # (S, P) rad²
    row: Float32Array,  # (K, 4, P)
    visibility: Float32Array,  # (K, P)
    normal: Float32Array,  # (3, P)
    inverse_albedo2: Float32Array,  # (P,)
    level: Float32Array,  # (S,)
    cap: float,  # rad²
    out: np.ndarray,  # (K,) mean capped variance after adding the candidate
) -> None:
    """What the objective would be with each candidate added."""
    scenarios, pixels = variance.shape
    one = np.float32(1.0)
    inverse_cap = np.float32(1.0 / cap)
    for k in numba.prange(row.shape[0]):
        total = 0.0
        for s in range(scenarios):
            part = np.float32(0.0)
            u = level[s]
            for p in range(pixels):
                a0 = row[k, 0, p]
                a1 = row[k, 1, p]
                a2 = row[k, 2, p]
                a3 = row[k, 3, p]
                c01 = covariance[s, 1, p]
                c02 = covariance[s, 2, p]
                c03 = covariance[s, 3, p]
                c12 = covariance[s, 5, p]
                c13 = covariance[s, 6, p]
                c23 = covariance[s, 8, p]
                u0 = covariance[s, 0, p] * a0 + c01 * a1 + c02 * a2 + c03 * a3
                u1 = c01 * a0 + covariance[s, 4, p] * a1 + c12 * a2 + c13 * a3
                u2 = c02 * a0 + c12 * a1 + covariance[s, 7, p] * a2 + c23 * a3
                u3 = c03 * a0 + c13 * a1 + c23 * a2 + covariance[s, 9, p] * a3
                along = normal[0, p] * u0 + normal[1, p] * u1 + normal[2, p] * u2
                gain = (u0 * u0 + u1 * u1 + u2 * u2 - along * along) * inverse_albedo2[p]
                gain /= one + a0 * u0 + a1 * u1 + a2 * u2 + a3 * u3
                v = variance[s, p] - (gain if visibility[k, p] > u else np.float32(0.0))
                part += v / (one + v * inverse_cap)
            total += part
        out[k] = total / (scenarios * pixels)


@numba.njit(
    "void(float32[:,::1], float64, float64, float64, float32[:,::1], float32[:,::1], float64, float64, float32[:,::1])",
    cache=True,
    parallel=True,
    error_model="numpy",
)
def clearance(
    depth: Float32Array,  # (h, w) m on a grid of undistorted rays; far where there is no object
    ray_x: float,  # ray of the grid's first column
    ray_y: float,  # and row, OpenCV camera frame
    pitch: float,  # step of the grid in rays
    point: Float32Array,  # (3, P) m, OpenCV camera frame
    lamp: Float32Array,  # (K, 3)
    nearest: float,  # m, the object's least depth
    start: float,  # m, where a march begins
    out: Float32Array,  # (K, P)
) -> None:
    """Least slope by which the light's ray clears the surface: clearance in depth over distance gone sideways."""
    height, width = depth.shape
    for k in numba.prange(lamp.shape[0]):
        for p in range(point.shape[1]):
            x, y, z = point[0, p], point[1, p], point[2, p]
            dx, dy, dz = lamp[k, 0] - x, lamp[k, 1] - y, lamp[k, 2] - z
            sideways = np.sqrt(dx * dx + dy * dy)
            least = np.float32(10.0)
            if sideways > 1e-6 and dz < 0.0:
                step = pitch * z / sideways
                t = start / sideways
                while t < 1.0:
                    pz = z + t * dz
                    if pz < nearest:
                        break
                    column = ((x + t * dx) / pz - ray_x) / pitch
                    row = ((y + t * dy) / pz - ray_y) / pitch
                    if column < 0.0 or row < 0.0 or column >= width - 1 or row >= height - 1:
                        break
                    i, j = int(row), int(column)
                    fi, fj = row - i, column - j
                    surface = (1 - fi) * ((1 - fj) * depth[i, j] + fj * depth[i, j + 1]) + fi * (
                        (1 - fj) * depth[i + 1, j] + fj * depth[i + 1, j + 1]
                    )
                    slope = np.float32((surface - pz) / (t * sideways))
                    least = min(least, slope)
                    t += step
            elif dz >= 0.0:
                least = np.float32(-10.0)
            out[k, p] = least


KERNELS = (scan, clearance)
