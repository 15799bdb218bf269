"""Noise of single pixels without repeated images: photon transfer on the residuals of neighbouring pixels.

Each pixel has more images than its normal needs, so the residuals contain its noise. They also contain errors of lamps
and model, but these are nearly the same at neighbouring pixels and proportional to their albedo: in the difference of
four neighbours' residuals, each divided by its albedo, they cancel. Its variance at each brightness is a
photon-transfer curve, like that of a session's repeated frames. Neighbours that were interpolated from one another
(demosaicing) or compressed together differ by less than their noise.
"""

from dataclasses import dataclass, replace

import numpy as np

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.result import SolveSettings
from acquisition.models.tuned import tuned
from acquisition.normals import photon_transfer, pixel_solve, residual_noise
from acquisition.normals.pixel_solve import Pixels
from acquisition.normals.pyramid import MaskedImages
from acquisition.normals.session_images import ImageStack, StoredImages


@dataclass(frozen=True)
class PixelNoiseSettings:
    """Tuned numbers of the noise from differences of residuals."""

    max_relative_sigma: float = tuned(0.15, "share")
    """1 σ of the shot noise, as a fraction, up to which the estimate replaces the guess."""


SETTINGS = PixelNoiseSettings()

MIN_RESIDUAL_SHARE = 1 - residual_noise.SETTINGS.max_leverage
"""Share of a measurement's variance that its residual has at least."""

STRIPS = 16
"""Groups of rows, spread over the window, that are read."""

MAX_PRODUCTS = 2_000_000
"""Pixels used, times the square of the number of lights: more do not improve the estimate."""


@dataclass(frozen=True)
class PixelNoiseEstimate:
    """The images with their estimated noise, and a sentence on its source."""

    images: ImageStack | StoredImages
    note: str


def estimate(
    images: ImageStack | StoredImages,
    mask: BoolArray,
    depth_m: Float32Array,
    calibration: Calibration,
    steps: FloatArray,
) -> PixelNoiseEstimate:
    """Photon-transfer estimate of shot and read noise from neighbouring residuals, in the images.

    `images` have a guess of it, which scales values to electrons; `mask` and the rough `depth_m` are (h, w), `steps`
    (F,) the quantisation of values, 0 for none. Where too few pixels determine it, the guess stays.
    """
    if len(images.lights) < photometry.REDUNDANT:
        return PixelNoiseEstimate(images, f"guessed: {len(images.lights)} lights leave nothing over")
    lamp = photometry.lamps(images.lights)
    step = float(np.max(steps / images.shot))
    masked = MaskedImages(images, mask, photometry.rays(calibration, images.rows, images.columns))
    parts = [
        _differences(masked.pixels(rows), depth_m[rows][mask[rows]], lamp, calibration, images.shot, images.floor)
        for rows in _strips(masked)
    ]
    level, apart = (np.concatenate(one) for one in zip(*parts, strict=True))
    line = photon_transfer.fit_line(photon_transfer.transfer_curve(level, apart, float(np.max(1 / images.shot)), step))
    if line is None or line.slope <= 0 or line.slope_sigma > SETTINGS.max_relative_sigma * line.slope:
        return PixelNoiseEstimate(images, "guessed: too few pixels tell")
    # Few lit pixels are dark, so the floor is hardly known by itself; with the slope it gives the noise of lit ones.
    shot, floor = images.shot * line.slope, np.maximum(line.floor * images.shot**2, images.floor)
    note = f"noise found in how neighbours differ: {1 / np.median(shot):.3g} electrons at a white surface's value"
    return PixelNoiseEstimate(replace(images, shot=shot, floor=floor), note)


def _strips(masked: MaskedImages) -> list[slice]:
    """Pairs of rows spread over the window, as many as MAX_PRODUCTS allows."""
    height, width = masked.mask.shape
    pairs = max(1, MAX_PRODUCTS // (2 * width * len(masked.images.lights) ** 2))
    each = 2 * -(-pairs // STRIPS)
    starts = np.unique(np.linspace(0, max(height - each, 0), min(STRIPS, pairs)).astype(int))
    return [slice(int(start), min(int(start) + each, height)) for start in starts]


def _differences(
    pixels: Pixels, depth_m: Float32Array, lamp: Float32Array, calibration: Calibration, shot: FloatArray,
    floor: FloatArray,
) -> tuple[Float32Array, Float32Array]:  # fmt: skip
    """Brightness (K,) and differences (K,) with one measurement's variance, both in electrons by the guessed gain."""
    light = photometry.light_vectors(photometry.points(pixels.ray, depth_m), lamp, calibration)
    strength = np.sqrt(np.einsum("fcn,fcn->fn", light, light))
    usable, _, _ = pixel_solve.classify_measurements(pixels, pixels.values, light, SolveSettings().shadow_threshold)
    weighted = light * (usable / np.maximum(strength, np.float32(1e-9)) ** 2)[:, None]
    inner = np.einsum("fan,fbn->nab", weighted, light, optimize=True) + 1e-6 * np.eye(3)
    solver = np.linalg.solve(inner, weighted.transpose(2, 1, 0))  # (N, 3, F): g from values
    albedo = np.linalg.norm(np.einsum("nak,kn->na", solver, pixels.values, optimize=True), axis=1)
    projection = np.eye(len(lamp)) - np.einsum("fan,nak->nfk", light, solver, optimize=True)
    residual = np.einsum("nfk,kn->fn", projection, pixels.values, optimize=True) / np.maximum(albedo, 1e-9)
    variance = np.where(usable, np.maximum(pixels.values, 0) * shot[:, None] + floor[:, None], 0)
    share = np.einsum("nfk,kn->fn", projection**2, variance, optimize=True) / np.maximum(variance, 1e-30)

    one, right, below, across = four = _quads(pixels)
    alike = np.logical_and.reduce([np.all(usable[:, one] == usable[:, other], axis=0) for other in four])
    good = usable[:, one] & alike & (np.min([share[:, at] for at in four], axis=0) > MIN_RESIDUAL_SHARE)
    level, spread, bright = (np.mean([all_[..., at] for at in four], axis=0) for all_ in (pixels.values, share, albedo))
    apart = (residual[:, one] - residual[:, right] - residual[:, below] + residual[:, across]) / 2
    apart = apart * bright / np.sqrt(np.maximum(spread, MIN_RESIDUAL_SHARE)) / shot[:, None]
    return (level / shot[:, None])[good].astype(np.float32), apart[good].astype(np.float32)


def _quads(pixels: Pixels) -> tuple[np.ndarray, ...]:
    """Pixel numbers (K,) of the four corners of each 2 × 2 square that lies on the object."""
    number = pixels.image(np.arange(1, len(pixels.index) + 1))
    height, width = (length // 2 * 2 for length in pixels.shape)
    four = [number[row:height:2, column:width:2].ravel() for row in (0, 1) for column in (0, 1)]
    complete = np.logical_and.reduce([one > 0 for one in four])
    return tuple(one[complete] - 1 for one in four)
