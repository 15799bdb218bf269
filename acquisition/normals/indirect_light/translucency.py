"""Test for light that spreads below the surface, by the light that leaks into cast shadows near their edges.

In lit pixels blurred shading equals the shading of a smoother surface. Residuals do not show it, because every pixel
has its own normal and albedo. Shadow edges do: the cast shadow of a small lamp is sharp within a pixel on an opaque
surface, while on a translucent one light from the lit side crosses the edge over a mean free path.

The observed irradiance in the dark pixels near each edge, at least one pixel away from it, is regressed on the
irradiance that `surface_diffusion.blurred` predicts there from the lit pixels. The predicted indirect light is
subtracted before, because the walls of a vessel send light into shadows near their edges, too (decision 99). Both are
taken without their local mean, which light from farther away causes. Irradiance is the value over the albedo; it is
used because a texture has edges of its own. The coefficient is the score of the blur in these pixels: 1 at the right
mean free path, and near 0 on opaque surfaces.

What a glossy surface mirrors also reaches into shadows (decision 48 lists the false positives). `term_alternatives`
therefore looks for no leak once gloss or metal is modelled, and shadows have to cover `min_pixel_share` of the object.
A defocused image looks the same, and is corrected alike.
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
    """Tuned number of the test for light in shadows."""

    min_coefficient: float = tuned(0.3, "share")
    """Least coefficient, if it is significant, from which images are sharpened on trial: light in shadows as a share of
    that by a mean free path of one pixel of the coarse grid. Measured: 0.5–2.5 on translucent objects, 0.2 with a mean
    free path of half a pixel, 0.1 on a smooth glossy solid."""


SETTINGS = TranslucencySettings()

KIND = "translucent surface"
"""Kind of the finding that light spreads below the surface, or that images are out of focus."""

LENGTHS_PX = (0.5, 0.7, 1.0, 1.4, 2.0, 2.8)
"""Mean free paths, pixels of the coarse grid, that are compared when light leaks. Light of shorter ones stays within
the pixels at the edge; sharpening by longer ones would amplify noise."""

NEAR_PX = 6
"""Distance from lit pixels up to which dark pixels are used, in pixels of the coarse grid. It is twice the longest mean
free path of the comparison, of which 3 % of the irradiance within a straight edge is left at this distance; of 1 px it
is 0.04 %. Half of it is the standard deviation of the Gaussian for local means and for the brightness of lit pixels."""

TESTED_PX = 1.0
"""Mean free path for which the regression is tested."""

GRID = 6
"""Rows and columns of a grid over the object's bounding box, whose cells are left out in turn (jackknife)."""

ALBEDO_ROUNDS = 2
"""Number of alternations of albedo and lit images."""

ROBUST_ROUNDS = 8
"""Number of reweightings of the regression."""

MIN_LIGHTS = 3
"""Least number of images in which a pixel has to be lit for its albedo to be known."""


@dataclass(frozen=True)
class Leak:
    """Regression of light in shadows on its prediction by a mean free path: the coefficient at `TESTED_PX`, and the
    mean free path in pixels at which it is 1, or 0 if it is insignificant or shorter than all `LENGTHS_PX`."""

    coefficient: float
    length_px: float

    @property
    def sought(self) -> bool:
        """Whether the leak is large enough for images to be sharpened."""
        return self.length_px > 0 and self.coefficient >= SETTINGS.min_coefficient


@dataclass(frozen=True)
class _Shadow:
    """Irradiance (h, w) of one image, that of lit pixels alone, the dark pixels that are used, and the level around."""

    image: Float32Array
    source: Float32Array
    dark: BoolArray
    level: Float32Array


def leak(
    pixels: Pixels, values: Float32Array, shading: Float32Array, received: Float32Array | None, over: SurfaceGraph
) -> Leak | None:
    """Tests `values` (F, N) of nominal lamps against the `shading` (F, N) of a solution; none: too few dark pixels.

    `received` (F, N) is the irradiance from other surfaces; none: it is insignificant. The mean free path is estimated
    only if the coefficient is significant.
    """
    if received is not None:
        albedo, _ = albedo_and_lit(values, shading)
        values = np.asarray(values - albedo * received, np.float32)
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
    """Returns max(0, n·s) (F, N) of unit normals (3, N) at depth (N,), the factor of the albedo."""
    light = photometry.light_vectors(photometry.points(pixels.ray, depth_m), lamps, calibration)
    return np.maximum(np.einsum("fcn,cn->fn", light, normals), np.float32(0))


def albedo_and_lit(values: Float32Array, shading: Float32Array) -> tuple[Float32Array, BoolArray]:
    """Estimates the albedo (N,) from the images in which a pixel is lit, which are also returned (F, N); 0: too few."""
    lit = (shading > 0) & (values > photometry.SETTINGS.grazing_cosine * np.max(values, axis=0))
    albedo = np.zeros(values.shape[1], np.float32)
    for _ in range(ALBEDO_ROUNDS):
        albedo = np.sum(lit * values * shading, axis=0) / np.maximum(np.sum(lit * shading**2, axis=0), 1e-9)
        lit = (shading > 0) & (values > photometry.SETTINGS.grazing_cosine * albedo * shading)
    known = (np.count_nonzero(lit, axis=0) >= MIN_LIGHTS) & (albedo > 0)
    return np.where(known, albedo, 0).astype(np.float32), lit & known


def _length_at_one(coefficients: FloatArray) -> float:
    """Finds by log–log interpolation where coefficients at `LENGTHS_PX`, which fall with the length, reach 1."""
    if coefficients[0] <= 1:
        return 0.0
    above = int(np.argmax(coefficients <= 1)) if np.any(coefficients <= 1) else len(coefficients)
    if above == len(coefficients):
        return LENGTHS_PX[-1]
    high, low = np.log(coefficients[above - 1]), np.log(max(coefficients[above], 1e-3))
    share = high / (high - low)
    return float(np.exp((1 - share) * np.log(LENGTHS_PX[above - 1]) + share * np.log(LENGTHS_PX[above])))


def _shadows(pixels: Pixels, values: Float32Array, shading: Float32Array, over: SurfaceGraph) -> list[_Shadow]:
    """Returns the images with enough dark pixels near lit ones, away from the silhouette and from depth steps."""
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
    """Returns each pixel's cell number (h, w) in a `GRID` × `GRID` grid over the object's bounding box."""
    row, column = np.unravel_index(pixels.index, pixels.shape)
    cell = np.zeros(pixels.shape, int)
    height, width = np.ptp(row) + 1, np.ptp(column) + 1
    cell[row, column] = (row - row.min()) * GRID // height * GRID + (column - column.min()) * GRID // width
    return cell


def _regressed(
    shadows: list[_Shadow], observed: FloatArray, over: SurfaceGraph, length_px: float, cell: np.ndarray
) -> tuple[float, float]:
    """Regresses robustly on the leak of a mean free path: coefficient and standard error. The error is that of the
    residuals or, if larger, that of a jackknife over the cells (N,)."""
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
    """Returns an image at the dark pixels, less its local mean over them, as a share of the brightness around."""
    high = image - _local_mean(image, shadow.dark, NEAR_PX / 2)
    return (high[shadow.dark] / shadow.level[shadow.dark]).astype(np.float64)


def _local_mean(image: Float32Array, where: np.ndarray, sigma_px: float) -> Float32Array:
    """Returns the Gaussian mean (h, w) over some of an image's pixels; 0 where there are none near."""
    weight = cv2.GaussianBlur(where.astype(np.float32), (0, 0), sigma_px)
    total = cv2.GaussianBlur(np.where(where, image, 0).astype(np.float32), (0, 0), sigma_px)
    return np.asarray(total / np.maximum(weight, 1e-6), np.float32)


def _dilated(mask: np.ndarray, width: int) -> BoolArray:
    return cv2.dilate(mask, np.ones((width, width), np.uint8)) > 0
