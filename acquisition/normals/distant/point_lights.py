"""Lambertian least squares under point lights at a given depth map: each pixel with its own directions and distances.

The depth map may be rough: for a flat object a plane will do. Directions are computed inside the kernel, because
storing them would take four times the stack.
"""

import numba
import numpy as np

from acquisition import photometry
from acquisition.models.base import Float32Array
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.result import LIT, SATURATED
from acquisition.normals.distant import solvers
from acquisition.normals.distant.least_squares_kernels import BLOCK, signatures, solve3
from acquisition.normals.distant.pixel_blocks import Block
from acquisition.normals.distant.solvers import Method, SolveResult
from acquisition.normals.image_set import ImageSet, NearLights

CHUNK = 100_000
"""Pixels whose residuals are held at once: each takes some hundred bytes for each light."""


def least_squares(images: ImageSet, depth_m: Float32Array) -> Method:
    """Lambertian least squares of unclipped measurements under near lights, at a depth map (H, W) in m.

    Raises RigError normals.infeasible without a camera or the lamps' positions.
    """
    lights, camera = images.lights, images.camera
    if camera is None or not isinstance(lights, NearLights):
        raise RigError(ErrorCode.NORMALS_INFEASIBLE, "near light needs a calibrated camera and the lamps' positions")
    lamp = np.ascontiguousarray(lights.positions_m, dtype=np.float32)

    def solve(block: Block, chosen: np.ndarray) -> SolveResult:
        rows = slice(block.start, block.stop)
        ray = photometry.camera_rays(camera.matrix, camera.distortion, rows, slice(0, images.width)).reshape(2, -1)
        depth = np.ascontiguousarray(depth_m[rows], dtype=np.float32).reshape(-1)
        count, size = block.stack.shape
        normals, albedo = np.empty((3, size), np.float32), np.empty(size, np.float32)
        limits = np.array([block.clipped_from, 0.0], np.float32)
        near_least_squares(block.stack, block.scale, lamp, ray, depth, limits, normals, albedo)
        spread, leverage = np.empty(len(chosen), np.float32), np.empty(len(chosen), np.float32)
        used, flags = np.empty(len(chosen), np.float32), np.empty((count, len(chosen)), np.uint8)
        for start in range(0, len(chosen), CHUNK):
            part = slice(start, start + CHUNK)
            pixels = chosen[part]
            kept = block.stack[:, pixels] < block.clipped_from
            flags[:, part] = np.where(kept, LIT, SATURATED)
            used[part] = np.count_nonzero(kept, axis=0)
            offsets = lamp[:, :, None] - photometry.points(ray[:, pixels], depth[pixels])[None]
            squared_distance = np.einsum("fcn,fcn->fn", offsets, offsets)
            unit = offsets / np.sqrt(squared_distance)[:, None]
            residual = block.stack[:, pixels] * block.scale[:, None] * squared_distance
            residual -= np.einsum("fcn,cn->fn", unit, normals[:, pixels] * albedo[pixels])
            spread[part] = np.sum(kept * residual * residual, axis=0) / np.maximum(used[part] - 3, 1)
            matrix = np.einsum("fn,fan,fbn->nab", kept, unit, unit, optimize=True)
            inverse = np.linalg.inv(matrix + np.float32(1e-5) * np.eye(3, dtype=np.float32))
            along_normal = np.einsum("an,nab,bn->n", normals[:, pixels], inverse, normals[:, pixels], optimize=True)
            leverage[part] = np.trace(inverse, axis1=1, axis2=2) - along_normal
        variance = solvers.angular_variance(spread, leverage, albedo[chosen], used)
        return SolveResult(normals[:, chosen], albedo[chosen], variance, np.sqrt(spread), flags)

    return solve


@numba.njit(
    signatures(
        "void(STORED[:,::1], float32[::1], float32[:,::1], float32[:,::1], float32[::1], float32[::1],"
        " float32[:,::1], float32[::1], int64, int64)"
    ),
    cache=True, fastmath=True, error_model="numpy",
)  # fmt: skip
def _near_least_squares(  # noqa: PLR0915
    stack: np.ndarray,  # (F, N) stored values
    scale: Float32Array,  # (F,) albedo per stored value at 1 m: 1 / (full scale · intensity · reference²)
    lamp: Float32Array,  # (F, 3) m, view frame
    ray: Float32Array,  # (2, N) X/Z and Y/Z in OpenCV's camera frame
    depth: Float32Array,  # (N,) m along OpenCV's z
    limits: Float32Array,  # stored value from which clipped; shadow as share of the largest
    normals: Float32Array,  # (3, N) out, view frame
    albedo: Float32Array,  # (N,) out
    start: int,
    end: int,
) -> None:
    """The pixels [start, end) of `near_least_squares`."""
    count = len(stack)
    clipped_from, dark = limits[0], limits[1]
    zero = np.float32(0.0)
    one = np.float32(1.0)
    size = end - start
    x = np.empty(size, np.float32)
    y = np.empty(size, np.float32)
    largest = np.zeros(size, np.float32)
    m = np.zeros((6, size), np.float32)
    b = np.zeros((3, size), np.float32)
    g = np.empty((3, size), np.float32)
    loose = np.empty(size, np.float32)
    far = depth[start:end]
    for p in range(size):
        x[p] = ray[0, start + p] * far[p]
        y[p] = -ray[1, start + p] * far[p]
        m[0, p] = m[3, p] = m[5, p] = np.float32(1e-5)
    for f in range(count):
        value = stack[f, start:end]
        lx, ly, lz = lamp[f, 0], lamp[f, 1], lamp[f, 2]
        k = scale[f]
        for p in range(size):
            dx = lx - x[p]
            dy = ly - y[p]
            dz = lz + far[p]
            v = np.float32(value[p])
            normalised = v * k * (dx * dx + dy * dy + dz * dz)
            largest[p] = max(largest[p], normalised if v < clipped_from else zero)
    for f in range(count):
        value = stack[f, start:end]
        lx, ly, lz = lamp[f, 0], lamp[f, 1], lamp[f, 2]
        k = scale[f]
        for p in range(size):
            dx = lx - x[p]
            dy = ly - y[p]
            dz = lz + far[p]
            r2 = dx * dx + dy * dy + dz * dz
            inverse = one / np.sqrt(r2)
            v = np.float32(value[p])
            normalised = v * k * r2
            w = (one if v < clipped_from else zero) * (one if normalised >= dark * largest[p] else zero)
            dx *= inverse
            dy *= inverse
            dz *= inverse
            wx = w * dx
            wy = w * dy
            m[0, p] += wx * dx
            m[1, p] += wx * dy
            m[2, p] += wx * dz
            m[3, p] += wy * dy
            m[4, p] += wy * dz
            m[5, p] += w * dz * dz
            normalised *= w
            b[0, p] += normalised * dx
            b[1, p] += normalised * dy
            b[2, p] += normalised * dz
    solve3(m, b, g, loose, size)
    for p in range(size):
        length = np.sqrt(g[0, p] * g[0, p] + g[1, p] * g[1, p] + g[2, p] * g[2, p])
        inverse = one / max(length, np.float32(1e-20))
        normals[0, start + p] = g[0, p] * inverse
        normals[1, start + p] = g[1, p] * inverse
        normals[2, start + p] = g[2, p] * inverse
        albedo[start + p] = length


@numba.njit(
    signatures(
        "void(STORED[:,::1], float32[::1], float32[:,::1], float32[:,::1], float32[::1], float32[::1],"
        " float32[:,::1], float32[::1])"
    ),
    cache=True, parallel=True, error_model="numpy",
)  # fmt: skip
def near_least_squares(
    stack: np.ndarray,  # (F, N) stored values
    scale: Float32Array,  # (F,) albedo per stored value at 1 m: 1 / (full scale · intensity · reference²)
    lamp: Float32Array,  # (F, 3) m, view frame
    ray: Float32Array,  # (2, N) X/Z and Y/Z in OpenCV's camera frame
    depth: Float32Array,  # (N,) m along OpenCV's z
    limits: Float32Array,  # stored value from which clipped; shadow as share of the largest
    normals: Float32Array,  # (3, N) out, view frame
    albedo: Float32Array,  # (N,) out
) -> None:
    """Lambertian least squares under point lights with 1/r² falloff, without clipped and shadowed measurements."""
    pixels = stack.shape[1]
    for block in numba.prange((pixels + BLOCK - 1) // BLOCK):
        start = block * BLOCK
        _near_least_squares(stack, scale, lamp, ray, depth, limits, normals, albedo, start, min(start + BLOCK, pixels))


KERNELS = (_near_least_squares, near_least_squares)
