"""Pictures of the effect of planned and placed lights: expected σ, and each light's leave-one-out gain.

The gain of a light at a pixel is the increase of σ if all lights of the plan but this one were captured. Two redundant
lights therefore both have small gains. Where the picture of a light is bright, the light has no substitute.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import cv2
import numpy as np
import numpy.typing as npt
from scipy.spatial import KDTree

from acquisition import photometry
from acquisition.models.base import BoolArray, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.result import NormalMap
from acquisition.models.shot import Observations
from acquisition.plan import sample_pixels
from acquisition.plan.criterion import Samples
from acquisition.plan.design_problem import DesignProblem

IMAGE_PX = 160
"""Longer side of a picture in pixels."""
BRIGHTEST_PERCENTILE = 98.0
"""Percentile of the values over pixels and lights that is mapped to the brightest colour."""
OUTSIDE = (32, 32, 32)
"""Colour (RGB, 8 bits) outside the object."""
SHOWN_RANGE = 100.0
"""Ratio of the largest σ that a picture resolves to the smallest, on a logarithmic scale. Lights lower σ from 15° after
a pilot to 1°, so on a linear scale the picture of a good plan would be black."""


@dataclass(frozen=True)
class Basis:
    """The part of the pictures that does not depend on the lights. Pictures are cropped to the object. Each pixel
    `inside` the object shows the value of the `nearest` of the P `shown` sample pixels."""

    problem: DesignProblem
    shown: Samples
    inside: BoolArray  # (h, w)
    nearest: npt.NDArray[np.intp]  # (K,)

    @classmethod
    def of(
        cls, problem: DesignProblem, normal_map: NormalMap, observations: Observations, calibration: Calibration
    ) -> Self:
        """Prepares pictures from the last result and the `problem` that was made from it."""
        usable = sample_pixels.usable(normal_map, calibration)
        shown = sample_pixels.samples(normal_map, calibration, usable, observations=observations)
        shown = replace(shown, margin=np.zeros(len(usable)))  # neighbours of different margins would speckle
        silhouette = normal_map.silhouette
        rows, columns = photometry.bounding_box(silhouette)
        cut = silhouette[rows, columns]
        step = max(1, -(-max(cut.shape) // IMAGE_PX))
        inside = cut[::step, ::step]
        pixels = np.argwhere(inside) * step + (rows.start, columns.start)
        _, nearest = KDTree(np.column_stack([shown.row, shown.column])).query(pixels)
        return cls(problem, shown, inside, np.asarray(nearest, np.intp))

    @cached_property
    def brightest_deg(self) -> float:
        """The σ that pictures show brightest: nearly the largest without further lights."""
        none = self.problem.predict(np.empty((0, 3)), sample=self.shown)
        return float(np.percentile(none.sigma_deg, BRIGHTEST_PERCENTILE))

    def sigma_picture(self, positions: FloatArray) -> bytes:
        """Expected σ with lights at positions (L, 3), m, view frame, as a PNG; dark pixels have a small σ."""
        sigma_deg = self.problem.predict(positions, sample=self.shown).sigma_deg
        return self._png(1 + np.log(np.maximum(sigma_deg / self.brightest_deg, 1e-9)) / np.log(SHOWN_RANGE))

    def gains_deg(self, positions: FloatArray) -> FloatArray:
        """Leave-one-out gain (L, P), degrees, of each light at positions (L, 3) at the shown pixels."""
        planned = self.problem.predict(positions, sample=self.shown)
        return planned.without_deg - planned.sigma_deg

    def gain_pictures(self, positions: FloatArray) -> tuple[list[bytes], float]:
        """Returns each light's gain as a PNG (dark: no gain), and the gain in degrees that is shown brightest."""
        gains_deg = self.gains_deg(positions)
        brightest_deg = max(float(np.percentile(gains_deg, BRIGHTEST_PERCENTILE)), 1e-6)
        return [self._png(of_light / brightest_deg) for of_light in gains_deg], brightest_deg

    def _png(self, shares: FloatArray) -> bytes:
        """Encodes values (P,) of the shown pixels as a colour-mapped PNG: 0 is dark, 1 brightest."""
        levels = np.zeros(self.inside.shape, np.uint8)
        levels[self.inside] = np.clip(255 * shares[self.nearest], 0, 255).astype(np.uint8)
        coloured = cv2.applyColorMap(levels, cv2.COLORMAP_INFERNO)
        coloured[~self.inside] = OUTSIDE
        return cv2.imencode(".png", coloured)[1].tobytes()
