"""The fused kernel of the solver: robust weighted least squares of normal, albedo and depth offset for every pixel.

State of a pixel: g = albedo × normal (3) and a depth offset ζ in units of its prior σ_z. Image i gives the row
(s_i + z ∂s_i/∂Z, σ_z g·∂s_i/∂Z), so that light which would need another depth to be explained does not bend the normal.
Rounds are Gauss–Newton steps and Cauchy reweighting at once. A tiny σ_z switches the depth offset off.

Pixels are the inner loops and images the outer ones, in blocks that stay in the cache: compilers vectorise that, and it
is an order of magnitude faster than the obvious order. Kernels compile at import, into numba's cache.
"""

import numba
import numpy as np

from acquisition.types import Float32Array, FloatArray

BLOCK = 512


@numba.njit(
    "void(float32[:,::1], float32[:,:,::1], uint8[:,::1], float32[:,::1], float32[:,::1], float32[:,::1],"
    " float32[:,::1], float32[::1], float32[::1], float32[::1], float32[:,::1], float32[::1], int64,"
    " float32[:,::1], float32[::1], float32[::1], float32[::1], float32[:,::1])",
    cache=True,
    parallel=True,
    fastmath=True,
    error_model="numpy",
)
def estimate(  # noqa: PLR0915 - one fused kernel is the point
    values: Float32Array,  # (F, N)
    light: Float32Array,  # (F, 3, N)
    usable: np.ndarray,  # (F, N) uint8
    extra: Float32Array,  # (F, N) variance beside the model's
    point: Float32Array,  # (3, N)
    along: Float32Array,  # (3, N) ∂x/∂Z
    lamp: Float32Array,  # (F, 6)
    shot: Float32Array,  # (F,)
    floor: Float32Array,  # (F,)
    scalars: Float32Array,  # c, σ_d, Cauchy scale (0: not robust), σ_z
    prior: Float32Array,  # (3, N) mean of g
    precision: Float32Array,  # (N,) of that prior
    rounds: int,
    out: Float32Array,  # (3, N) g
    offset: Float32Array,  # (N,) m
    variance: Float32Array,  # (N,) rad², both tangential directions
    residual: Float32Array,  # (N,) rms of whitened residuals
    weights: Float32Array,  # (F, N) robust weight / variance; 0 where not usable
) -> None:
    """Solves all pixels; results go to the last five arrays."""
    count = values.shape[0]
    pixels = values.shape[1]
    one = np.float32(1.0)
    zero = np.float32(0.0)
    tiny = np.float32(1e-12)
    c2 = scalars[0] * scalars[0]
    d2 = scalars[1] * scalars[1]
    inverse_cauchy2 = zero if scalars[2] <= zero else one / (scalars[2] * scalars[2])
    sigma_z = scalars[3]
    for block in numba.prange((pixels + BLOCK - 1) // BLOCK):
        start = block * BLOCK
        size = min(BLOCK, pixels - start)
        m = np.empty((10, size), dtype=np.float32)  # 00 01 02 11 12 22 03 13 23 33
        b = np.empty((4, size), dtype=np.float32)
        g = np.empty((4, size), dtype=np.float32)  # g and ζ
        albedo2 = np.empty(size, dtype=np.float32)
        for p in range(size):
            g[0, p] = prior[0, start + p]
            g[1, p] = prior[1, start + p]
            g[2, p] = prior[2, start + p]
            g[3, p] = zero
            albedo2[p] = g[0, p] * g[0, p] + g[1, p] * g[1, p] + g[2, p] * g[2, p]
        for turn in range(rounds):
            # Residuals against the prior say nothing, so the first round is least squares; it counts bright
            # measurements most, because those left over in shadow by bounced light are dark.
            tail = zero if turn == 0 else inverse_cauchy2
            first = one if turn == 0 and inverse_cauchy2 > zero else zero
            for p in range(size):
                w = precision[start + p]
                m[0, p] = w
                m[1, p] = zero
                m[2, p] = zero
                m[3, p] = w
                m[4, p] = zero
                m[5, p] = w
                m[6, p] = zero
                m[7, p] = zero
                m[8, p] = zero
                m[9, p] = one
                b[0, p] = w * prior[0, start + p]
                b[1, p] = w * prior[1, start + p]
                b[2, p] = w * prior[2, start + p]
                b[3, p] = zero
            for f in range(count):
                lx = lamp[f, 0]
                ly = lamp[f, 1]
                lz = lamp[f, 2]
                shot_f = shot[f]
                floor_f = floor[f]
                for p in range(size):
                    n = start + p
                    sx = light[f, 0, n]
                    sy = light[f, 1, n]
                    sz = light[f, 2, n]
                    y = values[f, n]
                    ax = along[0, n]
                    ay = along[1, n]
                    az = along[2, n]
                    rx = lx - point[0, n]
                    ry = ly - point[1, n]
                    rz = lz - point[2, n]
                    r2 = rx * rx + ry * ry + rz * rz
                    s2 = sx * sx + sy * sy + sz * sz
                    strength = np.sqrt(s2)
                    # ∂s/∂Z = −|s|/r (a − 3 d̂ (d̂·a)), d̂ = s/|s|
                    scale = -strength * (one / np.sqrt(r2)) * sigma_z
                    dot = np.float32(3.0) * (sx * ax + sy * ay + sz * az) / (s2 + tiny)
                    dx = scale * (ax - sx * dot)
                    dy = scale * (ay - sy * dot)
                    dz = scale * (az - sz * dot)
                    h = g[0, p] * dx + g[1, p] * dy + g[2, p] * dz
                    zeta = g[3, p]
                    sx += zeta * dx
                    sy += zeta * dy
                    sz += zeta * dz
                    difference = y - (g[0, p] * sx + g[1, p] * sy + g[2, p] * sz)
                    v = extra[f, n] + shot_f * max(y, zero) + floor_f + c2 * y * y + d2 * albedo2[p] * s2
                    w = np.float32(usable[f, n]) / (v + difference * difference * tail)
                    share = max(y, zero) * max(y, zero) / (albedo2[p] * s2 + tiny)
                    w *= one + first * (share * share - one)
                    weights[f, n] = w
                    target = w * (y + h * zeta)
                    wx = w * sx
                    wy = w * sy
                    wz = w * sz
                    wh = w * h
                    m[0, p] += wx * sx
                    m[1, p] += wx * sy
                    m[2, p] += wx * sz
                    m[3, p] += wy * sy
                    m[4, p] += wy * sz
                    m[5, p] += wz * sz
                    m[6, p] += wx * h
                    m[7, p] += wy * h
                    m[8, p] += wz * h
                    m[9, p] += wh * h
                    b[0, p] += target * sx
                    b[1, p] += target * sy
                    b[2, p] += target * sz
                    b[3, p] += target * h
            for p in range(size):
                # ζ eliminated, then LDLᵀ of the 3 × 3 that remains
                e = one / m[9, p]
                m0 = m[0, p] - m[6, p] * m[6, p] * e
                m1 = m[1, p] - m[6, p] * m[7, p] * e
                m2 = m[2, p] - m[6, p] * m[8, p] * e
                m3 = m[3, p] - m[7, p] * m[7, p] * e
                m4 = m[4, p] - m[7, p] * m[8, p] * e
                m5 = m[5, p] - m[8, p] * m[8, p] * e
                b0 = b[0, p] - m[6, p] * b[3, p] * e
                b1 = b[1, p] - m[7, p] * b[3, p] * e
                b2 = b[2, p] - m[8, p] * b[3, p] * e
                i0 = one / m0
                l1 = m1 * i0
                l2 = m2 * i0
                i1 = one / (m3 - l1 * m1)
                l3 = (m4 - l2 * m1) * i1
                i2 = one / (m5 - l2 * m2 - l3 * (m4 - l2 * m1))
                u1 = b1 - l1 * b0
                u2 = b2 - l2 * b0 - l3 * u1
                z = u2 * i2
                yy = u1 * i1 - l3 * z
                x = b0 * i0 - l1 * yy - l2 * z
                g[0, p] = x
                g[1, p] = yy
                g[2, p] = z
                zeta = (b[3, p] - m[6, p] * x - m[7, p] * yy - m[8, p] * z) * e
                g[3, p] = min(max(zeta, np.float32(-4.0)), np.float32(4.0))
                albedo2[p] = x * x + yy * yy + z * z
                # Inverse of LDLᵀ; its trace and its part along the normal
                c22 = i2
                c12 = -l3 * c22
                k = l1 * l3 - l2
                c02 = k * c22
                c11 = i1 - l3 * c12
                c01 = -l1 * i1 - l3 * c02
                c00 = i0 - l1 * c01 - l2 * c02
                trace = c00 + c11 + c22
                inner = (
                    c00 * x * x
                    + c11 * yy * yy
                    + c22 * z * z
                    + np.float32(2.0) * (c01 * x * yy + c02 * x * z + c12 * yy * z)
                )
                inverse = one / (albedo2[p] + tiny)
                variance[start + p] = max(trace - inner * inverse, tiny) * inverse
        for p in range(size):
            b[0, p] = zero
            b[1, p] = zero
            out[0, start + p] = g[0, p]
            out[1, start + p] = g[1, p]
            out[2, start + p] = g[2, p]
            offset[start + p] = g[3, p] * sigma_z
        for f in range(count):
            for p in range(size):
                n = start + p
                sx = light[f, 0, n]
                sy = light[f, 1, n]
                sz = light[f, 2, n]
                s2 = sx * sx + sy * sy + sz * sz
                y = values[f, n]
                rx = lamp[f, 0] - point[0, n]
                ry = lamp[f, 1] - point[1, n]
                rz = lamp[f, 2] - point[2, n]
                scale = -np.sqrt(s2 / (rx * rx + ry * ry + rz * rz)) * offset[n]
                dot = np.float32(3.0) * (sx * along[0, n] + sy * along[1, n] + sz * along[2, n]) / (s2 + tiny)
                sx += scale * (along[0, n] - sx * dot)
                sy += scale * (along[1, n] - sy * dot)
                sz += scale * (along[2, n] - sz * dot)
                difference = y - (g[0, p] * sx + g[1, p] * sy + g[2, p] * sz)
                v = extra[f, n] + shot[f] * max(y, zero) + floor[f] + c2 * y * y + d2 * albedo2[p] * s2
                used = np.float32(usable[f, n])
                b[0, p] += used * difference * difference / v
                b[1, p] += used
        for p in range(size):
            residual[start + p] = np.sqrt(b[0, p] / max(b[1, p], one))


@numba.njit(
    "void(float32[:,:,::1], float32[:,::1], float32[:,::1], float32[:,::1], float32[:,:,::1])",
    cache=True,
    parallel=True,
    fastmath=True,
    error_model="numpy",
)
def derivative(
    light: Float32Array,  # (F, 3, N)
    point: Float32Array,  # (3, N)
    along: Float32Array,  # (3, N) ∂x/∂Z
    lamp: Float32Array,  # (F, 6)
    out: Float32Array,  # (F, 3, N) ∂s/∂Z = −|s|/r (a − 3 d̂ (d̂·a)), d̂ = s/|s|
) -> None:
    """How light vectors change with depth."""
    for block in numba.prange((light.shape[2] + BLOCK - 1) // BLOCK):
        start = block * BLOCK
        stop = min(start + BLOCK, light.shape[2])
        for f in range(light.shape[0]):
            for n in range(start, stop):
                sx, sy, sz = light[f, 0, n], light[f, 1, n], light[f, 2, n]
                rx, ry, rz = lamp[f, 0] - point[0, n], lamp[f, 1] - point[1, n], lamp[f, 2] - point[2, n]
                ax, ay, az = along[0, n], along[1, n], along[2, n]
                s2 = sx * sx + sy * sy + sz * sz
                scale = -np.sqrt(s2 / (rx * rx + ry * ry + rz * rz))
                dot = np.float32(3.0) * (sx * ax + sy * ay + sz * az) / (s2 + np.float32(1e-24))
                out[f, 0, n] = scale * (ax - sx * dot)
                out[f, 1, n] = scale * (ay - sy * dot)
                out[f, 2, n] = scale * (az - sz * dot)


@numba.njit("void(float64[:,::1])", cache=True, error_model="numpy")
def cholesky(matrix: FloatArray) -> None:
    """Replaces the lower triangle of a small positive definite matrix (M, M) by L with L Lᵀ = the matrix."""
    for i in range(len(matrix)):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = np.sqrt(total) if i == j else total / matrix[j, j]


@numba.njit("void(float64[:,::1], float64[:,::1])", cache=True, error_model="numpy")
def forward(lower: FloatArray, columns: FloatArray) -> None:
    """Replaces columns (M, K) by L⁻¹ of them, L (M, M) a lower triangle."""
    for i in range(len(lower)):
        for k in range(columns.shape[1]):
            total = columns[i, k]
            for j in range(i):
                total -= lower[i, j] * columns[j, k]
            columns[i, k] = total / lower[i, i]


KERNELS = (estimate, derivative, cholesky, forward)
