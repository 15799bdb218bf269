"""What planned and placed lights bring: expected σ, leave-one-out gains as numbers and as small images.

The gain of a light at a pixel is the increase of σ if all other lights of the plan were captured but this one not. So
the gains of two redundant lights are both small, and where an image is bright, its light has no substitute. Figures are
means over the planner's held-out pixels: for a plan's own lights they are the plan's.
"""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
import numpy.typing as npt
from scipy.spatial import KDTree

from acquisition.models.base import BoolArray, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.result import NormalMap
from acquisition.models.shot import Observations
from acquisition.plan import sample_pixels
from acquisition.plan.criterion import Samples
from acquisition.plan.design_problem import Problem

IMAGE_PX = 160
"""Longer side of a picture in pixels."""
BRIGHTEST_PERCENTILE = 98.0
"""Percentile of the values over pixels and lights that is mapped to the brightest colour."""
OUTSIDE = (32, 32, 32)
"""Colour (RGB, 8 bits) outside the object."""
SHOWN_RANGE = 100.0
"""Ratio of the largest σ that a picture tells apart to the smallest. Lights take σ from 15° after a pilot to 1°, and
what is moved changes it by tenths: on a linear scale the picture of a good plan is black, on a logarithmic one equal
ratios of σ look equally different."""


@dataclass(frozen=True)
class Basis:
    """What pictures and forecasts need of the images so far, whatever the lights are.

    Pictures are of about `IMAGE_PX`, cropped to the object; their pixels `inside` show the `nearest` of P shown ones.
    """

    problem: Problem
    shown: Samples
    inside: BoolArray  # (h, w)
    nearest: npt.NDArray[np.intp]  # (K,)

    @cached_property
    def before_deg(self) -> FloatArray:
        """Expected σ (P,) of the held-out pixels without further lights."""
        return self.problem.sigma_deg(np.empty((0, 3)))

    @cached_property
    def brightest_deg(self) -> float:
        """The σ that pictures show brightest: nearly the largest without further lights."""
        none = self.problem.rows(self.shown, np.empty((0, 3))).posterior()
        return float(np.percentile(self.problem.expected.sigma_deg(none), BRIGHTEST_PERCENTILE))

    def png(self, shares: FloatArray) -> bytes:
        """Values (P,) of the shown pixels as a colour-mapped PNG: 0 is dark, 1 brightest."""
        levels = np.zeros(self.inside.shape, np.uint8)
        levels[self.inside] = np.clip(255 * shares[self.nearest], 0, 255).astype(np.uint8)
        coloured = cv2.applyColorMap(levels, cv2.COLORMAP_INFERNO)
        coloured[~self.inside] = OUTSIDE
        return cv2.imencode(".png", coloured)[1].tobytes()


@dataclass(frozen=True)
class PlacedForecast:
    """Expected σ (P,) of the held-out pixels, each light's leave-one-out gain, and a picture of σ (PNG)."""

    sigma_deg: FloatArray
    gains: list[float]
    picture: bytes


def basis(problem: Problem, normal_map: NormalMap, observations: Observations, calibration: Calibration) -> Basis:
    """Prepares gains and forecasts from the last result and the `problem` that was made of it."""
    usable = sample_pixels.usable(normal_map, calibration)
    shown = sample_pixels.samples(normal_map, calibration, usable, observations=observations)
    silhouette = normal_map.silhouette
    rows, columns = np.flatnonzero(silhouette.any(axis=1)), np.flatnonzero(silhouette.any(axis=0))
    cut = silhouette[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    step = max(1, -(-max(cut.shape) // IMAGE_PX))
    inside = cut[::step, ::step]
    pixels = np.argwhere(inside) * step + (rows[0], columns[0])
    _, nearest = KDTree(np.column_stack([shown.row, shown.column])).query(pixels)
    return Basis(problem, shown, inside, np.asarray(nearest, np.intp))


def gains_deg(known: Basis, positions: FloatArray) -> FloatArray:
    """Leave-one-out gain (L, P), degrees, of each light at positions (L, 3) at the shown pixels."""
    lights = known.problem.rows(known.shown, positions)
    without = [posterior.sigma_deg for posterior in lights.without_each()]
    return np.reshape(without, (len(positions), -1)) - lights.posterior().sigma_deg


def gain_pictures(known: Basis, gain_deg: FloatArray) -> tuple[list[bytes], float]:
    """Gains (L, P) as PNGs, cropped to the object, dark is no gain; and the gain in degrees that is shown brightest."""
    brightest_deg = max(float(np.percentile(gain_deg, BRIGHTEST_PERCENTILE)), 1e-6)
    return [known.png(of_light / brightest_deg) for of_light in gain_deg], brightest_deg


def evaluate(known: Basis, positions: FloatArray) -> PlacedForecast:
    """Expected σ with lights at positions (L, 3), m, view frame, each one's gain (the fraction by which the mean σ
    rises without it), and a picture of σ on a logarithmic scale, cropped to the object; dark is certain."""
    problem, sigma_of = known.problem, known.problem.expected.sigma_deg
    shown_deg = sigma_of(problem.rows(known.shown, positions).posterior())
    share = 1 + np.log(np.maximum(shown_deg / known.brightest_deg, 1e-9)) / np.log(SHOWN_RANGE)
    lights = problem.rows(problem.holdout_sample, positions)
    sigma_deg = sigma_of(lights.posterior())
    gains = [float(np.mean(sigma_of(without)) / np.mean(sigma_deg) - 1) for without in lights.without_each()]
    return PlacedForecast(sigma_deg, gains, known.png(share))
