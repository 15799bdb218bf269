"""Detection of indirect light, and estimation of ambient and stray light, from shadowed measurements.

In shadow a measurement consists of light from other surfaces, ambient light and an offset only: y = indirect + a ψ ρ +
o, where ψ is the sky view factor of the pixel. In lit pixels these are confused with errors of the normals.

Measured by the plain model's solutions (design seeds 201–211, eight families, eight lights by two rings; scratch
evaluation, November 2026): on 43 sound captures with such measurements, a alone is at most 0.005 except on two rough
vessels (0.010, 0.024), and o alone at most 0.001 (0.003, 0.005). With ambient light of 3 % a is 0.027–0.030 on 14
captures (0.045 on one of the vessels), with an offset of 3 % o is 0.028–0.030 on 13 (0.032). On all 29 the term that is
present gains more than the other.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from acquisition import photometry
from acquisition.image_values import Noise
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.tuned import tuned
from acquisition.normals.pixels.pixel_solve import Estimate, Pixels


@dataclass(frozen=True)
class ShadowLightSettings:
    """Tuned number of the light in shadows."""

    detection_quantile: float = tuned(0.75, "quantile")
    """Quantile of measured / predicted light in shadows, weighted by the prediction, that is compared with
    `grazing_cosine`. It is the upper quartile, because a shape that is still wrong also predicts light where none
    falls."""


SETTINGS = ShadowLightSettings()

LEAST_SKY_VIEW = 0.5
"""Sky view factor above which a shadowed pixel is used for ambient and stray light. Inside cavities indirect light
outweighs both, and surfaces that the camera does not see send some of it."""

ROBUST_ROUNDS = 10
"""Number of reweighted least-squares fits of a and o."""


@dataclass(frozen=True)
class ShadowEquations:
    """Normal equations `matrix` (2, 2) · (a, o) = `right` (2,) of ambient irradiance a and offset o by shadowed
    measurements. `indirect` is the ambient irradiance that equals the indirect light predicted there."""

    matrix: FloatArray
    right: FloatArray
    indirect: float = 0.0

    @property
    def has_measurements(self) -> bool:
        """Whether any measurement contributes."""
        return bool(np.any(self.matrix))

    @classmethod
    def none(cls) -> "ShadowEquations":
        """Returns the equations of no measurement."""
        return cls(np.zeros((2, 2)), np.zeros(2))


def shadows_show_indirect(pixels: Pixels, values: Float32Array, predicted: Float32Array, estimate: Estimate) -> bool:
    """Whether shadows in measured `values` (F, N) show the predicted indirect light (F, N).

    They do if the `detection_quantile` of measured over predicted light is at least `grazing_cosine`; with direct light
    alone, shadows are black. They decide only whether there is indirect light, because they understate its amount while
    the shape is still wrong.
    """
    return _shadow_ratio(pixels, values, predicted, estimate) >= photometry.SETTINGS.grazing_cosine


def equations(
    pixels: Pixels, sky: Float32Array, values: Float32Array, indirect: Float32Array, estimate: Estimate, noise: Noise
) -> ShadowEquations:
    """Regresses shadowed values (F, N), less predicted `indirect` light (F, N), robustly on ψ ρ and 1.

    `sky` (N,) are the pixels' sky view factors ψ.
    """
    used = umbra(pixels, values, estimate) & (sky > LEAST_SKY_VIEW)
    if np.count_nonzero(used) < photometry.SETTINGS.min_sample:
        return ShadowEquations.none()
    columns = np.broadcast_to(estimate.albedo * sky, values.shape)[used].astype(np.float64)
    rows = np.stack([columns, np.ones_like(columns)])
    left = (values - indirect)[used].astype(np.float64)
    variance = noise.variance(np.maximum(values, 0), np.zeros_like(values)) + pixels.plus_extra(
        np.square(np.float32(photometry.SETTINGS.predicted_light_sigma) * indirect)
    )
    variance = variance[used].astype(np.float64)
    weighted = rows / variance
    for _ in range(ROBUST_ROUNDS):
        found = np.linalg.lstsq(weighted @ rows.T, weighted @ left, rcond=None)[0]
        weighted = rows / (variance + (left - found @ rows) ** 2 / photometry.CAUCHY_SCALE**2)
    equal = float(np.sum(indirect[used], dtype=np.float64) / max(np.sum(columns), 1e-9))
    return ShadowEquations(weighted @ rows.T, weighted @ left, equal)


def umbra(pixels: Pixels, values: Float32Array, estimate: Estimate) -> BoolArray:
    """Marks measurements (F, N) in attached and cast shadows whose neighbours are all in shadow, too."""
    direct = estimate.lambertian()
    dark = ((direct < 0) | (values < photometry.SETTINGS.grazing_cosine * direct)) & ~pixels.clipped
    kernel = np.ones((3, 3), np.uint8)
    return np.stack([pixels.take(cv2.erode(pixels.image(mask.astype(np.uint8)), kernel)) > 0 for mask in dark])


def _shadow_ratio(pixels: Pixels, values: Float32Array, predicted: Float32Array, estimate: Estimate) -> float:
    """Returns the weighted `detection_quantile` of measured / predicted light in shadows; 1 if these are too few."""
    used = umbra(pixels, values, estimate) & (predicted > 0)
    if np.count_nonzero(used) < photometry.SETTINGS.min_sample:
        return 1.0
    ratio, weight = values[used] / predicted[used], predicted[used]
    order = np.argsort(ratio)
    summed = np.cumsum(weight[order])
    return float(ratio[order][np.searchsorted(summed, summed[-1] * SETTINGS.detection_quantile)])
