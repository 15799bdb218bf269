"""What one solve needs and another gives: depth, lamp intensities and the light that the object throws on itself.

They are found in turn on a coarse grid, which costs little and loses nothing, because none of them needs every pixel.
The first round drops much as shadow, since grazing, dark measurements are where bounced light rules; once that light is
taken out, they count. Intensities wait for the same moment: before it they would take bounced light for their own.
"""

from dataclasses import dataclass

import numpy as np

from acquisition import photometry
from acquisition.normals import grid, integrate, interreflection, lambert, self_calibration, steps
from acquisition.normals.interreflection import Table
from acquisition.normals.lambert import Estimate, Pixels
from acquisition.types import Calibration, Float32Array, FloatArray, SolveSettings

OFFSET_SIGMA_M = 0.003
"""1 σ of a pixel's depth offset in the joint solve."""

SHIFT_SIGMA_M = 0.03
"""1 σ of the object's mean depth as the caller gives it."""

LARGEST_STEP_M = 0.02
LARGEST_SHIFT_M = 0.08
FIRST_THRESHOLD = 0.15
LEAST_IMAGES_TO_CALIBRATE = 4
COARSE_PIXELS = 12_000
CALIBRATION_SAMPLES = 2500
BOUNCE_ROUNDS = 2
"""Rounds more where bounced light matters."""

FIRST_CUTS = 4
"""Times that the surface is cut at its steps at first; later rounds start from what they find cut."""

BOUNCE_MATTERS = 0.01
"""Share of bounced light, at the pixels that have most of it, below which it is left alone."""


@dataclass(frozen=True)
class Refined:
    """What the last solve takes over, at the full pixels: depth (N,) in m, how whole the surface is, 0–1 (N,), log
    intensity (F,), the shift of the whole object in m, the light received from other surfaces (F, N) or none, the scale
    found for it, and its share of all light."""

    depth_m: Float32Array
    whole: Float32Array
    log_intensity: FloatArray
    shift_m: float
    received: Float32Array | None
    bounce_scale: float
    bounce_share: float


def refine(
    pixels: Pixels, depth_m: Float32Array, lamp: Float32Array, calibration: Calibration, noise: photometry.Noise,
    settings: SolveSettings, table: Table | None = None,
) -> Refined:  # fmt: skip
    """Starts from depth (N,) in m and refines it with all that depends on it; `table` surrounds the object."""
    factor = int(np.ceil(np.sqrt(len(pixels.index) / COARSE_PIXELS)))
    coarse = grid.coarser(pixels, factor)
    around = None if table is None else Table(grid.means(table.depth_m, factor), grid.means(table.values, factor))
    mask = coarse.image(np.ones(len(coarse.index), np.bool_))
    ray = coarse.image(coarse.ray)
    along = photometry.ray_directions(coarse.ray)
    depth = np.full(len(coarse.index), np.mean(depth_m), np.float32) if factor > 1 else depth_m
    chosen = np.sort(np.random.default_rng(0).permutation(len(coarse.index))[:CALIBRATION_SAMPLES])
    log_intensity, shift = np.zeros(len(lamp)), 0.0
    received: Float32Array | None = None
    indirect = np.zeros_like(coarse.values)
    scale, threshold = 1.0, FIRST_THRESHOLD
    whole, stepped = np.ones_like(depth), True
    for turn in range(settings.depth_rounds + BOUNCE_ROUNDS):
        measured = _divided(coarse.values, log_intensity)
        values = measured - indirect
        found = lambert.solve(
            coarse, values, depth, lamp, calibration, noise, threshold=threshold, robust=settings.robust
        )
        normals = lambert.facing(found.normals, along)
        sure = certainty(found)
        start = coarse.image(depth, float(np.mean(depth)))
        smooth = coarse.take(integrate.depth(coarse.image(normals), mask, ray, coarse.image(sure), start))
        levelled = None
        if stepped:
            cuts = FIRST_CUTS if turn == 0 else 1
            levelled = steps.depth(coarse, values, found, normals, sure, depth, smooth, lamp, cuts)
        # Shadows tell of steps best before indirect light has been taken out of them, however well.
        stepped = levelled is not None
        depth, whole = (smooth, np.ones_like(smooth)) if levelled is None else levelled
        step = _calibrate(
            coarse.subset(chosen), values[:, chosen], depth[chosen], lamp, calibration, noise, settings,
            log_intensity, shift,
        )  # fmt: skip
        log_intensity = log_intensity + step.log_intensity
        shift += step.shift_m
        depth = depth + np.float32(step.shift_m)
        threshold = settings.shadow_threshold
        received = interreflection.received(coarse, measured, found, depth, normals, around, lamp, calibration)
        bounced = received * np.minimum(found.albedo, 1)
        scale = interreflection.scale(coarse, measured, bounced, found)
        indirect = (np.float32(scale) * bounced).astype(np.float32)
        share = np.sum(indirect, axis=0) / np.maximum(np.sum(measured, axis=0), 1e-6)
        matters = float(np.quantile(share, 0.98)) > BOUNCE_MATTERS
        if not matters:
            indirect = np.zeros_like(indirect)
            if turn + 1 >= settings.depth_rounds:
                received = None
                break
    return Refined(
        depth_m=grid.finer(depth, coarse, factor, pixels),
        whole=grid.finer(whole, coarse, factor, pixels),
        log_intensity=log_intensity,
        shift_m=shift,
        received=None if received is None else np.float32(scale) * grid.finer(received, coarse, factor, pixels),
        bounce_scale=scale,
        bounce_share=0.0 if received is None else float(np.sum(indirect) / np.sum(coarse.values)),
    )


def _divided(values: Float32Array, log_intensity: FloatArray) -> Float32Array:
    return (values / np.exp(log_intensity)[:, None]).astype(np.float32)


def _calibrate(
    pixels: Pixels, values: Float32Array, depth: Float32Array, lamp: Float32Array, calibration: Calibration,
    noise: photometry.Noise, settings: SolveSettings, log_intensity: FloatArray, shift: float,
) -> self_calibration.Shared:  # fmt: skip
    """The shared unknowns' total change over three Gauss–Newton steps, on a sample of pixels."""
    enough = len(lamp) >= LEAST_IMAGES_TO_CALIBRATE
    total = self_calibration.Shared(np.zeros(len(lamp)), 0.0)
    along = photometry.ray_directions(pixels.ray)
    if not enough:
        return total
    for _ in range(3):
        now = _divided(values, total.log_intensity)
        found = lambert.solve(
            pixels, now, depth + np.float32(total.shift_m), lamp, calibration, noise,
            threshold=settings.shadow_threshold, offset_sigma_m=OFFSET_SIGMA_M, robust=settings.robust,
        )  # fmt: skip
        change = lambert.derivative(found.light, found.point, along, lamp)
        step = self_calibration.step(
            found.light, change, now, found.g, found.offset_m, found.weights, log_intensity + total.log_intensity,
            shift + total.shift_m, calibration.intensity_sigma, SHIFT_SIGMA_M, OFFSET_SIGMA_M,
        )  # fmt: skip
        move = float(np.clip(step.shift_m, -LARGEST_STEP_M, LARGEST_STEP_M))
        move = float(np.clip(shift + total.shift_m + move, -LARGEST_SHIFT_M, LARGEST_SHIFT_M)) - shift - total.shift_m
        total = self_calibration.Shared(total.log_intensity + step.log_intensity, total.shift_m + move)
    return total


def certainty(found: Estimate) -> Float32Array:
    """How far a pixel's normal is to be believed in integration, 0–1."""
    return (1.0 / (1.0 + found.variance / np.radians(3.0) ** 2)).astype(np.float32) + np.float32(1e-3)
