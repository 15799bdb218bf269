"""Sequential optimum experimental design of the lights: sample, search, check, certify, report.

The criterion is a mean over pixels of the angular variance of the normal (A-optimality of the tangential components,
with a cap; `objective`), the prior is the Fisher information of the images so far. Everything reported is predicted on
held-out pixels, because the variance of the pixels that the search has used is optimistic.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from acquisition import lamp_pose
from acquisition.models.base import BoolArray, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import ForecastPoint, Light, LightPlan
from acquisition.models.recipe import Recipe
from acquisition.models.result import MEDIAN_ERROR_PER_SIGMA, NormalMap
from acquisition.models.route import Reach
from acquisition.models.shot import Observations
from acquisition.models.tuned import tuned
from acquisition.plan import (
    baselines,
    criterion,
    expected_sigma,
    objective,
    optimise,
    planned_noise,
    relaxation,
    two_ring_pattern,
    visibility,
)
from acquisition.plan.criterion import Candidates, Samples
from acquisition.plan.deadline import Deadline
from acquisition.plan.expected_sigma import ExpectedSigma
from acquisition.plan.objective import Loss
from acquisition.plan.planned_noise import Gloss
from acquisition.plan.visibility import Surface


@dataclass(frozen=True)
class PlannerSettings:
    """Tuned numbers of the planner."""

    sample_pixels: int = tuned(900, "pixels")
    """Number of random sample pixels of the search; from 50 to 4,000 the errors of the plans differ by less than 5
    %."""
    refine_stride: int = tuned(2, "pixels")
    """Stride of the sample pixels in the refinement off the candidates' grid, which casts most shadow rays."""
    search_offset_sigma_m: float = tuned(0.010, "m")
    """1 σ prior (m) of a pixel's depth offset by which lights are chosen; predictions use the solver's 3 mm. Integrated
    depth is wrong by 10 mm behind occluding contours, and wrong depth biases normals towards or away from the lights
    unless they surround the object: so the choice is even without a term for evenness. Errors of eight images against
    plans with 3 mm and a penalty on imbalance: 0.963 ± 0.016 on fourteen path-traced objects, 1.009 ± 0.021 on nine
    others (five families, design seeds 0 and 1, two azimuths); of twelve 0.993 ± 0.025."""
    certificate_pixels: int = tuned(300, "pixels")
    """Approximate number of pixels of the lower bound, which takes seconds with all of them."""
    min_pixels: int = tuned(20, "pixels")
    """Smallest number of usable sample pixels; with fewer the plan is infeasible."""
    max_undetermined_share: float = tuned(0.35, "share")
    """Share of pixels lit by fewer than three lights so far above which the plan warns; usual pilots leave 1–26 %."""
    max_candidates: int = tuned(300, "candidates")
    """Maximum number of candidate positions; 300 and 800 give the same errors."""


SETTINGS = PlannerSettings()


@dataclass(frozen=True)
class PlanOptions:
    """Limits of a plan's search, and optional reports."""

    region: BoolArray | None = None
    """(H, W) pixels whose normals count; none: the full object."""

    deadline_s: float | None = None
    """Seconds after which the best set so far is returned; none: no limit, and a deterministic plan."""

    certify: bool = True
    """Whether the relaxation's lower bound is computed."""

    listed: bool = False
    """Whether the candidates are all the positions there are, such as the lamps of a dome: lights are not refined off
    them, and they need not surround the object, since the images so far may do so."""

    forecast_counts: Sequence[int] = ()
    """Numbers of further lights for which the plan's `forecast` predicts σ; those above the candidates' are omitted."""


_DEFAULT_OPTIONS = PlanOptions()


@dataclass(frozen=True)
class Problem:
    """Design problem: sample pixels of the search, held-out pixels of the prediction, and the candidate lights."""

    normal_map: NormalMap
    observations: Observations
    surface: Surface
    gloss: Gloss
    expected: ExpectedSigma
    calibration: Calibration
    recipe: Recipe
    reach: Reach
    search_sample: Samples
    holdout_sample: Samples
    positions: FloatArray  # (K, 3) m, view frame
    units: FloatArray  # (K, 3)

    def lights(self, positions: FloatArray) -> list[Light]:
        """Lights at positions (M, 3) with their axes towards the dome's centre."""
        center = self.reach.center
        return [lamp_pose.light_at(position, center) for position in positions]

    def search_candidates(self, positions: FloatArray) -> Candidates:
        """Design rows (M, 4, P) of lights at positions (M, 3) at the search pixels, with cautious noise."""
        return self.design_rows(self.search_sample, positions, cautious=True)

    def holdout_candidates(self, positions: FloatArray) -> Candidates:
        """Design rows of lights at positions (M, 3) at the held-out pixels, with the expected noise."""
        return self.design_rows(self.holdout_sample, positions, cautious=False)

    def predicted_deg(self, positions: FloatArray) -> FloatArray:
        """σ (P,) in degrees expected of the held-out pixels after lights at positions (M, 3)."""
        none = criterion.no_candidates(self.holdout_sample)
        lights = self.holdout_candidates(positions) if len(positions) else none
        return self.expected.sigma_deg(criterion.posterior(self.holdout_sample, lights))

    def design_rows(self, sample: Samples, positions: FloatArray, *, cautious: bool) -> Candidates:
        """Whitened design rows and visibilities of lights at positions (M, 3) at sample pixels."""
        return criterion.candidates(
            sample, self.lights(positions), self.surface, self.calibration, self.recipe, self.gloss, cautious=cautious
        )

    @property
    def captured_directions(self) -> FloatArray:
        """Unit directions (T, 3) of the lights captured so far."""
        shots = self.observations.shots
        lights = [shot.light.position for shot in shots if shot.kind == "light" and shot.light is not None]
        offsets = np.array(lights).reshape(-1, 3) - self.reach.center
        return offsets / np.linalg.norm(offsets, axis=1, keepdims=True)


def choose(
    normal_map: NormalMap,
    observations: Observations,
    recipe: Recipe,
    reach: Reach,
    calibration: Calibration,
    count: int | None = None,
    options: PlanOptions = _DEFAULT_OPTIONS,
) -> LightPlan:
    """A-optimal sequential design: the `count` lights that lower the recipe's loss of the angular variance most.

    Bayesian: the normal map's information is the prior of the new lights. Exchange over the dome's candidates from many
    starts, completed rings among them (`optimise.search`), then a pattern search off their grid (`optimise.refine`),
    and the relaxation's lower bound as certificate. `count` None: as many lights as remain of the recipe; an empty plan
    means that it is fulfilled. Raises RigError plan.infeasible when the arm reaches too few positions or the normal map
    has too few usable pixels.
    """
    until = Deadline.within(options.deadline_s)
    captured = sum(shot.kind == "light" for shot in observations.shots)
    count_to_add = max(recipe.lights_total - captured, 0) if count is None else count
    problem = build_problem(normal_map, observations, recipe, reach, calibration, options, count_to_add)
    before_deg = problem.predicted_deg(np.empty((0, 3)))
    if count_to_add == 0:
        return _light_plan([], [], [], before_deg, ["all lights of the recipe have been captured"])
    candidates = problem.search_candidates(problem.positions)
    loss, sets = _loss_and_patterns(problem, candidates, count_to_add)
    chosen = optimise.search(problem.search_sample, candidates, loss, sets, count_to_add, recipe.seed, until)
    positions = problem.positions[chosen]
    if not options.listed:
        refine_sample = problem.search_sample.thinned(SETTINGS.refine_stride)
        positions = optimise.refine(
            refine_sample,
            positions,
            reach.center,
            loss,
            lambda places: problem.design_rows(refine_sample, places, cautious=True),
            lambda place: reach.allows(place) is None,
            until,
        )
    rings_deg = problem.predicted_deg(problem.positions[sets[0]])
    planned_rows = problem.holdout_candidates(positions)
    sigma_deg = problem.expected.sigma_deg(criterion.posterior(problem.holdout_sample, planned_rows))
    notes = [
        f"mean σ {np.mean(before_deg):.2f}° so far, {np.mean(sigma_deg):.2f}° expected with these lights, "
        f"{np.mean(rings_deg):.2f}° with two rings"
    ]
    if until.passed:
        notes.append(
            f"the search was stopped by its time limit of {options.deadline_s:g} s: the best set so far is used"
        )
    undetermined = float(np.mean(problem.search_sample.lit < criterion.MIN_LIGHTS))
    if observations.shots and undetermined > SETTINGS.max_undetermined_share:
        notes.append(
            f"{undetermined:.0%} of the pixels were lit by fewer than {criterion.MIN_LIGHTS} lights so far: the "
            "shape behind this plan is unreliable there; check that all lamps were on and nothing blocked their light"
        )
    unlit = float(np.mean(np.sum(planned_rows.visibility > 0.5, axis=0) == 0))
    if unlit > 0.02:
        notes.append(f"{unlit:.0%} of the pixels are expected to see none of the new lights")
    reasons, gains = _gains_and_reasons(problem, planned_rows, positions - reach.center)
    plan = _light_plan(problem.lights(positions), reasons, gains, sigma_deg, notes)
    within_reach = [further for further in options.forecast_counts if further <= len(problem.positions)]
    curve = _forecast_curve(problem, candidates, captured, within_reach)
    plan = plan.model_copy(update={"forecast": curve})
    if options.certify:
        bounded = candidates if options.listed else candidates.joined(problem.search_candidates(positions))
        plan = plan.model_copy(update=_certificate(problem, bounded, positions, sets[0], until))
    return plan


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
    captured = sum(shot.kind == "light" for shot in observations.shots)
    options, most = PlanOptions(region=region), max(counts, default=0)
    problem = build_problem(normal_map, observations, recipe, reach, calibration, options, most)
    return _forecast_curve(problem, problem.search_candidates(problem.positions), captured, counts)


def _forecast_curve(problem: Problem, options: Candidates, captured: int, counts: Sequence[int]) -> list[ForecastPoint]:
    """Forecast for each of `counts` further lights, by a quick search among the candidates `options`."""
    points: list[ForecastPoint] = []
    for count in counts:
        chosen: list[int] = []
        if count:
            loss, sets = _loss_and_patterns(problem, options, count)
            seed = problem.recipe.seed
            chosen = optimise.search(problem.search_sample, options, loss, sets, count, seed, Deadline(), quick=True)
        sigma_deg = float(np.mean(problem.predicted_deg(problem.positions[chosen])))
        points.append(ForecastPoint(added=count, lights=captured + count, sigma_deg=sigma_deg))
    return points


def build_problem(
    normal_map: NormalMap, observations: Observations, recipe: Recipe, reach: Reach, calibration: Calibration,
    options: PlanOptions, count: int,
) -> Problem:  # fmt: skip
    """The design problem of `count` further lights. Raises RigError plan.infeasible as `choose` does."""
    usable = criterion.usable_pixels(normal_map, calibration)
    region, where = options.region, ""
    if region is not None:
        if region.shape != normal_map.mask.shape:
            raise RigError(
                ErrorCode.PLAN_INFEASIBLE,
                f"the region of interest has {region.shape[1]} × {region.shape[0]} pixels, the images "
                f"{normal_map.mask.shape[1]} × {normal_map.mask.shape[0]}: draw it on an image of this camera",
            )
        information = normal_map.information
        usable = usable[region[information.rows[usable], information.columns[usable]]]
        where = " in the region of interest"
    if len(usable) < SETTINGS.min_pixels:
        raise RigError(
            ErrorCode.PLAN_INFEASIBLE,
            f"only {len(usable)} sample pixels of the normal map are usable{where}, {SETTINGS.min_pixels} are needed: "
            "check the pilot's images and the region",
            pixels=len(usable),
        )

    order = np.random.default_rng(recipe.seed).permutation(usable)
    half = max(len(order) // 2, SETTINGS.min_pixels // 2)
    search_pixels, holdout_pixels = (
        np.sort(numbers[: SETTINGS.sample_pixels]) for numbers in (order[:half], order[half:])
    )
    search_sample = criterion.samples(normal_map, calibration, search_pixels, SETTINGS.search_offset_sigma_m)
    holdout_sample = criterion.samples(normal_map, calibration, holdout_pixels)
    units = lamp_pose.directions(reach.candidates, reach.center, count, surround=not options.listed)
    kept = np.linspace(0, len(units) - 1, min(len(units), SETTINGS.max_candidates)).round().astype(int)
    return Problem(
        normal_map=normal_map,
        observations=observations,
        surface=visibility.surface(normal_map, calibration),
        gloss=planned_noise.gloss(normal_map),
        expected=expected_sigma.of(
            normal_map, lamp_pose.common_direction_sigma_rad(reach.candidates, reach.center, calibration)
        ),
        calibration=calibration,
        recipe=recipe,
        reach=reach,
        search_sample=criterion.reweight(search_sample, normal_map, observations, calibration, cautious=True),
        holdout_sample=criterion.reweight(holdout_sample, normal_map, observations, calibration),
        positions=reach.candidates[kept],
        units=units[kept],
    )


def _loss_and_patterns(problem: Problem, options: Candidates, count: int) -> tuple[Loss, list[list[int]]]:
    """The recipe's loss, scaled by two rings' posterior of the search pixels, and the two-ring completions of the
    captured lights, the best balanced first."""
    sets = two_ring_pattern.completions(problem.captured_directions, problem.units, count)
    rings = criterion.posterior(problem.search_sample, options.only(sets[0]))
    return objective.loss(problem.recipe.objective, rings), sets


def _certificate(
    problem: Problem, options: Candidates, positions: FloatArray, pattern: list[int], until: Deadline
) -> dict[str, float | str]:
    """Efficiency of plan and two rings against the relaxation's lower bound, as fields of `LightPlan`.

    `options` holds the plan's own positions too. The certificate is of the posterior: variances that no light lowers
    would pull all efficiencies towards 1.
    """
    step = max(1, len(problem.search_sample.albedo) // SETTINGS.certificate_pixels)
    sample = problem.search_sample.thinned(step)
    planned = problem.search_candidates(positions).thinned(step)
    thinned = options.thinned(step)
    bound = relaxation.bound(sample, thinned, len(positions), until)
    variance, rings = (
        float(np.mean(criterion.posterior(sample, set_).variance)) for set_ in (planned, thinned.only(pattern))
    )
    return {
        "lower_bound_sigma_deg": bound.sigma_deg,
        "efficiency": float(np.sqrt(bound.variance / variance)),
        "two_rings_efficiency": float(np.sqrt(bound.variance / rings)),
        "relaxation_gap": bound.gap,
        "certificate_note": (
            f"no choice of {len(positions)} among the {len(thinned.row)} candidate positions "
            f"brings the root mean square σ below {bound.sigma_deg:.2f}°; this plan is expected to reach "
            f"{np.degrees(np.sqrt(variance)):.2f}°, two rings {np.degrees(np.sqrt(rings)):.2f}°"
        ),
    }


def _light_plan(
    lights: list[Light], reasons: list[str], gains: list[float], sigma_deg: FloatArray, notes: list[str]
) -> LightPlan:
    return LightPlan(
        lights=lights,
        method="optimal",
        reasons=reasons,
        predicted_sigma_deg=float(np.mean(sigma_deg)),
        predicted_median_deg=float(MEDIAN_ERROR_PER_SIGMA * np.median(sigma_deg)),
        gains=gains,
        notes=notes,
    )


def _gains_and_reasons(problem: Problem, lights: Candidates, offsets: FloatArray) -> tuple[list[str], list[float]]:
    """Leave-one-out gains: for each light a sentence, and the fraction by which mean σ rises without it."""
    directions = offsets / np.linalg.norm(offsets, axis=1, keepdims=True)
    with_all, without_each = _leave_one_out(problem, lights)
    reasons: list[str] = []
    for direction, sigma_without in zip(directions, without_each, strict=True):
        improved = with_all < 0.95 * sigma_without
        effect = "makes all pixels a little more certain"
        if np.any(improved):
            change = f"from {np.median(sigma_without[improved]):.1f}° to {np.median(with_all[improved]):.1f}°"
            effect = f"makes {np.mean(improved):.0%} of the pixels more certain, their median σ falls {change}"
        reasons.append(f"{baselines.describe_direction(direction)}: {effect}")
    return reasons, _relative_gains(with_all, without_each)


def gains(problem: Problem, lights: Candidates) -> list[float]:
    """For each light, by its rows at the held-out pixels, the fraction by which the mean σ rises without it."""
    return _relative_gains(*_leave_one_out(problem, lights))


def _leave_one_out(problem: Problem, lights: Candidates) -> tuple[FloatArray, list[FloatArray]]:
    """Expected σ (P,) in degrees of the held-out pixels with all lights, and without each of them."""
    sample, every = problem.holdout_sample, np.arange(len(lights.row))
    without = (criterion.posterior(sample, lights.only(np.delete(every, number))) for number in every)
    return problem.expected.sigma_deg(criterion.posterior(sample, lights)), [
        problem.expected.sigma_deg(posterior) for posterior in without
    ]


def _relative_gains(with_all: FloatArray, without_each: Sequence[FloatArray]) -> list[float]:
    return [float(np.mean(without) / np.mean(with_all) - 1) for without in without_each]
