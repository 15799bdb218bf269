"""Sequential optimum experimental design of the lights: search, check, certify, report."""

from collections.abc import Sequence

import numpy as np

from acquisition.models.base import FloatArray
from acquisition.models.light_plan import ForecastPoint, LightPlan
from acquisition.models.result import MEDIAN_ERROR_PER_SIGMA
from acquisition.plan import baselines, criterion, exposure_plan, optimise, relaxation
from acquisition.plan.design_problem import Problem
from acquisition.plan.exposure_plan import CaptureTimes


def choose(
    problem: Problem, count: int | None = None, *, certify: bool = True, times: CaptureTimes | None = None,
    forecast_counts: Sequence[int] = (),
) -> LightPlan:  # fmt: skip
    """A-optimal sequential design: the `count` lights that lower the capped angular variance most.

    Bayesian: the information of the images so far is the prior of the new lights. Exchange over the dome's candidates
    from many starts, completed rings among them (`optimise.search`), and to `certify` it the relaxation's lower bound.
    `count` None: as many lights as remain of the recipe; an empty plan means that it is fulfilled. `times`: limits and
    times of the capture, by which exposures are planned where the recipe asks for it; None: each light has the
    automatic one. `forecast_counts`: numbers of further lights for which σ is forecast, where there are as many
    candidates. Raises RigError plan.infeasible when the arm reaches too few positions.
    """
    count = max(problem.recipe.lights_total - len(problem.captured), 0) if count is None else count
    before_deg = problem.sigma_deg(np.empty((0, 3)))
    if count == 0:
        return LightPlan(
            lights=[],
            method="optimal",
            reasons=[],
            notes=["all lights of the recipe have been captured"],
            predicted_sigma_deg=float(np.mean(before_deg)),
            predicted_median_deg=float(MEDIAN_ERROR_PER_SIGMA * np.median(before_deg)),
        )
    chosen, rings, inverse_cap = _search(problem, count)
    positions = problem.positions[chosen]
    exposures = exposure_plan.choose(problem, positions, inverse_cap, times)
    frames = None if exposures is None else [one.frames for one in exposures]
    planned = problem.rows(problem.holdout_sample, positions, frames)
    sigma_deg = problem.expected.sigma_deg(planned.posterior())
    without_deg = [problem.expected.sigma_deg(posterior) for posterior in planned.without_each()]
    notes = [
        f"mean σ {np.mean(before_deg):.2f}° so far, {np.mean(sigma_deg):.2f}° expected with these lights, "
        f"{np.mean(problem.sigma_deg(problem.positions[rings])):.2f}° with two rings"
    ]
    undetermined = float(np.mean(problem.search_sample.lit < criterion.MIN_LIGHTS))
    if len(problem.captured) and undetermined > 0.5:
        notes.append(
            f"{undetermined:.0%} of the pixels were lit by fewer than {criterion.MIN_LIGHTS} lights so far: the "
            "shape behind this plan is unreliable there; check that all lamps were on and nothing blocked their light"
        )
    unlit = float(np.mean(np.sum(planned.visibility > 0.5, axis=0) == 0))
    if unlit > 0.02:
        notes.append(f"{unlit:.0%} of the pixels are expected to see none of the new lights")
    if exposures is not None:
        notes.append(exposure_plan.sentence(exposures))
    plan = LightPlan(
        lights=problem.lights(positions),
        method="optimal",
        reasons=[
            _reason(unit, sigma_deg, without) for unit, without in zip(problem.units[chosen], without_deg, strict=True)
        ],
        gains=[float(np.mean(without) / np.mean(sigma_deg) - 1) for without in without_deg],
        notes=notes,
        exposures=exposures,
        forecast=forecast(problem, [further for further in forecast_counts if further <= len(problem.positions)]),
        predicted_sigma_deg=float(np.mean(sigma_deg)),
        predicted_median_deg=float(MEDIAN_ERROR_PER_SIGMA * np.median(sigma_deg)),
    )
    return plan.model_copy(update=_certificate(problem, chosen, rings)) if certify else plan


def forecast(problem: Problem, counts: Sequence[int]) -> list[ForecastPoint]:
    """Expected mean σ after each of `counts` further lights, by a search for each. Raises RigError as `choose` does."""
    points: list[ForecastPoint] = []
    for count in counts:
        chosen = _search(problem, count)[0] if count else []
        sigma_deg = float(np.mean(problem.sigma_deg(problem.positions[chosen])))
        points.append(ForecastPoint(added=count, lights=len(problem.captured) + count, sigma_deg=sigma_deg))
    return points


def _search(problem: Problem, count: int) -> tuple[list[int], list[int], float]:
    """Numbers of the best candidates, of those that complete the captured lights to two rings, and the loss's cap."""
    patterns = baselines.two_ring_completions(problem.captured, problem.units, count)
    inverse_cap = problem.options.posterior(patterns[0]).inverse_cap
    chosen = optimise.search(problem.options, inverse_cap, patterns, count, problem.recipe.seed)
    return chosen, patterns[0], inverse_cap


def _certificate(problem: Problem, chosen: list[int], pattern: list[int]) -> dict[str, float | str]:
    """Efficiency of plan and two rings against the relaxation's lower bound, as fields of `LightPlan`.

    The certificate is of the posterior: variances that no light lowers would pull all efficiencies towards 1.
    """
    options = problem.options.coarse
    bound, gap = relaxation.bound(options, len(chosen))
    variances = np.array([bound, *(np.mean(options.posterior(some).variance) for some in (chosen, pattern))])
    bound_deg, plan_deg, rings_deg = np.degrees(np.sqrt(variances)).tolist()
    return {
        "lower_bound_sigma_deg": bound_deg,
        "efficiency": bound_deg / plan_deg,
        "two_rings_efficiency": bound_deg / rings_deg,
        "relaxation_gap": gap,
        "certificate_note": (
            f"no choice of {len(chosen)} among the {len(options.row)} candidate positions brings the root mean square "
            f"σ below {bound_deg:.2f}°; this plan is expected to reach {plan_deg:.2f}°, two rings {rings_deg:.2f}°"
        ),
    }


def _reason(unit: FloatArray, with_all_deg: FloatArray, without_deg: FloatArray) -> str:
    """What a light in the direction `unit` (3,) does to σ (P,)."""
    improved = with_all_deg < 0.95 * without_deg
    effect = "makes all pixels a little more certain"
    if np.any(improved):
        change = f"from {np.median(without_deg[improved]):.1f}° to {np.median(with_all_deg[improved]):.1f}°"
        effect = f"makes {np.mean(improved):.0%} of the pixels more certain, their median σ falls {change}"
    return f"{baselines.describe_direction(unit)}: {effect}"
