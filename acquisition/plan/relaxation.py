"""Lower bound of any design by convex relaxation with multiplicative updates: the certificate of a plan.

Each candidate gets a design weight in [0, 1]. The mean σ is convex in the weights, so its tangent at any weights bounds
it from below. The tangent is least for the m lights with the smallest slopes, and this minimum bounds every exact
design, whether the weights are optimal or not (the gap of the equivalence theorem). The relaxation's own gap says how
far the weights are from optimal. Decision 0028.

Multiplicative updates: S. D. Silvey, D. M. Titterington and B. Torsney, J. Statist. Plann. Inference 2 (1978).
"""

import numpy as np

from acquisition.models.base import FloatArray
from acquisition.plan.criterion import Candidates

MAX_GAP = 0.001
"""Relative gap of the relaxation at which the iteration stops."""

MAX_ROUNDS = 400
"""Maximum number of multiplicative updates."""

MIN_RELATIVE_WEIGHT = 1e-4
"""Weights below this fraction of the largest are set to zero. The bound remains valid; the gap shows if they matter."""


def bound(options: Candidates, count: int) -> tuple[float, float]:
    """Multiplicative updates (Silvey, Titterington and Torsney 1978) until the gap closes.

    Returns the best lower bound of the mean σ (rad) of any `count` of the candidates (K ≥ count ≥ 1), and the
    relaxation's own gap: the excess of the mean σ at the best weights over the bound, as a fraction of that σ.
    """
    weights, lower, best = np.full(len(options.row), count / len(options.row)), -np.inf, np.inf
    for _ in range(MAX_ROUNDS):
        used = np.flatnonzero(weights)
        relaxed = options.posterior(used, weights[used])
        value, gradient = relaxed.loss, options.scan(relaxed, slope=True)
        lower = max(lower, value - float(gradient @ weights) + float(np.sum(np.partition(gradient, count - 1)[:count])))
        best = min(best, value)
        if best - lower <= MAX_GAP * best:
            break
        weights = _scaled_to_sum(-weights * gradient, count)
    return max(lower, 0.0), float((best - lower) / best)


def _scaled_to_sum(weights: FloatArray, count: int) -> FloatArray:
    """Scales weights so that they sum to `count` after clipping at 1."""
    weights = np.where(weights < MIN_RELATIVE_WEIGHT * np.max(weights), 0.0, weights)
    weights = weights * (count / np.sum(weights))
    for _ in range(50):
        full = weights >= 1.0
        weights = np.where(full, 1.0, weights)
        rest = count - float(np.count_nonzero(full))
        free = float(np.sum(weights[~full]))
        if free <= 0 or abs(free - rest) < 1e-12:
            break
        weights = np.where(full, 1.0, weights * (rest / free))
    return np.minimum(weights, 1.0)
