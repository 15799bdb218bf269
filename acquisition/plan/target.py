"""Accuracy on order: how many lights a wished-for certainty takes, and when to take no more.

The forecast says how the mean σ falls with the number of lights; the first number that meets the target is planned and
captured. Then the images themselves decide: while their solved σ is above the target, lights are added, as many as a
new forecast from all images asks for. Nothing but the images is remembered between the passes, so that a session which
was cut off goes on as if nothing had happened.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from acquisition import photometry
from acquisition.errors import ErrorCode, RigError
from acquisition.plan import selection
from acquisition.types import BoolArray, Calibration, Expected, LightPlan, NormalMap, Observations, Reach, Recipe

COUNTS = (1, 2, 3, 4, 6, 8, 11, 15, 20, 28, 40, 76)
"""Numbers of further lights for which the forecast is made; between them σ follows a straight line in logarithms."""
LEAST_GAIN = 0.005
"""Share by which all lights that are still allowed must lower the mean σ to be worth taking."""


def approach(
    normal_map: NormalMap,
    observations: Observations,
    recipe: Recipe,
    reach: Reach,
    calibration: Calibration,
    *,
    region: BoolArray | None = None,
) -> LightPlan:
    """The lights to take next for the recipe's `target_sigma_deg`, or an empty plan whose `conclusion` says why none.

    `region` (H, W) is the part of the image whose mean σ counts, none: the whole object. Raises RigError
    request.invalid when the recipe has no target, plan.infeasible as `choose` does.
    """
    target = recipe.target_sigma_deg
    if target is None:
        raise RigError(ErrorCode.REQUEST_INVALID, "the recipe has no target_sigma_deg")
    taken = sum(shot.kind == "light" for shot in observations.shots)
    reached = photometry.mean_sigma_deg(normal_map, calibration, region)
    state = f"mean σ {reached:.2f}°"
    if reached <= target:
        return _concluded(f"target met with {taken} images: {state} ≤ {target:.3g}°")
    allowed = recipe.max_lights - taken
    if allowed <= 0:
        return _concluded(f"the most lights allowed were taken ({taken}): {state} > {target:.3g}°")
    counts = [count for count in COUNTS if count < allowed] + [allowed]
    curve = selection.forecast(normal_map, observations, recipe, reach, calibration, counts, region=region)
    least = min(point.sigma_deg for point in curve)
    if least > (1 - LEAST_GAIN) * reached:
        return _concluded(f"no light that the arm can reach brings {state} below {least:.2f}°; wanted {target:.3g}°")
    wanted = _first_that_meets(curve, target)
    chosen = selection.choose(normal_map, observations, recipe, reach, calibration, wanted, region=region)
    notes = [f"{state} with {taken} images; {target:.3g}° is wanted"]
    if least > target:
        notes.append(f"the target may not be met: {least:.2f}° is expected with all {recipe.max_lights} lights allowed")
    return chosen.model_copy(update={"notes": [*notes, *chosen.notes], "forecast": curve})


def _first_that_meets(curve: Sequence[Expected], target_deg: float) -> int:
    """The least number of further lights whose expected σ meets the target; the last number of the curve if none."""
    if curve[0].sigma_deg <= target_deg:
        return curve[0].added
    for before, after in pairwise(curve):
        if after.sigma_deg > target_deg:
            continue
        added = np.arange(before.added, after.added + 1)
        taken = after.lights - after.added
        places = np.log([taken + before.added, taken + after.added])
        sigma = np.exp(np.interp(np.log(taken + added), places, np.log([before.sigma_deg, after.sigma_deg])))
        return int(added[np.argmax(sigma <= target_deg * (1 + 1e-9))])
    return curve[-1].added


def _concluded(why: str) -> LightPlan:
    return LightPlan(lights=[], method="optimal", reasons=[], conclusion=why, notes=[why])
