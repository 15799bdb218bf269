"""Mask of the pixels that lights reach, proposed from the images where a folder has none.

A pixel belongs to the object if three images, the least that give a normal, lie above the background by a multiple of
their noise. Both come from each image itself: the noise from differences of neighbouring pixels among the darkest, the
background from the level of these. A background that lights reach, such as a table, cannot be told apart this way.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from acquisition.models.base import BoolArray, Float32Array
from acquisition.models.tuned import tuned
from acquisition.normals.image_set import ImageSet
from acquisition.normals.session_images import BLOCK_ROWS

MIN_IMAGES = 3
"""Images in which a pixel must be lit: the least that give a normal."""


@dataclass(frozen=True)
class LitMaskSettings:
    """Tuned numbers of the mask of lit pixels."""

    noise_multiple: float = tuned(5.0, "σ")
    """Noise σ above the background from which a pixel counts as lit."""
    dark_share: float = tuned(0.1, "share")
    """Share of an image's pixels that are its darkest."""
    max_background_share: float = tuned(0.03, "share")
    """Share of an image's 99th percentile up to which its darkest pixels are background; above it the object fills the
    image, and black is the background's level."""
    min_component_share: float = tuned(0.01, "share")
    """Share of the largest connected region below which another is left out: dust, stray reflections."""


SETTINGS = LitMaskSettings()

SAMPLE_ROWS = 96
"""Rows of each image that noise and background are estimated from."""

WITHIN_SIGMA = 0.683
"""Share of normally distributed values within 1 σ."""


@dataclass(frozen=True)
class Background:
    """Level and noise of the background of one image, as fractions of full scale."""

    level: float
    noise: float


def propose(images: ImageSet) -> BoolArray:
    """Proposes the object's mask (H, W): lit in MIN_IMAGES images, holes closed, small regions left out.

    The whole frame where nothing is lit at all, so that what follows refuses the images by name.
    """
    backgrounds = [background(images, number) for number in range(images.count)]
    lit = np.zeros((images.height, images.width), np.bool_)
    rank = images.count - min(MIN_IMAGES, images.count)
    for start in range(0, images.height, BLOCK_ROWS):
        stop = min(start + BLOCK_ROWS, images.height)
        above = np.empty((images.count, stop - start, images.width), np.float32)
        for number, dark in enumerate(backgrounds):
            above[number] = (_grey(images, number, start, stop) - dark.level) / dark.noise
        lit[start:stop] = np.partition(above, rank, axis=0)[rank] > SETTINGS.noise_multiple
    return _regions(lit) if np.any(lit) else np.ones_like(lit)


def background(images: ImageSet, number: int) -> Background:
    """Background of one image: median of its dark pixels, and noise from differences of neighbours among them."""
    rows = np.unique(np.linspace(0, images.height - 1, min(SAMPLE_ROWS, images.height)).astype(int))
    values = np.concatenate([_grey(images, number, int(row), int(row) + 1) for row in rows])
    finite = np.nan_to_num(values, posinf=1.0)
    darkest = float(np.quantile(finite, SETTINGS.dark_share))
    limit = max(darkest, SETTINGS.max_background_share * float(np.quantile(finite, 0.99)))
    dark = finite <= limit
    level = float(np.median(finite[dark])) if darkest < limit else 0.0
    differences = np.abs(np.diff(finite, axis=1))[dark[:, :-1] & dark[:, 1:]]
    # A quantile above the median, because sensors' values are cut at black: half of the pixels are equal there.
    noise = float(np.quantile(differences, WITHIN_SIGMA)) / np.sqrt(2) if differences.size else 0.0
    quantum = 1.0 / images.full_scale if images.full_scale > 1 else 1e-6
    return Background(level, max(noise, quantum / 2))


def _grey(images: ImageSet, number: int, start: int, stop: int) -> Float32Array:
    """Mean of the channels (rows, W), as fractions of full scale."""
    values = images.values(number, start, stop)
    return values if values.ndim == 2 else values.mean(axis=2)


def _regions(lit: BoolArray) -> BoolArray:
    """Regions of lit pixels above `min_component_share` of the largest; single pixels are closed or removed."""
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    cleaned = cv2.morphologyEx(lit.astype(np.uint8), cv2.MORPH_OPEN, cross)
    cleaned = cv2.morphologyEx(cleaned, cv2.MORPH_CLOSE, cross)
    if not np.any(cleaned):
        return lit
    _, label, statistics, _ = cv2.connectedComponentsWithStats(cleaned, connectivity=4)
    areas = statistics[:, cv2.CC_STAT_AREA].copy()
    areas[0] = 0
    return np.isin(label, np.flatnonzero(areas >= max(1, SETTINGS.min_component_share * areas.max())))
