"""Segmentation of the object's silhouette by brightness: it is brighter than its table, and one connected component.

The table is seen by the camera and lit like the object, so radiance alone must separate them. Each pixel's largest
normalised value over the lights, divided by that of a white surface there, is a lower bound of its albedo that no
single shadow spoils. Otsu's threshold (1979) on its logarithm splits the region; since a steep object pixel loses a
factor of two or three, the threshold is then moved towards the table, as near as the table's own scatter allows. The
largest connected component with its holes filled is the silhouette: steep walls and dark spots inside belong to the
object.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from acquisition.models.base import BoolArray, Float32Array
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.tuned import tuned


@dataclass(frozen=True)
class SilhouetteSettings:
    """Tuned numbers of the mask by brightness."""

    min_contrast: float = tuned(1.5, "1")
    """Ratio of object to table below which the region is assumed to hold only the object."""
    table_deviations: float = tuned(6.0, "σ")
    """σ of the table's log brightness by which the threshold lies above its median."""
    table_margin: float = tuned(1.35, "1")
    """Factor by which it lies above it at least."""


SETTINGS = SilhouetteSettings()


def bounding_box(mask: BoolArray) -> tuple[slice, slice]:
    """Bounding box of a mask as rows and columns; an empty mask's is its first pixel."""
    indices = [np.flatnonzero(np.any(mask, axis=axis)) for axis in (1, 0)]
    rows, columns = (slice(int(one[0]), int(one[-1]) + 1) if len(one) else slice(0, 1) for one in indices)
    return rows, columns


def largest_component(mask: BoolArray) -> BoolArray:
    """Largest 4-connected component of a mask, its holes filled."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)
    if count < 2:
        return np.zeros_like(mask)
    part = labels == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    outside = cv2.copyMakeBorder((~part).astype(np.uint8), 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=1)
    _, background = cv2.connectedComponents(outside, connectivity=8)
    return (background != background[0, 0])[1:-1, 1:-1]


def albedo_bound(values: Float32Array, strength: Float32Array, clipped: BoolArray) -> Float32Array:
    """Lower bound of the albedo (h, w): each pixel's largest value as a share of a white surface's, inf if clipped.

    `values` and `clipped` (F, h, w); `strength` |s| (F, h, w) on a rough plane.
    """
    ratio = values / np.maximum(strength, 1e-6)
    ratio[clipped] = np.inf  # at least as bright as can be measured
    return np.max(ratio, axis=0)


def segment(albedo_bound: Float32Array, region: BoolArray) -> BoolArray:
    """Otsu segmentation of the object (h, w) within `region` by the `albedo_bound` (h, w) of each pixel.

    Raises RigError normals.infeasible when nothing is lit.
    """
    measured = albedo_bound[region & np.isfinite(albedo_bound) & (albedo_bound > 0)]
    if measured.size < 16 or float(np.quantile(measured, 0.99)) < 1e-3:
        raise RigError(
            ErrorCode.NORMALS_INFEASIBLE,
            "nothing in the region is lit in any image: check lamp, exposure and where the object stands",
        )
    level = np.log(np.clip(measured, 1e-4, None))
    threshold = _otsu(level)
    table, bright = level[level < threshold], level[level >= threshold]
    if table.size < 16 or float(np.median(bright) - np.median(table)) < np.log(SETTINGS.min_contrast):
        return largest_component(region & (albedo_bound > np.exp(np.median(level)) * 0.05))
    middle = float(np.median(table))
    scatter = 1.4826 * float(np.median(np.abs(table - middle)))
    threshold = min(threshold, middle + max(SETTINGS.table_deviations * scatter, np.log(SETTINGS.table_margin)))
    candidate = region & (albedo_bound > np.exp(threshold))
    return largest_component(
        cv2.morphologyEx(candidate.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0
    )


def _otsu(level: Float32Array) -> float:
    """Otsu's threshold: maximises the variance between two classes of a sample."""
    low, high = np.quantile(level, [0.001, 0.999])
    counts, edges = np.histogram(level, bins=256, range=(float(low), float(high) + 1e-6))
    centers = (edges[:-1] + edges[1:]) / 2
    below = np.cumsum(counts)
    above = below[-1] - below
    sums = np.cumsum(counts * centers)
    with np.errstate(divide="ignore", invalid="ignore"):
        between = below * above * (sums / below - (sums[-1] - sums) / above) ** 2
    return float(edges[1 + int(np.nanargmax(between))])
