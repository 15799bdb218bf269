"""Bayesian linear design: posterior angular variance of each pixel's normal under a set of lights, and their loss.

The parameters of a sample pixel are (g, ζ): albedo × normal, and a scaled depth offset. Their prior is the Fisher
information of the images so far. A light adds a design row: its light vector at the pixel, whitened by the noise of its
image (`planned_images`), or zero where the pixel will not see the light.

Visibility is uncertain, and an error of a pixel's normal hides all lights of one side together. So a third of the
pixels each count as turned away from all lights by 1 σ, as they are, and turned towards them by 1 σ. Multiplying
information by the probability of being seen would be optimistic (decision 0068).

The loss is the mean σ over the pixels, as in forecasts. A few pixels that no light can reach would decide the mean
variance. Many sets of lights are within a few per cent of the best; those evenly round the object suffer least from
wrong depth. The wide prior of the depth offset (`photometry.SETTINGS.integrated_depth_sigma_m`) makes plans even, not a
term of the loss (decision 0068).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numba
import numpy as np
import numpy.typing as npt

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array, FloatArray

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
    information: FloatArray  # (4, 4, P) of (g, ζ), weak prior included
    light_count: Float32Array  # (P,) images so far in which the pixel is lit
    indirect: Float32Array  # (P,) indirect part of y, mean of the images so far
    margin: FloatArray  # (P,) least excess of cosine of incidence and slope of clearance over a shadow's threshold
    offset_sigma_m: float = field(default_factory=lambda: photometry.SETTINGS.depth_sigma_m)  # depth offset of ζ = 1
    regression_share: float = 1.0  # share of the variance of independent noise that regression on neighbours leaves


@dataclass(frozen=True)
class Posterior:
    """Posterior covariance of all sample pixels, given a set of lights."""

    covariance: FloatArray  # (4, 4, P) of (g, ζ)
    variance: FloatArray  # (P,) rad², of the normal
    light_count: FloatArray  # (P,) lights visible from the pixel, captured ones included

    @property
    def loss(self) -> float:
        """Mean σ over the pixels, rad."""
        return float(np.mean(np.sqrt(self.variance)))


@dataclass(frozen=True)
class Candidates:
    """Lights that may be added, as whitened design rows at each sample pixel."""

    sample: Samples
    row: Float32Array  # (K, 4, P) whitened, zero where the pixel does not see the light

    @cached_property
    def visible(self) -> BoolArray:
        """Which pixels see which light (K, P)."""
        return np.any(self.row != 0, axis=1)

    def posterior(
        self, chosen: Sequence[int] | npt.NDArray[np.intp] | None = None, weight: FloatArray | None = None
    ) -> Posterior:
        """Bayesian update by the `chosen` lights (M,), each counted `weight` (M,) times; None: all lights, once."""
        numbers = slice(None) if chosen is None else np.asarray(chosen, np.intp)
        row, visible, sample = self.row[numbers], self.visible[numbers], self.sample
        weight = np.ones(len(row)) if weight is None else weight
        weighted = weight[:, None, None].astype(np.float32) * row
        information = sample.information + np.einsum("kap,kbp->abp", weighted, row, dtype=np.float64)
        covariance = np.moveaxis(np.linalg.inv(np.moveaxis(information, 2, 0)), 0, 2)
        of_g, normal = covariance[:3, :3], sample.normal
        across = np.trace(of_g) - np.einsum("ap,abp,bp->p", normal, of_g, normal)
        return Posterior(
            covariance, np.maximum(across, 1e-12) / sample.albedo**2, sample.light_count + weight @ visible
        )

    def scan(self, present: Posterior, *, slope: bool = False) -> FloatArray:
        """Returns the loss (K,) with each one of the lights added to the present posterior, by a rank-one update
        (Sherman–Morrison). With `slope`, returns the gradient of the loss in each light's design weight instead."""
        covariance, variance = np.ascontiguousarray(present.covariance, np.float32), present.variance.astype(np.float32)
        inverse_albedo2, out = (1 / self.sample.albedo**2).astype(np.float32), np.empty(len(self.row))
        _scan(covariance, variance, self.row, self.sample.normal, inverse_albedo2, slope, out)
        return out


def prior_information(albedo: Float32Array) -> FloatArray:
    """Information (4, 4, P) of the weak prior: 1 σ is `prior_scale` ρ for each component of g, 1 for the offset ζ."""
    prior = np.zeros((4, 4, len(albedo)))
    prior[(0, 1, 2), (0, 1, 2)] = 1.0 / (photometry.SETTINGS.prior_scale * albedo) ** 2
    prior[3, 3] = 1.0
    return prior


@numba.njit(
    "void(float32[:,:,::1], float32[::1], float32[:,:,::1], float32[:,::1], float32[::1], boolean, float64[::1])",
    cache=True,
    parallel=True,
    fastmath=True,
    error_model="numpy",
)
def _scan(
    c: Float32Array,  # (4, 4, P) covariance
    variance: Float32Array,  # (P,) rad²
    row: Float32Array,  # (K, 4, P)
    normal: Float32Array,  # (3, P)
    inverse_albedo2: Float32Array,  # (P,)
    slope: bool,
    out: FloatArray,  # (K,)
) -> None:
    """Computes the mean σ with each candidate added in turn; with `slope`, its gradient −mean |P C a|²/(2 ρ² σ)."""
    pixels = len(variance)
    zero, half, one = np.float32(0.0), np.float32(0.5), np.float32(1.0)
    for k in numba.prange(row.shape[0]):
        total = zero
        for p in range(pixels):
            a0, a1, a2, a3 = row[k, 0, p], row[k, 1, p], row[k, 2, p], row[k, 3, p]
            u0 = c[0, 0, p] * a0 + c[0, 1, p] * a1 + c[0, 2, p] * a2 + c[0, 3, p] * a3
            u1 = c[0, 1, p] * a0 + c[1, 1, p] * a1 + c[1, 2, p] * a2 + c[1, 3, p] * a3
            u2 = c[0, 2, p] * a0 + c[1, 2, p] * a1 + c[2, 2, p] * a2 + c[2, 3, p] * a3
            u3 = c[0, 3, p] * a0 + c[1, 3, p] * a1 + c[2, 3, p] * a2 + c[3, 3, p] * a3
            along = normal[0, p] * u0 + normal[1, p] * u1 + normal[2, p] * u2
            gain = (u0 * u0 + u1 * u1 + u2 * u2 - along * along) * inverse_albedo2[p]
            if slope:
                total -= half * gain / np.sqrt(variance[p])
            else:
                total += np.sqrt(max(variance[p] - gain / (one + a0 * u0 + a1 * u1 + a2 * u2 + a3 * u3), zero))
        out[k] = total / pixels


KERNELS = (_scan,)
