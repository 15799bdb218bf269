"""What shadows tell of light that no lamp sends: whether there is indirect light, how much ambient and stray light.

Where no lamp's light falls, a measurement is light from other surfaces, ambient light and an offset, and nothing else:
y = indirect + a ψ ρ + o, with ψ the share of the sky that the pixel sees. A residual of lit pixels tells these from
wrong normals only in part; shadows tell them alone. By the plain model's solution of 43 sound captures that have such
measurements a alone is 0.005 at most but of two rough vessels (0.010, 0.024), and o 0.001 (0.003, 0.005); with ambient
light of 3 % a is 0.027–0.030 of 14 captures (of one of these vessels 0.045), with an offset of 3 % o is 0.028–0.030 of
13 (0.032), and what is there gains more of all 29 (design seeds 201–211, eight families, eight lights by two rings;
scratch evaluation, November 2026).
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
    """Tuned numbers of the light in shadows."""

    detection_quantile: float = tuned(0.75, "quantile")
    """Quantile of measured / predicted in shadows, weighted by the prediction, that is compared. An upper quartile,
    because a shape that is still wrong predicts light where none falls as well."""


SETTINGS = ShadowLightSettings()

LEAST_SKY_VIEW = 0.5
"""Share of the sky from which a shadowed pixel tells of ambient and stray light: inside of cavities indirect light
outweighs both, and surfaces that the camera does not see send some of it."""

ROBUST_ROUNDS = 10
"""Reweighted least squares of a and o."""


@dataclass(frozen=True)
class ShadowEquations:
    """Normal equations of ambient irradiance a and offset o by shadowed measurements: `matrix` (2, 2) · (a, o) =
    `right` (2,); and `indirect`, what is predicted of indirect light there, as the ambient irradiance it equals."""

    matrix: FloatArray
    right: FloatArray
    indirect: float = 0.0

    @property
    def told(self) -> bool:
        """Whether there are any."""
        return bool(np.any(self.matrix))

    @classmethod
    def none(cls) -> "ShadowEquations":
        """Those of no measurement."""
        return cls(np.zeros((2, 2)), np.zeros(2))


def shadows_show_indirect(pixels: Pixels, values: Float32Array, predicted: Float32Array, estimate: Estimate) -> bool:
    """Whether shadows in measured `values` (F, N) show the predicted indirect light (F, N).

    They do where they hold `grazing_cosine` of it: where there is only direct light, they are black. Shadows,
    weighted by the prediction, decide only whether there is indirect light: they understate its amount while the shape
    is still wrong.
    """
    return _shadow_ratio(pixels, values, predicted, estimate) >= photometry.SETTINGS.grazing_cosine


def equations(
    pixels: Pixels, sky: Float32Array, values: Float32Array, indirect: Float32Array, estimate: Estimate, noise: Noise
) -> ShadowEquations:
    """Robust regression of shadowed values (F, N), without what is predicted of `indirect` light (F, N), on ψ ρ and 1.

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
    """Measurements (F, N) in attached and cast shadows, all of whose neighbours are in shadow, too."""
    direct = estimate.lambertian()
    dark = ((direct < 0) | (values < photometry.SETTINGS.grazing_cosine * direct)) & ~pixels.clipped
    kernel = np.ones((3, 3), np.uint8)
    return np.stack([pixels.take(cv2.erode(pixels.image(mask.astype(np.uint8)), kernel)) > 0 for mask in dark])


def _shadow_ratio(pixels: Pixels, values: Float32Array, predicted: Float32Array, estimate: Estimate) -> float:
    """Weighted `detection_quantile` of measured / predicted in shadows; 1 where there are too few."""
    used = umbra(pixels, values, estimate) & (predicted > 0)
    if np.count_nonzero(used) < photometry.SETTINGS.min_sample:
        return 1.0
    ratio, weight = values[used] / predicted[used], predicted[used]
    order = np.argsort(ratio)
    summed = np.cumsum(weight[order])
    return float(ratio[order][np.searchsorted(summed, summed[-1] * SETTINGS.detection_quantile)])
