"""Sequential optimum experimental design of the lights: search, check, certify, report."""

from collections.abc import Sequence

import numpy as np
from scipy import optimize

from acquisition.models.base import FloatArray
from acquisition.models.light_plan import ForecastPoint, LightPlan
from acquisition.models.rounding import percent
from acquisition.plan import baselines, criterion, exposure_plan, optimise, relaxation
from acquisition.plan.design_problem import DesignProblem
from acquisition.plan.exposure_plan import CaptureTimes


def choose(
    problem: DesignProblem, count: int | None = None, *, certify: bool = True, times: CaptureTimes | None = None,
    forecast_counts: Sequence[int] = (),
) -> LightPlan:  # fmt: skip
    """Sequential Bayesian design: chooses the `count` lights that lower the mean σ most, given the images so far.

    Without `count`, as many lights as the recipe has left are chosen; an empty plan means that it is fulfilled.
    `certify` adds the relaxation's lower bound. `times` are limits and times of the capture, with which exposures are
    planned if the recipe says so; None: each light has the automatic one. σ is forecast for `forecast_counts` further
    lights, up to the number of candidates. Raises RigError plan.infeasible when the arm reaches too few positions.
    """
    count = max(problem.recipe.lights_total - len(problem.captured), 0) if count is None else count
    if count == 0:
        return LightPlan(
            lights=[],
            method="optimal",
            reasons=[],
            notes=["all lights of the recipe have been captured"],
            predicted_sigma_deg=problem.before.mean_deg,
            predicted_median_deg=problem.before.median_error_deg,
        )
    chosen, rings = _search(problem, count)
    positions = problem.reach.candidates[chosen]
    exposures = exposure_plan.choose(problem, positions, times)
    frames = None if exposures is None else [one.frames for one in exposures]
    planned = problem.predict(positions, frames)
    notes = [
        f"mean σ {problem.before.mean_deg:.2f}° so far, {planned.mean_deg:.2f}° expected with these lights, "
        f"{problem.predict(problem.reach.candidates[rings]).mean_deg:.2f}° with two rings"
    ]
    undetermined = float(np.mean(problem.search_sample.light_count < criterion.MIN_LIGHTS))
    if len(problem.captured) and undetermined > 0.5:
        notes.append(
            f"{percent(undetermined, 0)} of the pixels were lit by fewer than {criterion.MIN_LIGHTS} lights so far: "
            "the shape behind this plan is unreliable there; check that all lamps were on and nothing blocked their "
            "light"
        )
    unlit = float(np.mean(~np.any(planned.lights.visible, axis=0)))
    if unlit > 0.02:
        notes.append(f"{percent(unlit, 0)} of the pixels are expected to see none of the new lights")
    if exposures is not None:
        notes.append(exposure_plan.sentence(exposures))
    plan = LightPlan(
        lights=problem.lights(positions),
        method="optimal",
        reasons=[
            _reason(unit, planned.sigma_deg, without)
            for unit, without in zip(problem.reach.units[chosen], planned.without_deg, strict=True)
        ],
        gains=planned.gains,
        notes=notes,
        exposures=exposures,
        forecast=forecast(problem, [further for further in forecast_counts if further <= len(problem.options.row)]),
        predicted_sigma_deg=planned.mean_deg,
        predicted_median_deg=planned.median_error_deg,
    )
    return plan.model_copy(update=_certificate(problem, chosen, rings)) if certify else plan


def forecast(problem: DesignProblem, counts: Sequence[int]) -> list[ForecastPoint]:
    """Expected mean σ after each of `counts` further lights (ascending), by a search for each and isotonic regression.

    A further light makes no normal less certain. A rise of the predicted σ comes from which held-out pixels the fewer
    lights happen to reach; the regression averages such neighbouring points. Raises RigError as `choose` does.
    """
    found = [_search(problem, count)[0] if count else [] for count in counts]
    sigma_deg = [problem.predict(problem.reach.candidates[chosen]).mean_deg for chosen in found]
    falling = optimize.isotonic_regression(sigma_deg, increasing=False).x if found else []
    return [
        ForecastPoint(added=count, lights=len(problem.captured) + count, sigma_deg=float(sigma))
        for count, sigma in zip(counts, falling, strict=True)
    ]


def _search(problem: DesignProblem, count: int) -> tuple[list[int], list[int]]:
    """Returns the numbers of the best candidates, and of those that complete the captured lights to two rings."""
    patterns = baselines.two_ring_completions(problem.captured, problem.reach.units, count)
    return optimise.search(problem.options, patterns, count, problem.recipe.seed), patterns[0]


def _certificate(problem: DesignProblem, chosen: list[int], pattern: list[int]) -> dict[str, float | str]:
    """Efficiencies of the plan and of two rings against the relaxation's lower bound, as fields of `LightPlan`.

    They compare the posterior σ only: variances that no light lowers would pull all efficiencies towards 1.
    """
    options = problem.options
    bound, gap = relaxation.bound(options, len(chosen))
    losses = [bound, *(options.posterior(some).loss for some in (chosen, pattern))]
    bound_deg, plan_deg, rings_deg = np.degrees(losses).tolist()
    return {
        "lower_bound_sigma_deg": bound_deg,
        "efficiency": bound_deg / plan_deg,
        "two_rings_efficiency": bound_deg / rings_deg,
        "relaxation_gap": gap,
        "certificate_note": (
            f"no choice of {len(chosen)} among the {len(options.row)} candidate positions brings the mean σ "
            f"below {bound_deg:.2f}°; this plan is expected to reach {plan_deg:.2f}°, two rings {rings_deg:.2f}°"
        ),
    }


def _reason(unit: FloatArray, with_all_deg: FloatArray, without_deg: FloatArray) -> str:
    """Describes the effect of a light in the direction `unit` (3,) on σ (P,)."""
    improved = with_all_deg < 0.95 * without_deg
    effect = "lowers σ of all pixels a little"
    if np.any(improved):
        change = f"from {np.median(without_deg[improved]):.2f}° to {np.median(with_all_deg[improved]):.2f}°"
        effect = f"lowers the median σ of {percent(float(np.mean(improved)), 0)} of the pixels {change}"
    return f"{baselines.describe_direction(unit)}: {effect}"
