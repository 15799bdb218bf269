"""Noise of single pixels without repeated images: photon transfer on the residuals of neighbouring pixels.

Each pixel has more images than its normal needs, so its residuals contain noise. They also contain errors of lamps and
model, which are nearly the same at neighbouring pixels and proportional to albedo; these cancel in the difference of
four neighbours' residuals, each divided by its albedo. The variance of this difference at each brightness is a
photon-transfer curve, like that of a session's repeated frames. If neighbours were interpolated from one another
(demosaicing) or compressed together, they differ by less than their noise.
"""

from dataclasses import replace

import numpy as np

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.result import SolveSettings
from acquisition.normals.images.normalised_images import Images
from acquisition.normals.pixels import pixel_solve
from acquisition.normals.pixels.pixel_solve import Pixels
from acquisition.normals.pyramid import MaskedImages
from acquisition.normals.uncertainty import photon_transfer, residual_noise

MAX_PRODUCTS = 2_000_000
"""Largest product of pixels used and squared number of lights; more pixels do not improve the estimate."""


def estimate(
    images: Images, mask: BoolArray, depth_m: Float32Array, calibration: Calibration, steps: FloatArray
) -> tuple[Images, str]:
    """Estimates shot and read noise by photon transfer from neighbouring residuals.

    Returns the images with this noise, and a sentence on its source. The noise of `images` is a first guess, which
    scales values to electrons; it stays if too few pixels determine the estimate. `mask` and the rough `depth_m` are
    (h, w), `steps` (F,) is the quantisation of values, 0 for none.
    """
    if len(images.lights) < photometry.REDUNDANT:
        return images, f"guessed: {len(images.lights)} lights leave no redundant measurement"
    lamp = photometry.lamps(images.lights)
    masked = MaskedImages(images, mask, photometry.rays(calibration, images.rows, images.columns))
    parts = [
        _differences(masked.pixels(rows), depth_m[rows][mask[rows]], lamp, calibration, images.shot, images.floor)
        for rows in photon_transfer.strips(len(mask), MAX_PRODUCTS // (mask.shape[1] * len(lamp) ** 2))
    ]
    level, apart = (np.concatenate(one) for one in zip(*parts, strict=True))
    top, step = float(np.max(1 / images.shot)), float(np.max(steps / images.shot))
    line = photon_transfer.fit_line(photon_transfer.transfer_curve(level, apart, top, step))
    if line is None or not line.known:
        return images, "guessed: too few pixels determine the noise"
    # Few lit pixels are dark, so the floor alone is uncertain; with the slope it gives the noise of lit pixels.
    shot, floor = images.shot * line.slope, np.maximum(line.floor * images.shot**2, images.floor)
    note = (
        f"noise estimated from differences of neighbouring pixels: {1 / np.median(shot):.3g} electrons at a white "
        "surface's value"
    )
    return replace(images, shot=shot, floor=floor), note


def _differences(
    pixels: Pixels, depth_m: Float32Array, lamp: Float32Array, calibration: Calibration, shot: FloatArray,
    floor: FloatArray,
) -> tuple[Float32Array, Float32Array]:  # fmt: skip
    """Returns brightness (K,) and differences (K,) of one measurement's variance, in electrons by the guessed gain."""
    light = photometry.light_vectors(photometry.points(pixels.ray, depth_m), lamp, calibration)
    strength = photometry.strength(light)
    usable, _, _ = pixel_solve.classify_measurements(pixels, pixels.values, light, SolveSettings().shadow_threshold)
    weighted = light * (usable / np.maximum(strength, np.float32(1e-9)) ** 2)[:, None]
    inner = np.einsum("fan,fbn->nab", weighted, light, optimize=True) + 1e-6 * np.eye(3)
    solver = np.linalg.solve(inner, weighted.transpose(2, 1, 0))  # (N, 3, F): g from values
    albedo = np.linalg.norm(np.einsum("nak,kn->na", solver, pixels.values, optimize=True), axis=1)
    projection = np.eye(len(lamp)) - np.einsum("fan,nak->nfk", light, solver, optimize=True)
    residual = np.einsum("nfk,kn->fn", projection, pixels.values, optimize=True) / np.maximum(albedo, 1e-9)
    variance = np.where(usable, np.maximum(pixels.values, 0) * shot[:, None] + floor[:, None], 0)
    share = np.einsum("nfk,kn->fn", projection**2, variance, optimize=True) / np.maximum(variance, 1e-30)

    least = 1 - residual_noise.SETTINGS.max_leverage
    number = photon_transfer.quads(pixels.image(np.arange(1, len(pixels.index) + 1))).reshape(4, -1)
    at = number[:, np.all(number > 0, axis=0)] - 1  # (4, K) the corners of squares that lie on the object
    lit = usable[:, at]
    good = lit[:, 0] & np.all(lit == lit[:, :1], axis=(0, 1)) & (np.min(share[:, at], axis=1) > least)
    level, spread, bright = (np.mean(part[..., at], axis=-2) for part in (pixels.values, share, albedo))
    apart = photon_transfer.quad_differences(residual[:, at], axis=1)
    apart = apart * bright / np.sqrt(np.maximum(spread, least)) / shot[:, None]
    return (level / shot[:, None])[good].astype(np.float32), apart[good].astype(np.float32)
