"""Solve of pixels given what all pixels share, and estimation of the noise from the residuals of a sample.

The mean of the weak prior is the viewing axis, not the neighbours' normals, which are wrong beside walls and in holes.
Light that is subtracted depends on the albedo that is solved for, so that pixels are solved by fixed-point iteration.
The noise is estimated from a sample at full resolution, because that of the coarse grid's block means is another.
"""

from dataclasses import dataclass, replace

import numpy as np

from acquisition import image_values, photometry
from acquisition.models.base import BoolArray, Float32Array
from acquisition.normals import alternation
from acquisition.normals.alternation import AlternationResult
from acquisition.normals.indirect_light import interreflection
from acquisition.normals.pixels import pixel_solve, robust_solve
from acquisition.normals.pixels.pixel_solve import Estimate, Lighting, Pixels, Scene
from acquisition.normals.uncertainty import goodness_of_fit, residual_noise
from acquisition.normals.uncertainty.goodness_of_fit import Fit

PRELIMINARY_ITERATIONS = 3
"""Iterations of a solve whose albedo and normals serve only to subtract light."""

SAMPLE_PIXELS = 4000
"""Pixels from which the noise is estimated."""


@dataclass(frozen=True)
class PixelSolution:
    """Final solve of N pixels: the estimate, `measured` values of nominal lamps (F, N), the `values` that were solved
    after subtraction of `indirect` light (F, N), their variance beyond the noise model's (F, N), and which are hardly
    lit (N,)."""

    estimate: Estimate
    measured: Float32Array
    values: Float32Array
    extra_variance: Float32Array
    indirect: Float32Array | None
    hardly_lit: BoolArray

    @property
    def variance(self) -> Float32Array:
        """Variance (N,), rad², of the normals; that of a random normal where hardly any lamp reaches."""
        return np.where(self.hardly_lit, np.float32(photometry.RANDOM_NORMAL_VARIANCE), self.estimate.variance)


def solve_pixels(pixels: Pixels, state: AlternationResult, scene: Scene) -> PixelSolution:
    """Solves pixels by fixed-point iteration, because indirect light depends on the albedo."""
    pixels = replace(pixels, sky=state.sky)
    measured = alternation.divide_intensity(pixels.values, state.shared.log_intensity)
    lighting = Lighting.at(pixels, state.depth_m, scene)

    def once(values: Float32Array, extra: Float32Array | None, iterations: int) -> Estimate:
        return pixel_solve.solve_lit(pixels, values, lighting, scene, iterations=iterations, extra_variance=extra)

    values, extra, indirect, irradiance = measured, None, None, state.indirect_irradiance
    estimate = once(values, None, robust_solve.IRLS_ITERATIONS if irradiance is None else PRELIMINARY_ITERATIONS)
    if irradiance is not None:
        for iterations in (PRELIMINARY_ITERATIONS, robust_solve.IRLS_ITERATIONS):
            other = np.sum(np.broadcast_to(estimate.nondiffuse_value, values.shape), axis=0)
            indirect = interreflection.reflected_radiosity(
                irradiance, np.sum(measured, axis=0) - other, np.sum(values, axis=0) - other, estimate.albedo
            )
            values = measured - indirect
            extra = np.square(np.float32(photometry.SETTINGS.predicted_indirect_sigma) * indirect)
            estimate = once(values, extra, iterations)
    extra = np.zeros_like(measured) if extra is None else extra
    if estimate.terms is not None:
        extra = extra + estimate.terms.highlight_variance
    hardly_lit = alternation.hardly_lit(
        state.indirect_irradiance, measured, estimate, scene.terms, state.typical_albedo
    )
    return PixelSolution(estimate, measured, values, pixels.plus_extra(extra), indirect, hardly_lit)


def noise_sample(count: int) -> np.ndarray:
    """Draws the numbers (K,), sorted, of the pixels among `count` that estimate the noise; the seed is fixed."""
    return np.sort(np.random.default_rng(1).permutation(count)[:SAMPLE_PIXELS])


@dataclass(frozen=True)
class SolvedSample:
    """Sample pixels (K) that lamps reach and that do not mix surfaces, the state there, and their solution."""

    pixels: Pixels
    state: AlternationResult
    solution: PixelSolution

    def solved_again(self, scene: Scene) -> PixelSolution:
        """Solves normals and albedo again in another scene; what pixels share stays as it is."""
        return solve_pixels(self.pixels, self.state, scene)

    def fit(self, solution: PixelSolution, stated: image_values.Noise) -> Fit:
        """Returns the goodness of fit of a solution of the sample in the stated noise."""
        ray = self.pixels.ray
        low, high = ray.min(axis=1, keepdims=True), ray.max(axis=1, keepdims=True)
        place = ((ray - low) / np.maximum(high - low, 1e-9))[::-1]
        return goodness_of_fit.evaluate(solution.estimate, solution.values, stated, solution.extra_variance, place)


def with_residual_noise(sample: Pixels, state: AlternationResult, scene: Scene) -> tuple[Scene, SolvedSample]:
    """Estimates noise scales and median albedo from a sample at full resolution: the scene with them, and the solved
    sample without pixels that hardly any lamp reaches or that mix surfaces."""

    def step(noise: image_values.Noise) -> tuple[image_values.Noise, PixelSolution]:
        """Solves the sample with a noise model, and estimates the noise anew from the residuals."""
        solution = solve_pixels(sample, state, replace(scene, noise=noise))
        estimated = residual_noise.estimate(
            solution.estimate, solution.values, noise, scene.noise, solution.extra_variance
        )
        return estimated, solution

    noise, solution = step(replace(scene.noise, intensity=state.noise.intensity, direction=state.noise.direction))
    left_out = solution.hardly_lit | (state.mixed > 0.5)
    if np.any(left_out):
        lit = np.flatnonzero(~left_out)
        sample, state = sample.subset(lit), state.resampled(lambda values: np.ascontiguousarray(values[..., lit]))
    noise, solution = step(noise)
    albedo = pixel_solve.median_albedo(solution.estimate, solution.measured, sample.clipped)
    solved = replace(scene, noise=noise, stated_noise=scene.noise, median_albedo=albedo)
    return solved, SolvedSample(sample, state, solution)
