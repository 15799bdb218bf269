"""Sequential stopping rule: how many lights a target σ needs, and when to stop.

The smallest number of lights whose forecast nearly meets the target is planned and captured. Then the images decide:
while their solved σ is above the target, lights are added, as many as a new forecast requires. This forecast is scaled
by the ratio of the solved to the expected σ so far. Nothing but the images is remembered between passes. The σ that is
compared is the result's mean σ, which includes the components that no light lowers. Decision 0031.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import ForecastPoint, LightPlan
from acquisition.models.tuned import tuned
from acquisition.plan import planner
from acquisition.plan.design_problem import DesignProblem
from acquisition.plan.exposure_plan import CaptureTimes

COUNTS = (1, 2, 3, 4, 6, 8, 11, 15, 20, 28, 40, 76)
"""Numbers of further lights for which σ is forecast; between them it is interpolated linearly in logarithms."""


@dataclass(frozen=True)
class StoppingRuleSettings:
    """Tuned numbers of the stopping rule."""

    tolerance: float = tuned(0.03, "share")
    """Fraction by which the mean σ, and forecasts after the first, may exceed the target and still meet it. Measured
    errors scatter by more, and near the attainable limit a light lowers σ by 1 %. If even the maximum number of lights
    does not meet the target, final lights that together lower σ by no more than this fraction are omitted."""
    first_slack: float = tuned(0.2, "share")
    """Fraction by which the first forecast may exceed the target. A missing light costs a pass, a superfluous one an
    image. Forecasts from the pilot are 0.88 ± 0.05 of the σ that is then reached, 0.65–1.2 (12 sessions of random
    height fields, November 2026). The pilot itself must be below the target by this fraction: too few images to
    self-calibrate the lamps predict their errors poorly (measured over predicted 0.9–1.5)."""


SETTINGS = StoppingRuleSettings()


def plan_to_target(problem: DesignProblem, achieved_deg: float, times: CaptureTimes | None = None) -> LightPlan:
    """Sequential design towards the recipe's `target_sigma_deg`: the next lights, or an empty plan with a `conclusion`.

    `achieved_deg` is the mean σ so far of the pixels that count; `times` is as in `choose`. Raises RigError
    request.invalid when the recipe has no target, and plan.infeasible as `choose` does.
    """
    recipe, captured = problem.recipe, len(problem.captured)
    target = recipe.target_sigma_deg
    if target is None:
        raise RigError(ErrorCode.REQUEST_INVALID, "the recipe has no target_sigma_deg")
    state = f"mean σ {achieved_deg:.2f}°"
    allowed = recipe.max_lights - captured
    first = captured <= recipe.pilot_lights and allowed > 0
    if achieved_deg <= (target / (1 + SETTINGS.first_slack) if first else target * (1 + SETTINGS.tolerance)):
        return _conclusion(f"target met with {captured} images: {state}, target {target:.3g}°")
    if allowed <= 0:
        return _conclusion(f"all lights allowed were captured ({captured}): {state}, above the target of {target:.3g}°")
    counts = [count for count in COUNTS if count < allowed] + [allowed]
    now, *curve = planner.forecast(problem, [0, *counts])
    slack = SETTINGS.first_slack
    if not first:
        scale = achieved_deg / now.sigma_deg
        curve = [point.model_copy(update={"sigma_deg": point.sigma_deg * scale}) for point in curve]
        slack = SETTINGS.tolerance
    lowest_deg = min(point.sigma_deg for point in curve)
    unreachable = lowest_deg > target
    aim_deg = (1 + SETTINGS.tolerance) * lowest_deg if unreachable else target
    if unreachable and achieved_deg <= aim_deg:
        return _conclusion(
            f"further lights would hardly lower σ after {captured} images: {state}, target {target:.3g}°; "
            f"{lowest_deg:.2f}° is expected even with all {recipe.max_lights} lights allowed"
        )
    chosen = planner.choose(problem, _fewest_lights_meeting(curve, (1 + slack) * aim_deg), times=times)
    notes = [f"{state} with {captured} images; the target is {target:.3g}°"]
    if unreachable:
        notes.append(
            f"the target may not be met: {lowest_deg:.2f}° is expected with all {recipe.max_lights} lights allowed"
        )
    return chosen.model_copy(update={"notes": [*notes, *chosen.notes], "forecast": curve})


def _fewest_lights_meeting(curve: Sequence[ForecastPoint], target_deg: float) -> int:
    """Smallest number of further lights whose expected σ meets the target; if none does, the largest of the curve."""
    added = np.arange(curve[0].added, curve[-1].added + 1)
    captured = curve[0].lights - curve[0].added
    log_lights, log_sigma = np.log([(point.lights, point.sigma_deg) for point in curve]).T
    meets = np.exp(np.interp(np.log(captured + added), log_lights, log_sigma)) <= target_deg * (1 + 1e-9)
    return int(added[np.argmax(meets)] if np.any(meets) else added[-1])


def _conclusion(reason: str) -> LightPlan:
    return LightPlan(lights=[], method="optimal", reasons=[], conclusion=reason, notes=[reason])
