"""A lower bound that no choice of lights can beat: the certificate of a plan.

Let every candidate be taken to a share between none and all of it. The mean angular variance is convex in the shares,
so its tangent at any shares bounds it from below, and the least value of the tangent over all choices of m lights is
the sum of its m smallest slopes: a bound for every real choice, whether the shares are the best ones or not. How far
they are from the best is the relaxation's own gap.

The bound is of the plain variance, the convex one; plans made for other objectives are certified by their variance.
Because lights are whole, even the best choice stays above it: by 30 % in variance for four lights, by 5 % for sixteen.

Multiplicative updates: S. D. Silvey, D. M. Titterington and B. Torsney, J. Statist. Plann. Inference 2 (1978).
"""

from dataclasses import dataclass

import numpy as np

from acquisition.models.base import FloatArray
from acquisition.plan import criterion, criterion_kernels
from acquisition.plan.criterion import LEVELS, Candidates, Samples
from acquisition.plan.deadline import Deadline

LARGEST_GAP = 0.001
MOST_ROUNDS = 400
BOLDEST = 4.0
SMALLEST = 1e-4
"""Shares below this part of the largest are dropped. The bound stays one; the gap shows it if they were needed."""


@dataclass(frozen=True)
class Bound:
    """A lower bound on the mean variance (rad²) of any `count` of the candidates, the shares (K,) that gave it, and the
    relaxation's own gap: how far its value at the best shares found lies above the bound, as a fraction."""

    variance: float
    shares: FloatArray
    gap: float

    @property
    def sigma_deg(self) -> float:
        """The bound's root, degrees."""
        return float(np.degrees(np.sqrt(self.variance)))


def bound(sample: Samples, options: Candidates, count: int, until: Deadline) -> Bound:
    """The best lower bound found until its gap closes or time is up; `count` of the candidates (K ≥ count ≥ 1)."""
    shares = np.full(len(options.row), count / len(options.row))
    value, slope = _value(sample, options, shares)
    least, best, best_shares = -np.inf, value, shares
    boldness = 2.0
    for _ in range(MOST_ROUNDS):
        least = max(least, value - float(slope @ shares) + float(np.sum(np.partition(slope, count - 1)[:count])))
        if best - least <= LARGEST_GAP * best or until.passed:
            break
        trial = _of_sum(shares * (slope / np.mean(slope)) ** boldness, count)
        trial_value, trial_slope = _value(sample, options, trial)
        if trial_value > value * (1 + 1e-9) and boldness > 0.05:
            boldness *= 0.5
            continue
        boldness = min(boldness * 1.15, BOLDEST)
        shares, value, slope = trial, trial_value, trial_slope
        if value < best:
            best, best_shares = value, shares
    return Bound(max(least, 0.0), best_shares, float((best - least) / best))


def _value(sample: Samples, options: Candidates, shares: FloatArray) -> tuple[float, FloatArray]:
    """Mean variance with each candidate taken to its share, and its slope (K,) in each share."""
    used = np.flatnonzero(shares)
    there = criterion.expect(sample, options.only(used), shares[used])
    slope = np.empty(len(shares))
    criterion_kernels.gradient(
        there.covariance,
        options.row,
        options.visibility,
        sample.normal,
        sample.inverse_albedo2,
        np.array(LEVELS, np.float32),
        slope,
    )
    return float(np.mean(there.variance)), slope


def _of_sum(shares: FloatArray, count: int) -> FloatArray:
    """Shares scaled so that, cut at 1, they add up to `count`."""
    shares = np.where(shares < SMALLEST * np.max(shares), 0.0, shares)
    for _ in range(50):
        full = shares >= 1.0
        shares = np.where(full, 1.0, shares)
        rest = count - float(np.count_nonzero(full))
        free = float(np.sum(shares[~full]))
        if free <= 0 or abs(free - rest) < 1e-12:
            break
        shares = np.where(full, 1.0, shares * (rest / free))
    return np.minimum(shares, 1.0)
