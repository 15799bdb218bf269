"""Relative light intensities from the images: one log factor per image, with the pixels' normals eliminated.

Folders often say nothing of the lamps' brightness, or too little: real ones are off by up to ±26 %. A wrong factor
tilts normals everywhere and leaves a step wherever its light falls into shadow. Under Lambert's law y = e^t ρ n·l, the
factor t of an image and the scaled normals g = ρ n of all pixels are found together: Gauss–Newton on a sample of
pixels, robust (Cauchy weights), with each pixel's g eliminated from the normal equations (Schur complement), as in
self-calibration under near light (`normals.self_calibration`). The mean of t is zero: the scale of albedo is arbitrary.

Gloss and rough surfaces leave residuals that factors can absorb, so the factors are tested before they are used: found
from one half of the pixels, they have to predict the other half's measurements, each from the other images of its pixel
(leave-one-image-out residual, from the leverage), distinctly better than the stated intensities do. The fit to all
pixels starts from the factors that have passed, so that it cannot end in another minimum.
"""

from dataclasses import dataclass

import numpy as np

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.tuned import tuned
from acquisition.normals.distant import robust_regression, solvers


@dataclass(frozen=True)
class LightIntensitySettings:
    """Tuned numbers of the intensities of distant lights."""

    prior_sigma: float = tuned(0.3, "1")
    """Prior 1 σ of a log factor: the largest deviation seen on real folders is 26 %."""
    correlated_pixels: float = tuned(500.0, "pixels")
    """Sampled pixels that err together, since reflectance and indirect light err alike over whole regions: the images'
    information is divided by it. On a flat part, whose few normals hardly tell factors from a tilt, it keeps factors
    near one: 20, 100 and 500 leave 6.7°, 5.8° and 4.6° where equal lamps are fitted (3.8° unfitted), and rounded bodies
    do not feel it (`tests/acquisition/normals/distant/few_light_scenes.py`, seeds 0 and 1)."""
    max_error_ratio: float = tuned(0.55, "1")
    """Greatest ratio of leave-one-image-out errors, with and without factors, at which they are used. On 32 rendered
    scenes of twelve lights it is 0.56–1.96 where lamps are equal, 0.15–0.65 where they scatter by 6 % (above 0.55 on
    four), 0.06–0.38 at 15 % and 0.03–0.28 at 30 % (`pytest -m long -s
    tests/acquisition/normals/distant/test_light_intensities.py`)."""
    free_steps: int = tuned(8, "iterations")
    """First steps in which the prior weighs as little as against images without noise. What unequal lamps leave in the
    residuals is no noise: weighed by it from the start, the prior holds factors near one, where they leave as much
    again. Of 140 balls under 8, 12 and 20 lights that scatter by 30 % (those of
    `tests/acquisition/normals/distant/test_light_intensities.py`, seeds 0–139) 10, 4 and 3 are refused or wrong with
    one such step, 3, 1 and 1 with two, one with four, none with eight."""
    min_spread: float = tuned(0.005, "of the albedo")
    """Least spread of the residuals, as a share of the pixel's albedo."""
    max_leverage: float = tuned(0.9, "share")
    """Leverage above which a measurement is not predicted by the other images of its pixel."""


SETTINGS = LightIntensitySettings()

MIN_LIGHTS = 2 * photometry.PIXEL_UNKNOWNS
"""Least number of lights: with fewer, a pixel's own unknowns leave too little to tell its lights apart."""

ITERATIONS = 25
"""Gauss–Newton steps at most."""

TOLERANCE = 1e-4
"""Largest change of a log factor at which the iteration ends."""


@dataclass(frozen=True)
class IntensityFactors:
    """Factors (F, C) of the stated intensities, all 1 where the test refused them, and what the test says."""

    factors: FloatArray
    why: str


def estimate(values: Float32Array, clipped: BoolArray, directions: FloatArray) -> IntensityFactors:
    """Estimates and tests factors from a sample of pixels (C, K, F), each channel divided by the stated intensities."""
    channels, pixels, count = values.shape
    if count < MIN_LIGHTS:
        return IntensityFactors(
            np.ones((count, channels)), f"as stated: {count} lights are too few to find their intensities"
        )
    order = np.random.default_rng(0).permutation(pixels)
    halves = (np.sort(order[::2]), np.sort(order[1::2]))
    equal = np.zeros(count)
    stated: list[float] = []
    refitted: list[float] = []
    starts = np.zeros((channels, count))
    for channel, (one, full) in enumerate(zip(values, clipped, strict=True)):
        for own, other in (halves, halves[::-1]):
            log_factors = fit(one[own], full[own], directions, equal, share=len(own) / pixels)
            stated.append(_prediction_error(one[other], full[other], directions, equal))
            refitted.append(_prediction_error(one[other], full[other], directions, log_factors))
            starts[channel] += log_factors / 2
    before, after = float(np.mean(stated)), float(np.mean(refitted))
    verdict = f"leave-one-image-out error {100 * before:.2f} % as stated, {100 * after:.2f} % as found"
    if not after < SETTINGS.max_error_ratio * before:
        return IntensityFactors(np.ones((count, channels)), f"as stated: {verdict}")
    found = [fit(one, full, directions, start) for one, full, start in zip(values, clipped, starts, strict=True)]
    return IntensityFactors(np.exp(np.stack(found, axis=1)), f"found: {verdict}")


def fit(
    values: Float32Array, clipped: BoolArray, directions: FloatArray, start: FloatArray, *, share: float = 1.0
) -> FloatArray:
    """Maximum a posteriori log factors (F,), mean zero, of pixels (K, F), by robust Gauss–Newton from `start` (F,).

    `share` of the sample that these pixels are: the prior weighs as much as it does against all of them.
    """
    count = len(directions)
    log_factors = start.copy()
    usable = solvers.shadow_weights(values, clipped)
    scaled, weight = _robust_normals(values * np.exp(-log_factors), usable, directions)
    for iteration in range(ITERATIONS):
        predicted = scaled @ directions.T
        residual = values * np.exp(-log_factors) - predicted
        albedo = np.maximum(np.linalg.norm(scaled, axis=1, keepdims=True), 1e-12)
        lit = np.maximum(predicted, 0) * usable
        # Relative to its albedo each pixel counts alike. In y e^-t - g·l the column of t is the measurement's own
        # value, which is taken as predicted: the noise in it would pull factors down.
        w = weight / albedo**2
        matrix = np.einsum("kf,fa,fb->kab", w, directions, directions, optimize=True)
        matrix += 1e-6 * np.eye(3) * np.trace(matrix, axis1=1, axis2=2)[:, None, None] + 1e-12 * np.eye(3)
        cross = (w * lit)[:, :, None] * directions  # (K, F, 3)
        solved = np.linalg.solve(matrix, cross.transpose(0, 2, 1))  # (K, 3, F)
        normal = np.diag(np.sum(w * lit**2, axis=0)) - np.einsum("kfa,kag->fg", cross, solved, optimize=True)
        right = np.sum(w * lit * residual, axis=0)
        right -= np.einsum("kag,ka->g", solved, np.einsum("kf,fa->ka", w * residual, directions), optimize=True)
        noise = np.sum(weight * (residual / albedo) ** 2) / max(np.sum(weight > 0) - 3 * len(values), 1)
        noise = max(noise, SETTINGS.min_spread**2) if iteration >= SETTINGS.free_steps else SETTINGS.min_spread**2
        prior = share * SETTINGS.correlated_pixels * noise / SETTINGS.prior_sigma**2
        step = np.linalg.solve(
            normal + prior * np.eye(count) + np.mean(np.diag(normal)) * np.ones((count, count)) / count,
            right - prior * log_factors,
        )
        step -= np.mean(step)
        log_factors += np.clip(step, -0.3, 0.3)
        log_factors -= np.mean(log_factors)
        scaled, weight = _robust_normals(values * np.exp(-log_factors), usable, directions)
        if iteration >= SETTINGS.free_steps and np.max(np.abs(step)) < TOLERANCE:
            break
    return log_factors


def _robust_normals(
    values: FloatArray | Float32Array, usable: Float32Array, directions: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Scaled normals (K, 3) and the weights (K, F) at which they are the least-squares solution."""
    fitted, statistics = solvers.robust_fit(
        np.ascontiguousarray(values, dtype=np.float32),
        usable,
        directions,
        robust_regression.SETTINGS.position_thresholds,
        robust_regression.MAX_ITERATIONS,
    )
    scaled = fitted.astype(float)
    albedo = np.linalg.norm(scaled, axis=1, keepdims=True)
    spread = np.maximum(np.sqrt(statistics[:, :1]), SETTINGS.min_spread * albedo)
    weight = usable / (
        1
        + ((values - scaled @ directions.T) / (robust_regression.SETTINGS.cauchy_scale * np.maximum(spread, 1e-12)))
        ** 2
    )
    return scaled, np.where((albedo > 0) & (np.sum(usable, axis=1, keepdims=True) > 3), weight, 0.0)


def _prediction_error(
    values: Float32Array, clipped: BoolArray, directions: FloatArray, log_factors: FloatArray
) -> float:
    """Geometric mean over pixels of the median leave-one-image-out residual, as a share of the albedo."""
    corrected = values * np.exp(-log_factors)
    scaled, weight = _robust_normals(corrected, solvers.shadow_weights(values, clipped), directions)
    matrix = np.einsum("kf,fa,fb->kab", weight, directions, directions, optimize=True)
    kept = np.sum(weight > 0, axis=1) > 4
    inverse = np.linalg.inv(matrix[kept] + 1e-9 * np.eye(3))
    leverage = weight[kept] * np.einsum("fa,kab,fb->kf", directions, inverse, directions, optimize=True)
    albedo = np.linalg.norm(scaled[kept], axis=1, keepdims=True)
    residual = np.abs(corrected[kept] - scaled[kept] @ directions.T) / np.maximum(albedo, 1e-12)
    predicted = np.where((weight[kept] > 0) & (leverage < SETTINGS.max_leverage), residual / (1 - leverage), np.nan)
    enough = np.count_nonzero(np.isfinite(predicted), axis=1) >= 3
    if not np.any(enough):
        return np.inf
    return float(np.exp(np.mean(np.log(np.nanmedian(predicted[enough], axis=1) + 1e-5))))
