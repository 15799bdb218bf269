"""Alternating estimation of depth, indirect light, lamps, terms and noise: block-coordinate descent on a coarse grid.

Each step estimates one group of quantities and holds the others fixed: the normals of single pixels; depth by
integration, cut at discontinuities; light from other surfaces; lamp intensities and positions with the object's depth
and the terms of image formation; and the noise scales. None of them needs every pixel, so the loop runs on means over
blocks of pixels. Intensities are calibrated after indirect light is subtracted, because they would absorb it. The noise
is estimated last, from the residuals that remain.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from acquisition import photometry
from acquisition.image_values import Noise
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.tuned import tuned
from acquisition.normals import self_calibration
from acquisition.normals.indirect_light import interreflection, shadow_light
from acquisition.normals.indirect_light.interreflection import Surface
from acquisition.normals.indirect_light.shadow_light import ShadowEquations
from acquisition.normals.pixels import image_terms, pixel_solve
from acquisition.normals.pixels.image_terms import LAMBERTIAN, ImageTerms
from acquisition.normals.pixels.pixel_solve import Estimate, Pixels, Scene
from acquisition.normals.pyramid import PyramidLevel
from acquisition.normals.self_calibration import Priors, SharedParameters
from acquisition.normals.surface import discontinuity, integration
from acquisition.normals.surface.discontinuity import ShadowImages
from acquisition.normals.uncertainty import error_variance, residual_noise


@dataclass(frozen=True)
class AlternationSettings:
    """Tuned numbers of the alternation over what all pixels share."""

    shift_sigma_m: float = tuned(0.03, "m")
    """1 σ of the object's mean depth as the caller gives it, m. The shift of the object is limited to three times this
    (`max_shift_m`). A judgement. Measured: the largest shift of 96 Lambertian captures of design seeds by two rings is
    50 mm; with half of this value 45 mm would be allowed."""
    least_metal_albedo: float = tuned(0.33, "of the upper quartile")
    """Albedo of metal below which no lamp counts as mirrored in a pixel; it then counts as hardly lit. Measured on
    eleven captures of metal (design seeds 44 and 62, eight lights by two rings): 74 % of such pixels err by more than
    15°, and 17 % of the others; with 0.2 it is 81 and 22 %; with 0.5 51 and 15 %, as surfaces of two albedos then lose
    half their pixels."""

    def max_shift_m(self, nearest_m: float) -> float:
        """Returns the largest shift of an object along the rays, m, whose nearest point is at a depth `nearest_m`: by
        its prior, and at most half of this depth, so that an object close to the camera never moves behind it."""
        return min(photometry.SETTINGS.outlying_deviations * self.shift_sigma_m, nearest_m / 2)


SETTINGS = AlternationSettings()

MAX_SHIFT_STEP_M = 0.02
"""Largest change of the shift in one Gauss–Newton step, m."""

EXTRA_ROUNDS = 2
"""Rounds beyond `SolveSettings.depth_rounds` if indirect light or gloss is significant."""

CONVERGED_DEG = 0.5
"""Mean rotation of the normals between rounds, degrees, below which the loop ends; the next would be a fifth of it."""

INITIAL_DISCONTINUITY_ROUNDS = 4
"""Rounds of discontinuity detection in the first turn; each later turn needs one, from the result of the last."""

MAX_COARSE_PIXELS = 12_000
"""Approximate upper limit of the coarse grid's object pixels."""

SAMPLE_PIXELS = 2500
"""Pixels from which lamps, terms and noise are estimated."""

PROBE_PIXELS = 1000
"""Pixels for which indirect light is predicted first, to decide whether it is significant."""


@dataclass(frozen=True)
class AlternationResult:
    """The state that the final solve starts from, at N pixels: those of the coarse grid, or interpolated to others.

    `continuity_weight` (N,) is 1 where the surface is continuous and 0 at depth discontinuities. `mixed` (N,) is 1 at
    pixels that are left out of later estimates because they mix surfaces, 0 at others. `sky` (N,) are sky view factors,
    `shadows` the equations of ambient and stray light from shadows. `shared_variance` (N,), rad², is the variance of
    the normals by errors that all pixels share and by indirect light. `indirect_irradiance` (F, N) is none if it is
    insignificant. `typical_albedo` is the median, for metal that of the brighter half. `noise` is that of coarse
    pixels. `normals` (3, M) are always those of the coarse pixels.
    """

    depth_m: Float32Array
    continuity_weight: Float32Array
    mixed: Float32Array
    sky: Float32Array
    shadows: ShadowEquations
    shared: SharedParameters
    shared_variance: Float32Array
    indirect_irradiance: Float32Array | None
    typical_albedo: float
    noise: Noise
    normals: Float32Array

    def resampled(self, interpolate: Callable[[Float32Array], Float32Array]) -> "AlternationResult":
        """Returns the state at other pixels, to which `interpolate` takes values (..., N)."""
        return replace(
            self,
            depth_m=interpolate(self.depth_m),
            continuity_weight=interpolate(self.continuity_weight),
            mixed=interpolate(self.mixed),
            sky=interpolate(self.sky),
            shared_variance=interpolate(self.shared_variance),
            indirect_irradiance=None if self.indirect_irradiance is None else interpolate(self.indirect_irradiance),
        )


@dataclass(frozen=True)
class _Sample:
    """Sample pixels for the shared parameters, their ∂x/∂Z (3, K) and depth (K,), and the nominal scene."""

    pixels: Pixels
    ray_direction: Float32Array
    depth_m: Float32Array
    nominal: Scene


@dataclass(frozen=True)
class _IndirectLight:
    """Light from other surfaces (F, N): irradiance received and radiance to the camera; insignificant: none and 0."""

    irradiance: Float32Array | None
    radiance: Float32Array


def coarse_factor(count: int, multiple: int = 1) -> int:
    """Returns the side of the coarse grid's blocks in pixels for an object of `count` pixels. It is 1 or a multiple of
    `multiple`; with the side of a mosaic's cell, every block holds the channels in the same shares."""
    least = int(np.ceil(np.sqrt(count / MAX_COARSE_PIXELS)))
    return 1 if least <= 1 else multiple * -(-least // multiple)


def refine(level: PyramidLevel, depth_m: Float32Array, scene: Scene, priors: Priors) -> AlternationResult:
    """Runs block-coordinate descent from depth (N,) in m at the level's coarse pixels.

    `scene` has the nominal lamps, the noise of single pixels, and the initial terms beyond Lambert's. `priors` are
    those of the parameters that all pixels share. The level's table is the surroundings of the object.
    """
    coarse = level.coarse
    ray_direction, depth = photometry.ray_directions(coarse.ray), depth_m
    drawn = np.sort(np.random.default_rng(0).permutation(len(coarse.index))[:SAMPLE_PIXELS])
    block = level.factor**2
    nominal = replace(scene, noise=replace(scene.noise, shot=scene.noise.shot / block, floor=scene.noise.floor / block))
    present = nominal
    shared = replace(SharedParameters.nominal(len(scene.lamps)), terms=scene.terms or LAMBERTIAN)
    indirect = _IndirectLight(None, np.zeros_like(coarse.values))
    normals, sky = np.zeros_like(ray_direction), np.ones_like(depth)
    continuity_weight, discontinuous = np.ones_like(depth), shared.terms.metal == 0
    turn, calibrations, from_elsewhere = 0, 0, priors.terms.from_elsewhere
    while True:
        measured = divide_intensity(coarse.values, shared.log_intensity)
        values = measured - indirect.radiance
        estimate = pixel_solve.solve(coarse, values, depth, present)
        previous, normals = normals, pixel_solve.clamp_to_visible(estimate.normals, ray_direction)
        typical = _typical_albedo(estimate, shared.terms)
        dark = hardly_lit(indirect.irradiance, measured, estimate, nominal.terms, typical)
        variance = np.where(dark, np.float32(photometry.RANDOM_NORMAL_VARIANCE), estimate.variance)
        mixed = _mixed(coarse, normals, variance, dark)
        shadow_images = None
        if discontinuous:
            shadow_images = ShadowImages(coarse, measured, indirect.radiance, estimate, present.lamps)
        cuts = INITIAL_DISCONTINUITY_ROUNDS if turn == 0 else 1
        depth, continuity_weight, discontinuous = _integrated(coarse, normals, variance, depth, shadow_images, cuts)
        chosen = drawn[~(dark | mixed)[drawn]]
        sample = _Sample(coarse.subset(chosen), ray_direction[:, chosen], depth[chosen], nominal)

        indirect = _indirect_light(
            level, measured, values, estimate, depth, normals, present, expected=indirect.irradiance is not None
        )
        if from_elsewhere:
            sky = interreflection.sky_view(coarse, depth, normals, level.table)
            coarse = replace(coarse, sky=sky)
            shadows = _shadow_equations(coarse, sky, measured, indirect.radiance, estimate, present)
            priors = replace(priors, shadows=shadows)
        direct_diffuse = indirect.irradiance is None and not shared.terms.specular

        values = (measured - indirect.radiance)[:, chosen]
        before = shared.shift_m
        hold = turn == 0 and not direct_diffuse
        shared, noise = _self_calibrate(sample, values, shared, present.noise, priors, hold=hold)
        calibrations += not hold
        depth = depth + np.float32(shared.shift_m - before)
        present = replace(present, lamps=shared.lamps(scene.lamps), noise=noise, terms=scene.terms and shared.terms)
        converged = turn >= scene.settings.depth_rounds and _mean_angle_deg(previous, normals) < CONVERGED_DEG
        turn += 1
        most = calibrations if direct_diffuse else turn - EXTRA_ROUNDS
        if converged or most >= scene.settings.depth_rounds:
            break
    if not from_elsewhere:
        sky = interreflection.sky_view(coarse, depth, normals, level.table)
    return AlternationResult(
        depth_m=depth,
        continuity_weight=continuity_weight,
        mixed=mixed.astype(np.float32),
        sky=sky,
        shadows=_shadow_equations(coarse, sky, measured, indirect.radiance, estimate, present),
        shared=shared,
        shared_variance=shared_normal_variance(estimate, shared, ray_direction, present.lamps, indirect.radiance),
        indirect_irradiance=indirect.irradiance,
        typical_albedo=typical,
        noise=present.noise,
        normals=normals,
    )


def _integrated(
    coarse: Pixels, normals: Float32Array, variance: Float32Array, depth_m: Float32Array,
    shadows: ShadowImages | None, cuts: int,
) -> tuple[Float32Array, Float32Array, bool]:  # fmt: skip
    """Integrates normals (3, N) of a variance (N,), rad². If the `shadows` show discontinuities, the surface is cut
    there in `cuts` rounds. Returns depth (N,), continuity weight (N,), and whether they do."""
    mask = coarse.image(np.ones(len(coarse.index), np.bool_))
    confidence = integration.confidence(variance)
    start = coarse.image(depth_m, float(np.mean(depth_m)))
    smooth = coarse.take(
        integration.depth(coarse.image(normals), mask, coarse.image(coarse.ray), coarse.image(confidence), start)
    )
    found = None
    if shadows is not None:
        found = discontinuity.discontinuous_depth(shadows, normals, confidence, depth_m, smooth, cuts)
    return (smooth, np.ones_like(smooth), False) if found is None else (*found, True)


def _mean_angle_deg(before: Float32Array, normals: Float32Array) -> float:
    """Returns the mean angle between two sets of unit normals (3, N)."""
    return float(np.degrees(np.mean(np.arccos(np.clip(np.sum(before * normals, axis=0), -1, 1)))))


def _indirect_light(
    level: PyramidLevel, measured: Float32Array, direct: Float32Array, estimate: Estimate, depth_m: Float32Array,
    normals: Float32Array, scene: Scene, *, expected: bool,
) -> _IndirectLight:  # fmt: skip
    """Predicts interreflection from `measured` images (F, N); the estimate was solved from `direct` (F, N). The
    non-diffuse part by the estimate's terms is subtracted from both. Unless indirect light is `expected`, a few pixels
    decide first whether it is significant."""
    coarse = level.coarse
    lit_by_lamps = measured - estimate.beside_direct_diffuse
    diffuse, direct = measured - estimate.nondiffuse_value, direct - estimate.nondiffuse_value

    def predicted(every: int) -> _IndirectLight:
        surface = Surface(depth_m, normals, estimate.albedo, level.table)
        irradiance = interreflection.received_irradiance(
            coarse, diffuse, surface, scene.lamps, scene.calibration, every
        )
        radiance = interreflection.reflected_radiosity(
            irradiance, np.sum(diffuse, axis=0), np.sum(direct, axis=0), estimate.albedo
        )
        share = np.sum(radiance[:, ::every], axis=0) / np.maximum(np.sum(diffuse[:, ::every], axis=0), 1e-6)
        significant = float(np.quantile(share, 0.98)) > 2 * photometry.SETTINGS.flat_field_sigma
        if significant and scene.shadows_informative:
            significant = shadow_light.shadows_show_indirect(coarse, lit_by_lamps, radiance, estimate)
        if not significant:
            return _IndirectLight(None, np.zeros_like(radiance))
        return _IndirectLight(irradiance, radiance)

    every = len(coarse.index) // PROBE_PIXELS
    if every > 1 and not expected:
        probe = predicted(every)
        if probe.irradiance is None:
            return probe
    return predicted(1)


def _shadow_equations(
    coarse: Pixels, sky: Float32Array, values: Float32Array, indirect: Float32Array, estimate: Estimate, scene: Scene
) -> ShadowEquations:
    """Returns `shadow_light.equations`, empty ones if the scene's shadows are not informative."""
    if not scene.shadows_informative:
        return ShadowEquations.none()
    return shadow_light.equations(coarse, sky, values, indirect, estimate, scene.noise)


def hardly_lit(
    received: Float32Array | None, values: Float32Array, estimate: Estimate, terms: ImageTerms | None,
    typical_albedo: float,
) -> BoolArray:  # fmt: skip
    """`interreflection.hardly_lit` (N,) by the diffuse part of values (F, N); no pixel if `received` (F, N) is none.
    Metal has no diffuse light; there, pixels that mirror no lamp count. Their faint light would fit a dark surface that
    mirrors one, but bare metal has one albedo, so a low albedo identifies them."""
    if terms is not None and terms.metal > 0:
        return estimate.albedo < np.float32(SETTINGS.least_metal_albedo * typical_albedo)
    if received is None:
        return np.zeros(values.shape[1], np.bool_)
    return interreflection.hardly_lit(received, values - estimate.beside_direct_diffuse, typical_albedo)


def _mixed(coarse: Pixels, normals: Float32Array, variance: Float32Array, dark: BoolArray) -> BoolArray:
    """Pixels (N,) on a line narrower than a pixel (`error_variance.line_deg`), by normals (3, N) of variance (N,),
    rad². They mix surfaces, so that no term describes how they reflect light. No pixel counts if fewer than
    SAMPLE_PIXELS others were left that are not `dark` (N,)."""
    known = coarse.image(np.ones(len(coarse.index), np.bool_))
    variance_deg2 = np.float32(np.degrees(1) ** 2) * coarse.image(variance)
    line = error_variance.line_deg(np.moveaxis(coarse.image(normals), 0, -1), known, variance_deg2)
    mixed = coarse.take(line) > 0
    return mixed if np.count_nonzero(~(mixed | dark)) >= SAMPLE_PIXELS else np.zeros_like(mixed)


def _typical_albedo(estimate: Estimate, terms: ImageTerms) -> float:
    """Median albedo; of metal the median of the brighter half, as the others may be pixels that mirror no lamp."""
    median = np.median(estimate.albedo)
    return float(median if terms.metal == 0 else np.median(estimate.albedo[estimate.albedo >= median]))


def shared_normal_variance(
    estimate: Estimate, shared: SharedParameters, ray_direction: Float32Array, lamps: Float32Array,
    indirect: Float32Array,
) -> Float32Array:  # fmt: skip
    """Variance (N,), rad², of the normals by errors of lamps, depth and terms, which pixels share, and of indirect
    light, which images share; at most that of a random normal.

    Without this bound it would be huge where the albedo vanishes, and cancellation in the interpolation to full
    resolution would then make it negative in the pixels beside.
    """
    by_depth = pixel_solve.depth_derivative(estimate.light, estimate.point, ray_direction, lamps)
    by_parameters = self_calibration.normal_variance(estimate, by_depth, lamps, shared)
    variance = by_parameters + interreflection.normal_variance(estimate, indirect)
    return np.minimum(variance, np.float32(photometry.RANDOM_NORMAL_VARIANCE))


def divide_intensity(values: Float32Array, log_intensity: FloatArray) -> Float32Array:
    """Normalises values (F, N) to lamps of nominal intensity, by log intensity factors (F,)."""
    return values / np.exp(log_intensity).astype(np.float32)[:, None]


def _self_calibrate(
    sample: _Sample, values: Float32Array, before: SharedParameters, noise: Noise, stated: Priors, *, hold: bool
) -> tuple[SharedParameters, Noise]:
    """Takes three Gauss–Newton steps of the shared parameters on K sample pixels; estimates noise from the residuals.

    `values` (F, K) and the sample's depth belong to the parameters `before`; `hold` leaves the lamps as they are.
    """
    nominal, depth_sigma_m = sample.nominal, photometry.SETTINGS.integrated_depth_sigma_m
    if len(nominal.lamps) < photometry.OVERDETERMINED:
        return before, noise
    calibrate = not hold and len(nominal.lamps) >= photometry.REDUNDANT
    priors, present = stated if calibrate else replace(stated, intensity=0.0, position_m=0.0), before
    if sample.depth_m.size == 0:  # all pixels are hardly lit or mixed, and tell nothing
        return (replace(before, covariance=priors.covariance(len(nominal.lamps))) if calibrate else before), noise
    largest = SETTINGS.max_shift_m(float(np.min(sample.depth_m)) - before.shift_m)
    for turn in range(4):
        lamps = present.lamps(nominal.lamps)
        divided = divide_intensity(values, present.log_intensity - before.log_intensity)
        estimate = pixel_solve.solve(
            sample.pixels, divided, sample.depth_m + np.float32(present.shift_m - before.shift_m),
            replace(nominal, lamps=lamps, noise=noise, terms=nominal.terms and present.terms),
        )  # fmt: skip
        if turn in (0, 3):
            noise = residual_noise.estimate(
                estimate, divided, noise, nominal.noise,
                sample.pixels.plus_extra(np.broadcast_to(estimate.highlight_variance, divided.shape)),
            )  # fmt: skip
        if turn == 3:
            break
        by_depth = pixel_solve.depth_derivative(estimate.light, estimate.point, sample.ray_direction, lamps)
        step = self_calibration.gauss_newton_step(estimate, by_depth, divided, lamps, present, priors, depth_sigma_m)
        shift = float(np.clip(step.shift_m, -MAX_SHIFT_STEP_M, MAX_SHIFT_STEP_M))
        present = SharedParameters(
            log_intensity=present.log_intensity + step.log_intensity,
            lamp_offset_m=present.lamp_offset_m + step.lamp_offset_m,
            shift_m=float(np.clip(present.shift_m + shift, -largest, largest)),
            covariance=step.covariance if calibrate else present.covariance,
            terms=image_terms.stepped(present.terms, step.terms),
        )
    return present, noise
