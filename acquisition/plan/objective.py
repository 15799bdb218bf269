"""Design criteria (A-optimality and variants): one loss from the angular variances of all pixels and scenarios.

`capped`, the default, is the mean of v / (1 + v/cap²): plain mean variance is decided by a few pixels that no light can
reach. `mean` is the mean σ. `quantile` looks at the pixels near the σ that nine tenths keep below with the two-ring
pattern: what lies well below counts nothing, and what lies well above counts alike, so that it nearly counts pixels,
adds up over them, and lowers the upper quantiles. `coverage` first counts the lights that pixels lack of three, which a
solve needs, and lets `capped` decide between equals.

Many sets of lights are within a few per cent of the best by any of these. Among them the even ones are the better
choice: errors that no variance contains (mixed pixels, wrong depth, interreflection) bias normals towards or away from
the lights, and these biases cancel where lights stand evenly round the object. So each loss rises
with the lights' imbalance.
"""

from dataclasses import dataclass, replace

import numpy as np

from acquisition.models.base import Float32Array, FloatArray
from acquisition.models.recipe import Objective
from acquisition.plan import criterion_kernels, two_ring_pattern
from acquisition.plan.criterion import VISIBILITY_LEVELS, Candidates, Posterior, Samples

CAP_DEG = 3.0
"""What is less certain counts hardly more. Errors of eight images are less by 2 % than at 5° and by 3 % than at 10° on
simulated scenes, by 8 % than at 10° on path-traced ones; at 2° more pixels are left over 10°."""

CAP_FACTOR = 4.0
"""The cap is at least so many times the mean σ of two rings: where all pixels are less certain, between walls that
light one another, a cap of 3° gives up half of them."""

QUANTILE = 0.9
LOWER_FACTOR, UPPER_FACTOR = 0.6, 2.0
COVERAGE_WEIGHT = 10.0
"""Loss of one light lacked by all pixels: a thousand times what the capped variance can differ by."""

IMBALANCE_WEIGHT = 4.0
"""Share by which the loss rises with the square of the lights' imbalance: 4 % at 0.1, the usual one of a plan at 0.2
costs 16 %. Between 2 and 5 the errors found are the same."""


@dataclass(frozen=True)
class Loss:
    """Loss of a pixel: (of_variance · c + of_sigma · max(√c − threshold, 0)) (1 + uneven · imbalance²) + lacking ·
    lights lacked of three, where c = v / (1 + v · inverse_cap); v in rad²."""

    variance_weight: float
    sigma_weight: float
    threshold: float
    inverse_cap: float
    coverage_weight: float
    imbalance_weight: float = 0.0

    def evaluate(self, expectation: Posterior) -> float:
        """The mean loss over pixels and scenarios."""
        capped = expectation.variance / (1 + expectation.variance * self.inverse_cap)
        loss = self.variance_weight * capped + self.sigma_weight * np.maximum(np.sqrt(capped) - self.threshold, 0)
        lacked = np.maximum(3 - expectation.lit, 0) if self.coverage_weight > 0 else np.zeros(1)
        uneven = self.imbalance_weight * two_ring_pattern.imbalance(expectation.units) ** 2
        return float(np.mean(loss) * (1 + uneven) + self.coverage_weight * np.mean(lacked))

    def scan(self, sample: Samples, present: Posterior, lights: Candidates) -> FloatArray:
        """The mean loss (K,) with each one of `lights` added to what is present."""
        out, deficit = np.empty(len(lights.row)), np.empty(len(lights.row))
        criterion_kernels.scan(
            present.covariance,
            present.variance.astype(np.float32),
            present.lit,
            lights.row,
            lights.visibility,
            sample.normal,
            sample.inverse_albedo2,
            np.array(VISIBILITY_LEVELS, np.float32),
            self._scalars,
            out,
            deficit,
        )
        out *= 1 + self.imbalance_weight * two_ring_pattern.imbalance_with_each(present.units, lights.unit) ** 2
        return out + self.coverage_weight * deficit

    @property
    def _scalars(self) -> Float32Array:
        return np.array([self.variance_weight, self.sigma_weight, self.threshold, self.inverse_cap], np.float32)


CAPPED = Loss(1.0, 0.0, 0.0, 1.0 / np.radians(CAP_DEG) ** 2, 0.0)
VARIANCE = Loss(1.0, 0.0, 0.0, 0.0, 0.0)
"""Plain mean variance: the convex one, which a lower bound can be had for."""


def loss(objective: Objective, reference: Posterior) -> Loss:
    """The loss of an objective; `reference` is what two rings would give, for the cap and the threshold."""
    if objective == "mean":
        return Loss(0.0, 1.0, 0.0, 0.0, 0.0, IMBALANCE_WEIGHT)
    if objective == "quantile":
        level = float(np.sqrt(np.quantile(reference.variance, QUANTILE)))
        inverse_cap = 1.0 / (UPPER_FACTOR * level) ** 2
        lower_variance = (LOWER_FACTOR * level) ** 2
        threshold = float(np.sqrt(lower_variance / (1 + lower_variance * inverse_cap)))
        return Loss(0.0, 1.0, threshold, inverse_cap, 0.0, IMBALANCE_WEIGHT)
    cap = max(np.radians(CAP_DEG), CAP_FACTOR * float(np.mean(np.sqrt(reference.variance))))
    return replace(
        CAPPED,
        inverse_cap=1.0 / cap**2,
        coverage_weight=COVERAGE_WEIGHT if objective == "coverage" else 0.0,
        imbalance_weight=IMBALANCE_WEIGHT,
    )
