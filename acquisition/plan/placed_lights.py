"""Forecast of σ for lights that a person places: the planner's own prediction, split so that a dragged light is cheap.

What depends on the images so far is made once (`basis`), what depends on one light once for each of its positions
(`rows`), so that after a move of one light only its own design rows are new, and a posterior over a few thousand pixels
remains. Figures are means over the planner's held-out pixels: for a plan's own lights they are the plan's.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from acquisition.models.base import BoolArray, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.recipe import Recipe
from acquisition.models.result import NormalMap
from acquisition.models.route import Reach
from acquisition.models.shot import Observations
from acquisition.plan import criterion, design_problem, explain
from acquisition.plan.criterion import Candidates, Samples
from acquisition.plan.design_problem import PlanOptions, Problem
from acquisition.plan.explain import Picture

SHOWN_RANGE = 100.0
"""Ratio of the largest σ that a picture tells apart to the smallest. Lights take σ from 15° after a pilot to 1°, and
what is moved changes it by tenths: on a linear scale the picture of a good plan is black, on a logarithmic one equal
ratios of σ look equally different."""


@dataclass(frozen=True)
class ForecastBasis:
    """What a forecast needs of the images so far, whatever lights are placed."""

    problem: Problem
    shown: Samples  # the pixels behind the picture
    picture: Picture
    before_deg: FloatArray  # (P,) expected σ of the held-out pixels without further lights
    brightest_deg: float


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


def basis(
    normal_map: NormalMap, observations: Observations, recipe: Recipe, reach: Reach, calibration: Calibration,
    region: BoolArray | None,
) -> ForecastBasis:  # fmt: skip
    """Prepares forecasts from the last result. Raises RigError plan.infeasible as `planner.choose` does."""
    problem = design_problem.build(normal_map, observations, recipe, reach, calibration, PlanOptions(region=region), 1)
    shown = criterion.usable_samples(normal_map, observations, calibration)
    none = criterion.posterior(shown, criterion.no_candidates(shown))
    return ForecastBasis(
        problem=problem,
        shown=shown,
        picture=Picture.of(normal_map.silhouette, shown),
        before_deg=problem.predicted_deg(np.empty((0, 3))),
        brightest_deg=float(np.percentile(problem.expected.sigma_deg(none), explain.BRIGHTEST_PERCENTILE)),
    )


def rows(known: ForecastBasis, position: FloatArray) -> LightRows:
    """Design rows of a light at `position` (3,), m, view frame, its axis towards the dome's centre."""
    problem, positions = known.problem, position[None]
    return LightRows(
        holdout=problem.holdout_candidates(positions),
        shown=problem.design_rows(known.shown, positions, cautious=False),
    )


def evaluate(known: ForecastBasis, lights: Sequence[LightRows]) -> PlacedForecast:
    """Expected σ with all of `lights`, each one's gain (the fraction by which the mean σ rises without it), and a
    picture of σ on a logarithmic scale, cropped to the object; dark is certain."""
    problem = known.problem
    holdout, shown = criterion.no_candidates(problem.holdout_sample), criterion.no_candidates(known.shown)
    for light in lights:
        holdout, shown = holdout.joined(light.holdout), shown.joined(light.shown)
    shown_deg = problem.expected.sigma_deg(criterion.posterior(known.shown, shown))
    share = 1 + np.log(np.maximum(shown_deg / known.brightest_deg, 1e-9)) / np.log(SHOWN_RANGE)
    return PlacedForecast(problem.expected_deg(holdout), problem.gains(holdout), known.picture.png(share))
