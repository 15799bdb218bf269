"""Two rings for a session that has images already: what planning starts from, is compared with and falls back on.

The images taken are part of the pattern: of as many lights as there will be in all, each light taken fills the place
that it is nearest to, and the places that remain are what to add. The pattern is tried at several turns.
"""

import numpy as np
from scipy.optimize import linear_sum_assignment

from acquisition import dome
from acquisition.plan.baselines import two_rings
from acquisition.types import FloatArray

TURNS = 12


def completions(taken: FloatArray, units: FloatArray, count: int) -> list[list[int]]:
    """Sets of `count` distinct numbers of `units` (K, 3) that complete lights `taken` (T, 3) to two rings, one set for
    each turn of the pattern."""
    free = np.ones(len(units), dtype=np.bool_)
    total = len(taken) + count
    step = 1.0 / TURNS
    sets: list[list[int]] = []
    for turn in np.arange(TURNS) * step:
        ideal = two_rings(total, float(turn))
        if len(taken):
            angle = np.arccos(np.clip(taken @ ideal.T, -1.0, 1.0))
            _, filled = linear_sum_assignment(angle**2)
            ideal = np.delete(ideal, filled, axis=0)
        sets.append(dome.nearest_distinct(ideal, units, free)[0])
    return sets
