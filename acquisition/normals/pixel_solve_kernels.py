"""Fused kernel of the pixel solve: iteratively reweighted least squares (Cauchy) of albedo × normal and depth offset.

State of a pixel: g = albedo × normal (3) and a depth offset ζ in units of its prior σ_z. Image i gives the row
(s_i + z ∂s_i/∂Z, σ_z g·∂s_i/∂Z), z = σ_z ζ, so that light which another depth would explain does not rotate the normal;
σ of the normal is from the covariance with the offset marginalised (Schur complement). Each iteration is a Gauss–Newton
step and a reweighting at once. A tiny σ_z switches the depth offset off.

Pixels are the inner loops and images the outer ones, in blocks that stay in the cache. What a block needs is copied
into two arrays of known width first: compilers vectorise loops over these, while among a dozen arrays they cannot prove
that none overlaps another. Both together are an order of magnitude faster than the obvious order. Kernels
compile at import, into numba's cache.
"""

import numba
import numpy as np

from acquisition.models.base import BoolArray, Float32Array, FloatArray

BLOCK_PIXELS = 128
"""Pixels of a block: its arrays stay in the cache."""

CAUCHY_MEAN_WEIGHT = np.float32(0.95)
"""Mean of Cauchy's weights of Gaussian noise. Errors are the same as without the weights, so the covariance, which
they would inflate by its inverse, is multiplied by it."""


@numba.njit(
    "void(float32[:,::1], float32[:,:,::1], uint8[:,::1], float32[:,::1], float32[:,::1], float32[:,::1],"
    " float32[:,::1], float32[::1], float32[::1], float32[::1], float32[:,::1], float32[::1], int64,"
    " float32[:,::1], float32[::1], float32[::1], float32[::1], float32[:,::1])",
    cache=True,
    parallel=True,
    fastmath=True,
    error_model="numpy",
)
def estimate(  # noqa: PLR0912, PLR0915 - one fused kernel is the point
    values: Float32Array,  # (F, N)
    light: Float32Array,  # (F, 3, N)
    usable: np.ndarray,  # (F, N) uint8
    extra: Float32Array,  # (F, N) variance beside the model's
    point: Float32Array,  # (3, N)
    ray_direction: Float32Array,  # (3, N) ∂x/∂Z
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
    """Gauss–Newton and Cauchy reweighting of all pixels at once; results go to the last five arrays."""
    count = values.shape[0]
    pixels = values.shape[1]
    one = np.float32(1.0)
    zero = np.float32(0.0)
    tiny = np.float32(1e-12)
    c2 = scalars[0] * scalars[0]
    d2 = scalars[1] * scalars[1]
    inverse_cauchy2 = zero if scalars[2] <= zero else one / (scalars[2] * scalars[2])
    sigma_z = scalars[3]
    for block in numba.prange((pixels + BLOCK_PIXELS - 1) // BLOCK_PIXELS):
        start = block * BLOCK_PIXELS
        size = min(BLOCK_PIXELS, pixels - start)
        # Of images: s 0–2, σ_z ∂s/∂Z 3–5, y 6, its variance but for directions 7, |s|² 8, usable 9, what w starts from
        # 10, w 11
        image = np.empty((count, 12, BLOCK_PIXELS), dtype=np.float32)
        # Of pixels: M 0–9 (00 01 02 11 12 22 03 13 23 33), b 10–13, g 14–16, ζ 17, ρ² 18, prior 19–21 and its precision
        # 22, ∂x/∂Z 23–25, x 26–28, variance 29, residual 30
        pixel = np.empty((31, BLOCK_PIXELS), dtype=np.float32)
        for p in range(size):
            pixel[22, p] = precision[start + p]
        for c in range(3):
            for p in range(size):
                pixel[19 + c, p] = prior[c, start + p]
            for p in range(size):
                pixel[23 + c, p] = ray_direction[c, start + p]
            for p in range(size):
                pixel[26 + c, p] = point[c, start + p]
        for p in range(size):
            gx, gy, gz = pixel[19, p], pixel[20, p], pixel[21, p]
            pixel[14, p], pixel[15, p], pixel[16, p] = gx, gy, gz
            pixel[17, p] = zero
            pixel[18, p] = gx * gx + gy * gy + gz * gz
        for f in range(count):
            for c in range(3):
                for p in range(size):
                    image[f, c, p] = light[f, c, start + p]
            for p in range(size):
                image[f, 6, p] = values[f, start + p]
            for p in range(size):
                image[f, 7, p] = extra[f, start + p]
            for p in range(size):
                image[f, 9, p] = np.float32(usable[f, start + p])
            lx, ly, lz = lamp[f, 0], lamp[f, 1], lamp[f, 2]
            shot_f, floor_f = shot[f], floor[f]
            for p in range(size):
                sx, sy, sz = image[f, 0, p], image[f, 1, p], image[f, 2, p]
                ax, ay, az = pixel[23, p], pixel[24, p], pixel[25, p]
                rx, ry, rz = lx - pixel[26, p], ly - pixel[27, p], lz - pixel[28, p]
                y = image[f, 6, p]
                lit = max(y, zero)
                s2 = sx * sx + sy * sy + sz * sz
                # ∂s/∂Z = −|s|/r (a − 3 d̂ (d̂·a)), d̂ = s/|s|
                scale = -np.sqrt(s2 / (rx * rx + ry * ry + rz * rz)) * sigma_z
                dot = np.float32(3.0) * (sx * ax + sy * ay + sz * az) / (s2 + tiny)
                image[f, 3, p] = scale * (ax - sx * dot)
                image[f, 4, p] = scale * (ay - sy * dot)
                image[f, 5, p] = scale * (az - sz * dot)
                image[f, 7, p] += shot_f * lit + floor_f + c2 * y * y
                image[f, 8, p] = s2
                # Residuals against the prior say nothing, so the first round is least squares; it counts bright
                # measurements most, because those left over in shadow by indirect light are dark.
                share = lit * lit / (pixel[18, p] * s2 + tiny)
                image[f, 10, p] = image[f, 9, p] * (share * share if inverse_cauchy2 > zero else one)
        for iteration in range(rounds):
            tail = zero if iteration == 0 else inverse_cauchy2
            for p in range(size):
                w = pixel[22, p]
                pixel[0, p], pixel[1, p], pixel[2, p] = w, zero, zero
                pixel[3, p], pixel[4, p], pixel[5, p] = w, zero, w
                pixel[6, p], pixel[7, p], pixel[8, p], pixel[9, p] = zero, zero, zero, one
                pixel[10, p], pixel[11, p] = w * pixel[19, p], w * pixel[20, p]
                pixel[12, p], pixel[13, p] = w * pixel[21, p], zero
            for f in range(count):
                for p in range(size):
                    gx, gy, gz, zeta = pixel[14, p], pixel[15, p], pixel[16, p], pixel[17, p]
                    dx, dy, dz = image[f, 3, p], image[f, 4, p], image[f, 5, p]
                    y = image[f, 6, p]
                    h = gx * dx + gy * dy + gz * dz
                    sx, sy, sz = image[f, 0, p] + zeta * dx, image[f, 1, p] + zeta * dy, image[f, 2, p] + zeta * dz
                    difference = y - (gx * sx + gy * sy + gz * sz)
                    v = image[f, 7, p] + d2 * pixel[18, p] * image[f, 8, p]
                    w = image[f, 10, p] / (v + difference * difference * tail)
                    image[f, 11, p] = w
                    target = w * (y + h * zeta)
                    wx, wy, wz, wh = w * sx, w * sy, w * sz, w * h
                    pixel[0, p] += wx * sx
                    pixel[1, p] += wx * sy
                    pixel[2, p] += wx * sz
                    pixel[3, p] += wy * sy
                    pixel[4, p] += wy * sz
                    pixel[5, p] += wz * sz
                    pixel[6, p] += wx * h
                    pixel[7, p] += wy * h
                    pixel[8, p] += wz * h
                    pixel[9, p] += wh * h
                    pixel[10, p] += target * sx
                    pixel[11, p] += target * sy
                    pixel[12, p] += target * sz
                    pixel[13, p] += target * h
                if iteration == 0:
                    for p in range(size):
                        image[f, 10, p] = image[f, 9, p]
            for p in range(size):
                # ζ eliminated, then LDLᵀ of the 3 × 3 that remains
                e = one / pixel[9, p]
                m6, m7, m8, b3 = pixel[6, p], pixel[7, p], pixel[8, p], pixel[13, p]
                m0 = pixel[0, p] - m6 * m6 * e
                m1 = pixel[1, p] - m6 * m7 * e
                m2 = pixel[2, p] - m6 * m8 * e
                m3 = pixel[3, p] - m7 * m7 * e
                m4 = pixel[4, p] - m7 * m8 * e
                m5 = pixel[5, p] - m8 * m8 * e
                b0 = pixel[10, p] - m6 * b3 * e
                b1 = pixel[11, p] - m7 * b3 * e
                b2 = pixel[12, p] - m8 * b3 * e
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
                pixel[14, p], pixel[15, p], pixel[16, p] = x, yy, z
                zeta = (b3 - m6 * x - m7 * yy - m8 * z) * e
                pixel[17, p] = min(max(zeta, np.float32(-4.0)), np.float32(4.0))
                albedo2 = x * x + yy * yy + z * z
                pixel[18, p] = albedo2
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
                inverse = one / (albedo2 + tiny)
                pixel[29, p] = max(trace - inner * inverse, tiny) * inverse
        for p in range(size):
            pixel[0, p] = zero
            pixel[1, p] = zero
        for f in range(count):
            for p in range(size):
                zeta = pixel[17, p]
                sx = image[f, 0, p] + zeta * image[f, 3, p]
                sy = image[f, 1, p] + zeta * image[f, 4, p]
                sz = image[f, 2, p] + zeta * image[f, 5, p]
                difference = image[f, 6, p] - (pixel[14, p] * sx + pixel[15, p] * sy + pixel[16, p] * sz)
                v = image[f, 7, p] + d2 * pixel[18, p] * image[f, 8, p]
                pixel[0, p] += image[f, 9, p] * difference * difference / v
                pixel[1, p] += image[f, 9, p]
            for p in range(size):
                weights[f, start + p] = image[f, 11, p]
        for p in range(size):
            residual[start + p] = np.sqrt(pixel[0, p] / max(pixel[1, p], one))
        for c in range(3):
            for p in range(size):
                out[c, start + p] = pixel[14 + c, p]
        for p in range(size):
            offset[start + p] = pixel[17, p] * sigma_z
        kept = CAUCHY_MEAN_WEIGHT if inverse_cauchy2 > zero else one
        for p in range(size):
            variance[start + p] = kept * pixel[29, p]


@numba.njit(
    "void(float32[:,:,::1], float32[:,::1], float32[:,::1], float32[:,::1], float32[:,:,::1])",
    cache=True,
    parallel=True,
    fastmath=True,
    error_model="numpy",
)
def depth_derivative(
    light: Float32Array,  # (F, 3, N)
    point: Float32Array,  # (3, N)
    ray_direction: Float32Array,  # (3, N) ∂x/∂Z
    lamp: Float32Array,  # (F, 6)
    out: Float32Array,  # (F, 3, N) ∂s/∂Z = −|s|/r (a − 3 d̂ (d̂·a)), d̂ = s/|s|
) -> None:
    """Derivative of near-light vectors by depth, into `out`."""
    for block in numba.prange((light.shape[2] + BLOCK_PIXELS - 1) // BLOCK_PIXELS):
        start = block * BLOCK_PIXELS
        stop = min(start + BLOCK_PIXELS, light.shape[2])
        for f in range(light.shape[0]):
            for n in range(start, stop):
                sx, sy, sz = light[f, 0, n], light[f, 1, n], light[f, 2, n]
                rx, ry, rz = lamp[f, 0] - point[0, n], lamp[f, 1] - point[1, n], lamp[f, 2] - point[2, n]
                ax, ay, az = ray_direction[0, n], ray_direction[1, n], ray_direction[2, n]
                s2 = sx * sx + sy * sy + sz * sz
                scale = -np.sqrt(s2 / (rx * rx + ry * ry + rz * rz))
                dot = np.float32(3.0) * (sx * ax + sy * ay + sz * az) / (s2 + np.float32(1e-24))
                out[f, 0, n] = scale * (ax - sx * dot)
                out[f, 1, n] = scale * (ay - sy * dot)
                out[f, 2, n] = scale * (az - sz * dot)


@numba.njit("float32(float32[:,:,::1], int64, int64)", cache=True, error_model="numpy")
def _strength(light: Float32Array, f: int, n: int) -> np.float32:
    """|s| of one measurement."""
    x, y, z = light[f, 0, n], light[f, 1, n], light[f, 2, n]
    return np.sqrt(x * x + y * y + z * z)


@numba.njit("float32(float32[:,::1], float32[:,:,::1], int64, int64)", cache=True, error_model="numpy")
def _ratio(values: Float32Array, light: Float32Array, f: int, n: int) -> np.float32:
    """y/|s| of one measurement."""
    return values[f, n] / max(_strength(light, f, n), np.float32(1e-9))


@numba.njit(
    "void(float32[:,::1], float32[:,:,::1], boolean[:,::1], float32[::1])",
    cache=True,
    parallel=True,
    error_model="numpy",
)
def peak_ratio(
    values: Float32Array,  # (F, N)
    light: Float32Array,  # (F, 3, N)
    clipped: BoolArray,  # (F, N)
    out: Float32Array,  # (N,)
) -> None:
    """Each pixel's largest y/|s| that is not clipped, at least 0."""
    for block in numba.prange((len(out) + BLOCK_PIXELS - 1) // BLOCK_PIXELS):
        start = block * BLOCK_PIXELS
        stop = min(start + BLOCK_PIXELS, len(out))
        out[start:stop] = 0
        for f in range(len(values)):
            for n in range(start, stop):
                if not clipped[f, n]:
                    out[n] = max(out[n], _ratio(values, light, f, n))


@numba.njit(
    "void(float32[:,::1], float32[:,:,::1], boolean[:,::1], float32[::1], float32, int64[::1], int64, float32,"
    " boolean[:,::1], float32[:,::1])",
    cache=True,
    parallel=True,
    error_model="numpy",
)
def classify(
    values: Float32Array,  # (F, N)
    light: Float32Array,  # (F, 3, N)
    clipped: BoolArray,  # (F, N)
    peak: Float32Array,  # (N,)
    threshold: float,  # share of the peak below which a measurement is in shadow
    place: np.ndarray,  # (N,) flat index in a window with a border of one pixel
    width: int,  # of that window
    penumbra_sigma: float,  # share of the peak
    usable: BoolArray,  # (F, N)
    variance: Float32Array,  # (F, N)
) -> None:
    """Which measurements are usable, and the variance of those that have a shadowed pixel among eight neighbours."""
    size = place[-1] + width + 2 if len(place) else 0
    for f in numba.prange(len(values)):
        shadow = np.zeros(size, np.uint8)
        for n in range(len(place)):
            ratio = _ratio(values, light, f, n)
            shadow[place[n]] = not clipped[f, n] and ratio < threshold * peak[n]
            usable[f, n] = not clipped[f, n] and not shadow[place[n]] and ratio > 0
        for n in range(len(place)):
            variance[f, n] = 0
            if not usable[f, n]:
                continue
            near = place[n]
            above, below = near - width, near + width
            if (
                shadow[above - 1] | shadow[above] | shadow[above + 1] | shadow[near - 1] | shadow[near + 1]
                | shadow[below - 1] | shadow[below] | shadow[below + 1]
            ):  # fmt: skip
                variance[f, n] = (penumbra_sigma * peak[n] * _strength(light, f, n)) ** 2


@numba.njit("void(float64[:,::1])", cache=True, error_model="numpy")
def cholesky(matrix: FloatArray) -> None:
    """Cholesky factorisation in place: the lower triangle of a positive definite matrix (M, M) becomes L, L Lᵀ = it."""
    for i in range(len(matrix)):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = np.sqrt(total) if i == j else total / matrix[j, j]


@numba.njit("void(float64[:,::1], float64[:,::1])", cache=True, error_model="numpy")
def forward_substitution(lower: FloatArray, columns: FloatArray) -> None:
    """Forward substitution in place: columns (M, K) become L⁻¹ of them, L (M, M) lower triangular."""
    for i in range(len(lower)):
        for k in range(columns.shape[1]):
            total = columns[i, k]
            for j in range(i):
                total -= lower[i, j] * columns[j, k]
            columns[i, k] = total / lower[i, i]


@numba.njit("void(float64[:,::1], float64, float64[:,::1])", cache=True, fastmath=True, error_model="numpy")
def orthonormalise(rows: FloatArray, offset_sigma_m: float, inner: FloatArray) -> None:
    """Orthonormalises a pixel's whitened rows (4, F) of g and depth offset in place, L⁻¹ rows: what they explain is the
    projection onto the result. The prior of the offset counts; L (4, 4) goes to `inner`."""
    for i in range(4):
        for j in range(i + 1):
            total = 0.0
            for f in range(rows.shape[1]):
                total += rows[i, f] * rows[j, f]
            inner[i, j] = total
        inner[i, i] += 1e-6 if i < 3 else offset_sigma_m**-2
    cholesky(inner)
    forward_substitution(inner, rows)


KERNELS = (estimate, depth_derivative, peak_ratio, classify, cholesky, forward_substitution, orthonormalise)
