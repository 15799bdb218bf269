"""Which lights to add: what the images say, what each light would bring, the search, and what is expected of it.

What is reported is predicted on pixels that the search has not seen, because those it has seen flatter it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from acquisition import lamp_pose
from acquisition.models.base import BoolArray, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import ForecastPoint, Light, LightPlan
from acquisition.models.recipe import Recipe
from acquisition.models.result import NormalMap
from acquisition.models.route import Reach
from acquisition.models.shot import Observations
from acquisition.plan import (
    baselines,
    criterion,
    objective,
    optimise,
    planned_noise,
    relaxation,
    two_ring_pattern,
    visibility,
)
from acquisition.plan.criterion import Candidates, Expectation, Samples
from acquisition.plan.deadline import Deadline
from acquisition.plan.fallback import Doubts
from acquisition.plan.objective import Loss
from acquisition.plan.planned_noise import Gloss
from acquisition.plan.visibility import Surface

SAMPLE_PIXELS = 900
REFINE_EVERY = 2
"""Every so many sample pixels are asked when lights leave the candidates' grid, where most shadow rays are cast."""

CERTIFICATE_PIXELS = 300
LEAST_PIXELS = 20
BLIND_FROM = 0.35
"""Share of pixels lit by fewer than three lights so far that a person should know of; a usual pilot leaves 1–26 %."""

MOST_CANDIDATES = 300


@dataclass(frozen=True)
class Problem:
    """What a plan is made from: sample pixels to search by and fresh ones to predict by, and candidate lights."""

    normal_map: NormalMap
    observations: Observations
    surface: Surface
    gloss: Gloss
    calibration: Calibration
    recipe: Recipe
    reach: Reach
    known: Samples
    fresh: Samples
    positions: FloatArray  # (K, 3) m, view frame
    units: FloatArray  # (K, 3)

    def lights(self, positions: FloatArray) -> list[Light]:
        """Lamps at positions (M, 3) that look at the dome's centre."""
        center = self.reach.center
        return [lamp_pose.light_at(position, center) for position in positions]

    def candidates(self, positions: FloatArray) -> Candidates:
        """What lights at positions (M, 3) would tell the known pixels, to choose by."""
        return self.told(self.known, positions, cautious=True)

    def forecast(self, positions: FloatArray) -> Candidates:
        """What lights at positions (M, 3) are expected to tell the fresh pixels."""
        return self.told(self.fresh, positions, cautious=False)

    def expected(self, positions: FloatArray) -> Expectation:
        """What is expected of the fresh pixels after lights at positions (M, 3)."""
        if not len(positions):
            return criterion.expect(self.fresh, criterion.none(self.fresh))
        return criterion.expect(self.fresh, self.forecast(positions))

    def told(self, sample: Samples, positions: FloatArray, *, cautious: bool) -> Candidates:
        """What lights at positions (M, 3) would tell sample pixels."""
        return criterion.candidates(
            sample, self.lights(positions), self.surface, self.calibration, self.recipe, self.gloss, cautious=cautious
        )

    @property
    def taken(self) -> FloatArray:
        """Unit directions (T, 3) of the lights taken already."""
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
    *,
    region: BoolArray | None = None,
    deadline_s: float | None = None,
    certify: bool = True,
    forecast_counts: Sequence[int] = (),
) -> LightPlan:
    """The lights that make the normals most certain, given what all images so far say.

    `count` lights, or as many as the recipe still lacks; an empty plan says that it is fulfilled. `region` (H, W) is
    the part of the image that matters, none: the whole object. After `deadline_s` seconds the best so far is returned.
    The plan's `forecast` tells what each of `forecast_counts` further lights would bring instead, as far as the arm
    reaches so many positions. Where a plan is not to be trusted, two rings are completed instead, and `fallback` says
    why. Raises RigError plan.infeasible when the arm reaches too few positions or the normal map has too few pixels to
    plan by.
    """
    until = Deadline.within(deadline_s)
    taken = sum(shot.kind == "light" for shot in observations.shots)
    wanted = max(recipe.lights_total - taken, 0) if count is None else count
    problem = _problem(normal_map, observations, recipe, reach, calibration, region, wanted)
    before_deg = problem.expected(np.empty((0, 3))).sigma_deg
    if wanted == 0:
        return _described([], [], [], before_deg, ["all lights of the recipe have been taken"])
    options = problem.candidates(problem.positions)
    loss, sets = _judged(problem, options, wanted)
    chosen = optimise.search(problem.known, options, loss, sets, wanted, recipe.seed, until)
    few = problem.known.thinned(REFINE_EVERY)
    positions = optimise.refine(
        few,
        problem.positions[chosen],
        reach.center,
        loss,
        lambda places: problem.told(few, places, cautious=True),
        lambda place: reach.allows(place) is None,
        until,
    )
    rings = problem.expected(problem.positions[sets[0]])
    gain = 1 - loss.of(problem.expected(positions)) / loss.of(rings)
    unexplained = criterion.unexplained_shadows(
        problem.known, normal_map, problem.surface, observations, calibration, recipe
    )
    mirrored = criterion.mirrored(problem.known, problem.units, problem.gloss)
    fallback = Doubts(unexplained, mirrored, gain).fallback
    if fallback is not None:
        positions = problem.positions[two_ring_pattern.instead(problem.taken, problem.units, wanted)]

    there = problem.forecast(positions)
    sigma_deg = criterion.expect(problem.fresh, there).sigma_deg
    notes = [
        f"mean σ {np.mean(before_deg):.2f}° so far, {np.mean(sigma_deg):.2f}° expected with these lights, "
        f"{np.mean(rings.sigma_deg):.2f}° with two rings"
    ]
    if fallback is not None:
        notes.append(f"two rings instead of planned lights: {fallback}")
    if until.passed:
        notes.append(f"the search was cut short after {deadline_s:g} s: the best so far is taken")
    blind = float(np.mean(problem.known.lit < criterion.DETERMINED_BY))
    if observations.shots and blind > BLIND_FROM:
        notes.append(
            f"{blind:.0%} of the pixels were lit by fewer than {criterion.DETERMINED_BY} lights so far: the shape that "
            "this is planned from is a guess there; check that all lamps were on and nothing stood in their way"
        )
    dark = float(np.mean(np.sum(there.visibility > 0.5, axis=0) == 0))
    if dark > 0.02:
        notes.append(f"{dark:.0%} of the pixels are expected to see none of the new lights")
    reasons, gains = _worth(problem.fresh, there, (positions - reach.center))
    plan = _described(problem.lights(positions), reasons, gains, sigma_deg, notes)
    within_reach = [further for further in forecast_counts if further <= len(problem.positions)]
    curve = _curve(problem, options, taken, within_reach)
    plan = plan.model_copy(update={"fallback": fallback, "forecast": curve})
    if certify:
        plan = plan.model_copy(update=_certificate(problem, options, positions, sets[0], until))
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
    """The error to be expected after each of `counts` further lights, chosen almost as `choose` would; in that order.

    Raises RigError plan.infeasible as `choose` does.
    """
    taken = sum(shot.kind == "light" for shot in observations.shots)
    problem = _problem(normal_map, observations, recipe, reach, calibration, region, max(counts, default=0))
    return _curve(problem, problem.candidates(problem.positions), taken, counts)


def _curve(problem: Problem, options: Candidates, taken: int, counts: Sequence[int]) -> list[ForecastPoint]:
    """What is expected after each of `counts` further lights, found by a quick search among `options`."""
    points: list[ForecastPoint] = []
    for count in counts:
        chosen: list[int] = []
        if count:
            loss, sets = _judged(problem, options, count)
            seed = problem.recipe.seed
            chosen = optimise.search(problem.known, options, loss, sets, count, seed, Deadline(), quick=True)
        sigma_deg = float(np.mean(problem.expected(problem.positions[chosen]).sigma_deg))
        points.append(ForecastPoint(added=count, lights=taken + count, sigma_deg=sigma_deg))
    return points


def _problem(
    normal_map: NormalMap, observations: Observations, recipe: Recipe, reach: Reach, calibration: Calibration,
    region: BoolArray | None, count: int,
) -> Problem:  # fmt: skip
    usable = criterion.usable(normal_map, calibration)
    where = ""
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
    if len(usable) < LEAST_PIXELS:
        raise RigError(
            ErrorCode.PLAN_INFEASIBLE,
            f"only {len(usable)} sample pixels of the normal map can be planned by{where}, {LEAST_PIXELS} are needed: "
            "check the pilot's images and the region",
            pixels=len(usable),
        )

    taken = [shot.light for shot in observations.shots if shot.kind == "light" and shot.light is not None]
    order = np.random.default_rng(recipe.seed).permutation(usable)
    half = max(len(order) // 2, LEAST_PIXELS // 2)
    known, fresh = (
        criterion.samples(normal_map, calibration, np.sort(numbers[:SAMPLE_PIXELS]), taken)
        for numbers in (order[:half], order[half:])
    )
    units = lamp_pose.directions(reach.candidates, reach.center, count)
    thin = np.linspace(0, len(units) - 1, min(len(units), MOST_CANDIDATES)).round().astype(int)
    return Problem(
        normal_map=normal_map,
        observations=observations,
        surface=visibility.surface(normal_map, calibration),
        gloss=planned_noise.gloss(normal_map),
        calibration=calibration,
        recipe=recipe,
        reach=reach,
        known=criterion.reweighed(known, normal_map, observations, calibration, cautious=True),
        fresh=criterion.reweighed(fresh, normal_map, observations, calibration),
        positions=reach.candidates[thin],
        units=units[thin],
    )


def _judged(problem: Problem, options: Candidates, count: int) -> tuple[Loss, list[list[int]]]:
    """The recipe's loss, by what rings give the known pixels, and two-ring completions of the lights taken, the best
    balanced first."""
    sets = two_ring_pattern.completions(problem.taken, problem.units, count)
    rings = criterion.expect(problem.known, options.only(sets[0]))
    return objective.loss(problem.recipe.objective, rings), sets


def _certificate(
    problem: Problem, options: Candidates, positions: FloatArray, pattern: list[int], until: Deadline
) -> dict[str, float | str]:
    """The lower bound, and what plan and pattern come to against it; the plan's own lights are candidates too.

    The variance that no light removes is left out: it would make all look alike.
    """
    step = max(1, len(problem.known.albedo) // CERTIFICATE_PIXELS)
    sample = problem.known.thinned(step)
    sample = replace(sample, unresolved=np.zeros_like(sample.unresolved))
    ours = problem.candidates(positions).thinned(step)
    few = options.thinned(step)
    found = relaxation.bound(sample, few.joined(ours), len(positions), until)
    variance, rings = (float(np.mean(criterion.expect(sample, set_).variance)) for set_ in (ours, few.only(pattern)))
    return {
        "lower_bound_sigma_deg": found.sigma_deg,
        "efficiency": float(np.sqrt(found.variance / variance)),
        "two_rings_efficiency": float(np.sqrt(found.variance / rings)),
        "relaxation_gap": found.gap,
        "certificate_note": (
            f"no choice of {len(positions)} among the {len(few.row) + len(positions)} positions looked at brings the "
            f"root mean square σ below {found.sigma_deg:.2f}°; this plan is expected to reach "
            f"{np.degrees(np.sqrt(variance)):.2f}°, two rings {np.degrees(np.sqrt(rings)):.2f}°"
        ),
    }


def _described(
    lights: list[Light], reasons: list[str], gains: list[float], sigma_deg: FloatArray, notes: list[str]
) -> LightPlan:
    return LightPlan(
        lights=lights,
        method="optimal",
        reasons=reasons,
        predicted_sigma_deg=float(np.mean(sigma_deg)),
        predicted_median_deg=float(0.833 * np.median(sigma_deg)),
        gains=gains,
        notes=notes,
    )


def _worth(sample: Samples, lights: Candidates, offsets: FloatArray) -> tuple[list[str], list[float]]:
    """What each light brings beside the others: in words, and as the share by which mean σ would rise without it."""
    directions = offsets / np.linalg.norm(offsets, axis=1, keepdims=True)
    with_all = criterion.expect(sample, lights).sigma_deg
    reasons: list[str] = []
    gains: list[float] = []
    for number, direction in enumerate(directions):
        without = criterion.expect(sample, lights.only(np.delete(np.arange(len(lights.row)), number))).sigma_deg
        better = with_all < 0.95 * without
        brings = "makes all pixels a little more certain"
        if np.any(better):
            fell = f"from {np.median(without[better]):.1f}° to {np.median(with_all[better]):.1f}°"
            brings = f"makes {np.mean(better):.0%} of the pixels more certain, their median σ falls {fell}"
        reasons.append(f"{baselines.place(direction)}: {brings}")
        gains.append(float(np.mean(without) / np.mean(with_all) - 1))
    return reasons, gains
