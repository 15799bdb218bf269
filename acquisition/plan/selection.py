"""Which lights to add: greedy from several starts, then exchange.

Greedy alone is 10–30 % short in the objective for few lights; exchanging one light at a time for the best candidate
closes that, and several starts remove the rest. One start is the two-ring pattern, so that a plan is never predicted to
be worse than the pattern. Everything is deterministic for a given seed. What is reported is predicted on pixels that
the search has not seen, because those it has seen flatter it.
"""

from collections.abc import Sequence

import numpy as np

from acquisition import dome
from acquisition.errors import ErrorCode, RigError
from acquisition.plan import baselines, criterion
from acquisition.plan.criterion import Candidates, Samples
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

SEARCH_PIXELS = 400
POLISH_PIXELS = 900
LEAST_PIXELS = 20
RANDOM_STARTS = 3
MOST_CANDIDATES = 300
STEPS_FROM = 0.05
"""Share of unexplained shadows above which the depth map is not to be trusted: 0–3 % on objects without steps, 9 % on a
machined part, where the errors found are twice those expected."""


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
    taken = sum(shot.kind == "light" for shot in observations.shots)
    wanted = max(recipe.lights_total - taken, 0) if count is None else count
    usable = criterion.usable(normal_map, calibration)
    if len(usable) < LEAST_PIXELS:
        raise RigError(
            ErrorCode.PLAN_INFEASIBLE,
            f"only {len(usable)} pixels of the normal map can be planned by: check the pilot's images and the region",
            pixels=len(usable),
        )
    order = np.random.default_rng(recipe.seed).permutation(usable)
    half = max(len(order) // 2, LEAST_PIXELS // 2)
    known = criterion.samples(normal_map, calibration, np.sort(order[:half][:POLISH_PIXELS]))
    fresh = criterion.samples(normal_map, calibration, np.sort(order[half:][:POLISH_PIXELS]))
    if wanted == 0:
        sigma_deg = criterion.expect(fresh, _none(fresh)).sigma_deg
        return _described([], [], sigma_deg, ["all lights of the recipe have been taken"])
    units = dome.directions(reach.candidates, reach.center, wanted)
    thin = np.linspace(0, len(units) - 1, min(len(units), MOST_CANDIDATES)).round().astype(int)
    units, positions = units[thin], reach.candidates[thin]
    lights = [dome.light(position, reach.center) for position in positions]
    options = criterion.candidates(known, lights, normal_map, calibration, recipe)

    chosen = search(known, options, units, wanted, recipe.seed)
    chosen_lights = [lights[index] for index in chosen]
    there = criterion.candidates(fresh, chosen_lights, normal_map, calibration, recipe)
    sigma_deg = criterion.expect(fresh, there).sigma_deg
    before_deg = criterion.expect(fresh, _none(fresh)).sigma_deg
    reasons = [
        f"{baselines.place(units[index])}: {_worth(fresh, there, number)}" for number, index in enumerate(chosen)
    ]
    notes = [f"mean σ {np.mean(before_deg):.2f}° so far, {np.mean(sigma_deg):.2f}° expected with these lights"]
    dark = float(np.mean(np.sum(there.visibility > 0.5, axis=0) == 0))
    if dark > 0.02:
        notes.append(f"{dark:.0%} of the pixels are expected to see none of the new lights")
    unexplained = criterion.unexplained_shadows(known, normal_map, observations, calibration, recipe)
    if unexplained > STEPS_FROM:
        notes.append(
            f"{unexplained:.0%} of what the shape found so far would light is dark in the images: the object has steps "
            "that its depth map does not show, and errors may be twice those expected"
        )
    return _described(chosen_lights, reasons, sigma_deg, notes)


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
    points: list[Expected] = []
    for count in counts:
        chosen = choose(normal_map, observations, recipe, reach, calibration, count, region=region, certify=False)
        sigma_deg = chosen.predicted_sigma_deg
        if sigma_deg is not None:
            points.append(Expected(added=count, lights=taken + count, sigma_deg=sigma_deg))
    return points


def _described(lights: list[Light], reasons: list[str], sigma_deg: FloatArray, notes: list[str]) -> LightPlan:
    return LightPlan(
        lights=lights,
        method="optimal",
        reasons=reasons,
        predicted_sigma_deg=float(np.mean(sigma_deg)),
        predicted_median_deg=float(0.833 * np.median(sigma_deg)),
        notes=notes,
    )


def search(sample: Samples, options: Candidates, units: FloatArray, count: int, seed: int) -> list[int]:
    """The best set found: short searches on few pixels from all starts, then exchange on all pixels.

    Few pixels may mislead, so the last exchange starts from whichever is best on all of them, the patterns included.
    """
    few = _thinned(sample, options, SEARCH_PIXELS)
    rng = np.random.default_rng(seed)
    free = np.ones(len(units), dtype=np.bool_)
    patterns = [dome.nearest_distinct(baselines.two_rings(count, turn), units, free)[0] for turn in (0.0, 0.33, 0.67)]
    starts = [_greedy(*few, count), *patterns]
    starts += [[int(index) for index in rng.permutation(len(units))[:count]] for _ in range(RANDOM_STARTS)]
    found = [_exchange(*few, start, passes=3) for start in starts]
    shortlist = [min(found, key=lambda item: (item[0], item[1]))[1], *patterns]
    best = min(shortlist, key=lambda chosen: criterion.expect(sample, options.only(chosen)).objective)
    return _exchange(sample, options, best, passes=4)[1]


def _thinned(sample: Samples, options: Candidates, pixels: int) -> tuple[Samples, Candidates]:
    step = slice(None, None, max(1, len(sample.albedo) // pixels))
    return (
        Samples(
            row=sample.row[step],
            column=sample.column[step],
            point=np.ascontiguousarray(sample.point[:, step]),
            along=np.ascontiguousarray(sample.along[:, step]),
            normal=np.ascontiguousarray(sample.normal[:, step]),
            albedo=sample.albedo[step],
            sigma=sample.sigma[step],
            information=sample.information[step],
        ),
        Candidates(np.ascontiguousarray(options.row[:, :, step]), np.ascontiguousarray(options.visibility[:, step])),
    )


def _greedy(sample: Samples, options: Candidates, count: int) -> list[int]:
    chosen: list[int] = []
    for _ in range(count):
        objective = criterion.scan(sample, criterion.expect(sample, options.only(chosen)), options)
        objective[chosen] = np.inf
        chosen.append(int(np.argmin(objective)))
    return chosen


def _exchange(sample: Samples, options: Candidates, start: list[int], passes: int) -> tuple[float, list[int]]:
    """Exchanges one light at a time for the best candidate until nothing improves; the objective and the set."""
    chosen = list(start)
    value = criterion.expect(sample, options.only(chosen)).objective
    for _ in range(passes):
        changed = False
        for number in range(len(chosen)):
            others = chosen[:number] + chosen[number + 1 :]
            objective = criterion.scan(sample, criterion.expect(sample, options.only(others)), options)
            objective[others] = np.inf
            best = int(np.argmin(objective))
            if objective[best] < value * (1 - 1e-5):
                chosen[number] = best
                value = float(objective[best])
                changed = True
        if not changed:
            break
    return value, chosen


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


def _none(sample: Samples) -> Candidates:
    pixels = len(sample.albedo)
    return Candidates(np.empty((0, 4, pixels), np.float32), np.empty((0, pixels), np.float32))
