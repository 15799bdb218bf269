"""Fused kernels of Lambertian least squares under distant lights, from stored values to normals (Woodham 1980).

Memory bandwidth limits the speed: the stack is read once, in blocks of pixels that stay in the cache, and every
intermediate lives in such a block. Lights are the outer loops and pixels the inner ones, which compilers vectorise; the
obvious order is an order of magnitude slower. Stored integers are converted where they are read. Kernels compile at
import, into numba's cache; the parallel kernel is a thin loop round a serial one, because compiling takes minutes
otherwise.
"""

import numba
import numpy as np

from acquisition.models.base import Float32Array

BLOCK = 4096
"""Pixels of one block, whose intermediates stay in the processor's cache."""

STORED = ("uint16", "float32")
"""Types of stored values that the kernels accept; eight-bit values are widened when they are read."""


def signatures(pattern: str) -> list[str]:
    """Numba signatures of a kernel, one for each stored type in place of `STORED`."""
    return [pattern.replace("STORED", stored) for stored in STORED]


@numba.njit(
    signatures("void(STORED[:,::1], float32[:,::1], float32[:,::1], float32[::1], int64, int64)"),
    cache=True, fastmath=True, error_model="numpy",
)  # fmt: skip
def _least_squares(
    stack: np.ndarray,  # (F, N) stored values
    inverse: Float32Array,  # (3, F) pseudo-inverse of the light vectors per stored value
    normals: Float32Array,  # (3, N) out
    albedo: Float32Array,  # (N,) out
    start: int,
    end: int,
) -> None:
    """The pixels [start, end) of `least_squares`."""
    count = len(stack)
    size = end - start
    gx = np.zeros(size, np.float32)
    gy = np.zeros(size, np.float32)
    gz = np.zeros(size, np.float32)
    nx = normals[0, start:end]
    ny = normals[1, start:end]
    nz = normals[2, start:end]
    rho = albedo[start:end]
    last = count - count % 4
    for f in range(0, last, 4):
        y0 = stack[f, start:end]
        y1 = stack[f + 1, start:end]
        y2 = stack[f + 2, start:end]
        y3 = stack[f + 3, start:end]
        a0, a1, a2, a3 = inverse[0, f], inverse[0, f + 1], inverse[0, f + 2], inverse[0, f + 3]
        b0, b1, b2, b3 = inverse[1, f], inverse[1, f + 1], inverse[1, f + 2], inverse[1, f + 3]
        c0, c1, c2, c3 = inverse[2, f], inverse[2, f + 1], inverse[2, f + 2], inverse[2, f + 3]
        for p in range(size):
            v0 = np.float32(y0[p])
            v1 = np.float32(y1[p])
            v2 = np.float32(y2[p])
            v3 = np.float32(y3[p])
            gx[p] += a0 * v0 + a1 * v1 + a2 * v2 + a3 * v3
            gy[p] += b0 * v0 + b1 * v1 + b2 * v2 + b3 * v3
            gz[p] += c0 * v0 + c1 * v1 + c2 * v2 + c3 * v3
    for f in range(last, count):
        y = stack[f, start:end]
        for p in range(size):
            value = np.float32(y[p])
            gx[p] += inverse[0, f] * value
            gy[p] += inverse[1, f] * value
            gz[p] += inverse[2, f] * value
    for p in range(size):
        squared = gx[p] * gx[p] + gy[p] * gy[p] + gz[p] * gz[p]
        length = np.sqrt(squared)
        scale = np.float32(1.0) / max(length, np.float32(1e-20))
        rho[p] = length
        nx[p] = gx[p] * scale
        ny[p] = gy[p] * scale
        nz[p] = gz[p] * scale


@numba.njit(
    signatures("void(STORED[:,::1], float32[:,::1], float32[:,::1], float32[::1])"),
    cache=True, parallel=True, error_model="numpy",
)  # fmt: skip
def least_squares(
    stack: np.ndarray,  # (F, N) stored values
    inverse: Float32Array,  # (3, F) pseudo-inverse of the light vectors per stored value
    normals: Float32Array,  # (3, N) out
    albedo: Float32Array,  # (N,) out
) -> None:
    """Lambertian least squares of all measurements: g = pseudo-inverse · values, albedo |g|, normal g/|g|."""
    pixels = stack.shape[1]
    for block in numba.prange((pixels + BLOCK - 1) // BLOCK):
        start = block * BLOCK
        _least_squares(stack, inverse, normals, albedo, start, min(start + BLOCK, pixels))


@numba.njit(fastmath=True, error_model="numpy", inline="always")  # a part of its callers, never compiled by itself
def solve3(m: Float32Array, b: Float32Array, g: Float32Array, leverage: Float32Array, size: int) -> None:
    """Solves symmetric 3 × 3 systems m g = b (m: 00 01 02 11 12 22) by LDLᵀ, for `size` pixels side by side.

    `leverage` is the trace of the inverse of m less its part along g.
    """
    one = np.float32(1.0)
    for p in range(size):
        i0 = one / m[0, p]
        l1 = m[1, p] * i0
        l2 = m[2, p] * i0
        i1 = one / (m[3, p] - l1 * m[1, p])
        t = m[4, p] - l2 * m[1, p]
        l3 = t * i1
        i2 = one / (m[5, p] - l2 * m[2, p] - l3 * t)
        u1 = b[1, p] - l1 * b[0, p]
        u2 = b[2, p] - l2 * b[0, p] - l3 * u1
        z = u2 * i2
        y = u1 * i1 - l3 * z
        x = b[0, p] * i0 - l1 * y - l2 * z
        g[0, p] = x
        g[1, p] = y
        g[2, p] = z
        c12 = -l3 * i2
        c02 = (l1 * l3 - l2) * i2
        c11 = i1 - l3 * c12
        c01 = -l1 * i1 - l3 * c02
        c00 = i0 - l1 * c01 - l2 * c02
        inner = c00 * x * x + c11 * y * y + i2 * z * z + 2 * (c01 * x * y + c02 * x * z + c12 * y * z)
        squared = max(x * x + y * y + z * z, np.float32(1e-30))
        leverage[p] = max(c00 + c11 + i2 - inner / squared, np.float32(0.0))


@numba.njit(
    signatures(
        "void(STORED[:,::1], float32[::1], float32[:,::1], float32[::1],"
        " float32[:,::1], float32[::1], float32[::1], float32[::1], uint8[:,::1], int64, int64)"
    ),
    cache=True, fastmath=True, error_model="numpy",
)  # fmt: skip
def _weighted(  # noqa: PLR0915 - one fused kernel is the point
    stack: np.ndarray,  # (F, N) stored values
    scale: Float32Array,  # (F,) value per stored value: divides by full scale and by the light's intensity
    light: Float32Array,  # (F, 3) unit directions
    limits: Float32Array,  # stored value from which clipped; shadow as share of the largest; highlight, share of albedo
    normals: Float32Array,  # (3, N) out
    albedo: Float32Array,  # (N,) out
    leverage: Float32Array,  # (N,) out: trace of the tangential part of (SᵀWS)⁻¹
    spread: Float32Array,  # (N,) out: variance of one measurement, from the residuals
    flags: np.ndarray,  # (F, N) uint8 out: bits of acquisition.models.result
    start: int,
    end: int,
) -> None:
    """The pixels [start, end) of `weighted`."""
    count = len(stack)
    clipped_from, dark, excess = limits[0], limits[1], limits[2]
    zero = np.float32(0.0)
    one = np.float32(1.0)
    half = np.float32(0.5)
    size = end - start
    largest = np.zeros(size, np.float32)
    m = np.zeros((6, size), np.float32)
    b = np.zeros((3, size), np.float32)
    g = np.empty((3, size), np.float32)
    n = np.zeros(size, np.float32)
    total = np.zeros(size, np.float32)
    block_leverage = leverage[start:end]
    for f in range(0, count, 2):
        # Two lights a turn: what is carried from light to light is read and written half as often.
        other = min(f + 1, count - 1)
        y, z = stack[f, start:end], stack[other, start:end]
        k, l = scale[f], scale[other]
        for p in range(size):
            v = np.float32(y[p])
            u = np.float32(z[p])
            one_value = v * k * (one if v < clipped_from else zero)
            other_value = u * l * (one if u < clipped_from else zero)
            most = largest[p]
            most = one_value if one_value > most else most
            largest[p] = other_value if other_value > most else most
    for p in range(size):
        largest[p] = one / max(largest[p] * dark, np.float32(1e-20))
        m[0, p] = m[3, p] = m[5, p] = np.float32(1e-5)
    for f in range(0, count, 2):
        other = min(f + 1, count - 1)
        present = one if f + 1 < count else zero
        y = stack[f, start:end]
        z = stack[other, start:end]
        k, l = scale[f], scale[other]
        sx, sy, sz = light[f, 0], light[f, 1], light[f, 2]
        tx, ty, tz = light[other, 0], light[other, 1], light[other, 2]
        for p in range(size):
            v = np.float32(y[p])
            u = np.float32(z[p])
            w = (one if v < clipped_from else zero) * min(max(v * k * largest[p] - half, zero), one)
            x = (present if u < clipped_from else zero) * min(max(u * l * largest[p] - half, zero), one)
            m[0, p] += w * (sx * sx) + x * (tx * tx)
            m[1, p] += w * (sx * sy) + x * (tx * ty)
            m[2, p] += w * (sx * sz) + x * (tx * tz)
            m[3, p] += w * (sy * sy) + x * (ty * ty)
            m[4, p] += w * (sy * sz) + x * (ty * tz)
            m[5, p] += w * (sz * sz) + x * (tz * tz)
            v *= k
            u *= l
            total[p] += w * v * v + x * u * u
            v *= w
            u *= x
            b[0, p] += v * sx + u * tx
            b[1, p] += v * sy + u * ty
            b[2, p] += v * sz + u * tz
            n[p] += w + x
    solve3(m, b, g, block_leverage, size)
    limit = np.empty(size, np.float32)
    for p in range(size):
        limit[p] = excess * np.sqrt(g[0, p] * g[0, p] + g[1, p] * g[1, p] + g[2, p] * g[2, p])
        limit[p] += np.float32(1e9) if n[p] <= np.float32(4.0) else zero
    highlights = zero
    first = g.copy()
    for f in range(0, count, 2):
        other = min(f + 1, count - 1)
        y, z = stack[f, start:end], stack[other, start:end]
        k, l = scale[f], scale[other]
        sx, sy, sz = light[f, 0], light[f, 1], light[f, 2]
        tx, ty, tz = light[other, 0], light[other, 1], light[other, 2]
        flag, flag_other = flags[f, start:end], flags[other, start:end]
        for p in range(size):
            v = np.float32(y[p])
            u = np.float32(z[p])
            unclipped = one if v < clipped_from else zero
            lit = unclipped * (one if v * k * largest[p] >= one else zero)
            facing = g[0, p] * sx + g[1, p] * sy + g[2, p] * sz
            away = np.float32(2.0) if facing < zero else zero
            over = v * k - facing
            bright = lit * (one if over > limit[p] else zero)
            # 1 lit, 16 highlight, 8 clipped, 4 in shadow, 2 in shadow and turned from the light
            dark = (one - lit) * (np.float32(8.0) - (np.float32(4.0) + away) * unclipped)
            flag[p] = np.uint8(np.int32(lit + np.float32(15.0) * bright + dark))
            highlights += lit * (one if over > half * limit[p] else zero)
            unclipped = one if u < clipped_from else zero
            lit = unclipped * (one if u * l * largest[p] >= one else zero)
            facing = g[0, p] * tx + g[1, p] * ty + g[2, p] * tz
            away = np.float32(2.0) if facing < zero else zero
            over = u * l - facing
            bright = lit * (one if over > limit[p] else zero)
            dark = (one - lit) * (np.float32(8.0) - (np.float32(4.0) + away) * unclipped)
            flag_other[p] = np.uint8(np.int32(lit + np.float32(15.0) * bright + dark))
            highlights += lit * (one if over > half * limit[p] else zero)
    for f in range(count if highlights > zero else 0):
        y = stack[f, start:end]
        sx, sy, sz = light[f, 0], light[f, 1], light[f, 2]
        k = scale[f]
        for p in range(size):
            v = np.float32(y[p]) * k
            facing = first[0, p] * sx + first[1, p] * sy + first[2, p] * sz
            w = (one if y[p] < clipped_from else zero) * min(max(v * largest[p] - half, zero), one)
            w *= min(max((v - facing) / limit[p] - half, zero), one)
            m[0, p] -= w * (sx * sx)
            m[1, p] -= w * (sx * sy)
            m[2, p] -= w * (sx * sz)
            m[3, p] -= w * (sy * sy)
            m[4, p] -= w * (sy * sz)
            m[5, p] -= w * (sz * sz)
            value = w * v
            b[0, p] -= value * sx
            b[1, p] -= value * sy
            b[2, p] -= value * sz
            n[p] -= w
            total[p] -= value * v
    if highlights > zero:
        solve3(m, b, g, block_leverage, size)
    for p in range(size):
        length = np.sqrt(g[0, p] * g[0, p] + g[1, p] * g[1, p] + g[2, p] * g[2, p])
        inverse = one / max(length, np.float32(1e-20))
        normals[0, start + p] = g[0, p] * inverse
        normals[1, start + p] = g[1, p] * inverse
        normals[2, start + p] = g[2, p] * inverse
        albedo[start + p] = length
        # At the solution the residuals' squares sum to Σy² − g·b.
        left = total[p] - (g[0, p] * b[0, p] + g[1, p] * b[1, p] + g[2, p] * b[2, p])
        spread[start + p] = max(left, zero) / max(n[p] - np.float32(3.0), one)


@numba.njit(
    signatures(
        "void(STORED[:,::1], float32[::1], float32[:,::1], float32[::1],"
        " float32[:,::1], float32[::1], float32[::1], float32[::1], uint8[:,::1])"
    ),
    cache=True, parallel=True, error_model="numpy",
)  # fmt: skip
def weighted(
    stack: np.ndarray,  # (F, N) stored values
    scale: Float32Array,  # (F,) value per stored value: divides by full scale and by the light's intensity
    light: Float32Array,  # (F, 3) unit directions
    limits: Float32Array,  # stored value from which clipped; shadow as share of the largest; highlight, share of albedo
    normals: Float32Array,  # (3, N) out
    albedo: Float32Array,  # (N,) out
    leverage: Float32Array,  # (N,) out: trace of the tangential part of (SᵀWS)⁻¹
    spread: Float32Array,  # (N,) out: variance of one measurement, from the residuals
    flags: np.ndarray,  # (F, N) uint8 out: bits of acquisition.models.result
) -> None:
    """Thresholded least squares: omits clipped and shadowed measurements, then highlights, and solves again.

    A measurement is in shadow below a share of the pixel's largest unclipped value, attached where the fitted normal
    faces away from the light, cast else. Highlights exceed the first fit by a share of the albedo; they are left out
    unless fewer than four measurements would remain. Both weights fall linearly from one to zero between half and one
    and a half of the threshold, so that normals have no seam where the set of lights changes.
    """
    pixels = stack.shape[1]
    for block in numba.prange((pixels + BLOCK - 1) // BLOCK):
        start = block * BLOCK
        _weighted(
            stack, scale, light, limits, normals, albedo, leverage, spread, flags, start, min(start + BLOCK, pixels)
        )


KERNELS = (_least_squares, least_squares, _weighted, weighted)
