"""Score tests (Rao) of groups of parameters: find the part of a calibration that new images contradict.

A calibration states parameters with a covariance C. New images add information N about them and a gradient at the
stated values: without a change the gradient has covariance N + N C N. A group of parameters that has changed (the
camera's place, the lamp's intensity) is one more unknown without a prior. It reduces the sum of squares by a χ² with as
many degrees of freedom as the group has parameters. The group with the largest reduction, after Akaike's penalty for
each parameter, is named and set free; the others are tested again, until no significant change is left. The
probabilities are corrected for the number of groups (Bonferroni), so that a sound calibration counts as changed with
probability `FALSE_ALARM`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from acquisition.models.base import FloatArray

FALSE_ALARM = 0.005
"""Probability that a check contradicts a true calibration: with daily checks about one false alarm in half a year."""

LEAST_INFORMATION = 1e-9
"""Eigenvalue of a group's information, scaled to a unit diagonal, below which a direction counts as not observed."""


@dataclass(frozen=True)
class Group:
    """Parameters that change together, given by their numbers."""

    name: str
    parameters: tuple[int, ...]


@dataclass(frozen=True)
class GroupTest:
    """Most likely change of a group since the calibration, with its covariance and χ²."""

    group: Group
    change: FloatArray
    covariance: FloatArray
    chi_square: float
    freedom: int

    @property
    def probability(self) -> float:
        """Probability that a sound calibration shows at least this change, for this group alone."""
        return float(chdtrc(self.freedom, self.chi_square)) if self.freedom else 1.0


@dataclass(frozen=True)
class ChangeTest:
    """The tests of all groups against the stated calibration; those that have changed, the most explanatory first, each
    with its change while the ones before it are free; the least probability, corrected."""

    tests: tuple[GroupTest, ...]
    changed: tuple[GroupTest, ...]
    probability: float


def find_changes(
    information: FloatArray, gradient: FloatArray, covariance: FloatArray, groups: Sequence[Group]
) -> ChangeTest:
    """Tests groups of parameters by `information` (P, P) and `gradient` (P,) of new images at the stated values, whose
    covariance (P, P) is stated."""
    tests = _tests(information, gradient, covariance, groups)
    least = min(1.0, len(groups) * min(test.probability for test in tests))
    changed: list[GroupTest] = []
    left, now = list(groups), tests
    freed = covariance
    while left and len(left) * min(test.probability for test in now) < FALSE_ALARM:
        worst = max(now, key=lambda test: test.chi_square - 2 * test.freedom)
        changed.append(worst)
        left.remove(worst.group)
        freed = _freed(freed, information, worst.group)
        now = _tests(information, gradient, freed, left)
    return ChangeTest(tests, tuple(changed), least)


def _tests(
    information: FloatArray, gradient: FloatArray, covariance: FloatArray, groups: Sequence[Group]
) -> tuple[GroupTest, ...]:
    mixed = np.eye(len(gradient)) + information @ covariance
    score = np.asarray(np.linalg.solve(mixed, gradient), np.float64)
    seen = np.asarray(np.linalg.solve(mixed, information), np.float64)
    return tuple(_test(score, (seen + seen.T) / 2, group) for group in groups)


def _test(score: FloatArray, seen: FloatArray, group: Group) -> GroupTest:
    numbers = list(group.parameters)
    own = seen[np.ix_(numbers, numbers)]
    scale = np.sqrt(np.maximum(np.diag(own), 1e-300))
    values, vectors = np.linalg.eigh(own / np.outer(scale, scale))
    good = values > LEAST_INFORMATION
    inverse = np.asarray((vectors[:, good] / values[good]) @ vectors[:, good].T / np.outer(scale, scale), np.float64)
    change = inverse @ score[numbers]
    return GroupTest(group, change, inverse, float(score[numbers] @ change), int(np.count_nonzero(good)))


def _freed(covariance: FloatArray, information: FloatArray, group: Group) -> FloatArray:
    """Returns the covariance with a group set free: its 1 σ becomes a thousand times that by the images."""
    freed = covariance.copy()
    for number in group.parameters:
        freed[number, number] += 1e6 / max(float(information[number, number]), 1e-300)
    return freed
