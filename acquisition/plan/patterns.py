"""Two rings for a session that has images already: what planning starts from, is compared with and falls back on.

The images taken are part of the pattern: each fills the place of a ring that it is nearest to, and what remains is to
be added. Among the ways to do so the best balanced is taken, because balance is what the pattern is good for: depth
that is wrong and steep surface that pixels do not resolve pull normals towards or away from every light, and only
lights that stand evenly round the object let these pulls cancel.
"""

from itertools import product

import numpy as np
from scipy.optimize import linear_sum_assignment

from acquisition import dome, geometry
from acquisition.plan.baselines import INNER_SLANT_DEG, OUTER_SLANT_DEG
from acquisition.types import FloatArray

TURNS = 12
TOP_SLANT_DEG, BETWEEN_SLANT_DEG = 15.0, 40.0
"""Lights taken below the first stand on top of the object, up to the second on the inner ring, beyond on the outer."""


def completions(taken: FloatArray, units: FloatArray, count: int) -> list[list[int]]:
    """Sets of `count` distinct numbers of `units` (K, 3) that complete unit lights `taken` (T, 3) to two rings.

    One set for each likely number of lights inside, the best balanced one first.
    """
    slant = np.degrees(geometry.slant_azimuth(taken)[0])
    inside = taken[(slant > TOP_SLANT_DEG) & (slant <= BETWEEN_SLANT_DEG)]
    outside = taken[slant > BETWEEN_SLANT_DEG]
    total = len(taken) + count
    wanted = round(total / 3) - np.count_nonzero(slant <= BETWEEN_SLANT_DEG)
    free = np.ones(len(units), dtype=np.bool_)
    found: list[tuple[float, list[int]]] = []
    for inner in sorted({int(np.clip(wanted + more, 0, count)) for more in (-1, 0, 1)}):
        rings = [
            [_places(ring, number, slant_deg, turn) for turn in np.arange(TURNS) / TURNS]
            for ring, number, slant_deg in (
                (inside, inner, INNER_SLANT_DEG),
                (outside, count - inner, OUTER_SLANT_DEG),
            )
        ]
        sets = [np.concatenate(pair) for pair in product(*rings)]
        balance = [imbalance(np.concatenate([taken, added])) for added in sets]
        best = int(np.argmin(np.round(balance, 6)))
        found.append((balance[best], dome.nearest_distinct(sets[best], units, free)[0]))
    return [chosen for _, chosen in sorted(found)]


def imbalance(units: FloatArray) -> float:
    """How unevenly unit lights (N, 3) stand round the view axis: 0 evenly, 1 all on one side at the horizon.

    The first two circular moments, weighted by the sine of the slant and its square.
    """
    x, y = units[:, 0], units[:, 1]
    return float(np.hypot(np.hypot(x.mean(), y.mean()), np.hypot((x * x - y * y).mean(), (2 * x * y).mean())))


def _places(ring: FloatArray, count: int, slant_deg: float, turn: float) -> FloatArray:
    """The `count` places (count, 3) of an even ring that lights `ring` (R, 3) leave; `turn` in steps of the ring."""
    whole = len(ring) + count
    ideal = geometry.direction(np.radians(slant_deg), (turn + np.arange(whole)) * 2 * np.pi / max(whole, 1))
    if not len(ring):
        return ideal
    angle = np.arccos(np.clip(ring @ ideal.T, -1.0, 1.0))
    _, filled = linear_sum_assignment(angle**2)
    return np.delete(ideal, filled, axis=0)
