"""Sequential optimum experimental design of the lights: sample, search, check, certify, report.

The criterion is a mean over pixels of the angular variance of the normal (A-optimality of the tangential components,
with a cap; `objective`), the prior is the Fisher information of the images so far. Everything reported is predicted on
held-out pixels, because the variance of the pixels that the search has used is optimistic.
"""

from collections.abc import Sequence

import numpy as np

from acquisition.models.base import BoolArray, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.light_plan import ForecastPoint, LightPlan
from acquisition.models.recipe import Recipe
from acquisition.models.result import MEDIAN_ERROR_PER_SIGMA, NormalMap
from acquisition.models.route import Reach
from acquisition.models.shot import Observations
from acquisition.plan import (
    baselines,
    criterion,
    design_problem,
    exposure_plan,
    objective,
    optimise,
    relaxation,
)
from acquisition.plan.criterion import Candidates
from acquisition.plan.design_problem import PlanOptions, Problem
from acquisition.plan.objective import Loss

CERTIFICATE_PIXELS = 300
"""Approximate number of pixels of the lower bound, which takes seconds with all of them."""

_DEFAULT_OPTIONS = PlanOptions()


def choose(
    normal_map: NormalMap,
    observations: Observations,
    recipe: Recipe,
    reach: Reach,
    calibration: Calibration,
    count: int | None = None,
    options: PlanOptions = _DEFAULT_OPTIONS,
) -> LightPlan:
    """A-optimal sequential design: the `count` lights that lower the capped angular variance most.

    Bayesian: the normal map's information is the prior of the new lights. Exchange over the dome's candidates from many
    starts, completed rings among them (`optimise.search`), and the relaxation's lower bound as certificate. `count`
    None: as many lights as remain of the recipe; an empty plan means that it is fulfilled. Raises RigError
    plan.infeasible when the arm reaches too few positions or the normal map has too few usable pixels.
    """
    captured = sum(shot.kind == "light" for shot in observations.shots)
    count_to_add = max(recipe.lights_total - captured, 0) if count is None else count
    problem = design_problem.build(normal_map, observations, recipe, reach, calibration, options, count_to_add)
    before_deg = problem.predicted_deg(np.empty((0, 3)))
    if count_to_add == 0:
        note = "all lights of the recipe have been captured"
        return LightPlan(
            lights=[],
            method="optimal",
            reasons=[],
            notes=[note],
            predicted_sigma_deg=float(np.mean(before_deg)),
            predicted_median_deg=float(MEDIAN_ERROR_PER_SIGMA * np.median(before_deg)),
        )
    candidates = problem.design_rows(problem.search_sample, problem.positions)
    loss, sets = _loss_and_patterns(problem, candidates, count_to_add)
    chosen = optimise.search(problem.search_sample, candidates, loss, sets, count_to_add, recipe.seed)
    positions = problem.positions[chosen]
    exposures = exposure_plan.choose(problem, positions, loss, options.times, observations)
    rings_deg = problem.predicted_deg(problem.positions[sets[0]])
    frames = None if exposures is None else [one.frames for one in exposures]
    planned_rows = problem.holdout_candidates(positions, frames)
    sigma_deg = problem.expected_deg(planned_rows)
    notes = [
        f"mean σ {np.mean(before_deg):.2f}° so far, {np.mean(sigma_deg):.2f}° expected with these lights, "
        f"{np.mean(rings_deg):.2f}° with two rings"
    ]
    undetermined = float(np.mean(problem.search_sample.lit < criterion.MIN_LIGHTS))
    if observations.shots and undetermined > 0.5:
        notes.append(
            f"{undetermined:.0%} of the pixels were lit by fewer than {criterion.MIN_LIGHTS} lights so far: the "
            "shape behind this plan is unreliable there; check that all lamps were on and nothing blocked their light"
        )
    unlit = float(np.mean(np.sum(planned_rows.visibility > 0.5, axis=0) == 0))
    if unlit > 0.02:
        notes.append(f"{unlit:.0%} of the pixels are expected to see none of the new lights")
    if exposures is not None:
        notes.append(exposure_plan.sentence(exposures))
    within_reach = [further for further in options.forecast_counts if further <= len(problem.positions)]
    plan = LightPlan(
        lights=problem.lights(positions),
        method="optimal",
        reasons=_reasons(problem, planned_rows, positions - reach.center),
        gains=problem.gains(planned_rows),
        notes=notes,
        exposures=exposures,
        forecast=forecast_curve(problem, candidates, within_reach),
        predicted_sigma_deg=float(np.mean(sigma_deg)),
        predicted_median_deg=float(MEDIAN_ERROR_PER_SIGMA * np.median(sigma_deg)),
    )
    return plan.model_copy(update=_certificate(problem, candidates, chosen, sets[0])) if options.certify else plan


def forecast(
    normal_map: NormalMap,
    observations: Observations,
    recipe: Recipe,
    reach: Reach,
    calibration: Calibration,
    counts: Sequence[int],
    *,
    region: BoolArray | None = None,
) -> list[ForecastPoint]:
    """Expected σ after each of `counts` further lights, by a quick search for each count; in that order.

    Raises RigError plan.infeasible as `choose` does.
    """
    options, most = PlanOptions(region=region), max(counts, default=0)
    problem = design_problem.build(normal_map, observations, recipe, reach, calibration, options, most)
    return forecast_curve(problem, problem.design_rows(problem.search_sample, problem.positions), counts)


def forecast_curve(problem: Problem, candidates: Candidates, counts: Sequence[int]) -> list[ForecastPoint]:
    """Forecast for each of `counts` further lights, by a search for each among the problem's `candidates`."""
    points: list[ForecastPoint] = []
    for count in counts:
        chosen: list[int] = []
        if count:
            loss, sets = _loss_and_patterns(problem, candidates, count)
            chosen = optimise.search(problem.search_sample, candidates, loss, sets, count, problem.recipe.seed)
        sigma_deg = float(np.mean(problem.predicted_deg(problem.positions[chosen])))
        points.append(ForecastPoint(added=count, lights=len(problem.captured) + count, sigma_deg=sigma_deg))
    return points


def _loss_and_patterns(problem: Problem, options: Candidates, count: int) -> tuple[Loss, list[list[int]]]:
    """The loss of plans, its cap set by two rings' posterior of the search pixels, and the two-ring completions of the
    captured lights, the best balanced first."""
    sets = baselines.two_ring_completions(problem.captured, problem.units, count)
    rings = criterion.posterior(problem.search_sample, options.only(sets[0]))
    return objective.capped(rings), sets


def _certificate(
    problem: Problem, options: Candidates, chosen: list[int], pattern: list[int]
) -> dict[str, float | str]:
    """Efficiency of plan and two rings against the relaxation's lower bound, as fields of `LightPlan`.

    The plan is `chosen` among the `options`. The certificate is of the posterior: variances that no light lowers would
    pull all efficiencies towards 1.
    """
    step = max(1, len(problem.search_sample.albedo) // CERTIFICATE_PIXELS)
    sample = problem.search_sample.thinned(step)
    thinned = options.thinned(step)
    bound = relaxation.bound(sample, thinned, len(chosen))
    variance, rings = (
        float(np.mean(criterion.posterior(sample, thinned.only(some)).variance)) for some in (chosen, pattern)
    )
    return {
        "lower_bound_sigma_deg": bound.sigma_deg,
        "efficiency": float(np.sqrt(bound.variance / variance)),
        "two_rings_efficiency": float(np.sqrt(bound.variance / rings)),
        "relaxation_gap": bound.gap,
        "certificate_note": (
            f"no choice of {len(chosen)} among the {len(thinned.row)} candidate positions "
            f"brings the root mean square σ below {bound.sigma_deg:.2f}°; this plan is expected to reach "
            f"{np.degrees(np.sqrt(variance)):.2f}°, two rings {np.degrees(np.sqrt(rings)):.2f}°"
        ),
    }


def _reasons(problem: Problem, lights: Candidates, offsets: FloatArray) -> list[str]:
    """For each light a sentence on what it does to σ."""
    directions = offsets / np.linalg.norm(offsets, axis=1, keepdims=True)
    with_all = problem.expected_deg(lights)
    reasons: list[str] = []
    for direction, sigma_without in zip(directions, problem.without_each_deg(lights), strict=True):
        improved = with_all < 0.95 * sigma_without
        effect = "makes all pixels a little more certain"
        if np.any(improved):
            change = f"from {np.median(sigma_without[improved]):.1f}° to {np.median(with_all[improved]):.1f}°"
            effect = f"makes {np.mean(improved):.0%} of the pixels more certain, their median σ falls {change}"
        reasons.append(f"{baselines.describe_direction(direction)}: {effect}")
    return reasons
