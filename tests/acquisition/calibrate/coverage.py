"""Whether errors are as large as the covariances say that were stated with them: neither larger nor smaller."""

from collections.abc import Sequence

import numpy as np
from scipy.stats import chi2

from acquisition.models.base import FloatArray

LEAST, MOST = 0.85, 0.99
"""Shares of errors within their 95 % ellipsoids: of 50 seeds 43 to 49."""

MEAN_OFF = 4.0
"""Standard deviations by which the mean square error may differ from what is stated: a covariance that is too wide
shows in it sooner than in the share, of which 50 in 50 are 8 % likely by chance."""


def squared(error: FloatArray, covariance: FloatArray) -> float:
    """Square of an error (K,) in standard deviations of its covariance (K, K), over K: 1 on average."""
    return float(error @ np.linalg.solve(covariance, error)) / len(error)


def require_covered(name: str, squares: Sequence[float], unknowns: int, most: float = MOST) -> None:
    """Prints and asserts how many errors of `unknowns` values, by `squared`, lie in their ellipsoids.

    Of several values that are asserted each, one has all 50 by chance in a third of the cases: for these `most` is 1,
    and the mean square tells a covariance that is too wide.
    """
    values = np.array(squares)
    share, mean = float(np.mean(unknowns * values < chi2.ppf(0.95, unknowns))), float(values.mean())
    scatter = float(np.sqrt(2 / (unknowns * len(values))))
    print(f"{name}: {share:.0%} of {len(values)} in their 95 % ellipsoids, mean square {mean:.2f} of what is stated")
    assert LEAST <= share <= most, name
    assert abs(mean - 1) < MEAN_OFF * scatter, name
