"""Planned images at sample pixels: shading, exposure, noise and shadows, as whitened design rows of lights.

The noise of y is that of the final solve, not the calibration's: the final solve self-calibrates each image's
intensity, and what remains is mostly common to all images, which affects the albedo only; depth is a nuisance parameter
of its own, so that the error of the light's direction is that of the lamp's position, and changes y only at oblique
incidence; independent pixel noise is halved by the projection of the normals to an integrable field, and the regression
on neighbours leaves as much of it as of the images so far. Indirect radiance, estimated from the images so far, is
subtracted by a prediction whose error is proportional to it, so dark measurements beside it carry less information.
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
    """1 σ of the residual indirect radiance after correction, as a share of it, for each light. By a tenth of it lights
    differ, by which the solver weights (`predicted_indirect_sigma`); a fifth and more is common to all, which affects
    normals least where many lights are well visible. Eight path-traced images have 0.98–0.99 times the error of two
    rings with 0.4, 1.03 times without."""


SETTINGS = PlannedImagesSettings()

INTEGRABILITY_SHARE = 0.5
"""Share of independent pixel noise, a variance, that the projection of the normals to an integrable field leaves: of
two slopes of equal variance one is a surface's. What it leaves of pilots, 0.52–0.82, forecasts no better."""


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
    """What the images of any lights depend on: the object's surface (None: convex, without cast shadows), the
    calibration, and the exposure that the recipe asks for."""

    surface: Surface | None
    calibration: Calibration
    exposure: Exposure

    def candidates(
        self, sample: Samples, lights: Sequence[Light], exposures: Sequence[Sequence[FrameExposure]] | None = None
    ) -> Candidates:
        """Whitened design rows of lights, at each light's own exposures.

        `exposures` None: the automatic one of each light, with planned exposures also one that is `UNPLANNED_FACTOR`
        times as long, until they are planned.
        """
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
        """The automatic exposure time (K,), s, of lights by the sample pixels' expected level."""
        if self.exposure.seconds is not None:
            return np.full(len(shaded.value), self.exposure.seconds)
        brightest = np.maximum(np.quantile(np.where(shaded.seen, shaded.value, 0.0), 0.995, axis=1), 1e-4)
        return self.exposure.target / brightest / self.calibration.lamp_intensity


def shading(
    sample: Samples, lights: Sequence[Light], calibration: Calibration, surface: Surface | None = None
) -> Shading:
    """Shading of the sample pixels by lights, with the cast shadows of a `surface`, where one is given."""
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
    """The sensor's part of the variance of values (K, P) by each light's exposures, and which are saturated."""
    variances, saturated = np.empty(value.shape), np.empty(value.shape, np.bool_)
    for number, (one, wanted) in enumerate(zip(value, exposures, strict=True)):
        variances[number], saturated[number] = image_values.merged_variance(one, wanted, calibration)
    return variances, saturated


def variance(shading: Shading, sensor: FloatArray, calibration: Calibration, sample: Samples) -> FloatArray:
    """Heteroscedastic noise model of a diffuse surface: expected variance of y (K, P), of which `sensor` (K, P) is the
    sensor's part, with the sample's indirect radiance and what regression leaves of its noise."""
    value, strength = shading.value, shading.strength
    lamp_angle = calibration.lamp_position_sigma_m / shading.distance
    pixel_variance = sensor + photometry.SETTINGS.flat_field_sigma**2 * value**2
    return np.asarray(
        INTEGRABILITY_SHARE * sample.regression_share * pixel_variance
        + lamp_angle**2 * np.clip(1 - shading.cosine**2, 0, 1) * strength**2
        + (SETTINGS.indirect_sigma * sample.indirect) ** 2
    )
