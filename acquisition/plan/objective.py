"""Design criterion (A-optimality with a cap): one loss from the angular variances of all pixels and scenarios.

The loss is the mean of v / (1 + v/cap²): the plain mean variance is dominated by a few pixels that no light can reach.

Many sets of lights are within a few per cent of the best. Even ones among them suffer least from wrong depth, which
biases normals towards or away from the lights; what makes plans even is the wide prior of the depth offset
(`photometry.SETTINGS.integrated_depth_sigma_m`), not a term of the loss. Decision 0026.
"""

from dataclasses import dataclass

import numpy as np

from acquisition.models.base import FloatArray
from acquisition.models.tuned import tuned
from acquisition.plan import criterion
from acquisition.plan.criterion import Candidates, Posterior, Samples


@dataclass(frozen=True)
class ObjectiveSettings:
    """Tuned numbers of the objective."""

    cap_deg: float = tuned(3.0, "deg")
    """Cap in degrees of σ, above which the loss saturates. Errors of eight images are 2 % lower than at 5°
    and 3 % lower than at 10° on simulated scenes, 8 % lower than at 10° on path-traced ones; at 2° more pixels stay
    over 10°."""
    cap_factor: float = tuned(4.0, "1")
    """Lower bound of the cap in units of the mean σ of two rings: where all pixels are uncertain, as between
    interreflecting walls, a cap of 3° would disregard half of them. Without it the mean error of eight images is 3 %
    larger and the median 3 % smaller (sixteen design scenes)."""


SETTINGS = ObjectiveSettings()


@dataclass(frozen=True)
class Loss:
    """Loss v / (1 + v · inverse_cap) of a pixel with angular variance v, rad²; `inverse_cap` 1/cap², 1/rad²."""

    inverse_cap: float

    def evaluate(self, expectation: Posterior) -> float:
        """The mean loss over pixels and scenarios."""
        return float(np.mean(expectation.variance / (1 + expectation.variance * self.inverse_cap)))

    def scan(self, sample: Samples, present: Posterior, lights: Candidates) -> FloatArray:
        """Mean loss (K,) with each one of `lights` added to the present posterior (Sherman–Morrison)."""
        return criterion.scan(sample, present, lights, self.inverse_cap)


def capped(reference: Posterior) -> Loss:
    """The loss of plans, with the cap that the two-ring posterior `reference` asks for."""
    mean_sigma = float(np.mean(np.sqrt(reference.variance)))
    return Loss(1.0 / max(np.radians(SETTINGS.cap_deg), SETTINGS.cap_factor * mean_sigma) ** 2)
