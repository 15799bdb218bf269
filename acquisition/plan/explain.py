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
from acquisition.plan.criterion import Samples

IMAGE_PX = 160
"""Longer side of a picture in pixels."""
BRIGHTEST_PERCENTILE = 98.0
"""Percentile of the values over pixels and lights that is mapped to the brightest colour."""
OUTSIDE = (32, 32, 32)
"""Colour (RGB, 8 bits) outside the object."""


@dataclass(frozen=True)
class Picture:
    """A picture of about `IMAGE_PX`, cropped to the object, whose pixels `inside` (h, w) show the `nearest` (K,) of P
    sample pixels."""

    inside: BoolArray
    nearest: npt.NDArray[np.intp]

    @classmethod
    def of(cls, silhouette: BoolArray, sample: Samples) -> "Picture":
        """The picture of an object `silhouette` (H, W)."""
        rows, columns = np.flatnonzero(silhouette.any(axis=1)), np.flatnonzero(silhouette.any(axis=0))
        cut = silhouette[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        step = max(1, -(-max(cut.shape) // IMAGE_PX))
        inside = cut[::step, ::step]
        pixels = np.argwhere(inside) * step + (rows[0], columns[0])
        _, nearest = KDTree(np.column_stack([sample.row, sample.column])).query(pixels)
        return cls(inside, np.asarray(nearest, np.intp))

    def png(self, shares: FloatArray) -> bytes:
        """Values (P,) as a colour-mapped PNG: 0 is dark, 1 brightest."""
        levels = np.zeros(self.inside.shape, np.uint8)
        levels[self.inside] = np.clip(255 * shares[self.nearest], 0, 255).astype(np.uint8)
        coloured = cv2.applyColorMap(levels, cv2.COLORMAP_INFERNO)
        coloured[~self.inside] = OUTSIDE
        return cv2.imencode(".png", coloured)[1].tobytes()


@dataclass(frozen=True)
class Gains:
    """Each light's gain (L, P) at the pixels of a sample, degrees, and a picture of the object."""

    sample: Samples
    gain_deg: FloatArray
    picture: Picture

    @property
    def brightest_deg(self) -> float:
        """Gain in degrees that images show brightest; the same scale for all lights of a plan."""
        return max(float(np.percentile(self.gain_deg, BRIGHTEST_PERCENTILE)), 1e-6) if self.gain_deg.size else 1e-6

    def image(self, light: int) -> bytes:
        """One light's gains as a colour-mapped PNG, cropped to the object; dark is no gain."""
        return self.picture.png(self.gain_deg[light] / self.brightest_deg)


def gains(
    normal_map: NormalMap, observations: Observations, recipe: Recipe, lights: list[Light], calibration: Calibration
) -> Gains:
    """Leave-one-out gains of the planned `lights`, predicted from the normal map that they were planned from."""
    sample = criterion.usable_samples(normal_map, observations, calibration)
    surface = visibility.surface(normal_map, calibration)
    planned = criterion.candidates(sample, lights, surface, calibration, recipe, planned_noise.gloss(normal_map))
    with_all = criterion.posterior(sample, planned).sigma_deg
    without = [one.sigma_deg for one in criterion.without_each(sample, planned)]
    return Gains(sample, np.reshape(without, (len(lights), -1)) - with_all, Picture.of(normal_map.silhouette, sample))
