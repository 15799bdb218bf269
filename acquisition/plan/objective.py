"""Design criteria (A-optimality and variants): one loss from the angular variances of all pixels and scenarios.

`capped`, the default, is the mean of v / (1 + v/cap²): the plain mean variance is dominated by a few pixels that no
light can reach. `mean` is the mean σ. `quantile` is a smooth count of pixels near the 0.9 quantile of σ of the two-ring
pattern: pixels well below it count nothing, those well above it all count the same, so it is a sum over pixels that
lowers the upper quantiles. `coverage` first counts by how many lights pixels fall short of the three that a solve
needs, and uses `capped` between equals.

Many sets of lights are within a few per cent of the best by any of these. Even ones among them suffer least from wrong
depth, which biases normals towards or away from the lights; what makes plans even is the wide prior of the depth offset
(`photometry.SETTINGS.integrated_depth_sigma_m`), not a term of the loss. Decision 0026.
"""

from dataclasses import dataclass, replace

import numpy as np

from acquisition.models.base import Float32Array, FloatArray
from acquisition.models.recipe import Objective
from acquisition.models.tuned import tuned
from acquisition.plan import criterion_kernels
from acquisition.plan.criterion import VISIBILITY_LEVELS, Candidates, Posterior, Samples


@dataclass(frozen=True)
class ObjectiveSettings:
    """Tuned numbers of the objectives."""

    cap_deg: float = tuned(3.0, "deg")
    """Cap of `capped` in degrees of σ, above which the loss saturates. Errors of eight images are 2 % lower than at 5°
    and 3 % lower than at 10° on simulated scenes, 8 % lower than at 10° on path-traced ones; at 2° more pixels stay
    over 10°."""
    cap_factor: float = tuned(4.0, "1")
    """Lower bound of the cap in units of the mean σ of two rings: where all pixels are uncertain, as between
    interreflecting walls, a cap of 3° would disregard half of them."""
    quantile: float = tuned(0.9, "quantile")
    """Quantile of σ over the pixels that the objective `quantile` lowers."""
    lower_factor: float = tuned(0.6, "1")
    """σ at which `quantile` begins to count a pixel, in units of that quantile with two rings."""
    upper_factor: float = tuned(2.0, "1")
    """σ at which it stops rising, in the same units."""
    coverage_weight: float = tuned(10.0, "1")
    """Loss of `coverage` when all pixels fall short by one light: a thousand times the range of the capped variance."""


SETTINGS = ObjectiveSettings()


@dataclass(frozen=True)
class Loss:
    """Loss of a pixel with angular variance v (rad²), capped to c = v / (1 + v · inverse_cap).

    variance_weight · c + sigma_weight · max(√c − threshold, 0) + coverage_weight · lights short of three.
    """

    variance_weight: float
    sigma_weight: float
    threshold: float
    inverse_cap: float
    coverage_weight: float

    def evaluate(self, expectation: Posterior) -> float:
        """The mean loss over pixels and scenarios."""
        capped = expectation.variance / (1 + expectation.variance * self.inverse_cap)
        loss = self.variance_weight * capped + self.sigma_weight * np.maximum(np.sqrt(capped) - self.threshold, 0)
        lacked = np.maximum(3 - expectation.lit, 0) if self.coverage_weight > 0 else np.zeros(1)
        return float(np.mean(loss) + self.coverage_weight * np.mean(lacked))

    def scan(self, sample: Samples, present: Posterior, lights: Candidates) -> FloatArray:
        """Mean loss (K,) with each one of `lights` added to the present posterior (Sherman–Morrison)."""
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
        return out + self.coverage_weight * deficit

    @property
    def _scalars(self) -> Float32Array:
        return np.array([self.variance_weight, self.sigma_weight, self.threshold, self.inverse_cap], np.float32)


CAPPED = Loss(1.0, 0.0, 0.0, 1.0 / np.radians(SETTINGS.cap_deg) ** 2, 0.0)
"""Mean capped variance at a cap of `cap_deg`."""
VARIANCE = Loss(1.0, 0.0, 0.0, 0.0, 0.0)
"""A-optimality, the plain mean variance: convex in the design weights, so a lower bound exists (`relaxation`)."""


def loss(objective: Objective, reference: Posterior) -> Loss:
    """The loss of an objective; `reference` is the two-ring posterior, which sets the cap and the threshold."""
    if objective == "mean":
        return Loss(0.0, 1.0, 0.0, 0.0, 0.0)
    if objective == "quantile":
        level = float(np.sqrt(np.quantile(reference.variance, SETTINGS.quantile)))
        inverse_cap = 1.0 / (SETTINGS.upper_factor * level) ** 2
        lower_variance = (SETTINGS.lower_factor * level) ** 2
        threshold = float(np.sqrt(lower_variance / (1 + lower_variance * inverse_cap)))
        return Loss(0.0, 1.0, threshold, inverse_cap, 0.0)
    cap = max(np.radians(SETTINGS.cap_deg), SETTINGS.cap_factor * float(np.mean(np.sqrt(reference.variance))))
    return replace(
        CAPPED,
        inverse_cap=1.0 / cap**2,
        coverage_weight=SETTINGS.coverage_weight if objective == "coverage" else 0.0,
    )
