"""From candidates to a set of lights: greedy from several starts, exchange, then off the grid.

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

FEW_PIXELS = 300
RANDOM_LIGHTS = 80
"""Random starts have this many lights together, so that few lights, which have more local minima, get more starts. One
start of eight finds the best set, and two passes of exchange are enough to see it."""

QUICK_RANDOM_LIGHTS = 40
"""As many in a quick search: on one cushion seen by sixteen domes of candidates, the σ of four lights is within 1.1 %
of what the whole search finds, of eight within 2.6 %. With 24, sets are found whose σ is 4 % larger at a loss that is
hardly larger."""

SHORTLIST = 4
PAIRS = 12
STEPS_DEG = (4.0, 2.0, 1.0, 0.5)
ROUNDS = 3
"""Times that all lights are tried at one step, while any of them moves."""

DIRECTIONS = 8
"""Places round a light that it may move to."""

WORTH_MOVING = 1e-4


def search(
    sample: Samples, options: Candidates, loss: Loss, patterns: Sequence[list[int]], count: int, seed: int,
    until: Deadline, *, quick: bool = False,
) -> list[int]:  # fmt: skip
    """Numbers of the best set of `count` options found: short searches on few pixels from all starts, then exchange on
    all pixels, from whichever set is best there, the patterns included; `quick` for what is forecast, not driven to."""
    step = max(1, len(sample.albedo) // FEW_PIXELS)
    few, few_options = sample.thinned(step), options.thinned(step)
    rng = np.random.default_rng(seed)
    starts = [greedy(few, few_options, loss, count, until)]
    starts += [min(patterns, key=lambda chosen: value(few, few_options, loss, chosen))] if patterns else []
    random_starts = QUICK_RANDOM_LIGHTS // count if quick else max(2, RANDOM_LIGHTS // count)
    for _ in range(random_starts if count > 1 else 0):  # a single light has been scanned already
        starts.append([int(index) for index in rng.permutation(len(options.row))[:count]])
    found = [exchange(few, few_options, loss, start, until, passes=2) for start in starts]
    if not quick:
        found.sort(key=lambda chosen: value(few, few_options, loss, chosen))
        found = [exchange(few, few_options, loss, chosen, until, passes=4) for chosen in found[:SHORTLIST]]
        found.sort(key=lambda chosen: value(few, few_options, loss, chosen))
        found.append(pair_exchange(few, few_options, loss, found[0], rng, until))
    best = min([*found, *patterns], key=lambda chosen: value(sample, options, loss, chosen))
    return exchange(sample, options, loss, best, until, passes=2 if quick else 5)


def value(sample: Samples, options: Candidates, loss: Loss, chosen: list[int]) -> float:
    """The mean loss with these options."""
    return loss.of(criterion.expect(sample, options.only(chosen)))


def greedy(sample: Samples, options: Candidates, loss: Loss, count: int, until: Deadline) -> list[int]:
    """One option after the other, each the best beside those before it; after the deadline the first ones left."""
    chosen: list[int] = []
    for _ in range(count):
        if until.passed:
            return chosen + [index for index in range(len(options.row)) if index not in chosen][: count - len(chosen)]
        losses = loss.scan(sample, criterion.expect(sample, options.only(chosen)), options)
        losses[chosen] = np.inf
        chosen.append(int(np.argmin(losses)))
    return chosen


def exchange(
    sample: Samples, options: Candidates, loss: Loss, start: list[int], until: Deadline, passes: int
) -> list[int]:
    """Exchanges one light at a time for the best candidate until nothing improves."""
    chosen = list(start)
    settled = 0
    for turn in range(passes * len(chosen)):
        place = turn % len(chosen)
        others = chosen[:place] + chosen[place + 1 :]
        losses = loss.scan(sample, criterion.expect(sample, options.only(others)), options)
        losses[others] = np.inf
        best = int(np.argmin(losses))
        # What stays is compared by the same scan: its sums are in single precision.
        better = losses[best] < losses[chosen[place]] * (1 - WORTH_MOVING)
        settled = 0 if better else settled + 1
        if better:
            chosen[place] = best
        if settled >= len(chosen) or until.passed:
            break
    return chosen


def pair_exchange(
    sample: Samples, options: Candidates, loss: Loss, start: list[int], rng: np.random.Generator, until: Deadline
) -> list[int]:
    """Takes two lights out at a time and refills and exchanges from there: the way out of most local minima."""
    chosen, best = list(start), value(sample, options, loss, start)
    pairs = list(combinations(range(len(chosen)), 2))
    for number in rng.permutation(len(pairs))[:PAIRS]:
        if until.passed:
            break
        trial = [index for place, index in enumerate(chosen) if place not in pairs[number]]
        removed = [chosen[place] for place in pairs[number]]
        while len(trial) < len(chosen):
            losses = loss.scan(sample, criterion.expect(sample, options.only(trial)), options)
            losses[trial] = np.inf
            if len(trial) == len(chosen) - 2:
                losses[removed] = np.inf
            trial.append(int(np.argmin(losses)))
        trial = exchange(sample, options, loss, trial, until, passes=2)
        found = value(sample, options, loss, trial)
        if found < best * (1 - WORTH_MOVING):
            best, chosen = found, trial
    return chosen


def refine(
    sample: Samples,
    positions: FloatArray,
    center: FloatArray,
    loss: Loss,
    make: Callable[[FloatArray], Candidates],
    allowed: Callable[[FloatArray], bool],
    until: Deadline,
) -> FloatArray:
    """Positions (M, 3) moved on their spheres round `center` while the loss falls and `allowed` says yes.

    `make` gives the candidates of positions (K, 3). A pattern search, because visibility makes the loss jump.
    """
    positions = positions.copy()
    current = make(positions)
    start = loss.of(criterion.expect(sample, current))
    for step_deg in STEPS_DEG:
        near: dict[int, Candidates] = {}  # what is round each light that has not moved since
        for _ in range(ROUNDS):
            around = np.stack([_around(position, center, step_deg) for position in positions])
            fresh = [place for place in range(len(positions)) if place not in near]
            if not fresh:
                break
            made = make(around[fresh].reshape(-1, 3))
            for number, place in enumerate(fresh):
                near[place] = made.only(np.arange(number * DIRECTIONS, (number + 1) * DIRECTIONS))
            for place in range(len(positions)):
                if until.passed:
                    return positions
                others = [index for index in range(len(positions)) if index != place]
                own = near[place]
                losses = loss.scan(
                    sample, criterion.expect(sample, current.only(others)), own.joined(current.only([place]))
                )
                best = int(np.argmin(losses[:DIRECTIONS]))
                better = losses[best] < losses[DIRECTIONS] - WORTH_MOVING * start
                if better and allowed(around[place, best]):
                    positions[place] = around[place, best]
                    current.row[place], current.visibility[place] = own.row[best], own.visibility[best]
                    del near[place]
    return positions


def _around(position: FloatArray, center: FloatArray, step_deg: float) -> FloatArray:
    """DIRECTIONS positions (8, 3) at `step_deg` from one, along slant, along azimuth and between."""
    offset = position - center
    radius = np.linalg.norm(offset)
    slant, azimuth = geometry.slant_azimuth(offset / radius)
    turns = np.arange(DIRECTIONS) * 2 * np.pi / DIRECTIONS
    step = np.radians(step_deg)
    slants = np.abs(slant + step * np.cos(turns))
    azimuths = azimuth + step * np.sin(turns) / max(np.sin(slant), np.sin(step))
    return center + radius * geometry.direction(slants, azimuths)
