"""Exchange algorithm for exact designs (after Fedorov 1972): greedy, pattern and random starts, exchange.

Greedy selection alone is 10–30 % worse in the objective for few lights; exchanging one light at a time closes that gap,
and several starts most of the rest. Two-ring patterns are starts too, so that a plan is never predicted to be worse.
"""

from collections.abc import Sequence

import numpy as np

from acquisition.plan import criterion
from acquisition.plan.criterion import Candidates, Samples
from acquisition.plan.objective import Loss

COARSE_PIXELS = 300
"""Approximate number of sample pixels of the coarse search from all starts."""

RANDOM_START_LIGHTS = 40
"""Total number of lights of all random starts, so that designs of few lights, with more local minima, get more starts.
One start in eight leads to the best set."""

MAX_PASSES = 5
"""Most passes of exchange over all lights; most designs settle after three."""

MIN_IMPROVEMENT = 1e-4
"""Smallest relative decrease of the loss that counts as an improvement."""


def search(
    sample: Samples, options: Candidates, loss: Loss, patterns: Sequence[list[int]], count: int, seed: int
) -> list[int]:
    """Multistart exchange algorithm: numbers of the best set of `count` options.

    Exchange on few pixels from greedy, pattern and random starts, then on all pixels from the best of these sets and
    the patterns.
    """
    if count >= len(options.row):  # nothing to choose
        return list(range(len(options.row)))
    step = max(1, len(sample.albedo) // COARSE_PIXELS)
    coarse, coarse_options = sample.thinned(step), options.thinned(step)
    rng = np.random.default_rng(seed)
    starts = [greedy(coarse, coarse_options, loss, count), *patterns[:1]]
    for _ in range(RANDOM_START_LIGHTS // count if count > 1 else 0):  # for one the greedy scan is exhaustive
        starts.append([int(index) for index in rng.permutation(len(options.row))[:count]])
    solutions = [exchange(coarse, coarse_options, loss, start) for start in starts]
    best = min([*solutions, *patterns], key=lambda chosen: value(sample, options, loss, chosen))
    return exchange(sample, options, loss, best)


def value(sample: Samples, options: Candidates, loss: Loss, chosen: list[int]) -> float:
    """Mean loss of the design with these candidates."""
    return loss.evaluate(criterion.posterior(sample, options.only(chosen)))


def greedy(sample: Samples, options: Candidates, loss: Loss, count: int) -> list[int]:
    """Greedy forward selection, one candidate at a time."""
    chosen: list[int] = []
    for _ in range(count):
        losses = loss.scan(sample, criterion.posterior(sample, options.only(chosen)), options)
        losses[chosen] = np.inf
        chosen.append(int(np.argmin(losses)))
    return chosen


def exchange(sample: Samples, options: Candidates, loss: Loss, start: list[int]) -> list[int]:
    """Coordinate exchange: replaces one light at a time by the best candidate, until no improvement."""
    chosen = list(start)
    unchanged = 0
    for turn in range(MAX_PASSES * len(chosen)):
        slot = turn % len(chosen)
        others = chosen[:slot] + chosen[slot + 1 :]
        losses = loss.scan(sample, criterion.posterior(sample, options.only(others)), options)
        losses[others] = np.inf
        best = int(np.argmin(losses))
        # The present light is evaluated by the same scan, because its sums are in single precision.
        better = losses[best] < losses[chosen[slot]] * (1 - MIN_IMPROVEMENT)
        unchanged = 0 if better else unchanged + 1
        if better:
            chosen[slot] = best
        if unchanged >= len(chosen):
            break
    return chosen
