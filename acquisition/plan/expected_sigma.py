"""σ expected of a result after planned lights: the variance components of a result, estimated from the images so far.

    σ = √(1 / (1/w + 1/V²)) + S,   w = (1 + B m (κ − 1)) (v + 2 L²) + E²

- v is the posterior's variance, of both tangential directions; m is the number of lights that will reach the pixel.
- κ − 1 is the value of χ² (ε + ε̄) (`photometry.SETTINGS.misfit_factor`) that would raise σ of all pixels that face the
  camera as much as their own do in the mean. It replaces each pixel's own value, because few images have few residuals.
  Causes of misfit are shared by images, so that this part does not fall with their number. Of a pilot √κ counts,
  because further images can put right what fits its few images badly: under 8 lights κ is 1–140 where that of the pilot
  is 1–1,700 (decision 103).
- L is 1 σ, per axis, of the lamp directions by errors of the calibration that all lamps share.
- E is 1 σ of normals that nothing checks: those of fewer than four lights, or of a capture in which something is wrong
  (`photometry.capture_sigma_deg`).
- S is the part of σ by creases, detail and lines in the images so far, mean over the pixels, over √(f / (f + 1)) with
  the degrees of freedom f = images − 3, at least 1. A pixel's own χ², which is its weight, has a prior of one degree of
  freedom (`error_variance`): where the model is wrong, χ² of a pilot is half of what many images will show (decision
  109). Few pixels have nearly all of S, and hardly any other error, so that it adds to the mean σ of the others
  (decision 103).
- V is 1 σ of a normal of which nothing is known (`photometry.bounded_variance`), as in a result.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from acquisition import photometry
from acquisition.models.base import FloatArray
from acquisition.models.result import MEDIAN_ERROR_PER_SIGMA, NormalMap
from acquisition.plan.criterion import Candidates, Posterior


@dataclass(frozen=True)
class ExpectedSigma:
    """Terms of the expected σ that do not depend on the planned lights: κ (`misfit`), E of the capture and S in degrees
    from the images so far, and L in rad from the calibration."""

    misfit: float = 1.0
    capture_deg: float = 0.0
    structure_deg: float = 0.0
    calibration_rad: float = 0.0

    @classmethod
    def of(cls, normal_map: NormalMap, calibration_rad: float = 0.0) -> "ExpectedSigma":
        """Takes misfit and findings of the images so far. If no misfit is stated, it is 1, that of a model that holds.

        Of fewer than `photometry.REDUNDANT` images the misfit counts by its root, and uncorrected findings do not
        count: most other models are not tried with so few images, and further images can correct what was found.
        """
        redundant = len(normal_map.flags) >= photometry.REDUNDANT
        findings = [finding for finding in normal_map.findings if redundant or finding.corrected]
        freedom = max(len(normal_map.flags) - photometry.PIXEL_UNKNOWNS, 1)
        misfit = max(normal_map.noise.get("misfit", 1.0), 1.0)
        return cls(
            misfit=misfit if redundant else float(np.sqrt(misfit)),
            structure_deg=normal_map.noise.get("structure_deg", 0.0) * float(np.sqrt((freedom + 1) / freedom)),
            capture_deg=photometry.capture_sigma_deg(findings),
            calibration_rad=calibration_rad,
        )

    def sigma_deg(self, posterior: Posterior) -> FloatArray:
        """Returns the expected σ (P,), degrees, of pixels with this posterior."""
        settings = photometry.SETTINGS
        factor = 1 + settings.misfit_factor * posterior.light_count * (self.misfit - 1)
        few = np.where(posterior.light_count <= photometry.PIXEL_UNKNOWNS, settings.unchecked_sigma_deg**2, 0.0)
        # Both tangential directions of a normal, as in the posterior's variance.
        shared = 2 * self.calibration_rad**2
        variance = factor * np.degrees(1) ** 2 * (posterior.variance + shared) + few + self.capture_deg**2
        return np.asarray(np.sqrt(photometry.bounded_variance(variance)) + self.structure_deg)


@dataclass(frozen=True)
class Prediction:
    """Expected σ of sample pixels after a set of lights, and without each one of these (leave-one-out)."""

    lights: Candidates
    expected: ExpectedSigma

    @cached_property
    def sigma_deg(self) -> FloatArray:
        """Expected σ (P,) in degrees."""
        return self.expected.sigma_deg(self.lights.posterior())

    @cached_property
    def without_deg(self) -> FloatArray:
        """Expected σ (L, P) in degrees without each one of the lights."""
        numbers = np.arange(len(self.lights.row))
        without = [self.expected.sigma_deg(self.lights.posterior(np.delete(numbers, one))) for one in numbers]
        return np.reshape(without, (len(numbers), len(self.sigma_deg)))

    @property
    def mean_deg(self) -> float:
        """Mean of the expected σ, degrees."""
        return float(np.mean(self.sigma_deg))

    @property
    def median_error_deg(self) -> float:
        """Expected median error, degrees."""
        return float(MEDIAN_ERROR_PER_SIGMA * np.median(self.sigma_deg))

    @property
    def gains(self) -> list[float]:
        """For each light, the fraction by which the mean σ rises without it."""
        return (np.mean(self.without_deg, axis=1) / self.mean_deg - 1).tolist()
