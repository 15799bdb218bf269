"""Which part of a calibration new images contradict: score tests of groups of parameters (Rao), named one at a time.

A calibration states parameters with a covariance; new images say more of them. Both follow from the information matrix
and the gradient of the new images at the stated values: without a change the gradient has covariance N + N C N. A group
of parameters that has changed (the camera's place, the lamp's intensity) is one more unknown without a prior; how far
it lowers the sum of squares is χ² with as many degrees of freedom as it has parameters. The group that explains most,
each parameter's worth by Akaike's criterion, is named and set free, and the others are tested again, until nothing is
left to explain. The probabilities are corrected for the number of groups (Bonferroni), so that a sound calibration is
taken for a changed one as rarely as `FALSE_ALARM` says.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from acquisition.models.base import FloatArray

FALSE_ALARM = 0.005
"""Probability with which a check contradicts a calibration that is true: daily for half a year, about one in a lab."""

LEAST_INFORMATION = 1e-9
"""Eigenvalue of a group's information, scaled to a unit diagonal, below which a direction is not seen at all."""


@dataclass(frozen=True)
class Group:
    """Parameters that change together, by their numbers."""

    name: str
    parameters: tuple[int, ...]


@dataclass(frozen=True)
class GroupTest:
    """A group's most likely change since the calibration, its covariance, and how improbable chance makes it."""

    group: Group
    change: FloatArray
    covariance: FloatArray
    chi_square: float
    freedom: int

    @property
    def probability(self) -> float:
        """With which a sound calibration shows as much, of this group alone."""
        return float(chdtrc(self.freedom, self.chi_square)) if self.freedom else 1.0


@dataclass(frozen=True)
class ChangeTest:
    """The tests of all groups against the calibration as stated, those that have changed in the order of what they
    explain, each with its change when the ones before it are free, and the least probability, corrected."""

    tests: tuple[GroupTest, ...]
    changed: tuple[GroupTest, ...]
    probability: float


def find_changes(
    information: FloatArray, gradient: FloatArray, covariance: FloatArray, groups: Sequence[Group]
) -> ChangeTest:
    """Tests groups of parameters by the `information` (P, P) and `gradient` (P,) of new images at the stated values,
    whose covariance (P, P) is stated."""
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
    """The covariance with a group about which nothing is known: a thousand times what the images tell of it."""
    freed = covariance.copy()
    for number in group.parameters:
        freed[number, number] += 1e6 / max(float(information[number, number]), 1e-300)
    return freed
