"""Noise model of planned images: heteroscedastic variance of y, as expected of the final solve.

It differs from the calibration's: the final solve self-calibrates each image's intensity, so that only a part of that
error remains; depth is a nuisance parameter of its own, so that the error of the light's direction is that of the
lamp's position, and changes y only at oblique incidence; independent pixel noise is halved by the projection of the
normals to an integrable field. Indirect radiance, estimated from the images so far, is subtracted by a prediction whose
error is proportional to it, so dark measurements beside it carry less information. So do lights that would cause
highlights at many pixels, where the solver has fitted a lobe. The information of the images so far is reweighted by
this model.
"""

from dataclasses import dataclass

import numpy as np

from acquisition import photometry
from acquisition.models.base import Float32Array, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.result import NormalMap
from acquisition.models.tuned import tuned


@dataclass(frozen=True)
class PlannedNoiseSettings:
    """Tuned numbers of the noise that a plan expects."""

    self_calibration_factor: float = tuned(0.3, "1")
    """Self-calibration factor of σ: share of an image's intensity error that remains and affects normals. Of 0.010 at
    eight images 0.0055 remain, most of it common to all images, which affects the albedo only. Planning with the
    covariance of the estimated intensities (a Schur complement over images) in place of this number changes the errors
    by less than can be measured."""
    integrability_factor: float = tuned(0.5, "1")
    """Integrability factor of variance: share of the independent pixel noise that remains after the projection of the
    normals to an integrable field. With it, measured over expected mean errors of eight images are 0.83–1.0 for smooth
    objects and figures, 1.0–1.3 for parts and fine relief."""
    indirect_sigma: float = tuned(0.4, "share")
    """1 σ of the residual indirect radiance after correction, as a share of it, for each light. It contains more than
    the part that differs between lights, by which the solver weights (`predicted_indirect_sigma`): that part
    is a tenth, but the residual common to all lights, a fifth and more, also affects normals least where many lights
    are well visible. Eight path-traced images have 0.98–0.99 times the error of two rings with 0.4, 1.03 times
    without."""


SETTINGS = PlannedNoiseSettings()


@dataclass(frozen=True)
class Gloss:
    """Variance of y from highlights (Blinn lobe): (sigma |s| (n·h)^exponent)², h the half vector of lamp and camera."""

    sigma: float = 0.0
    exponent: float = 1.0


DIFFUSE = Gloss()
"""No highlight variance."""


def gloss(normal_map: NormalMap) -> Gloss:
    """Highlight noise by the lobe that the solver fitted: the residual that its solve leaves of it, not the full
    highlight, since lights that avoid all highlights would leave the lobe undetermined."""
    lobe = normal_map.notes.get("lobe")
    if lobe is None or lobe["strength"] <= 0:
        return DIFFUSE
    return Gloss(photometry.SETTINGS.predicted_highlight_sigma * float(lobe["strength"]), float(lobe["exponent"]))


@dataclass(frozen=True)
class Shading:
    """Near-light shading of P sample pixels by K lights, without shadows."""

    light: Float32Array  # (K, 3, P) light vectors s
    strength: Float32Array  # (K, P) ρ|s|
    distance: Float32Array  # (K, P) m
    cosine: Float32Array  # (K, P) of the angle of incidence
    value: Float32Array  # (K, P) y


def variance(shading: Shading, sensor: FloatArray, calibration: Calibration, indirect: Float32Array) -> FloatArray:
    """Heteroscedastic noise model: expected variance of y (K, P).

    `sensor` (K, P) is the sensor's part of it, `indirect` (P,) the indirect radiance, in y.
    """
    value, strength = shading.value, shading.strength
    lamp_angle = calibration.lamp_position_sigma_m / shading.distance
    intensity_variance = SETTINGS.self_calibration_factor**2 * (calibration.intensity_sigma**2 + (2 * lamp_angle) ** 2)
    direction_variance = lamp_angle**2 * np.clip(1 - shading.cosine**2, 0, 1)
    pixel_variance = sensor + photometry.SETTINGS.flat_field_sigma**2 * value**2
    return np.asarray(
        SETTINGS.integrability_factor * pixel_variance
        + intensity_variance * value**2
        + direction_variance * strength**2
        + (SETTINGS.indirect_sigma * indirect) ** 2
    )


def solved_variance(
    shading: Shading, sensor: FloatArray, calibration: Calibration, indirect: Float32Array, normal_map: NormalMap
) -> FloatArray:
    """Variance (K, P) of y by which the solver of `normal_map` weighted such values; arguments as of `variance`."""
    none = np.zeros(len(shading.value))
    assumed = photometry.model_noise(calibration, none, none, float(np.mean(shading.distance)))
    intensity = normal_map.noise.get("intensity", assumed.intensity)
    direction = normal_map.noise.get("direction", assumed.direction)
    lamps = (intensity * shading.value) ** 2 + (direction * shading.strength) ** 2
    predicted = (photometry.SETTINGS.predicted_indirect_sigma * indirect) ** 2
    return np.asarray(sensor + lamps + predicted)
