"""Exchange algorithm for exact designs (after Fedorov 1972) from several starts.

Two-ring patterns are among the starts, so that a plan is never predicted to be worse than they are.
"""

from collections.abc import Sequence

import numpy as np

from acquisition.plan.criterion import Candidates

RANDOM_START_LIGHTS = 40
"""Total number of lights of all random starts. Designs of few lights have more local minima and thus get more starts.
One start in eight leads to the best set."""

MAX_PASSES = 5
"""Maximum number of passes of exchange over all lights. Most designs settle after three."""

MIN_IMPROVEMENT = 1e-4
"""Smallest relative decrease of the loss that counts as an improvement."""


def search(options: Candidates, patterns: Sequence[list[int]], count: int, seed: int) -> list[int]:
    """Multistart exchange algorithm, from the best of the patterns and from random starts. Returns the numbers of the
    best set of `count` options."""

    def loss(chosen: list[int]) -> float:
        return options.posterior(chosen).loss

    if count >= len(options.row):  # nothing to choose
        return list(range(len(options.row)))
    rng = np.random.default_rng(seed)
    drawn = RANDOM_START_LIGHTS // count if count > 1 else 0  # one light is exchanged for the best of all
    starts = [min(patterns, key=loss), *(rng.permutation(len(options.row))[:count].tolist() for _ in range(drawn))]
    return min((exchange(options, start) for start in starts), key=loss)


def exchange(options: Candidates, start: list[int]) -> list[int]:
    """Coordinate exchange: replaces one light at a time by the best candidate, until nothing improves the loss."""
    chosen = list(start)
    unchanged = 0
    for turn in range(MAX_PASSES * len(chosen)):
        slot = turn % len(chosen)
        others = chosen[:slot] + chosen[slot + 1 :]
        losses = options.scan(options.posterior(others))
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
