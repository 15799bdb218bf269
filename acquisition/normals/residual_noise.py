"""How wrong lamps and model are, read off the residuals instead of being assumed.

Two shares of the noise cannot be known beforehand: an error c in proportion to y (lamp intensities, what is left of the
model) and one in proportion to ρ|s| (directions of the light). A residual's spread is √(v (1 − h)), h the leverage of
its measurement in the pixel's own solve with the depth column; c is set so that the median of the whitened bright
residuals is that of a Gaussian, and σ_d likewise by grazing ones. Medians, because a few per cent are half in shadow.

Kernels compile at import, into numba's cache.
"""

from dataclasses import replace

import numba
import numpy as np

from acquisition.models.base import Float32Array, FloatArray
from acquisition.normals import pixel_solve, pixel_solve_kernels
from acquisition.normals.pixel_solve import Estimate
from acquisition.photometry import Noise

GAUSSIAN_MEDIAN_DEVIATION = 0.6745
BRIGHT_COSINE, GRAZING_COSINE = 0.7, 0.4
"""Cosines to the light above which c and below which σ_d shows."""

MAX_LEVERAGE = 0.8
MIN_LIGHTS = 5
MIN_MEASUREMENTS = 300
MIN_PIXEL_SHARE = 0.1
"""Share of the pixels that must show an error. Of a machined part, whose faces meet light steeply, only its edges and
the half shadow at the foot of its walls graze it; what is wrong there is no lamp's direction, and all faces would be
believed less for it."""

INTENSITY_RANGE = (0.001, 0.1)
DIRECTION_RANGE = (0.001, 0.05)
ROUNDS = 2


def estimate(
    found: Estimate, values: Float32Array, noise: Noise, stated: Noise, along: Float32Array, lamp: Float32Array,
    offset_sigma_m: float, extra: Float32Array,
) -> Noise:  # fmt: skip
    """The `noise` that K pixels were solved with, with c and σ_d as these pixels show them.

    Where too few tell, c or σ_d is the `stated` one: what pixels showed that were solved with less knowledge is worth
    less. `values` (F, K) are what `found` was solved from, `extra` (F, K) the variance it was told of beside the
    model's.
    """
    enough = np.count_nonzero(found.weights > 0, axis=0) >= MIN_LIGHTS
    light = found.light[:, :, enough].astype(np.float64)
    change = pixel_solve.depth_derivative(found.light[:, :, enough], found.point[:, enough], along[:, enough], lamp)
    g, y = found.g[:, enough].astype(np.float64), values[:, enough].astype(np.float64)
    slope = np.einsum("fck,ck->fk", change, g)
    bent = light + change * found.offset_m[enough]
    predicted = np.einsum("fck,ck->fk", bent, g)
    rows = np.ascontiguousarray(np.concatenate([bent, slope[:, None]], axis=1))  # (F, 4, K)
    leverage = np.empty(y.shape)
    strength = np.sqrt(np.einsum("fck,fck->fk", light, light)) * np.sqrt(np.sum(g * g, axis=0))
    cosine = predicted / np.maximum(strength, 1e-9)
    used = found.weights[:, enough] > 0
    residual = y - predicted
    added = extra[:, enough]
    for _ in range(ROUNDS):
        variance = noise.variance(np.maximum(y, 0), strength) + added
        _leverage(rows, np.ascontiguousarray(np.where(used, 1 / variance, 0)), offset_sigma_m, leverage)
        told = used & (leverage < MAX_LEVERAGE)
        left = residual**2 / np.maximum(1 - leverage, 0.05)
        bright, grazing = told & (cosine > BRIGHT_COSINE), told & (cosine < GRAZING_COSINE)
        by_intensity, by_direction = y**2, strength**2
        intensity = _median_matched_share(
            left, variance - noise.intensity**2 * by_intensity, by_intensity, bright, INTENSITY_RANGE
        )
        intensity = stated.intensity if intensity is None else intensity
        variance = variance + (intensity**2 - noise.intensity**2) * by_intensity
        direction = _median_matched_share(
            left, variance - noise.direction**2 * by_direction, by_direction, grazing, DIRECTION_RANGE
        )
        noise = replace(noise, intensity=intensity, direction=stated.direction if direction is None else direction)
    return noise


def _median_matched_share(
    squares: FloatArray, rest: FloatArray, by: FloatArray, where: np.ndarray, within: tuple[float, float]
) -> float | None:
    """The share q with median of squares / (rest + q² by) that of a Gaussian; none where too few tell."""
    if np.count_nonzero(where) < MIN_MEASUREMENTS or np.mean(np.any(where, axis=0)) < MIN_PIXEL_SHARE:
        return None
    squares, rest, by = squares[where], rest[where], by[where]
    # squares / (rest + q² by) is above the Gaussian's median where q² is below this.
    return float(
        np.clip(np.sqrt(max(float(np.median((squares / GAUSSIAN_MEDIAN_DEVIATION**2 - rest) / by)), 0.0)), *within)
    )


@numba.njit(
    "void(float64[:,:,::1], float64[:,::1], float64, float64[:,::1])", cache=True, fastmath=True, error_model="numpy"
)
def _leverage(rows: FloatArray, weight: FloatArray, offset_sigma_m: float, out: FloatArray) -> None:
    """Each measurement's leverage (F, K) in its pixel's solve, of rows (F, 4, K) that have weights (F, K)."""
    count = len(rows)
    inner, own = np.empty((4, 4)), np.empty((4, count))
    for p in range(rows.shape[2]):
        for f in range(count):
            root = np.sqrt(weight[f, p])
            for i in range(4):
                own[i, f] = root * rows[f, i, p]
        for i in range(4):
            for j in range(i + 1):
                total = 0.0
                for f in range(count):
                    total += own[i, f] * own[j, f]
                inner[i, j] = total
            inner[i, i] += 1e-6 if i < 3 else offset_sigma_m**-2
        pixel_solve_kernels.cholesky(inner)
        pixel_solve_kernels.forward_substitution(inner, own)
        for f in range(count):
            total = 0.0
            for i in range(4):
                total += own[i, f] * own[i, f]
            out[f, p] = total


KERNELS = (_leverage,)
