"""Locally weighted regression of a normal map (Cleveland 1979) with shrinkage by its noise (empirical Bayes, Lee 1980).

Each pixel is solved by itself, although its neighbours contain information on its normal: most surfaces are flat or
evenly curved over a few pixels. A plane is therefore fitted to each component of the surrounding normals, weighted by
their precision. Tukey's biweight of the residuals, in units of the noise, leaves out pixels beyond a crease. The
pixel's normal n moves towards the fit m,

    n' = m + g (n − m),    g = max(χ² − χ₀², 0) / max(χ², χ₀²),

where χ² is the weighted mean of the squared residuals around in units of the noise, and χ₀² its expectation by noise
alone. Residuals beyond noise are detail of the surface, and g keeps their share. Relief that the images resolve has g
near 1 and does not change.

Measured on 112 captures of design seeds 205–225 (eight lights by two rings): errors are 0.888 ± 0.014 of those without
regression, of machined parts 0.77, of reliefs 0.99 (decision 78; scratch evaluation, November 2026).

Kernels compile at import, into numba's cache.
"""

import numba
import numpy as np

from acquisition import photometry
from acquisition.models.base import Float32Array
from acquisition.normals.surface import integrability

RADIUS_PX = 3
"""Pixels to either side that are fitted. Time grows with its square. Measured on 112 captures of design seeds 205–225
(eight lights by two rings): errors are 0.890 of those without regression, with 2 0.898; on 56 of them with 1 0.93, with
4 0.88, but reliefs err by 0.5 % more (decision 78; scratch evaluation, November 2026)."""

ROUNDS = 3
"""Number of weighted fits, each with weights from the residuals of the one before."""

LEAST_WEIGHT = 6.0
"""Sum of biweights below which the residuals of a fit of three parameters are not used."""

LEAST_NOISE = 1e-3
"""Least ratio of independent to stated variance, for images without noise."""

STRIP_ROWS, CHUNK_COLUMNS = 256, 256
"""Rows that are fitted at once, and columns, few enough for their sums to stay in the processor's cache."""


def noise_mean_square(most: float) -> float:
    """Returns χ₀², to two digits: the mean squared residual of two components, in units of their variance, under their
    own biweights. That is the mean of an exponentially distributed x with the weights (1 − x/m)² below m = `most`."""
    tail = np.exp(-most)
    weighted = 1 - 4 / most + 6 / most**2 - (2 / most + 6 / most**2) * tail
    return round(float(weighted / (1 - 2 / most + 2 / most**2 * (1 - tail))), 2)


def regress(normals: Float32Array, sigma_deg: Float32Array, variance: Float32Array, noise_ratio: float) -> float:
    """Regresses unit normals (H, W, 3), view frame, on those around, and changes their σ accordingly, in place.

    `sigma_deg` (H, W), `variance` (H, W), rad², and `noise_ratio` are those of `integrability.project_integrable`. The
    ratio tells which part of the stated variance is independent from pixel to pixel; the rest is error that neighbours
    have in common, and stays. Returns the mean remaining share of the independent variance.
    """
    height, width = variance.shape
    radius, total, pixels, most = RADIUS_PX, 0.0, 0, photometry.SETTINGS.outlying_deviations**2
    above = normals[:0].copy(), variance[:0].copy()
    for start in range(0, height, STRIP_ROWS):
        stop, below = min(start + STRIP_ROWS, height), min(start + STRIP_ROWS + radius, height)
        known = np.isfinite(sigma_deg[start:below]) & (variance[start:below] > 0)
        before = np.concatenate([above[1], np.where(known, variance[start:below], 0)])
        strip = np.concatenate([above[0], normals[start:below]])
        first, count = len(above[0]), stop - start
        normal = np.zeros((3, count + 2 * radius, width + 2 * radius), np.float32)
        precision = np.zeros(normal.shape[1:], np.float32)
        noise = np.float32(max(noise_ratio, LEAST_NOISE)) * before
        inside = slice(radius - first, radius - first + len(strip)), slice(radius, radius + width)
        normal[:, *inside] = strip.transpose(2, 0, 1)
        np.divide(1, noise, out=precision[inside], where=noise > 0)
        above = strip[first + count - radius : first + count].copy(), before[first + count - radius : first + count]
        fitted, left = np.empty((3, count, width), np.float32), np.empty((count, width), np.float32)
        _fit(normal, precision, np.float32(1 / most), np.float32(noise_mean_square(most)), fitted, left)
        own = before[first : first + count]
        normals[start:stop] = np.where((own > 0)[..., None], fitted.transpose(1, 2, 0), normals[start:stop])
        change = (left * noise_ratio - min(noise_ratio, 1)) * own
        integrability.add_variance(sigma_deg[start:stop], variance[start:stop], change)
        total, pixels = total + float(np.sum(left[own > 0], dtype=np.float64)), pixels + int(np.count_nonzero(own))
    return total / pixels if pixels else 1.0


(MX, MY, MZ, AX, AY, AZ, DX, DY, DZ, OWN, SQUARES, W, WA, WD, WAA, WAD, WDD, X, Y, Z, XA, YA, ZA, XD, YD, ZD) = (
    np.uint64(row * CHUNK_COLUMNS) for row in range(26)
)
"""Offsets of the rows of the buffer in which some columns are fitted: planes (middle, slopes across and down),
precision of what neighbours are compared with, sum of squared residuals, and normal equations (first the weights)."""

CERTAIN = np.float32(1e30)
"""Precision of a value without noise."""

RIDGE = np.float32(1e-3)
"""Share of a fit's weight that pulls slopes to zero; needed if all neighbours are in one row."""


@numba.njit(
    "void(float32[::1], float32[::1], float32[::1], uint64, uint64, float32, float32, uint64)",
    cache=True, fastmath=True, error_model="numpy",
)  # fmt: skip
def _add_row(
    buffer: Float32Array, normal: Float32Array, precision: Float32Array, at: np.uint64, area: np.uint64,
    down: np.float32, square: np.float32, count: np.uint64,
) -> None:  # fmt: skip
    """Adds the neighbours that are `down` rows below to the normal equations of `count` pixels.

    The first neighbour is `at` an index of the flat strip, in which each component takes an `area`. A row's sums are
    formed in registers; one buffer and unsigned offsets show the compiler that nothing overlaps.
    """
    one, zero = np.float32(1), np.float32(0)
    for j in range(count):
        ax, ay, az = buffer[AX + j], buffer[AY + j], buffer[AZ + j]
        mx, my, mz = (
            buffer[MX + j] + down * buffer[DX + j],
            buffer[MY + j] + down * buffer[DY + j],
            buffer[MZ + j] + down * buffer[DZ + j],
        )
        own, squares = buffer[OWN + j], buffer[SQUARES + j]
        w0 = w1 = w2 = x0 = x1 = y0 = y1 = z0 = z1 = zero
        for u in range(2 * RADIUS_PX + 1):
            across, k = np.float32(u - RADIUS_PX), at + j + np.uint64(u)
            x, y, z, known = normal[k], normal[area + k], normal[area + area + k], precision[k]
            dx, dy, dz = x - mx - across * ax, y - my - across * ay, z - mz - across * az
            residual = (dx * dx + dy * dy + dz * dz) * known * own / (known + own)
            weight = max(one - residual * square, zero)
            weight *= weight * known
            squares += weight * residual
            wx, wy, wz = weight * x, weight * y, weight * z
            w0, x0, y0, z0 = w0 + weight, x0 + wx, y0 + wy, z0 + wz
            w1, x1, y1, z1 = w1 + across * weight, x1 + across * wx, y1 + across * wy, z1 + across * wz
            w2 += across * across * weight
        buffer[SQUARES + j] = squares
        buffer[W + j] += w0
        buffer[WA + j] += w1
        buffer[WAA + j] += w2
        buffer[WD + j] += w0 * down
        buffer[WAD + j] += w1 * down
        buffer[WDD + j] += w0 * down * down
        buffer[X + j] += x0
        buffer[Y + j] += y0
        buffer[Z + j] += z0
        buffer[XA + j] += x1
        buffer[YA + j] += y1
        buffer[ZA + j] += z1
        buffer[XD + j] += x0 * down
        buffer[YD + j] += y0 * down
        buffer[ZD + j] += z0 * down


@numba.njit("float32(float32[::1], uint64)", cache=True, fastmath=True, error_model="numpy")
def _solve_plane(buffer: Float32Array, j: np.uint64) -> float:
    """Solves a pixel's normal equations by Cramer's rule; returns the middle's variance in units of 1 / weight."""
    a, b, c = buffer[W + j] + 1 / CERTAIN, buffer[WA + j], buffer[WD + j]
    d, e, f = buffer[WAA + j] + RIDGE * a, buffer[WAD + j], buffer[WDD + j] + RIDGE * a
    aa, ab, ac = d * f - e * e, c * e - b * f, b * e - c * d
    bb, bc, cc = a * f - c * c, b * c - a * e, a * d - b * b
    inverse = 1 / (a * aa + b * ab + c * ac)
    for middle, sum_, across, down in ((MX, X, XA, XD), (MY, Y, YA, YD), (MZ, Z, ZA, ZD)):
        p, q, r = buffer[sum_ + j] * inverse, buffer[across + j] * inverse, buffer[down + j] * inverse
        buffer[middle + j] = aa * p + ab * q + ac * r
        buffer[middle + AX + j] = ab * p + bb * q + bc * r
        buffer[middle + DX + j] = ac * p + bc * q + cc * r
    return aa * inverse


@numba.njit(
    "void(float32[:,:,::1], float32[:,::1], float32, float32, float32[:,:,::1], float32[:,::1])",
    cache=True, parallel=True, fastmath=True, error_model="numpy",
)  # fmt: skip
def _fit(
    normal: Float32Array,  # (3, h + 2 radius, w + 2 radius), padded
    precision: Float32Array,  # (h + 2 radius, w + 2 radius), 0 where there is no normal
    square: np.float32,  # 1 over the squared residual, in σ, from which the weight is 0
    noise: np.float32,  # χ₀²
    out: Float32Array,  # (3, h, w) unit normals
    left: Float32Array,  # (h, w) remaining share of the variance
) -> None:
    """Fits and shrinks all pixels of a strip, some columns of a row at once."""
    (height, width), radius = left.shape, RADIUS_PX
    area, one = np.uint64(precision.size), np.float32(1)
    normals, precisions = normal.reshape(3 * precision.size), precision.reshape(precision.size)
    for i in numba.prange(height):
        buffer = np.empty(26 * CHUNK_COLUMNS, np.float32)
        for start in range(0, width, CHUNK_COLUMNS):
            count = min(CHUNK_COLUMNS, width - start)
            own = precision[i + radius, start + radius : start + radius + count]
            buffer[:] = 0
            for c in range(3):
                here = normal[c, i + radius, start + radius : start + radius + count]
                buffer[c * CHUNK_COLUMNS : c * CHUNK_COLUMNS + count] = here
                out[c, i, start : start + count] = here
            left[i, start : start + count] = one
            if not np.any(own > 0):
                continue
            buffer[OWN : OWN + np.uint64(count)] = own
            for turn in range(ROUNDS):
                if turn > 0:
                    buffer[OWN : OWN + np.uint64(count)] = CERTAIN
                buffer[SQUARES:] = 0
                for v in range(2 * radius + 1):
                    at = np.uint64((i + v) * precision.shape[1] + start)
                    _add_row(buffer, normals, precisions, at, area, np.float32(v - radius), square, np.uint64(count))
                for j in range(count):
                    left[i, start + j] = _solve_plane(buffer, np.uint64(j)) * own[j]
            for j in range(count):
                k = np.uint64(j)
                counted = buffer[W + k] / own[j] if own[j] > 0 else 0.0
                if counted < LEAST_WEIGHT:
                    left[i, start + j] = one
                    continue
                spread = buffer[SQUARES + k] / buffer[W + k] * counted / (counted - 3)
                kept = max(spread - noise, 0) / max(spread, noise)
                left[i, start + j] = min(kept + (one - kept) ** 2 * left[i, start + j], one)
                x = buffer[MX + k] + kept * (out[0, i, start + j] - buffer[MX + k])
                y = buffer[MY + k] + kept * (out[1, i, start + j] - buffer[MY + k])
                z = buffer[MZ + k] + kept * (out[2, i, start + j] - buffer[MZ + k])
                length = np.sqrt(x * x + y * y + z * z)
                out[0, i, start + j], out[1, i, start + j], out[2, i, start + j] = x / length, y / length, z / length


KERNELS = (_add_row, _solve_plane, _fit)
