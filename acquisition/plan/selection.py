"""Which lights to add: what the images say, what each light would bring, the search, and what is expected of it.

What is reported is predicted on pixels that the search has not seen, because those it has seen flatter it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from acquisition import dome
from acquisition.errors import ErrorCode, RigError
from acquisition.plan import baselines, criterion, objective, patterns, relaxation, search, visibility
from acquisition.plan.criterion import Candidates, Samples
from acquisition.plan.deadline import Deadline
from acquisition.plan.objective import VARIANCE, Loss
from acquisition.plan.visibility import Surface
from acquisition.types import (
    BoolArray,
    Calibration,
    Expected,
    FloatArray,
    Light,
    LightPlan,
    NormalMap,
    Observations,
    Reach,
    Recipe,
)

SAMPLE_PIXELS = 900
CERTIFICATE_PIXELS = 300
LEAST_PIXELS = 20
MOST_CANDIDATES = 300
STEPS_FROM = 0.05
"""Share of unexplained shadows above which the depth map is not to be trusted: 0–3 % on objects without steps, 9 % on a
machined part, where the errors found are twice those expected."""


@dataclass(frozen=True)
class Problem:
    """What a plan is made from: sample pixels to search by and fresh ones to predict by, and candidate lights."""

    normal_map: NormalMap
    surface: Surface
    calibration: Calibration
    recipe: Recipe
    reach: Reach
    known: Samples
    fresh: Samples
    taken: FloatArray  # (T, 3) unit directions of the lights taken already
    positions: FloatArray  # (K, 3) m, view frame
    units: FloatArray  # (K, 3)

    def candidates(self, sample: Samples, positions: FloatArray) -> Candidates:
        """What lights at positions (M, 3) would tell sample pixels."""
        lights = [dome.light(position, self.reach.center) for position in positions]
        return criterion.candidates(sample, lights, self.surface, self.calibration, self.recipe)

    def pattern(self, options: Candidates, loss: Loss, count: int) -> tuple[list[int], list[list[int]]]:
        """The best two-ring completion, and all of them."""
        sets = patterns.completions(self.taken, self.units, count)
        return min(sets, key=lambda chosen: search.value(self.known, options, loss, chosen)), sets


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
) -> LightPlan:
    """The lights that make the normals most certain, given what all images so far say.

    `count` lights, or as many as the recipe still lacks; an empty plan says that it is fulfilled. `region` (H, W) is
    the part of the image that matters, none: the whole object. After `deadline_s` seconds the best so far is returned.
    Raises RigError plan.infeasible when the arm reaches too few positions or the normal map has too few pixels to plan
    by.
    """
    until = Deadline.within(deadline_s)
    taken = sum(shot.kind == "light" for shot in observations.shots)
    wanted = max(recipe.lights_total - taken, 0) if count is None else count
    problem = _problem(normal_map, observations, recipe, reach, calibration, region, wanted)
    if wanted == 0:
        sigma_deg = criterion.expect(problem.fresh, criterion.none(problem.fresh)).sigma_deg
        return _described([], [], sigma_deg, ["all lights of the recipe have been taken"])
    options = problem.candidates(problem.known, problem.positions)
    loss, pattern, sets = _judged(problem, options, wanted)
    chosen = search.search(problem.known, options, loss, sets, wanted, recipe.seed, until)
    positions = search.refine(
        problem.known,
        problem.positions[chosen],
        reach.center,
        loss,
        lambda places: problem.candidates(problem.known, places),
        lambda place: reach.allows(place) is None,
        until,
    )
    there = problem.candidates(problem.fresh, positions)
    sigma_deg = criterion.expect(problem.fresh, there).sigma_deg
    before_deg = criterion.expect(problem.fresh, criterion.none(problem.fresh)).sigma_deg
    directions = (positions - reach.center) / np.linalg.norm(positions - reach.center, axis=1, keepdims=True)
    reasons = [
        f"{baselines.place(direction)}: {_worth(problem.fresh, there, number)}"
        for number, direction in enumerate(directions)
    ]
    notes = [f"mean σ {np.mean(before_deg):.2f}° so far, {np.mean(sigma_deg):.2f}° expected with these lights"]
    dark = float(np.mean(np.sum(there.visibility > 0.5, axis=0) == 0))
    if dark > 0.02:
        notes.append(f"{dark:.0%} of the pixels are expected to see none of the new lights")
    unexplained = criterion.unexplained_shadows(
        problem.known, normal_map, problem.surface, observations, calibration, recipe
    )
    if unexplained > STEPS_FROM:
        notes.append(
            f"{unexplained:.0%} of what the shape found so far would light is dark in the images: the object has steps "
            "that its depth map does not show, and errors may be twice those expected"
        )
    lights = [dome.light(position, reach.center) for position in positions]
    plan = _described(lights, reasons, sigma_deg, notes)
    if certify:
        plan = plan.model_copy(update=_certificate(problem, options, positions, pattern, until))
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
) -> list[Expected]:
    """The error to be expected after each of `counts` further lights, chosen as `choose` would; in that order.

    Raises RigError plan.infeasible as `choose` does.
    """
    taken = sum(shot.kind == "light" for shot in observations.shots)
    problem = _problem(normal_map, observations, recipe, reach, calibration, region, max(counts, default=0))
    options = problem.candidates(problem.known, problem.positions)
    never = Deadline()
    points: list[Expected] = []
    for count in counts:
        chosen: list[int] = []
        if count:
            loss, pattern, _ = _judged(problem, options, count)
            starts = [search.greedy(problem.known, options, loss, count, never), pattern]
            found = [search.exchange(problem.known, options, loss, start, never, passes=2) for start in starts]
            chosen = min(found, key=lambda some: search.value(problem.known, options, loss, some))
        there = problem.candidates(problem.fresh, problem.positions[chosen])
        sigma_deg = float(np.mean(criterion.expect(problem.fresh, there).sigma_deg))
        points.append(Expected(added=count, lights=taken + count, sigma_deg=sigma_deg))
    return points


def _problem(
    normal_map: NormalMap, observations: Observations, recipe: Recipe, reach: Reach, calibration: Calibration,
    region: BoolArray | None, count: int,
) -> Problem:  # fmt: skip
    usable = criterion.usable(normal_map, calibration)
    where = ""
    if region is not None:
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
    order = np.random.default_rng(recipe.seed).permutation(usable)
    half = max(len(order) // 2, LEAST_PIXELS // 2)
    units = dome.directions(reach.candidates, reach.center, count)
    thin = np.linspace(0, len(units) - 1, min(len(units), MOST_CANDIDATES)).round().astype(int)
    lights = [shot.light.position for shot in observations.shots if shot.kind == "light" and shot.light is not None]
    offsets = np.array(lights).reshape(-1, 3) - reach.center
    return Problem(
        normal_map,
        visibility.surface(normal_map, calibration),
        calibration,
        recipe,
        reach,
        criterion.samples(normal_map, calibration, np.sort(order[:half][:SAMPLE_PIXELS])),
        criterion.samples(normal_map, calibration, np.sort(order[half:][:SAMPLE_PIXELS])),
        offsets / np.linalg.norm(offsets, axis=1, keepdims=True),
        reach.candidates[thin],
        units[thin],
    )


def _judged(problem: Problem, options: Candidates, count: int) -> tuple[Loss, list[int], list[list[int]]]:
    """The recipe's loss, the best two-ring completion by it, and all of them."""
    pattern, _ = problem.pattern(options, VARIANCE, count)
    loss = objective.loss(problem.recipe.objective, criterion.expect(problem.known, options.only(pattern)))
    return loss, *problem.pattern(options, loss, count)


def _certificate(
    problem: Problem, options: Candidates, positions: FloatArray, pattern: list[int], until: Deadline
) -> dict[str, float | str]:
    """The lower bound, and what plan and pattern come to against it; the plan's own lights are candidates too."""
    step = max(1, len(problem.known.albedo) // CERTIFICATE_PIXELS)
    sample = problem.known.thinned(step)
    ours = problem.candidates(problem.known, positions).thinned(step)
    few = options.thinned(step)
    found = relaxation.bound(sample, few.joined(ours), len(positions), until)
    variance, rings = (float(np.mean(criterion.expect(sample, set_).variance)) for set_ in (ours, few.only(pattern)))
    efficiency, of_rings = float(np.sqrt(found.variance / variance)), float(np.sqrt(found.variance / rings))
    return {
        "lower_bound_sigma_deg": found.sigma_deg,
        "efficiency": efficiency,
        "two_rings_efficiency": of_rings,
        "relaxation_gap": found.gap,
        "certificate_note": (
            f"no choice of {len(positions)} among the {len(few.row) + len(positions)} positions looked at brings the "
            f"root mean square σ below {found.sigma_deg:.2f}°; this plan is expected to reach "
            f"{np.degrees(np.sqrt(variance)):.2f}°, two rings {np.degrees(np.sqrt(rings)):.2f}°"
        ),
    }


def _described(lights: list[Light], reasons: list[str], sigma_deg: FloatArray, notes: list[str]) -> LightPlan:
    return LightPlan(
        lights=lights,
        method="optimal",
        reasons=reasons,
        predicted_sigma_deg=float(np.mean(sigma_deg)),
        predicted_median_deg=float(0.833 * np.median(sigma_deg)),
        notes=notes,
    )


def _worth(sample: Samples, lights: Candidates, number: int) -> str:
    """What one light brings beside all the others."""
    others = [index for index in range(len(lights.row)) if index != number]
    without = criterion.expect(sample, lights.only(others)).sigma_deg
    with_it = criterion.expect(sample, lights).sigma_deg
    better = with_it < 0.95 * without
    if not np.any(better):
        return "makes all pixels a little more certain"
    fell = f"from {np.median(without[better]):.1f}° to {np.median(with_it[better]):.1f}°"
    return f"makes {np.mean(better):.0%} of the pixels more certain, their median σ falls {fell}"
