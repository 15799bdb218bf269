"""Two-ring completion of captured lights: a start of the planner's search, and its reference.

Each captured light fills the nearest position of a ring (linear assignment), and the open positions are added. Of the
possible completions the most balanced is chosen: wrong depth and steep surfaces that pixels do not resolve bias normals
towards or away from every light, and these biases cancel only if the lights surround the object evenly. The
score is the circular moments' norm (azimuthal imbalance) plus the misfit of captured lights to their positions.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from acquisition import geometry, lamp_pose
from acquisition.models.base import FloatArray
from acquisition.models.tuned import tuned
from acquisition.plan import baselines
from acquisition.plan.baselines import INNER_SLANT_DEG, OUTER_SLANT_DEG


@dataclass(frozen=True)
class TwoRingSettings:
    """Tuned numbers of the completion of two rings."""

    misfit_weight: float = tuned(0.5, "1/rad")
    """Weight of the rms misfit of captured lights to their ring positions, per rad, relative to imbalance."""


SETTINGS = TwoRingSettings()

TOP_MAX_SLANT_DEG, INNER_MAX_SLANT_DEG = INNER_SLANT_DEG / 2, (INNER_SLANT_DEG + OUTER_SLANT_DEG) / 2
"""Upper slants of captured lights that count as the top one and as the inner ring: half way to the next ring."""


def completions(captured: FloatArray, units: FloatArray, count: int) -> list[list[int]]:
    """Completes unit lights `captured` (T, 3) to two rings: sets of `count` distinct numbers of `units` (K, 3).

    One set for each likely number of lights on the inner ring, the lowest score (imbalance and misfit) first.
    """
    slant = np.degrees(geometry.slant_azimuth(captured)[0])
    captured_inner = captured[(slant > TOP_MAX_SLANT_DEG) & (slant <= INNER_MAX_SLANT_DEG)]
    captured_outer = captured[slant > INNER_MAX_SLANT_DEG]
    total = len(captured) + count
    inner_missing = round(total / 3) - np.count_nonzero(slant <= INNER_MAX_SLANT_DEG)
    free = np.ones(len(units), dtype=np.bool_)
    scored: list[tuple[float, list[int]]] = []
    for inner in sorted({int(np.clip(inner_missing + more, 0, count)) for more in (-1, 0, 1)}):
        rings = [
            [
                _open_positions(ring, number, slant_deg, turn)
                for turn in np.arange(baselines.AZIMUTH_STEPS) / baselines.AZIMUTH_STEPS
            ]
            for ring, number, slant_deg in (
                (captured_inner, inner, INNER_SLANT_DEG),
                (captured_outer, count - inner, OUTER_SLANT_DEG),
            )
        ]
        moments = [np.array([np.sum(_circular_moments(places), axis=0) for places, _ in ring]) for ring in rings]
        misfits = [np.array([misfit for _, misfit in ring]) for ring in rings]
        moment_sums = np.sum(_circular_moments(captured), axis=0) + moments[0][:, None] + moments[1]
        score = np.linalg.norm(moment_sums, axis=-1) / total + SETTINGS.misfit_weight * (
            misfits[0][:, None] + misfits[1]
        )
        first, second = np.unravel_index(int(np.argmin(np.round(score, 6))), score.shape)
        best = np.concatenate([rings[0][int(first)][0], rings[1][int(second)][0]])
        scored.append((float(score[first, second]), lamp_pose.nearest_distinct(best, units, free)[0]))
    return [chosen for _, chosen in sorted(scored)]


def _circular_moments(units: FloatArray) -> FloatArray:
    """First two circular moments (N, 4) of unit lights round the view axis, weighted by the sine of the slant and its
    square; their sum is zero where lights are even."""
    x, y = units[:, 0], units[:, 1]
    return np.column_stack([x, y, x * x - y * y, 2 * x * y])


def _open_positions(ring: FloatArray, count: int, slant_deg: float, turn: float) -> tuple[FloatArray, float]:
    """Linear assignment of lights `ring` (R, 3) to the positions of an even ring: the `count` open positions (count, 3)
    and the rms misfit of the assigned ones in rad of azimuth; `turn` in steps of the ring."""
    ring_size = len(ring) + count
    azimuth = (turn + np.arange(ring_size)) * 2 * np.pi / max(ring_size, 1)
    ideal = geometry.direction(np.radians(slant_deg), azimuth)
    if not len(ring):
        return ideal, 0.0
    misses = geometry.slant_azimuth(ring)[1][:, None] - azimuth
    misses = np.abs((misses + np.pi) % (2 * np.pi) - np.pi)
    rows, filled = linear_sum_assignment(misses**2)
    return np.delete(ideal, filled, axis=0), float(np.sqrt(np.mean(misses[rows, filled] ** 2)))
