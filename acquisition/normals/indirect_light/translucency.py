"""Test for light that spreads below the surface: what leaks into cast shadows, next to their edges.

Where a pixel is lit, blurred shading is the shading of a smoother surface: no residual tells, since every pixel has its
own normal and albedo. At the edges of shadows it does: a cast shadow of a small lamp is sharp within a pixel, and one
on a translucent surface is crossed by light from its lit side over a mean free path. So in the dark pixels near each
edge, one apart from it, the observed irradiance is regressed on what `surface_diffusion.blurred` predicts of the lit
ones, both without their local mean, which indirect light makes; irradiance, the value over the albedo, because a
texture has edges of its own. The coefficient is nothing but the score of the blur in the pixels that have a say: 1 at
the right mean free path, and near 0 on opaque surfaces. Not all of these: what a glossy one mirrors, or the walls of a
recess send, reaches into shadows as well (decision 48 names the false alarms), so that `term_alternatives` looks for
no leak once gloss or metal is modelled, and shadows have to cover `min_pixel_share` of the object. A defocused image
looks the same as a translucent surface, and is cured alike.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.tuned import tuned
from acquisition.normals.indirect_light import interreflection, surface_diffusion
from acquisition.normals.indirect_light.surface_diffusion import SurfaceGraph
from acquisition.normals.pixels.pixel_solve import Pixels


@dataclass(frozen=True)
class TranslucencySettings:
    """Tuned numbers of the test for light in shadows."""

    min_coefficient: float = tuned(0.3, "share")
    """Light in shadows, as a share of what a mean free path of one pixel of the coarse grid makes, from which images
    are sharpened on trial if it is significant. 0.5–2.5 of translucent objects, 0.2 of a mean free path of half a
    pixel, 0.1 of gloss on a smooth solid."""


SETTINGS = TranslucencySettings()

KIND = "translucent surface"
"""Kind of the finding that light spreads below the surface, or that images are out of focus."""

LENGTHS_PX = (0.5, 0.7, 1.0, 1.4, 2.0, 2.8)
"""Mean free paths, pixels of the coarse grid, that are compared when light leaks; shorter ones stay within the pixels
at the edge, and sharpening by a longer one would bring up noise."""

NEAR_PX = 6
"""Distance from lit pixels up to which dark ones take part, pixels of the coarse grid; twice the standard deviation of
the Gaussian of local means, and of the brightness of the lit pixels around. It is twice the longest mean free path that
is compared, of which 3 % of the irradiance within a straight edge is left there; of 1 px it is 0.04 %."""

TESTED_PX = 1.0
"""Mean free path for which the regression is tested."""

GRID = 6
"""Parts of the object that are left out in turn: cells of a grid of so many rows and columns over its bounding box."""

ALBEDO_ROUNDS = 2
"""Alternations of albedo and lit images."""

ROBUST_ROUNDS = 8
"""Reweightings of the regression."""

MIN_LIGHTS = 3
"""Images in which a pixel has to be lit for its prediction to count."""


@dataclass(frozen=True)
class Leak:
    """Regression of light in shadows on what a mean free path predicts: the coefficient at `TESTED_PX`, and the mean
    free path in pixels at which it is 1, 0 where it is insignificant or below the least."""

    coefficient: float
    length_px: float

    @property
    def sought(self) -> bool:
        """Whether it is so much that images are worth to be sharpened."""
        return self.length_px > 0 and self.coefficient >= SETTINGS.min_coefficient


@dataclass(frozen=True)
class _Shadow:
    """Irradiance (h, w) of one image, that of lit pixels alone, dark pixels that take part, and the level around."""

    image: Float32Array
    source: Float32Array
    dark: BoolArray
    level: Float32Array


def leak(pixels: Pixels, values: Float32Array, shading: Float32Array, over: SurfaceGraph) -> Leak | None:
    """Tests `values` (F, N) of nominal lamps against the `shading` (F, N) of a solution; none: too few dark pixels.

    The mean free path is only sought where the coefficient is significant.
    """
    shadows = _shadows(pixels, values, shading, over)
    place = _cells(pixels)
    cell = np.concatenate([place[one.dark] for one in shadows] or [np.zeros(0, int)])
    if (
        len(cell) < photometry.SETTINGS.min_sample
        or np.mean(np.any([pixels.take(one.dark) for one in shadows], axis=0)) < photometry.SETTINGS.min_pixel_share
    ):
        return None
    observed = np.concatenate([_relative(one, one.image) for one in shadows])
    coefficient, error = _regressed(shadows, observed, over, TESTED_PX, cell)
    if coefficient < photometry.SETTINGS.outlying_deviations * error:
        return Leak(coefficient, 0.0)
    coefficients = [_regressed(shadows, observed, over, length, cell)[0] for length in LENGTHS_PX]
    return Leak(coefficient, _length_at_one(np.array(coefficients)))


def shading(
    pixels: Pixels, depth_m: Float32Array, normals: Float32Array, lamps: Float32Array, calibration: Calibration
) -> Float32Array:
    """max(0, n·s) (F, N) of unit normals (3, N) at depth (N,), which the albedo multiplies."""
    light = photometry.light_vectors(photometry.points(pixels.ray, depth_m), lamps, calibration)
    return np.maximum(np.einsum("fcn,cn->fn", light, normals), np.float32(0))


def albedo_and_lit(values: Float32Array, shading: Float32Array) -> tuple[Float32Array, BoolArray]:
    """Albedo (N,) from the images in which a pixel is lit, 0 where they are too few, and which these are (F, N)."""
    lit = (shading > 0) & (values > photometry.SETTINGS.grazing_cosine * np.max(values, axis=0))
    albedo = np.zeros(values.shape[1], np.float32)
    for _ in range(ALBEDO_ROUNDS):
        albedo = np.sum(lit * values * shading, axis=0) / np.maximum(np.sum(lit * shading**2, axis=0), 1e-9)
        lit = (shading > 0) & (values > photometry.SETTINGS.grazing_cosine * albedo * shading)
    known = (np.count_nonzero(lit, axis=0) >= MIN_LIGHTS) & (albedo > 0)
    return np.where(known, albedo, 0).astype(np.float32), lit & known


def _length_at_one(coefficients: FloatArray) -> float:
    """Where coefficients at `LENGTHS_PX`, which fall with the length, reach 1: log–log interpolation."""
    if coefficients[0] <= 1:
        return 0.0
    above = int(np.argmax(coefficients <= 1)) if np.any(coefficients <= 1) else len(coefficients)
    if above == len(coefficients):
        return LENGTHS_PX[-1]
    high, low = np.log(coefficients[above - 1]), np.log(max(coefficients[above], 1e-3))
    share = high / (high - low)
    return float(np.exp((1 - share) * np.log(LENGTHS_PX[above - 1]) + share * np.log(LENGTHS_PX[above])))


def _shadows(pixels: Pixels, values: Float32Array, shading: Float32Array, over: SurfaceGraph) -> list[_Shadow]:
    """The images that have enough dark pixels near lit ones, away from the silhouette and from depth steps."""
    albedo, lit = albedo_and_lit(values, shading)
    known = pixels.image((albedo > 0).astype(np.uint8))
    steps, at_wall = np.zeros(pixels.shape, np.uint8), 1 / (1 + interreflection.SETTINGS.wall_slope**2)
    steps[:, :-1] |= over.across < at_wall
    steps[:-1] |= over.down < at_wall
    core = (cv2.erode(known, np.ones((5, 5), np.uint8), borderValue=0) > 0) & ~_dilated(steps & known, 3)
    out: list[_Shadow] = []
    for irradiance, image_lit in zip(values / np.where(albedo > 0, albedo, np.inf), lit, strict=True):
        bright = pixels.image(image_lit.astype(np.uint8))
        dark = core & ~_dilated(bright, 3) & _dilated(bright, 2 * NEAR_PX + 1)
        if np.count_nonzero(dark) < photometry.SETTINGS.min_sample:
            continue
        image = pixels.image(irradiance.astype(np.float32))
        source = np.where(bright > 0, image, 0).astype(np.float32)
        level = _local_mean(source, bright, NEAR_PX / 2)
        dark &= level > 0
        out.append(_Shadow(image, source, dark, level))
    return out


def _cells(pixels: Pixels) -> np.ndarray:
    """Number (h, w) of the cell of a `GRID` × `GRID` grid over the object's bounding box."""
    row, column = np.unravel_index(pixels.index, pixels.shape)
    cell = np.zeros(pixels.shape, int)
    height, width = np.ptp(row) + 1, np.ptp(column) + 1
    cell[row, column] = (row - row.min()) * GRID // height * GRID + (column - column.min()) * GRID // width
    return cell


def _regressed(
    shadows: list[_Shadow], observed: FloatArray, over: SurfaceGraph, length_px: float, cell: np.ndarray
) -> tuple[float, float]:
    """Coefficient of the robust regression on the leak of a mean free path, and its standard error: from the residuals
    or, where it is larger, from the scatter between cells (N,), one left out in turn (jackknife)."""
    rows = np.concatenate([_relative(one, surface_diffusion.blurred(one.source, over, length_px)) for one in shadows])
    weight, slope, error = np.ones_like(observed), 0.0, float("inf")
    for _ in range(ROBUST_ROUNDS):
        information = max(float(np.sum(weight * rows**2)), 1e-15)
        slope = float(np.sum(weight * rows * observed)) / information
        left = observed - slope * rows
        scale = max(float(np.median(np.abs(left))) / photometry.GAUSSIAN_MEDIAN_DEVIATION, 1e-9)
        error = scale / np.sqrt(information)
        weight = 1 / (1 + (left / (photometry.CAUCHY_SCALE * scale)) ** 2)
    score, information = (np.bincount(cell, weight * rows * one) for one in (observed, rows))
    inside = information > 0
    without = ((np.sum(score) - score) / np.maximum(np.sum(information) - information, 1e-15))[inside]
    return slope, max(float(error), float(np.sqrt((len(without) - 1) * np.var(without))))


def _relative(shadow: _Shadow, image: Float32Array) -> FloatArray:
    """An image at the dark pixels, without its local mean over them, as a share of the brightness around."""
    high = image - _local_mean(image, shadow.dark, NEAR_PX / 2)
    return (high[shadow.dark] / shadow.level[shadow.dark]).astype(np.float64)


def _local_mean(image: Float32Array, where: np.ndarray, sigma_px: float) -> Float32Array:
    """Gaussian mean (h, w) over some of an image's pixels; 0 where there are none near."""
    weight = cv2.GaussianBlur(where.astype(np.float32), (0, 0), sigma_px)
    total = cv2.GaussianBlur(np.where(where, image, 0).astype(np.float32), (0, 0), sigma_px)
    return np.asarray(total / np.maximum(weight, 1e-6), np.float32)


def _dilated(mask: np.ndarray, width: int) -> BoolArray:
    return cv2.dilate(mask, np.ones((width, width), np.uint8)) > 0
