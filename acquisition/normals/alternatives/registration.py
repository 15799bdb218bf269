"""Registration of the images with one another: each image's translation against the prediction (Lucas & Kanade 1981).

An object or camera that moved between two images leaves a residual in the direction of the predicted image's gradient.
Least squares over the object gives one translation for each image. Since it moved once, they also tell when. Borders of
shadows move with the lamp and not with the object, so only measurements well inside lit parts count.

Least squares is not made robust, because weights would reject the residuals of the largest moves. Measured, after four
rounds: nine captures that moved by 1 or 2 pixels are found 11 % short with robust weights, 6 % without, and 8 % by
OpenCV's ECC (design seeds 40, 70 and 71 of six families, ten lights; scratch evaluation, November 2026).
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from acquisition import mosaic, photometry
from acquisition.models.base import Float32Array, FloatArray
from acquisition.normals import alternation
from acquisition.normals.alternatives import changed_images
from acquisition.normals.pixels import pixel_solve, resampling
from acquisition.normals.pixels.pixel_solve import Pixels, Scene

ROUNDS, LEAST_STEP_PX = 8, 0.03
"""Largest number of alternations of solve and registration, and the step that ends them. Several are needed because the
first solution is of the unregistered images. Measured: with four of them moves are found 6 % short, with eight 1 %;
images that did not move end at the first or second."""


@dataclass(frozen=True)
class Registration:
    """Translation (F, 2) of each image's content against the first's, pixels of a grid in x and y. `residual_ratio` is
    the median residual of pixels once that is undone, over that before."""

    translations: FloatArray
    residual_ratio: float


def register(pixels: Pixels, depth_m: Float32Array, scene: Scene, log_intensity: FloatArray) -> Registration:
    """Registers images with one another at pixels' depth (N,), m. `scene` has lamps and noise as estimated,
    `log_intensity` (F,) is divided out of the images. In a mosaic the cells are registered, not the sites."""
    if pixels.channel is not None:
        of_cells_m = resampling.coarsen_values(depth_m, pixels, mosaic.CELL)
        found = register(resampling.coarsen(pixels, mosaic.CELL), of_cells_m, scene, log_intensity)
        return replace(found, translations=mosaic.CELL * found.translations)
    values = alternation.divide_intensity(pixels.values, log_intensity)
    stack = [pixels.image(one) for one in values]
    inside = pixels.image(np.ones(len(pixels.index), np.uint8))
    core = cv2.erode(inside, np.ones((5, 5), np.uint8), borderValue=0) > 0
    total, residuals = np.zeros((len(values), 2)), list[float]()
    for _ in range(ROUNDS):
        moved = np.stack(
            [pixels.take(changed_images.shifted(one, -shift)) for one, shift in zip(stack, total, strict=True)]
        )
        estimate = pixel_solve.solve(pixels, moved.astype(np.float32), depth_m, scene)
        residuals.append(float(np.median(estimate.residual)))
        step = np.array(
            [
                _step(pixels.image(one), pixels.image(model), core & _lit(pixels, usable))
                for one, model, usable in zip(moved, estimate.predicted(), estimate.usable, strict=True)
            ]
        )
        before, total = total, single_move(total + step)
        if np.max(np.abs(total - before)) < LEAST_STEP_PX:
            break
    return Registration(total, residuals[-1] / max(residuals[0], 1e-9))


def single_move(translations: FloatArray) -> FloatArray:
    """Returns the translations (F, 2) of images that moved once, between two of them: zero before, one vector after.

    An image's own translation is uncertain by half a pixel, because errors of its shading resemble one. Medians of
    those before and after are not, so the split of least absolute deviations is taken.
    """
    count = len(translations)
    splits = [(translations[:k], translations[k:]) for k in range(1, count)]
    cost = [sum(float(np.sum(np.abs(part - np.median(part, axis=0)))) for part in both) for both in splits]
    before, after = splits[int(np.argmin(cost))]
    move = np.median(after, axis=0) - np.median(before, axis=0)
    return np.concatenate([np.zeros_like(before), np.broadcast_to(move, after.shape)])


def _lit(pixels: Pixels, usable: np.ndarray) -> np.ndarray:
    return cv2.erode(pixels.image(usable.astype(np.uint8)), np.ones((3, 3), np.uint8), borderValue=0) > 0


def _step(image: Float32Array, model: Float32Array, counted: np.ndarray) -> FloatArray:
    """Returns one least-squares Lucas–Kanade step: the translation from the content of `model` to that of `image`."""
    if np.count_nonzero(counted) < photometry.SETTINGS.min_sample:
        return np.zeros(2)
    slopes = -np.stack([np.gradient(model.astype(np.float64), axis=axis)[counted] for axis in (1, 0)], axis=1)
    return np.asarray(np.linalg.lstsq(slopes, (image - model)[counted])[0], np.float64)
