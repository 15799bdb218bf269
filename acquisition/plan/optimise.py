"""Exchange algorithm for exact designs (after Fedorov 1972): greedy and random starts, exchange, pattern search.

Greedy alone is 10–30 % short in the objective for few lights; exchanging one light at a time for the best candidate
closes that, and many starts and exchanges of two at a time remove most of the rest. The two-ring patterns are starts
too, so that a plan is never predicted to be worse than they are. What the exchange has settled moves off the
candidates' grid by steps of 4° down to 0.5°, as far as the arm allows. Everything is deterministic for a given seed,
unless a deadline cuts it short.
"""

from collections.abc import Callable, Sequence
from itertools import combinations

import numpy as np

from acquisition import geometry
from acquisition.models.base import FloatArray
from acquisition.plan import criterion
from acquisition.plan.criterion import Candidates, Samples
from acquisition.plan.deadline import Deadline
from acquisition.plan.objective import Loss

COARSE_PIXELS = 300
RANDOM_START_LIGHTS = 80
"""Random starts have this many lights together, so that few lights, which have more local minima, get more starts. One
start of eight finds the best set, and two passes of exchange are enough to see it."""

QUICK_RANDOM_START_LIGHTS = 40
"""As many in a quick search: on one cushion seen by sixteen domes of candidates, the σ of four lights is within 1.1 %
of what the whole search finds, of eight within 2.6 %. With 24, sets are found whose σ is 4 % larger at a loss that is
hardly larger."""

SHORTLIST = 4
PAIR_TRIALS = 12
REFINE_STEPS_DEG = (4.0, 2.0, 1.0, 0.5)
REFINE_ROUNDS = 3
"""Times that all lights are tried at one step, while any of them moves."""

REFINE_DIRECTIONS = 8
"""Places round a light that it may move to."""

MIN_IMPROVEMENT = 1e-4


def search(
    sample: Samples, options: Candidates, loss: Loss, patterns: Sequence[list[int]], count: int, seed: int,
    until: Deadline, *, quick: bool = False,
) -> list[int]:  # fmt: skip
    """Numbers of the best set of `count` options found: short searches on few pixels from all starts, then exchange on
    all pixels, from whichever set is best there, the patterns included; `quick` for what is forecast, not driven to."""
    step = max(1, len(sample.albedo) // COARSE_PIXELS)
    coarse, coarse_options = sample.thinned(step), options.thinned(step)
    rng = np.random.default_rng(seed)
    starts = [greedy(coarse, coarse_options, loss, count, until)]
    starts += [min(patterns, key=lambda chosen: value(coarse, coarse_options, loss, chosen))] if patterns else []
    random_starts = QUICK_RANDOM_START_LIGHTS // count if quick else max(2, RANDOM_START_LIGHTS // count)
    for _ in range(random_starts if count > 1 else 0):  # a single light has been scanned already
        starts.append([int(index) for index in rng.permutation(len(options.row))[:count]])
    solutions = [exchange(coarse, coarse_options, loss, start, until, passes=2) for start in starts]
    if not quick:
        solutions.sort(key=lambda chosen: value(coarse, coarse_options, loss, chosen))
        solutions = [
            exchange(coarse, coarse_options, loss, chosen, until, passes=4) for chosen in solutions[:SHORTLIST]
        ]
        solutions.sort(key=lambda chosen: value(coarse, coarse_options, loss, chosen))
        solutions.append(pair_exchange(coarse, coarse_options, loss, solutions[0], rng, until))
    best = min([*solutions, *patterns], key=lambda chosen: value(sample, options, loss, chosen))
    return exchange(sample, options, loss, best, until, passes=2 if quick else 5)


def value(sample: Samples, options: Candidates, loss: Loss, chosen: list[int]) -> float:
    """Mean loss of the design with these candidates."""
    return loss.evaluate(criterion.posterior(sample, options.only(chosen)))


def greedy(sample: Samples, options: Candidates, loss: Loss, count: int, until: Deadline) -> list[int]:
    """Greedy forward selection, one candidate at a time; after the deadline the first ones left."""
    chosen: list[int] = []
    for _ in range(count):
        if until.passed:
            return chosen + [index for index in range(len(options.row)) if index not in chosen][: count - len(chosen)]
        losses = loss.scan(sample, criterion.posterior(sample, options.only(chosen)), options)
        losses[chosen] = np.inf
        chosen.append(int(np.argmin(losses)))
    return chosen


def exchange(
    sample: Samples, options: Candidates, loss: Loss, start: list[int], until: Deadline, passes: int
) -> list[int]:
    """Coordinate exchange: one light at a time for the best candidate, until nothing improves."""
    chosen = list(start)
    unchanged = 0
    for turn in range(passes * len(chosen)):
        slot = turn % len(chosen)
        others = chosen[:slot] + chosen[slot + 1 :]
        losses = loss.scan(sample, criterion.posterior(sample, options.only(others)), options)
        losses[others] = np.inf
        best = int(np.argmin(losses))
        # What stays is compared by the same scan: its sums are in single precision.
        better = losses[best] < losses[chosen[slot]] * (1 - MIN_IMPROVEMENT)
        unchanged = 0 if better else unchanged + 1
        if better:
            chosen[slot] = best
        if unchanged >= len(chosen) or until.passed:
            break
    return chosen


def pair_exchange(
    sample: Samples, options: Candidates, loss: Loss, start: list[int], rng: np.random.Generator, until: Deadline
) -> list[int]:
    """Pair exchange: removes two lights, refills greedily and exchanges, which leaves most local minima."""
    chosen, best = list(start), value(sample, options, loss, start)
    pairs = list(combinations(range(len(chosen)), 2))
    for number in rng.permutation(len(pairs))[:PAIR_TRIALS]:
        if until.passed:
            break
        trial = [index for place, index in enumerate(chosen) if place not in pairs[number]]
        removed = [chosen[place] for place in pairs[number]]
        while len(trial) < len(chosen):
            losses = loss.scan(sample, criterion.posterior(sample, options.only(trial)), options)
            losses[trial] = np.inf
            if len(trial) == len(chosen) - 2:
                losses[removed] = np.inf
            trial.append(int(np.argmin(losses)))
        trial = exchange(sample, options, loss, trial, until, passes=2)
        trial_value = value(sample, options, loss, trial)
        if trial_value < best * (1 - MIN_IMPROVEMENT):
            best, chosen = trial_value, trial
    return chosen


def refine(
    sample: Samples,
    positions: FloatArray,
    center: FloatArray,
    loss: Loss,
    candidates_at: Callable[[FloatArray], Candidates],
    allowed: Callable[[FloatArray], bool],
    until: Deadline,
) -> FloatArray:
    """Positions (M, 3) moved on their spheres round `center` while the loss falls and `allowed` says yes.

    `make` gives the candidates of positions (K, 3). A pattern search, because visibility makes the loss jump.
    """
    positions = positions.copy()
    current = candidates_at(positions)
    start = loss.evaluate(criterion.posterior(sample, current))
    for step_deg in REFINE_STEPS_DEG:
        neighbourhoods: dict[int, Candidates] = {}  # what is round each light that has not moved since
        for _ in range(REFINE_ROUNDS):
            neighbours = np.stack([_neighbours(position, center, step_deg) for position in positions])
            stale = [slot for slot in range(len(positions)) if slot not in neighbourhoods]
            if not stale:
                break
            evaluated = candidates_at(neighbours[stale].reshape(-1, 3))
            for number, place in enumerate(stale):
                neighbourhoods[place] = evaluated.only(
                    np.arange(number * REFINE_DIRECTIONS, (number + 1) * REFINE_DIRECTIONS)
                )
            for place in range(len(positions)):
                if until.passed:
                    return positions
                others = [index for index in range(len(positions)) if index != place]
                own = neighbourhoods[place]
                losses = loss.scan(
                    sample, criterion.posterior(sample, current.only(others)), own.joined(current.only([place]))
                )
                best = int(np.argmin(losses[:REFINE_DIRECTIONS]))
                better = losses[best] < losses[REFINE_DIRECTIONS] - MIN_IMPROVEMENT * start
                if better and allowed(neighbours[place, best]):
                    positions[place] = neighbours[place, best]
                    current.row[place], current.visibility[place] = own.row[best], own.visibility[best]
                    del neighbourhoods[place]
    return positions


def _neighbours(position: FloatArray, center: FloatArray, step_deg: float) -> FloatArray:
    """DIRECTIONS positions (8, 3) at `step_deg` from one, along slant, along azimuth and between."""
    offset = position - center
    radius = np.linalg.norm(offset)
    slant, azimuth = geometry.slant_azimuth(offset / radius)
    turns = np.arange(REFINE_DIRECTIONS) * 2 * np.pi / REFINE_DIRECTIONS
    step = np.radians(step_deg)
    slants = np.abs(slant + step * np.cos(turns))
    azimuths = azimuth + step * np.sin(turns) / max(np.sin(slant), np.sin(step))
    return center + radius * geometry.direction(slants, azimuths)
