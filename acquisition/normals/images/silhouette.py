"""Segmentation of the object in the images, against a lit table or against a background that no light reaches.

`segment` separates the object from a table by radiance alone: the object is brighter, and one connected component. Each
pixel's largest normalised value over the lights, divided by that of a white surface there, is a lower bound of its
albedo, on which a single shadow has no effect. Otsu's threshold (1979) on its logarithm splits the region. Steep parts
of the object are darker by a factor of two or three, so the threshold is then moved towards the table, as near as the
table's own scatter allows. The largest connected component with its holes filled is the silhouette, because steep walls
and dark spots inside belong to the object.

`propose` finds the object in a folder without a mask. A pixel belongs to it if its values in three images, the least
number for a normal, exceed the background by a multiple of the noise. Both are estimated from each image: the
background is the level of its dark pixels, the noise that of differences of neighbours among them. This cannot separate
the object from a background that lights reach.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.result import SolveSettings
from acquisition.models.tuned import tuned
from acquisition.normals.images.image_set import ImageSet
from acquisition.normals.images.normalised_images import row_blocks


@dataclass(frozen=True)
class SilhouetteSettings:
    """Tuned numbers of the masks."""

    min_contrast: float = tuned(1.5, "1")
    """Ratio of object to table below which the region is assumed to hold only the object; also the least ratio of an
    object pixel to the table. Measured on 24 simulated objects of albedo 0.3–0.7 with tables of 0.08–0.25: all masks
    are right, also in regions of the object alone; with 2 their overlap (IoU) is 0.87 before tables, with 1.2 it is
    0.69 in such regions (scratch evaluation, November 2026)."""
    min_component_share: float = tuned(0.01, "share")
    """Share of the largest connected region's area below which another region is left out as dust or stray reflection.
    Measured with six specks of 21 pixels in the frame: overlaps (IoU) are 0.985, with half 0.976, with twice 0.989."""


SETTINGS = SilhouetteSettings()

SAMPLE_ROWS = 96
"""Rows of each image from which noise and background are estimated."""

WITHIN_SIGMA = 0.683
"""Share of normally distributed values within 1 σ."""


def largest_component(mask: BoolArray) -> BoolArray:
    """Returns the largest 4-connected component of a mask, with its holes filled."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)
    if count < 2:
        return np.zeros_like(mask)
    part = labels == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    outside = cv2.copyMakeBorder((~part).astype(np.uint8), 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=1)
    _, background = cv2.connectedComponents(outside, connectivity=8)
    return (background != background[0, 0])[1:-1, 1:-1]


def segment(albedo_bound: Float32Array, region: BoolArray) -> BoolArray:
    """Segments the object (h, w) within `region` by Otsu's method, by the lower bound (h, w) of each pixel's albedo,
    which is infinite where it is clipped. Raises RigError normals.infeasible if nothing is lit."""
    measured = albedo_bound[region & np.isfinite(albedo_bound) & (albedo_bound > 0)]
    if measured.size < 16 or float(np.quantile(measured, 0.99)) < 1e-3:
        raise RigError(
            ErrorCode.NORMALS_INFEASIBLE,
            "nothing in the region is lit in any image: check lamp, exposure and where the object stands",
        )
    level = np.log(np.clip(measured, 1e-4, None))
    threshold = _otsu(level)
    table, bright = level[level < threshold], level[level >= threshold]
    least = np.log(SETTINGS.min_contrast)
    if table.size < 16 or float(np.median(bright) - np.median(table)) < least:
        return largest_component(region & (albedo_bound > np.exp(np.median(level)) * 0.05))
    middle = float(np.median(table))
    scatter = float(np.median(np.abs(table - middle))) / photometry.GAUSSIAN_MEDIAN_DEVIATION
    threshold = min(threshold, middle + max(photometry.SETTINGS.significant_deviations * scatter, least))
    candidate = (region & (albedo_bound > np.exp(threshold))).astype(np.uint8)
    return largest_component(cv2.morphologyEx(candidate, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0)


def _otsu(level: Float32Array) -> float:
    """Returns Otsu's threshold of a sample, in 256 bins without its extremes."""
    low, high = np.quantile(level, [0.001, 0.999]).tolist()
    width = (high - low) / 256 + 1e-9
    bins = np.clip((level - low) / width, 0, 255).astype(np.uint8)
    last, _ = cv2.threshold(bins, 0, 255, cv2.THRESH_OTSU)
    return low + (last + 1) * width


def propose(images: ImageSet) -> BoolArray:
    """Proposes the object's mask (H, W): lit in three images, holes closed, small regions left out.

    If nothing is lit, it is the whole frame; later checks then refuse the images by name.
    """
    backgrounds = [background(images, number) for number in range(images.count)]
    lit = np.zeros((images.height, images.width), np.bool_)
    rank = images.count - min(photometry.PIXEL_UNKNOWNS, images.count)
    for rows in row_blocks(images.height):
        above = np.empty((images.count, rows.stop - rows.start, images.width), np.float32)
        for number, (level, noise) in enumerate(backgrounds):
            above[number] = (_grey(images, number, rows) - level) / noise
        lit[rows] = np.partition(above, rank, axis=0)[rank] > photometry.SETTINGS.significant_deviations
    return _regions(lit) if np.any(lit) else np.ones_like(lit)


def background(images: ImageSet, number: int) -> tuple[float, float]:
    """Estimates level and noise of one image's background, as fractions of full scale, from the median of its dark
    pixels and from differences of neighbours among them."""
    rows = np.unique(np.linspace(0, images.height - 1, min(SAMPLE_ROWS, images.height)).astype(int))
    values = np.concatenate([_grey(images, number, slice(row, row + 1)) for row in rows.tolist()])
    finite = np.nan_to_num(values, posinf=1.0)
    dark = finite <= SolveSettings().shadow_threshold * float(np.quantile(finite, 0.99))
    level = float(np.median(finite[dark])) if np.any(dark) else 0.0
    differences = np.abs(np.diff(finite, axis=1))[dark[:, :-1] & dark[:, 1:]]
    # A quantile above the median, because sensors cut values at black, where half of the pixels are equal.
    noise = float(np.quantile(differences, WITHIN_SIGMA)) / np.sqrt(2) if differences.size else 0.0
    quantum = 1.0 / images.full_scale if images.quantised else 1e-6
    return level, max(noise, quantum / 2)


def _grey(images: ImageSet, number: int, rows: slice) -> Float32Array:
    """Returns the mean of the channels (rows, W), as fractions of full scale."""
    values = images.values(number, rows.start, rows.stop)
    return values if values.ndim == 2 else values.mean(axis=2)


def _regions(lit: BoolArray) -> BoolArray:
    """Returns the regions of lit pixels above `min_component_share` of the largest; closes or removes single pixels."""
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    cleaned = cv2.morphologyEx(lit.astype(np.uint8), cv2.MORPH_OPEN, cross)
    cleaned = cv2.morphologyEx(cleaned, cv2.MORPH_CLOSE, cross)
    if not np.any(cleaned):
        return lit
    _, label, statistics, _ = cv2.connectedComponentsWithStats(cleaned, connectivity=4)
    areas = statistics[:, cv2.CC_STAT_AREA]
    areas[0] = 0
    return np.isin(label, np.flatnonzero(areas >= max(1, SETTINGS.min_component_share * areas.max())))
