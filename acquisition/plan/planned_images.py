"""Planned images at sample pixels: shading, exposure, noise and shadows, as whitened design rows of lights.

The noise of y is that of the final solve, not that of the calibration. The final solve self-calibrates each image's
intensity; the remaining error is mostly common to all images and affects the albedo only. Depth is a nuisance parameter
of its own, so the error of the light's direction is that of the lamp's position, which changes y only at oblique
incidence. The projection of the normals to an integrable field halves independent pixel noise; the regression on
neighbours leaves the same share of it as in the images so far. Indirect radiance, estimated from the images so far, is
subtracted; its error is proportional to it, so dark measurements with indirect light carry less information.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from acquisition import image_values, photometry
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.light_plan import FrameExposure, Light
from acquisition.models.recipe import UNPLANNED_FACTOR, Exposure
from acquisition.models.result import SolveSettings
from acquisition.models.tuned import tuned
from acquisition.plan.criterion import Candidates, Samples
from acquisition.plan.visibility import Surface

MIN_COSINE = SolveSettings().shadow_threshold
"""Cosine of incidence below which a pixel counts as in attached shadow: the solver's threshold, a share of the peak."""


@dataclass(frozen=True)
class PlannedImagesSettings:
    """Tuned numbers of the images that a plan expects."""

    indirect_sigma: float = tuned(0.4, "share")
    """1 σ of the indirect radiance that remains after correction, as a share of it, for each light. A tenth of it
    differs from light to light; the solver weights by that (`predicted_indirect_sigma`). A fifth or more is common to
    all lights, and affects normals least where many lights are well visible. Measured: eight path-traced images have
    0.98–0.99 times the error of two rings with 0.4, and 1.03 times without this term."""


SETTINGS = PlannedImagesSettings()

INTEGRABILITY_SHARE = 0.5
"""Share of the variance of independent pixel noise that the projection of the normals to an integrable field leaves: a
surface has one of two slopes of equal variance. Forecasts with the shares of pilots, 0.52–0.82, are no better."""


@dataclass(frozen=True)
class Shading:
    """Near-light shading of P sample pixels by K lights."""

    light: Float32Array  # (K, 3, P) light vectors s
    strength: Float32Array  # (K, P) ρ|s|
    distance: Float32Array  # (K, P) m
    cosine: Float32Array  # (K, P) of the angle of incidence
    value: Float32Array  # (K, P) y, without shadows
    seen: BoolArray  # (K, P) in neither attached nor cast shadow


@dataclass(frozen=True)
class PlannedImages:
    """Everything that the images of any lights depend on: the object's surface (None: convex, without cast shadows),
    the calibration, and the recipe's exposure."""

    surface: Surface | None
    calibration: Calibration
    exposure: Exposure

    def candidates(
        self, sample: Samples, lights: Sequence[Light], exposures: Sequence[Sequence[FrameExposure]] | None = None
    ) -> Candidates:
        """Returns whitened design rows of lights, with the `exposures` of each. None: each light has its automatic
        exposure and, if the recipe's exposures are planned, another one `UNPLANNED_FACTOR` times as long."""
        shaded = shading(sample, lights, self.calibration, self.surface)
        if exposures is None:
            factors = (1.0,) if self.exposure.plan == "fixed" else (1.0, UNPLANNED_FACTOR)
            exposures = [
                [FrameExposure(exposure_s=float(one * factor)) for factor in factors]
                for one in self.automatic_seconds(shaded)
            ]
        sensor, saturated = sensor_variance(shaded.value, exposures, self.calibration)
        noise = variance(shaded, sensor, self.calibration, sample)
        along = np.einsum("fcp,cp->fp", shaded.light, sample.ray_direction) * sample.albedo
        facing = np.einsum("cp,cp->p", sample.normal, sample.ray_direction) * shaded.strength
        slope = (3 * shaded.cosine * along - facing) / shaded.distance * sample.offset_sigma_m
        row = np.concatenate([shaded.light, slope[:, None]], axis=1) / np.sqrt(noise)[:, None]
        return Candidates(sample, np.ascontiguousarray(row * (shaded.seen & ~saturated)[:, None], np.float32))

    def automatic_seconds(self, shaded: Shading) -> FloatArray:
        """Exposure time (K,), s, of each light: the recipe's, or the automatic one for the sample pixels' values."""
        if self.exposure.seconds is not None:
            return np.full(len(shaded.value), self.exposure.seconds)
        brightest = np.maximum(np.quantile(np.where(shaded.seen, shaded.value, 0.0), 0.995, axis=1), 1e-4)
        return self.exposure.target / brightest / self.calibration.lamp_intensity


def shading(
    sample: Samples, lights: Sequence[Light], calibration: Calibration, surface: Surface | None = None
) -> Shading:
    """Computes the shading of the sample pixels by lights, with the cast shadows of `surface` if one is given."""
    lamp = photometry.lamps(lights)
    light = photometry.light_vectors(sample.point, lamp, calibration)
    length = photometry.strength(light)
    distance = np.sqrt(np.sum((lamp[:, :3, None] - sample.point[None]) ** 2, axis=1))
    cosine = np.einsum("fcp,cp->fp", light, sample.normal) / np.maximum(length, 1e-9)
    seen = cosine - MIN_COSINE > sample.margin
    if surface is not None:
        seen &= surface.clearance(sample.point, lamp) > sample.margin
    strength = sample.albedo * length
    return Shading(light, strength, distance, cosine, np.maximum(cosine, MIN_COSINE) * strength, seen)


def sensor_variance(
    value: Float32Array, exposures: Sequence[Sequence[FrameExposure]], calibration: Calibration
) -> tuple[FloatArray, BoolArray]:
    """Returns the sensor's part of the variance of values (K, P) with each light's exposures, and which saturate."""
    variances, saturated = np.empty(value.shape), np.empty(value.shape, np.bool_)
    for number, (one, wanted) in enumerate(zip(value, exposures, strict=True)):
        variances[number], saturated[number] = image_values.merged_variance(one, wanted, calibration)
    return variances, saturated


def variance(shading: Shading, sensor: FloatArray, calibration: Calibration, sample: Samples) -> FloatArray:
    """Heteroscedastic noise model of a diffuse surface: expected variance of y (K, P). `sensor` (K, P) is the sensor's
    part. The sample gives the indirect radiance and the share of noise that the regression leaves."""
    value, strength = shading.value, shading.strength
    lamp_angle = calibration.lamp_position_sigma_m / shading.distance
    pixel_variance = sensor + photometry.SETTINGS.flat_field_sigma**2 * value**2
    return np.asarray(
        INTEGRABILITY_SHARE * sample.regression_share * pixel_variance
        + lamp_angle**2 * np.clip(1 - shading.cosine**2, 0, 1) * strength**2
        + (SETTINGS.indirect_sigma * sample.indirect) ** 2
    )
