"""Noise scales of lamps and model, estimated from the residuals of the pixel solve.

Two components of the noise are not known beforehand: an error c in proportion to y (lamp intensities, model error), and
an error σ_d in proportion to ρ|s| (light directions). The σ of a residual is √(v (1 − h)), where h is the leverage of
its measurement in the pixel's own solve. c is set so that the median of the squared whitened residuals of bright
measurements is that of a Gaussian (median absolute deviation); σ_d is set in the same way by grazing measurements.
Medians are used because a few per cent of the measurements lie in penumbrae.

Kernels compile at import, into numba's cache.
"""

from dataclasses import dataclass, replace

import numba
import numpy as np

from acquisition import photometry
from acquisition.image_values import Noise
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.tuned import tuned
from acquisition.normals import self_calibration
from acquisition.normals.pixels import pixel_solve_kernels
from acquisition.normals.pixels.pixel_solve import Estimate


@dataclass(frozen=True)
class ResidualNoiseSettings:
    """Tuned numbers of the noise from residuals."""

    max_leverage: float = tuned(0.8, "share")
    """Leverage above which a residual is not used, because too little of its noise is left: at this value a fifth of
    the variance. P(e < σ) of the prototype is then 0.62 and 0.60 at intensity errors of 0.3 and 3 % (decision 36)."""
    bounds: tuple[float, float] = tuned((0.001, 0.05), "1")
    """Lower and upper bounds of c, a fraction, and of σ_d, rad. Measured for the upper one (scratch evaluations,
    November 2026): with 0.03 errors of 27 sound captures of design seeds 101–104 are 0.997 ± 0.003 of those with 0.05,
    but a turned part that moves by two pixels (seed 62) errs by 3.6 instead of 2.2°; with 0.1 rms e/σ of a vessel that
    no model fits (family seed 0, Oren-Nayar, eight lights, 64 px) is 2.4 instead of 1.3."""


SETTINGS = ResidualNoiseSettings()

ROUNDS = 2
"""Number of alternations of c and σ_d."""


def estimate(solution: Estimate, values: Float32Array, noise: Noise, stated: Noise, extra: Float32Array) -> Noise:
    """Estimates the scales c and σ_d robustly from K pixels' residuals, in the `noise` that they were solved with.

    If too few measurements determine c or σ_d, the `stated` value is used, not that of an earlier round, which was
    solved with less knowledge. `values` (F, K) are what `solution` was solved from, `extra` (F, K) is their variance
    beyond the noise model's.
    """
    residuals = _Residuals.of(solution, values, extra, photometry.REDUNDANT)
    least_pixels = photometry.SETTINGS.min_pixel_share * np.count_nonzero(np.any(residuals.used, axis=0))
    cosine = residuals.predicted / np.maximum(residuals.strength, 1e-9)
    by_intensity, by_direction = residuals.values**2, residuals.strength**2
    for _ in range(ROUNDS):
        variance, squares, counted = residuals.studentised(noise)
        intensity = _median_matched_share(
            squares, variance - noise.intensity**2 * by_intensity, by_intensity,
            counted & (cosine > photometry.SETTINGS.grazing_cosine), least_pixels,
        )  # fmt: skip
        intensity = stated.intensity if intensity is None else intensity
        variance = variance + (intensity**2 - noise.intensity**2) * by_intensity
        direction = _median_matched_share(
            squares, variance - noise.direction**2 * by_direction, by_direction,
            counted & (cosine < photometry.SETTINGS.grazing_cosine), least_pixels,
        )  # fmt: skip
        noise = replace(noise, intensity=intensity, direction=stated.direction if direction is None else direction)
    return noise


def studentised_squares(
    solution: Estimate, values: Float32Array, noise: Noise, extra: Float32Array
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Returns squared residuals (F, K) over v (1 − h), their expectation in the given `noise`, the same over the
    squared value and 1 − h, and which of them count.

    Pixels need five usable lights, or four if there are only four images (`photometry.REDUNDANT`). Measurements of
    leverage above `max_leverage` do not count. Arguments are those of `estimate`.
    """
    least_lights = min(len(values), photometry.REDUNDANT)
    variance, squares, counted = _Residuals.of(solution, values, extra, least_lights).studentised(noise)
    return squares / variance, squares / np.maximum(values, 1e-6) ** 2, counted


@dataclass(frozen=True)
class _Residuals:
    """Least squares of K pixels: Lambert's rows s (F, 3, K); values, predicted values, ρ|s| and variance beyond the
    noise model's (F, K); and the measurements that are used, of pixels with enough of them.

    Leverages are those of Lambert's law, also if there are further terms. With the rows s + ∂h/∂g of a lobe, the few
    measurements that determine it have such leverage that in four images gloss fits no better than no gloss.
    """

    rows: FloatArray
    values: FloatArray
    predicted: FloatArray
    strength: FloatArray
    extra: Float32Array
    used: BoolArray

    @classmethod
    def of(cls, solution: Estimate, values: Float32Array, extra: Float32Array, least_lights: int) -> "_Residuals":
        light, g = solution.light.astype(np.float64), solution.g.astype(np.float64)
        strength = photometry.strength(light) * np.sqrt(np.sum(g * g, axis=0))
        used = solution.weights > 0
        used &= np.count_nonzero(used, axis=0) >= max(least_lights, photometry.OVERDETERMINED)
        predicted = solution.predicted(np.float64)
        return cls(np.ascontiguousarray(light), values.astype(np.float64), predicted, strength, extra, used)

    def studentised(self, noise: Noise) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Returns variance v in a `noise`, squared residuals over 1 − h, and which of them count; each (F, K)."""
        variance = noise.variance(np.maximum(self.values, 0), self.strength) + self.extra
        leverage = np.empty(variance.shape)
        _leverage(self.rows, np.ascontiguousarray(np.where(self.used, 1 / variance, 0)), leverage)
        counted = self.used & (leverage < SETTINGS.max_leverage)
        return variance, (self.values - self.predicted) ** 2 / np.where(counted, 1 - leverage, 1), counted


def _median_matched_share(
    squares: FloatArray, rest: FloatArray, by: FloatArray, where: BoolArray, least_pixels: float
) -> float | None:
    """Returns the q for which the median of squares / (rest + q² by) is that of a Gaussian; none if too few
    measurements or pixels count."""
    where = where & (by > 0)  # predictions of 0, as for metal between highlights, have no information
    pixels = np.count_nonzero(np.any(where, axis=0))
    if np.count_nonzero(where) < self_calibration.SETTINGS.independent_sample or pixels < least_pixels:
        return None
    # squares / (rest + q² by) is above the Gaussian's median where q² is below this.
    bound = float(np.median((squares[where] / photometry.GAUSSIAN_MEDIAN_DEVIATION**2 - rest[where]) / by[where]))
    return float(np.clip(np.sqrt(max(bound, 0.0)), *SETTINGS.bounds))


@numba.njit("void(float64[:,:,::1], float64[:,::1], float64[:,::1])", cache=True, fastmath=True, error_model="numpy")
def _leverage(rows: FloatArray, weight: FloatArray, out: FloatArray) -> None:
    """Computes the leverage (F, K) of measurements in their pixels' least squares: rows (F, 3, K), weights (F, K)."""
    count = len(rows)
    inner, own, regular = np.empty((3, 3)), np.empty((3, count)), np.full(3, 1e-6)
    for p in range(rows.shape[2]):
        for f in range(count):
            root = np.sqrt(weight[f, p])
            for i in range(3):
                own[i, f] = root * rows[f, i, p]
        pixel_solve_kernels.orthonormalise(own, regular, inner)
        for f in range(count):
            total = 0.0
            for i in range(3):
                total += own[i, f] * own[i, f]
            out[f, p] = total


KERNELS = (_leverage,)
