"""Leave-one-out gain of each planned light: per pixel, as numbers and as small images.

The gain of a light at a pixel is the increase of σ if all other lights of the plan were captured but this one not. So
the gains of two redundant lights are both small, and where an image is bright, its light has no substitute.
"""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from scipy.spatial import KDTree

from acquisition.models.base import BoolArray, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.light_plan import Light
from acquisition.models.recipe import Recipe
from acquisition.models.result import NormalMap
from acquisition.models.shot import Observations
from acquisition.plan import criterion, planned_noise, visibility

IMAGE_PX = 160
"""Longer side of a gain image in pixels."""
BRIGHTEST_PERCENTILE = 98.0
"""Percentile of the gains over pixels and lights that is mapped to the brightest colour."""
OUTSIDE = (32, 32, 32)
"""Colour (RGB, 8 bits) outside the object."""


@dataclass(frozen=True)
class Gains:
    """At sample pixels `rows`, `columns` (P,): expected σ (P,) with all lights, each light's gain (L, P); degrees."""

    rows: npt.NDArray[np.int64]
    columns: npt.NDArray[np.int64]
    sigma_deg: FloatArray
    gain_deg: FloatArray

    @property
    def brightest_deg(self) -> float:
        """Gain in degrees that images show brightest; the same scale for all lights of a plan."""
        return max(float(np.percentile(self.gain_deg, BRIGHTEST_PERCENTILE)), 1e-6) if self.gain_deg.size else 1e-6


def gains(
    normal_map: NormalMap, observations: Observations, recipe: Recipe, lights: list[Light], calibration: Calibration
) -> Gains:
    """Leave-one-out gains of the planned `lights`, predicted from the normal map that they were planned from."""
    usable = criterion.usable_pixels(normal_map, calibration)
    sample = criterion.samples(normal_map, calibration, usable)
    sample = criterion.reweight(sample, normal_map, observations, calibration)
    surface = visibility.surface(normal_map, calibration)
    planned = criterion.candidates(sample, lights, surface, calibration, recipe, planned_noise.gloss(normal_map))
    with_all = criterion.posterior(sample, planned).sigma_deg
    every = np.arange(len(lights))
    gain = [criterion.posterior(sample, planned.only(np.delete(every, light))).sigma_deg - with_all for light in every]
    return Gains(sample.row, sample.column, with_all, np.array(gain).reshape(len(lights), len(with_all)))


def gain_image(pixel_gains: Gains, light: int, silhouette: BoolArray) -> bytes:
    """One light's gains as a colour-mapped PNG, cropped to the object; dark is no gain.

    `silhouette` (H, W) is the object; each of its pixels shows the nearest sample pixel.
    """
    pixels, inside = picture_pixels(silhouette)
    _, nearest = KDTree(np.column_stack([pixel_gains.rows, pixel_gains.columns])).query(pixels)
    return coloured_png(pixel_gains.gain_deg[light][nearest] / pixel_gains.brightest_deg, inside)


def coloured_png(shares: FloatArray, inside: BoolArray) -> bytes:
    """A colour-mapped PNG of one value (K,) for each pixel `inside` (h, w), row by row: 0 is dark, 1 brightest."""
    levels = np.zeros(inside.shape, np.uint8)
    levels[inside] = np.clip(255 * shares, 0, 255).astype(np.uint8)
    coloured = cv2.applyColorMap(levels, cv2.COLORMAP_INFERNO)
    coloured[~inside] = OUTSIDE
    return cv2.imencode(".png", coloured)[1].tobytes()


def picture_pixels(silhouette: BoolArray) -> tuple[npt.NDArray[np.int64], BoolArray]:
    """Pixels (K, 2), row and column, of a picture of about `IMAGE_PX`, cropped to the object `silhouette` (H, W), and
    the picture's mask (h, w) of where they stand."""
    rows, columns = np.flatnonzero(silhouette.any(axis=1)), np.flatnonzero(silhouette.any(axis=0))
    cut = silhouette[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    step = max(1, -(-max(cut.shape) // IMAGE_PX))
    inside = cut[::step, ::step]
    return np.argwhere(inside) * step + (rows[0], columns[0]), inside
