"""What one solve needs and another gives: depth, gloss, light from other surfaces, lamp intensities, noise.

They are found in turn on a coarse grid, which costs little and loses nothing, because none of them needs every pixel.
The first round drops much as shadow, since grazing, dark measurements are where bounced light rules; once that light is
taken out, they count. Intensities wait for the same moment, and for the highlights to be gone: before it they would
take them for their own. Noise comes last, from what is left.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from acquisition import photometry
from acquisition.models.base import Float32Array, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.result import SolveSettings
from acquisition.normals import discontinuity, integration, interreflection, pixel_solve, self_calibration
from acquisition.normals import residual_noise as residuals
from acquisition.normals import specular as gloss
from acquisition.normals.interreflection import Table
from acquisition.normals.pixel_solve import Estimate, Pixels
from acquisition.normals.self_calibration import Priors, SharedParameters
from acquisition.normals.specular import Lobe
from acquisition.photometry import Noise

OFFSET_SIGMA_M = 0.003
"""1 σ of a pixel's depth offset in the joint solve."""

CALIBRATION_DEPTH_SIGMA_M = 0.01
"""1 σ of a pixel's depth beside the shift, where shift and intensities are sought. Integrated depth is wrong by that
much behind limbs that no normal leads round, and thousands of pixels that are believed to the last solve's 3 mm call it
a shift, and the shift wrong intensities: 12 mm and 2 % of them on a figure at 1024 × 1024, where it is 5 mm."""

SHIFT_SIGMA_M = 0.03
"""1 σ of the object's mean depth as the caller gives it."""

MAX_SHIFT_STEP_M = 0.02
MAX_SHIFT_M = 0.08
INITIAL_SHADOW_THRESHOLD = 0.15
MIN_IMAGES_FOR_SHIFT, MIN_IMAGES_FOR_LAMPS = 4, 5
MAX_COARSE_PIXELS = 12_000
SAMPLE_PIXELS = 2500
EXTRA_ROUNDS = 2
"""Rounds more where bounced light or gloss matters."""

CONVERGED_DEG = 0.5
"""Mean turn of the normals from one round to the next below which no more follows: it would be a fifth of that."""

INITIAL_DISCONTINUITY_ROUNDS = 4
"""Times that the surface is cut at its steps at first; later rounds start from what they find cut."""

PROBE_PIXELS = 1000
"""Pixels that are asked whether light bounces at all."""

MIN_INDIRECT_SHARE = 0.012
"""Share of bounced light, at the pixels that have most of it, below which it is left alone: smooth shapes of albedo
0.05 lose 0.003° by that; a groove as dark has twice as much."""


@dataclass(frozen=True)
class AlternationResult:
    """What the last solve takes over, at N pixels: the coarse ones that it was found at, or others.

    Depth (N,) in m; how whole the surface is, 0–1 (N,); what all pixels share of lamps and shift; the variance (N,) in
    rad² that the normals have of it, and of the light from other surfaces; the light received from other surfaces
    (F, N) or none, and the scale of its prediction; the lobe; the noise of coarse pixels.
    """

    depth_m: Float32Array
    continuity_weight: Float32Array
    shared: SharedParameters
    shared_variance: Float32Array
    indirect_irradiance: Float32Array | None
    indirect_scale: float
    lobe: Lobe
    noise: Noise

    def resampled(self, carried: Callable[[Float32Array], Float32Array]) -> "AlternationResult":
        """The same at other pixels, to which `carried` takes values (..., N)."""
        return replace(
            self,
            depth_m=carried(self.depth_m),
            continuity_weight=carried(self.continuity_weight),
            shared_variance=carried(self.shared_variance),
            indirect_irradiance=None if self.indirect_irradiance is None else carried(self.indirect_irradiance),
        )


@dataclass(frozen=True)
class _Sample:
    """What stays the same over the rounds, for the sample pixels that find what all pixels share."""

    pixels: Pixels
    along: Float32Array
    lamp: Float32Array
    calibration: Calibration
    stated: Noise
    settings: SolveSettings

    @property
    def cauchy_scale(self) -> float | None:
        return pixel_solve.CAUCHY_SCALE if self.settings.robust else None


@dataclass(frozen=True)
class _IndirectLight:
    """Light from other surfaces: received and sent on to the camera (F, N), scaled; zero where it does not matter."""

    irradiance: Float32Array
    radiance: Float32Array
    scale: float
    significant: bool


def coarse_factor(count: int) -> int:
    """How many times coarser than the images the grid is on which an object of `count` pixels is refined."""
    return int(np.ceil(np.sqrt(count / MAX_COARSE_PIXELS)))


def refine(
    coarse: Pixels, factor: int, depth_m: Float32Array, lamp: Float32Array, calibration: Calibration, noise: Noise,
    settings: SolveSettings, around: Table | None = None,
) -> AlternationResult:  # fmt: skip
    """Starts from depth (N,) in m and refines it with all that depends on it.

    `coarse` are means over factor × factor pixels, `around` is what surrounds the object on the same grid; `noise` is
    that of single pixels.
    """
    mask = coarse.image(np.ones(len(coarse.index), np.bool_))
    ray = coarse.image(coarse.ray)
    along = photometry.ray_directions(coarse.ray)
    depth = depth_m
    chosen = np.sort(np.random.default_rng(0).permutation(len(coarse.index))[:SAMPLE_PIXELS])
    finest = replace(noise, shot=noise.shot / factor**2, floor=noise.floor / factor**2)
    known = _Sample(coarse.subset(chosen), along[:, chosen], lamp, calibration, finest, settings)
    shared, left, there = SharedParameters.nominal(len(lamp)), finest, lamp
    lobe = gloss.NO_LOBE
    bounced: _IndirectLight | None = None
    found: Estimate | None = None
    normals = np.zeros_like(along)
    indirect, highlight = np.zeros_like(coarse.values), np.zeros_like(coarse.values)
    threshold = INITIAL_SHADOW_THRESHOLD
    whole, stepped = np.ones_like(depth), True
    calibrated = 0
    for turn in range(settings.depth_rounds + EXTRA_ROUNDS):
        measured = divide_intensity(coarse.values, shared.log_intensity)
        values = measured - indirect - highlight
        found = pixel_solve.solve(
            coarse, values, depth, there, calibration, left, threshold=threshold,
            cauchy_scale=known.cauchy_scale, extra=(np.float32(gloss.HIGHLIGHT_SIGMA) * highlight) ** 2,
        )  # fmt: skip
        last, normals = normals, pixel_solve.clamp_to_visible(found.normals, along)
        sure = integration.certainty(found.variance.copy())
        start = coarse.image(depth, float(np.mean(depth)))
        smooth = coarse.take(integration.depth(coarse.image(normals), mask, ray, coarse.image(sure), start))
        levelled = None
        if stepped:
            cuts = INITIAL_DISCONTINUITY_ROUNDS if turn == 0 else 1
            levelled = discontinuity.depth(
                coarse, measured - highlight, found, normals, sure, depth, smooth, there, cuts
            )
        stepped = levelled is not None
        depth, whole = (smooth, np.ones_like(smooth)) if levelled is None else levelled

        lobe = gloss.fit(
            known.pixels, (measured - indirect)[:, chosen], depth[chosen], known.along, there, calibration, left,
            INITIAL_SHADOW_THRESHOLD, lobe,
        )  # fmt: skip
        highlight = lobe.highlight(found, along)
        bounced = _indirect_light(
            coarse, measured - highlight, values, found, depth, normals, around, there, calibration,
            expected=bounced is not None and bounced.significant,
        )  # fmt: skip
        indirect = bounced.radiance
        plain = not bounced.significant and lobe.strength == 0

        values = (measured - indirect)[:, chosen]
        before = shared.shift_m
        hold = turn == 0 and not plain
        shared, left = _self_calibrate(
            known, values, highlight[:, chosen], lobe, depth[chosen], shared, left, hold=hold
        )
        calibrated += not hold
        depth, there = depth + np.float32(shared.shift_m - before), shared.lamps(lamp)
        threshold = settings.shadow_threshold
        still = turn >= settings.depth_rounds and _mean_angle_deg(last, normals) < CONVERGED_DEG
        if still or (plain and calibrated >= settings.depth_rounds):
            break
    spread = np.zeros_like(depth) if found is None else _shared_normal_variance(found, shared, there, indirect)
    return AlternationResult(
        depth_m=depth,
        continuity_weight=whole,
        shared=shared,
        shared_variance=spread,
        indirect_irradiance=bounced.irradiance if bounced and bounced.significant else None,
        indirect_scale=bounced.scale if bounced else 0.0,
        lobe=lobe,
        noise=left,
    )


def _mean_angle_deg(before: Float32Array, normals: Float32Array) -> float:
    """Mean angle between unit normals (3, N)."""
    return float(np.degrees(np.mean(np.arccos(np.clip(np.sum(before * normals, axis=0), -1, 1)))))


def _indirect_light(
    coarse: Pixels, matt: Float32Array, direct: Float32Array, found: Estimate, depth_m: Float32Array,
    normals: Float32Array, table: Table | None, lamp: Float32Array, calibration: Calibration, *, expected: bool,
) -> _IndirectLight:  # fmt: skip
    """The light that surfaces send one another, from images (F, N) without highlights, and what `found` is from.

    Unless it is `expected`, some pixels tell first whether it matters.
    """

    def predicted(every: int) -> _IndirectLight:
        received = interreflection.received(coarse, matt, found, depth_m, normals, table, lamp, calibration, every)
        indirect = interreflection.sent_on(received, matt, direct, found.albedo)
        scale = interreflection.scale(coarse, matt, indirect, found)
        indirect = (np.float32(scale) * indirect).astype(np.float32)
        share = np.sum(indirect[:, ::every], axis=0) / np.maximum(np.sum(matt[:, ::every], axis=0), 1e-6)
        matters = float(np.quantile(share, 0.98)) > MIN_INDIRECT_SHARE
        received = np.float32(scale) * received
        return _IndirectLight(received, indirect if matters else np.zeros_like(indirect), scale, matters)

    every = len(coarse.index) // PROBE_PIXELS
    if every > 1 and not expected:
        probe = predicted(every)
        if not probe.significant:
            return probe
    return predicted(1)


def _shared_normal_variance(
    found: Estimate, shared: SharedParameters, lamp: Float32Array, indirect: Float32Array
) -> Float32Array:
    """Variance (N,) in rad² of the normals from errors that pixels or images share."""
    return self_calibration.normal_variance(found, lamp, shared.covariance) + interreflection.spread(found, indirect)


def divide_intensity(values: Float32Array, log_intensity: FloatArray) -> Float32Array:
    """Values (F, N) as lamps of the nominal intensity would have given them."""
    return (values / np.exp(log_intensity)[:, None]).astype(np.float32)


def _self_calibrate(
    known: _Sample, values: Float32Array, highlight: Float32Array, lobe: Lobe, depth_m: Float32Array, before: SharedParameters,  # noqa: E501
    noise: Noise, *, hold: bool,
) -> tuple[SharedParameters, Noise]:  # fmt: skip
    """The shared unknowns after three Gauss–Newton steps on a sample of pixels, and the noise that is left.

    `values` (F, K), with the `highlight` (F, K) of `lobe` in them, and depth are those of what was known `before`;
    `hold` leaves the lamps as they are.
    """
    if len(known.lamp) < MIN_IMAGES_FOR_SHIFT:
        return before, noise
    calibrate = not hold and len(known.lamp) >= MIN_IMAGES_FOR_LAMPS
    stated = known.calibration
    lamps = (stated.intensity_sigma, stated.lamp_position_sigma_m) if calibrate else (0.0, 0.0)
    priors, now = Priors(*lamps, SHIFT_SIGMA_M), before
    for turn in range(4):
        lamp = now.lamps(known.lamp)
        whole = divide_intensity(values, now.log_intensity - before.log_intensity)
        matt, extra = whole - highlight, (np.float32(gloss.HIGHLIGHT_SIGMA) * highlight) ** 2
        found = pixel_solve.solve(
            known.pixels, matt, depth_m + np.float32(now.shift_m - before.shift_m), lamp, stated, noise,
            threshold=known.settings.shadow_threshold, offset_sigma_m=CALIBRATION_DEPTH_SIGMA_M, cauchy_scale=known.cauchy_scale,  # noqa: E501
            extra=extra,
        )  # fmt: skip
        if turn in (0, 3):
            noise = residuals.estimate(
                found, matt, noise, known.stated, known.along, lamp, CALIBRATION_DEPTH_SIGMA_M, extra
            )
        if turn == 3:
            break
        change = pixel_solve.depth_derivative(found.light, found.point, known.along, lamp)
        glossy = lobe.derivatives(found, known.along)
        if glossy is not None:
            highlight = glossy.highlight
        step = self_calibration.gauss_newton_step(
            found, change, whole - highlight, lamp, now, priors, CALIBRATION_DEPTH_SIGMA_M, glossy
        )  # fmt: skip
        move = float(np.clip(step.shift_m, -MAX_SHIFT_STEP_M, MAX_SHIFT_STEP_M))
        now = SharedParameters(
            log_intensity=now.log_intensity + step.log_intensity,
            lamp_offset_m=now.lamp_offset_m + step.lamp_offset_m,
            shift_m=float(np.clip(now.shift_m + move, -MAX_SHIFT_M, MAX_SHIFT_M)),
            covariance=step.covariance if calibrate else now.covariance,
        )
    return now, noise
