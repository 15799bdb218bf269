"""What planned and placed lights bring: expected σ, leave-one-out gains as numbers and as small images.

The gain of a light at a pixel is the increase of σ if all other lights of the plan were captured but this one not. So
the gains of two redundant lights are both small, and where an image is bright, its light has no substitute.

For lights that a person drags, what depends on the images so far is made once (`basis`), what depends on one light once
for each of its positions (`rows`), so that after a move of one light only its own design rows are new, and a posterior
over a few thousand pixels remains. Figures are means over the planner's held-out pixels: for a plan's own lights they
are the plan's.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
import numpy.typing as npt
from scipy.spatial import KDTree

from acquisition.models.base import BoolArray, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.light_plan import Light
from acquisition.models.recipe import Recipe
from acquisition.models.result import NormalMap
from acquisition.models.route import Reach
from acquisition.models.shot import Observations
from acquisition.plan import criterion, design_problem
from acquisition.plan.criterion import Candidates, Samples
from acquisition.plan.design_problem import PlanOptions, Problem

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
class Basis:
    """What pictures and forecasts need of the images so far, whatever the lights are."""

    problem: Problem
    shown: Samples  # the pixels behind the picture
    picture: Picture

    @cached_property
    def before_deg(self) -> FloatArray:
        """Expected σ (P,) of the held-out pixels without further lights."""
        return self.problem.predicted_deg(np.empty((0, 3)))

    @cached_property
    def brightest_deg(self) -> float:
        """The σ that pictures show brightest: nearly the largest without further lights."""
        none = criterion.posterior(self.shown, criterion.joined(self.shown, []))
        return float(np.percentile(self.problem.expected.sigma_deg(none), BRIGHTEST_PERCENTILE))


@dataclass(frozen=True)
class LightRows:
    """Design rows of one light at a basis' held-out pixels and at those of its picture."""

    holdout: Candidates
    shown: Candidates


@dataclass(frozen=True)
class PlacedForecast:
    """Expected σ (P,) of the held-out pixels, each light's leave-one-out gain, and a picture of σ (PNG)."""

    sigma_deg: FloatArray
    gains: list[float]
    picture: bytes


@dataclass(frozen=True)
class Gains:
    """Each light's gain (L, P) at the pixels of a basis, degrees, and a picture of the object."""

    gain_deg: FloatArray
    picture: Picture

    @property
    def brightest_deg(self) -> float:
        """Gain in degrees that images show brightest; the same scale for all lights of a plan."""
        return max(float(np.percentile(self.gain_deg, BRIGHTEST_PERCENTILE)), 1e-6) if self.gain_deg.size else 1e-6

    def image(self, light: int) -> bytes:
        """One light's gains as a colour-mapped PNG, cropped to the object; dark is no gain."""
        return self.picture.png(self.gain_deg[light] / self.brightest_deg)


def basis(
    normal_map: NormalMap, observations: Observations, recipe: Recipe, reach: Reach, calibration: Calibration,
    region: BoolArray | None,
) -> Basis:  # fmt: skip
    """Prepares gains and forecasts from the last result. Raises RigError plan.infeasible as `planner.choose` does."""
    problem = design_problem.build(normal_map, observations, recipe, reach, calibration, PlanOptions(region=region), 1)
    usable = criterion.samples(normal_map, calibration, criterion.usable_pixels(normal_map, calibration))
    shown = criterion.reweight(usable, normal_map, observations, calibration)
    return Basis(problem, shown, Picture.of(normal_map.silhouette, shown))


def gains(known: Basis, lights: Sequence[Light]) -> Gains:
    """Leave-one-out gains of the planned `lights`, predicted from the images that they were planned from."""
    places = np.array([light.position for light in lights]).reshape(-1, 3)
    planned = known.problem.design_rows(known.shown, places)
    with_all = criterion.posterior(known.shown, planned).sigma_deg
    without = [one.sigma_deg for one in criterion.without_each(known.shown, planned)]
    return Gains(np.reshape(without, (len(lights), -1)) - with_all, known.picture)


def rows(known: Basis, position: FloatArray) -> LightRows:
    """Design rows of a light at `position` (3,), m, view frame, its axis towards the dome's centre."""
    problem, positions = known.problem, position[None]
    return LightRows(problem.holdout_candidates(positions), problem.design_rows(known.shown, positions))


def evaluate(known: Basis, lights: Sequence[LightRows]) -> PlacedForecast:
    """Expected σ with all of `lights`, each one's gain (the fraction by which the mean σ rises without it), and a
    picture of σ on a logarithmic scale, cropped to the object; dark is certain."""
    problem = known.problem
    holdout = criterion.joined(problem.holdout_sample, [light.holdout for light in lights])
    shown = criterion.joined(known.shown, [light.shown for light in lights])
    shown_deg = problem.expected.sigma_deg(criterion.posterior(known.shown, shown))
    share = 1 + np.log(np.maximum(shown_deg / known.brightest_deg, 1e-9)) / np.log(SHOWN_RANGE)
    return PlacedForecast(problem.expected_deg(holdout), problem.gains(holdout), known.picture.png(share))
