"""Bayesian linear design: posterior angular variance of each pixel's normal under a set of lights, and their loss.

The parameters of a sample pixel are (g, ζ), albedo × normal and a scaled depth offset, with the Fisher information of
the images so far as prior. A light adds a design row: its light vector at the pixel, whitened by the noise of its image
(`planned_images`). Whether the pixel will see the light is a probability. Three scenarios carry it into the criterion:
each regards every light of probability above its level as visible, because an error of one pixel's normal hides all
lights of one side together. Multiplying information by probability instead would be optimistic (decision 0027).

The loss is the mean σ over pixels and scenarios, which is what a plan forecasts; the mean variance would be decided by
a few pixels that no light can reach. Many sets of lights are within a few per cent of the best. Even ones among them
suffer least from wrong depth; what makes plans even is the wide prior of the depth offset
(`photometry.SETTINGS.integrated_depth_sigma_m`), not a term of the loss (decision 0026).
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from acquisition import photometry
from acquisition.models.base import Float32Array, FloatArray
from acquisition.plan import criterion_kernels

VISIBILITY_LEVELS = (1 / 6, 1 / 2, 5 / 6)
"""Visibility probabilities above which a light counts as visible, one for each scenario; decision 0027."""

COARSE_PIXELS = 300
"""Approximate number of pixels of the search from all starts, and of the lower bound."""

MIN_LIGHTS = 3
"""Lights needed to determine a pixel's normal and albedo."""


@dataclass(frozen=True)
class Samples:
    """Sample pixels with their estimates and Fisher information from the images so far."""

    row: np.ndarray  # (P,)
    column: np.ndarray  # (P,)
    point: Float32Array  # (3, P) m, view frame
    ray_direction: Float32Array  # (3, P) ∂x/∂Z
    normal: Float32Array  # (3, P)
    albedo: Float32Array  # (P,)
    sigma: Float32Array  # (P,) rad
    information: FloatArray  # (4, 4, P) of (g, ζ), weak prior included
    lit: Float32Array  # (P,) images so far in which the pixel is lit
    indirect: Float32Array  # (P,) indirect part of y, mean of the images so far
    offset_sigma_m: float = photometry.SETTINGS.offset_sigma_m  # ζ = 1 is a depth offset of so much

    @cached_property
    def upper(self) -> FloatArray:
        """The upper entries (10, P) of the information."""
        return self.information[np.triu_indices(4)]

    @cached_property
    def inverse_albedo2(self) -> Float32Array:
        """1/ρ² (P,)."""
        return (1.0 / self.albedo**2).astype(np.float32)

    def thinned(self, step: int) -> "Samples":
        """Every `step`-th pixel."""
        values = {one.name: getattr(self, one.name) for one in fields(self)}
        return replace(self, **{name: _every(step, v) for name, v in values.items() if isinstance(v, np.ndarray)})


@dataclass(frozen=True)
class Posterior:
    """Posterior covariance of all sample pixels in all visibility scenarios, given a set of lights."""

    covariance: Float32Array  # (S, 10, P) upper entries of that of (g, ζ)
    variance: FloatArray  # (S, P) rad²
    lit: Float32Array  # (S, P) lights visible from the pixel, captured ones included

    @property
    def loss(self) -> float:
        """Mean σ over pixels and scenarios, rad."""
        return float(np.mean(np.sqrt(self.variance)))


@dataclass(frozen=True)
class Candidates:
    """Lights that may be added, as whitened design rows and visibilities at each sample pixel."""

    sample: Samples
    row: Float32Array  # (K, 4, P) whitened
    visibility: Float32Array  # (K, P) probability

    @property
    def coarse(self) -> "Candidates":
        """The same lights at about `COARSE_PIXELS` of the pixels."""
        step = max(1, len(self.sample.albedo) // COARSE_PIXELS)
        return Candidates(self.sample.thinned(step), _every(step, self.row), _every(step, self.visibility))

    def posterior(
        self, chosen: Sequence[int] | npt.NDArray[np.intp] | None = None, weight: FloatArray | None = None
    ) -> Posterior:
        """Bayesian update by the `chosen` lights (M,), None: all of them, each `weight` (M,) times, None: once."""
        numbers = slice(None) if chosen is None else np.asarray(chosen, np.intp)
        row, visibility = self.row[numbers], self.visibility[numbers]
        shape = (len(VISIBILITY_LEVELS), len(self.sample.albedo))
        covariance = np.empty((shape[0], 10, shape[1]), np.float32)
        variance, lit = np.empty(shape), np.empty(shape, np.float32)
        criterion_kernels.posterior(
            self.sample.upper,
            row,
            visibility,
            np.ones(len(row)) if weight is None else weight,
            np.array(VISIBILITY_LEVELS, np.float32),
            self.sample.normal,
            self.sample.inverse_albedo2,
            covariance,
            variance,
            lit,
        )
        return Posterior(covariance, variance, lit + self.sample.lit)

    def without_each(self) -> list[Posterior]:
        """Leave-one-out: the posterior by all lights but one, for each of them."""
        return [self.posterior(np.delete(np.arange(len(self.row)), one)) for one in range(len(self.row))]

    def scan(self, present: Posterior) -> FloatArray:
        """The loss (K,) with each one of the lights added to the present posterior (Sherman–Morrison)."""
        return self._scan(present, slope=False)

    def gradient(self, present: Posterior) -> FloatArray:
        """Gradient (K,) of the loss in each light's design weight, at the present posterior."""
        return self._scan(present, slope=True)

    def _scan(self, present: Posterior, *, slope: bool) -> FloatArray:
        out = np.empty(len(self.row))
        criterion_kernels.scan(
            present.covariance,
            present.variance.astype(np.float32),
            self.row,
            self.visibility,
            self.sample.normal,
            self.sample.inverse_albedo2,
            np.array(VISIBILITY_LEVELS, np.float32),
            slope,
            out,
        )
        return out


def prior_information(albedo: Float32Array) -> FloatArray:
    """Information (4, 4, P) of the weak prior: ±`prior_scale` ρ of each component of g, ±1 of the scaled offset ζ."""
    prior = np.zeros((4, 4, len(albedo)))
    prior[(0, 1, 2), (0, 1, 2)] = 1.0 / (photometry.SETTINGS.prior_scale * albedo) ** 2
    prior[3, 3] = 1.0
    return prior


def _every(step: int, values: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(values[..., ::step])
