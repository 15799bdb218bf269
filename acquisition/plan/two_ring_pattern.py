"""Two-ring completion of captured lights: a start of the planner's search, and its reference.

Two rings of all lights, captured and new, are turned to the captured ones; each of these fills a position (linear
assignment of least squared angle), and the open positions are added.
"""

import numpy as np
from scipy.optimize import linear_sum_assignment

from acquisition import lamp_pose
from acquisition.models.base import FloatArray
from acquisition.plan import baselines


def completions(captured: FloatArray, units: FloatArray, count: int) -> list[list[int]]:
    """Completes unit lights `captured` (T, 3) to two rings: sets of `count` distinct numbers of `units` (K, 3).

    One set for each turn of the rings, that to which the captured lights fit best first.
    """
    scored: list[tuple[float, list[int]]] = []
    for turn in np.arange(baselines.AZIMUTH_STEPS) / baselines.AZIMUTH_STEPS:
        ideal = baselines.two_rings(len(captured) + count, float(turn))
        squared = np.arccos(np.clip(captured @ ideal.T, -1, 1)) ** 2
        rows, filled = linear_sum_assignment(squared)
        chosen, _ = lamp_pose.nearest_distinct(np.delete(ideal, filled, axis=0), units)
        scored.append((float(np.sum(squared[rows, filled])), chosen))
    return [chosen for _, chosen in sorted(scored)]
