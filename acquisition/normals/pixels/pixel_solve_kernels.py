"""Fused kernel of the pixel solve: iteratively reweighted least squares (Cauchy) of albedo × normal.

The state of a pixel is g = albedo × normal (3). Image i gives the row s_i. Each iteration is a Gauss–Newton step and a
reweighting at once.

Images are the outer loops and pixels the inner ones, in blocks that stay in the cache. What a block needs is first
copied into two arrays of known width: compilers vectorise loops over these, while among a dozen arrays they cannot
prove that none overlaps another. This is an order of magnitude faster than the obvious order. Kernels compile at
import, into numba's cache.
"""

import numba
import numpy as np

from acquisition.models.base import BoolArray, Float32Array, FloatArray

BLOCK_PIXELS = 128
"""Pixels of a block, so few that its arrays stay in the cache."""

CAUCHY_COVARIANCE_FACTOR = np.float32(0.95)
"""Factor of the covariance, which Cauchy's weights inflate: on Gaussian noise their mean is 0.88 to 0.92, by leverage,
and their efficiency is 0.95. The constants of σ are fitted with it (`error_variance`)."""


@numba.njit(
    "void(float32[:,::1], float32[:,:,::1], uint8[:,::1], float32[:,::1], float32[::1], float32[::1], float32[::1],"
    " float32[:,::1], float32[::1], int64, float32[:,::1], float32[::1], float32[::1], float32[:,::1])",
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
    shot: Float32Array,  # (F,)
    floor: Float32Array,  # (F,)
    scalars: Float32Array,  # c, σ_d, Cauchy scale (0: not robust)
    prior: Float32Array,  # (3, N) mean of g
    precision: Float32Array,  # (N,) of that prior
    rounds: int,
    out: Float32Array,  # (3, N) g
    variance: Float32Array,  # (N,) rad², both tangential directions
    residual: Float32Array,  # (N,) rms of whitened residuals
    weights: Float32Array,  # (F, N) robust weight / variance; 0 where not usable
) -> None:
    """Solves all pixels at once by Gauss–Newton steps with Cauchy reweighting, into the last four arrays."""
    count = values.shape[0]
    pixels = values.shape[1]
    one = np.float32(1.0)
    zero = np.float32(0.0)
    tiny = np.float32(1e-12)
    c2 = scalars[0] * scalars[0]
    d2 = scalars[1] * scalars[1]
    inverse_cauchy2 = zero if scalars[2] <= zero else one / (scalars[2] * scalars[2])
    for block in numba.prange((pixels + BLOCK_PIXELS - 1) // BLOCK_PIXELS):
        start = block * BLOCK_PIXELS
        size = min(BLOCK_PIXELS, pixels - start)
        # Rows of `image`: s 0–2, y 3, its variance without directions 4, |s|² 5, usable 6, start of w 7, w 8
        image = np.empty((count, 9, BLOCK_PIXELS), dtype=np.float32)
        # Rows of `pixel`: M 0–5 (00 01 02 11 12 22), b 6–8, g 9–11, ρ² 12, prior 13–15, its precision 16, variance 17
        pixel = np.empty((18, BLOCK_PIXELS), dtype=np.float32)
        for p in range(size):
            pixel[16, p] = precision[start + p]
        for c in range(3):
            for p in range(size):
                pixel[13 + c, p] = prior[c, start + p]
        for p in range(size):
            gx, gy, gz = pixel[13, p], pixel[14, p], pixel[15, p]
            pixel[9, p], pixel[10, p], pixel[11, p] = gx, gy, gz
            pixel[12, p] = gx * gx + gy * gy + gz * gz
        for f in range(count):
            for c in range(3):
                for p in range(size):
                    image[f, c, p] = light[f, c, start + p]
            for p in range(size):
                image[f, 3, p] = values[f, start + p]
            for p in range(size):
                image[f, 4, p] = extra[f, start + p]
            for p in range(size):
                image[f, 6, p] = np.float32(usable[f, start + p])
            shot_f, floor_f = shot[f], floor[f]
            for p in range(size):
                sx, sy, sz = image[f, 0, p], image[f, 1, p], image[f, 2, p]
                y = image[f, 3, p]
                lit = max(y, zero)
                s2 = sx * sx + sy * sy + sz * sz
                image[f, 4, p] += shot_f * lit + floor_f + c2 * y * y
                image[f, 5, p] = s2
                # Residuals against the prior mean nothing, so the first round is least squares. It weighs bright
                # measurements most, because those in shadow that indirect light keeps usable are dark.
                share = lit * lit / (pixel[12, p] * s2 + tiny)
                image[f, 7, p] = image[f, 6, p] * (share * share if inverse_cauchy2 > zero else one)
        for iteration in range(rounds):
            tail = zero if iteration == 0 else inverse_cauchy2
            for p in range(size):
                w = pixel[16, p]
                pixel[0, p], pixel[1, p], pixel[2, p] = w, zero, zero
                pixel[3, p], pixel[4, p], pixel[5, p] = w, zero, w
                pixel[6, p], pixel[7, p], pixel[8, p] = w * pixel[13, p], w * pixel[14, p], w * pixel[15, p]
            for f in range(count):
                for p in range(size):
                    sx, sy, sz = image[f, 0, p], image[f, 1, p], image[f, 2, p]
                    y = image[f, 3, p]
                    difference = y - (pixel[9, p] * sx + pixel[10, p] * sy + pixel[11, p] * sz)
                    v = image[f, 4, p] + d2 * pixel[12, p] * image[f, 5, p]
                    w = image[f, 7, p] / (v + difference * difference * tail)
                    image[f, 8, p] = w
                    wx, wy, wz, wt = w * sx, w * sy, w * sz, w * y
                    pixel[0, p] += wx * sx
                    pixel[1, p] += wx * sy
                    pixel[2, p] += wx * sz
                    pixel[3, p] += wy * sy
                    pixel[4, p] += wy * sz
                    pixel[5, p] += wz * sz
                    pixel[6, p] += wt * sx
                    pixel[7, p] += wt * sy
                    pixel[8, p] += wt * sz
                if iteration == 0:
                    for p in range(size):
                        image[f, 7, p] = image[f, 6, p]
            for p in range(size):
                # LDLᵀ of M. Its pivots are at least the prior's precision, but may be less by rounding: one bright
                # highlight can weigh 10⁷ times as much.
                m1, m2, m4, least = pixel[1, p], pixel[2, p], pixel[4, p], pixel[16, p]
                b0 = pixel[6, p]
                i0 = one / pixel[0, p]
                l1 = m1 * i0
                l2 = m2 * i0
                i1 = one / max(pixel[3, p] - l1 * m1, least)
                l3 = (m4 - l2 * m1) * i1
                i2 = one / max(pixel[5, p] - l2 * m2 - l3 * (m4 - l2 * m1), least)
                u1 = pixel[7, p] - l1 * b0
                u2 = pixel[8, p] - l2 * b0 - l3 * u1
                z = u2 * i2
                yy = u1 * i1 - l3 * z
                x = b0 * i0 - l1 * yy - l2 * z
                pixel[9, p], pixel[10, p], pixel[11, p] = x, yy, z
                albedo2 = x * x + yy * yy + z * z
                pixel[12, p] = albedo2
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
                pixel[17, p] = max(trace - inner * inverse, tiny) * inverse
        for p in range(size):
            pixel[0, p] = zero
            pixel[1, p] = zero
        for f in range(count):
            for p in range(size):
                sx, sy, sz = image[f, 0, p], image[f, 1, p], image[f, 2, p]
                difference = image[f, 3, p] - (pixel[9, p] * sx + pixel[10, p] * sy + pixel[11, p] * sz)
                v = image[f, 4, p] + d2 * pixel[12, p] * image[f, 5, p]
                pixel[0, p] += image[f, 6, p] * difference * difference / v
                pixel[1, p] += image[f, 6, p]
            for p in range(size):
                weights[f, start + p] = image[f, 8, p]
        for p in range(size):
            residual[start + p] = np.sqrt(pixel[0, p] / max(pixel[1, p], one))
        for c in range(3):
            for p in range(size):
                out[c, start + p] = pixel[9 + c, p]
        kept = CAUCHY_COVARIANCE_FACTOR if inverse_cauchy2 > zero else one
        for p in range(size):
            variance[start + p] = kept * pixel[17, p]


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
    lamp: Float32Array,  # (F, 6 or 9)
    out: Float32Array,  # (F, 3, N) ∂s/∂Z = −|s|/r (a − 3 d̂ (d̂·a)), d̂ = s/|s|
) -> None:
    """Writes the derivative of near-light vectors by depth, without the lobe's fall-off, into `out`."""
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
    """y/|s| of one measurement, an albedo; 0 of a lamp that does not reach the pixel, beside or behind its lobe.

    There the albedo would be without bound, and rounding of its square would make the solution NaN.
    """
    strength = _strength(light, f, n)
    return values[f, n] / strength if strength > np.float32(1e-9) else np.float32(0)


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
    """Writes each pixel's largest y/|s| that is not clipped, at least 0, into `out`."""
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
    """Finds the usable measurements, and the variance of those with a shadowed pixel among their eight neighbours."""
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


@numba.njit("void(float64[:,::1], float64[::1], float64[:,::1])", cache=True, fastmath=True, error_model="numpy")
def orthonormalise(rows: FloatArray, precision: FloatArray, inner: FloatArray) -> None:
    """Orthonormalises whitened rows (M, F) in place, L⁻¹ rows, so that what they explain is the projection onto the
    result. A prior of `precision` (M,) counts. L (M, M) goes to `inner`."""
    for i in range(len(rows)):
        for j in range(i + 1):
            total = 0.0
            for f in range(rows.shape[1]):
                total += rows[i, f] * rows[j, f]
            inner[i, j] = total
        inner[i, i] += precision[i]
    cholesky(inner)
    forward_substitution(inner, rows)


KERNELS = (estimate, depth_derivative, peak_ratio, classify, cholesky, forward_substitution, orthonormalise)
