"""Projection of a normal map onto integrable ones: generalised least squares under the zero-curl constraint.

A normal has two unknowns, a surface only one at each pixel. The slopes of a surface along rows and columns derive from
one depth, so their circulation round any cell of 2 × 2 pixels is zero (integrability; Frankot & Chellappa 1988). Pixels
are solved one by one without this constraint, so a circulation is an error. The projection removes it by the least
change of all normals in the metric of their covariances. This halves the variance that pixels do not share. It does not
smooth: relief of any fineness is integrable and is kept. Errors of the lamps stay too: they tilt all normals much as a
surface could.

At occluding contours, discontinuities and creases, a circulation is larger than its noise explains, or curvature makes
a pixel's mean normal differ from its mean slope. The constraint of such a cell gets a variance of its own. The change
is small, so slopes are linearised; it is local, so strips of rows are projected one after another. The dual problem,
with one multiplier per cell, is solved by Jacobi-preconditioned conjugate gradients.

Kernels compile at import, into numba's cache.
"""

from dataclasses import dataclass

import numba
import numpy as np
from scipy.sparse.linalg import LinearOperator, cg

from acquisition import photometry
from acquisition.models.base import Float32Array
from acquisition.models.tuned import tuned


@dataclass(frozen=True)
class IntegrabilitySettings:
    """Tuned number of the projection onto integrable normals."""

    curvature_sigma: float = tuned(0.05, "share")
    """1 σ of the circulation as a share of the slope differences within the cell, because pixels are areas, not points.
    A larger value weakens the constraint where the surface is curved. Measured: against 0.03 errors of fine relief fall
    by 2–3 %, those of other objects rise by less than 1 % (November 2026)."""


SETTINGS = IntegrabilitySettings()

ITERATIONS = 10
"""Iterations of conjugate gradients. Noise is local; after five of them errors fall by less than a hundredth."""

CONVERGED = 1e-10
"""Residual, as a share of the first, at which the iteration ends: only where few cells are complete, for which further
iterations would divide zero by zero."""

TINY = np.finfo(np.float32).tiny

LEAST_COSINE = photometry.SETTINGS.min_view_cosine


SAMPLED_CELLS = 20_000
"""Approximate number of cells of a strip whose circulations determine the noise ratio."""

STRIP_ROWS, OVERLAP_ROWS = 256, 12
"""Rows of a strip, and extra rows above and below that are solved with it to avoid seams between strips."""


def project_integrable(
    normals: Float32Array, sigma_deg: Float32Array, variance: Float32Array, ray: Float32Array
) -> float:
    """Projects unit normals (H, W, 3), view frame, onto integrable ones by least squares, and lowers their σ, in place.

    `sigma_deg` (H, W) is 1 σ over both tangential directions, as in NormalMap, NaN where there is no normal. `variance`
    (H, W), rad², is the part of its square by errors that pixels do not share; it is lowered as well. `ray` (2, H, W)
    are the pixels' rays.

    Returns the noise ratio: the variance that pixels do not share by the circulations, over the stated `variance`. It
    follows from the median of the squared circulations, which a surface does not have, and is 1 if they are too few.
    """
    height, width = variance.shape
    if min(height, width) < 2:
        return 1.0
    squares: list[Float32Array] = []
    pitch = np.float32(abs(ray[0, height // 2, -1] - ray[0, height // 2, 0]) / (width - 1))
    above = normals[:0].copy(), variance[:0].copy()
    for start in range(0, height, STRIP_ROWS):
        stop, below = min(start + STRIP_ROWS, height), min(start + STRIP_ROWS + OVERLAP_ROWS, height)
        known = np.isfinite(sigma_deg[start:below])
        strip = np.concatenate([above[0], normals[start:below]])
        before = np.concatenate([above[1], np.where(known, variance[start:below], 0)])
        first = len(above[0])
        last = first + stop - start
        above = strip[max(last - OVERLAP_ROWS, 0) : last].copy(), before[max(last - OVERLAP_ROWS, 0) : last]
        if len(strip) < 2:
            continue
        left, relative = _project_strip(strip, before, ray[:, start - first : below], pitch)
        left = left[first:last]
        squares.append(relative)
        normals[start:stop] = strip[first:last]
        add_variance(sigma_deg[start:stop], variance[start:stop], (left - 1) * before[first:last])
    found = np.concatenate(squares) if squares else np.zeros(0, np.float32)
    if len(found) < photometry.SETTINGS.min_sample:
        return 1.0
    return float(np.median(found)) / photometry.GAUSSIAN_MEDIAN_DEVIATION**2


def add_variance(sigma_deg: Float32Array, variance: Float32Array, change: Float32Array) -> None:
    """Adds a `change` (h, w), rad², of the variance that pixels do not share to `variance` and to `sigma_deg` squared,
    in place. Above `unchecked_sigma_deg` errors come from too few lights and are shared: nothing is added."""
    unchecked = sigma_deg > photometry.SETTINGS.unchecked_sigma_deg
    change = np.where(unchecked, 0, change).astype(np.float32)
    sigma_deg[:] = np.degrees(np.sqrt(np.maximum(np.radians(sigma_deg) ** 2 + change, 0)))
    variance += change


def _project_strip(
    normals: Float32Array, variance: Float32Array, ray: Float32Array, pitch: np.float32
) -> tuple[Float32Array, Float32Array]:
    """Projects the normals (h, w, 3) of one strip, in place; a variance of zero marks a pixel without a normal.

    Returns the remaining share (h, w) of their variance, and the squared circulations (C,) of a sample of cells over
    their expectation by noise.
    """
    height, width = variance.shape
    down, across = (np.gradient(ray, axis=axis) / pitch for axis in (1, 2))
    rays = np.ascontiguousarray(np.concatenate([ray, across, down]), np.float32)
    slope = np.empty((5, height, width), np.float32)
    _slopes(normals, variance, rays, slope)
    shape = (height + 1, width + 1)  # a multiplier for each cell of 2 × 2 pixels, and zeros at the border
    circulation, slack, inverse = (np.zeros(shape, np.float32) for _ in range(3))
    _circulations(slope, photometry.CAUCHY_SCALE, SETTINGS.curvature_sigma, circulation, slack, inverse)
    noise = np.where(inverse > 0, 1 / np.maximum(inverse, TINY) - slack, 0)
    some = np.flatnonzero(noise)[:: 1 + np.count_nonzero(noise) // SAMPLED_CELLS]
    relative = np.asarray(circulation.ravel()[some] ** 2 / noise.ravel()[some], np.float32)
    change, image = np.empty((2, height, width), np.float32), np.zeros(shape, np.float32)
    complete = (inverse > 0).astype(np.float32)  # other cells have no multiplier, so their circulation does not count

    def applied(multiplier: Float32Array) -> Float32Array:
        _slope_changes(multiplier.reshape(shape), slope, change)
        _apply(change, multiplier.reshape(shape), slack, image)
        np.multiply(image, complete, out=image)
        return image.ravel()

    count = circulation.size
    found, _ = cg(
        LinearOperator((count, count), matvec=applied, dtype=np.float32),
        circulation.ravel(), rtol=CONVERGED, atol=TINY, maxiter=ITERATIONS,
        M=LinearOperator((count, count), matvec=lambda residual: inverse.ravel() * residual, dtype=np.float32),
    )  # fmt: skip
    multiplier = np.asarray(found, np.float32).reshape(shape)
    _slope_changes(multiplier, slope, change)
    left = np.empty((height, width), np.float32)
    _update_normals(normals, rays, slope, change, slack, inverse, left)
    return left, relative


@numba.njit(
    "void(float32[:,:,::1], float32[:,::1], float32[:,:,::1], float32[:,:,::1])",
    cache=True, parallel=True, fastmath={"contract", "arcp", "nsz", "reassoc"}, error_model="numpy",
)  # fmt: skip
def _slopes(normals: Float32Array, variance: Float32Array, rays: Float32Array, out: Float32Array) -> None:
    """Computes the slopes of log depth along rows and columns, per pitch, and their covariance: p, q, C_pp, C_pq, C_qq.

    n·∂(Zr)/∂u = 0 gives p = −n·r_u / n·r. With the tangent t_u = r_u + p r, a rotation δn changes p by −t_u·δn / n·r.
    Noise that is isotropic in the tangent plane has the covariance σ²/2 (t·t) / (n·r)². Pixels without a normal get 0.
    """
    height, width = variance.shape
    for i in numba.prange(height):
        for j in range(width):
            nx, ny, nz = normals[i, j, 0], normals[i, j, 1], normals[i, j, 2]
            x, y = rays[0, i, j], -rays[1, i, j]
            ax, ay, bx, by = rays[2, i, j], -rays[3, i, j], rays[4, i, j], -rays[5, i, j]
            towards = nx * x + ny * y - nz
            v = variance[i, j]
            for k in range(5):
                out[k, i, j] = 0.0
            if not (v > 0) or towards * towards < LEAST_COSINE**2 * (x * x + y * y + 1) or towards > 0:
                continue
            p, q = -(nx * ax + ny * ay) / towards, -(nx * bx + ny * by) / towards
            ux, uy, uz = ax + p * x, ay + p * y, -p
            vx, vy, vz = bx + q * x, by + q * y, -q
            v *= np.float32(0.5) / (towards * towards)
            out[0, i, j], out[1, i, j] = p, q
            out[2, i, j] = v * (ux * ux + uy * uy + uz * uz)
            out[3, i, j] = v * (ux * vx + uy * vy + uz * vz)
            out[4, i, j] = v * (vx * vx + vy * vy + vz * vz)


@numba.njit(
    "void(float32[:,:,::1], float64, float64, float32[:,::1], float32[:,::1], float32[:,::1])",
    cache=True, parallel=True, fastmath=True, error_model="numpy",
)  # fmt: skip
def _circulations(
    slope: Float32Array, limit: float, curvature_sigma: float, total: Float32Array, slack: Float32Array,
    inverse: Float32Array,
) -> None:  # fmt: skip
    """Computes the circulation round each cell, the variance of its constraint, and 1 / the total variance. `limit` is
    Cauchy's scale, `curvature_sigma` that of the settings."""
    height, width = slope.shape[1:]
    for i in numba.prange(height - 1):
        for j in range(width - 1):
            if slope[2, i, j] <= 0 or slope[2, i, j + 1] <= 0 or slope[2, i + 1, j] <= 0 or slope[2, i + 1, j + 1] <= 0:
                continue
            p00, p01, p10, p11 = slope[0, i, j], slope[0, i, j + 1], slope[0, i + 1, j], slope[0, i + 1, j + 1]
            q00, q01, q10, q11 = slope[1, i, j], slope[1, i, j + 1], slope[1, i + 1, j], slope[1, i + 1, j + 1]
            added = np.float32(0.5) * (p10 + p11 - p00 - p01 + q00 + q10 - q01 - q11)
            noise = np.float32(0.0)
            for k in range(2):
                noise += slope[2, i, j + k] + slope[2, i + 1, j + k] + slope[4, i, j + k] + slope[4, i + 1, j + k]
            mixed = slope[3, i, j + 1] + slope[3, i + 1, j] - slope[3, i, j] - slope[3, i + 1, j + 1]
            noise += np.float32(2.0) * mixed
            noise *= np.float32(0.25)
            curvature = (p00 - p11) ** 2 + (p01 - p10) ** 2 + (q00 - q11) ** 2 + (q01 - q10) ** 2
            known = noise + np.float32(curvature_sigma**2) * curvature
            variance = max(known, added * added / np.float32(limit**2))
            total[i + 1, j + 1] = added
            slack[i + 1, j + 1] = variance - noise
            inverse[i + 1, j + 1] = 1 / variance


@numba.njit(
    "void(float32[:,::1], float32[:,:,::1], float32[:,:,::1])",
    cache=True, parallel=True, fastmath=True, error_model="numpy",
)  # fmt: skip
def _slope_changes(multiplier: Float32Array, slope: Float32Array, change: Float32Array) -> None:
    """Computes the change of the slopes (2, h, w) by a multiplier of each cell: covariance times adjoint curl."""
    height, width = slope.shape[1:]
    half = np.float32(0.5)
    for i in numba.prange(height):
        for j in range(width):
            a, b, c, d = multiplier[i, j], multiplier[i, j + 1], multiplier[i + 1, j], multiplier[i + 1, j + 1]
            p, q = half * (a + b - c - d), half * (b + d - a - c)
            change[0, i, j] = slope[2, i, j] * p + slope[3, i, j] * q
            change[1, i, j] = slope[3, i, j] * p + slope[4, i, j] * q


@numba.njit(
    "void(float32[:,:,::1], float32[:,::1], float32[:,::1], float32[:,::1])",
    cache=True, parallel=True, fastmath=True, error_model="numpy",
)  # fmt: skip
def _apply(change: Float32Array, multiplier: Float32Array, slack: Float32Array, out: Float32Array) -> None:
    """Applies the dual system's matrix: circulation of the slope changes plus constraint variance × multiplier."""
    height, width = change.shape[1:]
    half = np.float32(0.5)
    for i in numba.prange(height - 1):
        for j in range(width - 1):
            across = change[0, i + 1, j] + change[0, i + 1, j + 1] - change[0, i, j] - change[0, i, j + 1]
            down = change[1, i, j] + change[1, i + 1, j] - change[1, i, j + 1] - change[1, i + 1, j + 1]
            out[i + 1, j + 1] = half * (across + down) + slack[i + 1, j + 1] * multiplier[i + 1, j + 1]


@numba.njit(
    "void(float32[:,:,::1], float32[:,:,::1], float32[:,:,::1], float32[:,:,::1], float32[:,::1], float32[:,::1],"
    " float32[:,::1])",
    cache=True, parallel=True, fastmath=True, error_model="numpy",
)  # fmt: skip
def _update_normals(
    normals: Float32Array, rays: Float32Array, slope: Float32Array, change: Float32Array, slack: Float32Array,
    inverse: Float32Array, left: Float32Array,
) -> None:  # fmt: skip
    """Computes the normals of the slopes less their changes, and approximately the remaining share of their variance.

    Each cell measures a pixel's slopes with the uncertainty of its other three pixels. These are improved by their own
    cells as well, so two thirds of their variance count; for equal variances this gives the exact half.
    """
    height, width = left.shape
    for i in numba.prange(height):
        for j in range(width):
            left[i, j] = 1.0
            if slope[2, i, j] <= 0:
                continue
            x, y = rays[0, i, j], -rays[1, i, j]
            p, q = slope[0, i, j] - change[0, i, j], slope[1, i, j] - change[1, i, j]
            ux, uy, uz = rays[2, i, j] + p * x, -rays[3, i, j] + p * y, -p
            vx, vy, vz = rays[4, i, j] + q * x, -rays[5, i, j] + q * y, -q
            nx, ny, nz = vy * uz - vz * uy, vz * ux - vx * uz, vx * uy - vy * ux
            length = np.sqrt(nx * nx + ny * ny + nz * nz)
            normals[i, j, 0], normals[i, j, 1], normals[i, j, 2] = nx / length, ny / length, nz / length
            information = np.float32(0)  # from the cells round the pixel, in units of the pixel's own
            for a in range(2):
                for b in range(2):
                    if inverse[i + a, j + b] <= 0:
                        continue
                    mixed = -slope[3, i, j] if a == b else slope[3, i, j]
                    own = np.float32(0.25) * (slope[2, i, j] + slope[4, i, j]) + np.float32(0.5) * mixed
                    cell = slack[i + a, j + b]
                    others = 1 / inverse[i + a, j + b] - cell - own
                    information += np.float32(0.5) * own / (np.float32(2 / 3) * others + cell)
            left[i, j] = 1 / (1 + information)


KERNELS = (_slopes, _circulations, _slope_changes, _apply, _update_normals)
