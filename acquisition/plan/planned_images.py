"""Planned images at sample pixels: shading, exposure, noise and shadows, as whitened design rows of lights.

The noise of y is that of the final solve, not the calibration's: the final solve self-calibrates each image's
intensity, so that only a part of that error remains; depth is a nuisance parameter of its own, so that the error of the
light's direction is that of the lamp's position, and changes y only at oblique incidence; independent pixel noise is
halved by the projection of the normals to an integrable field. Indirect radiance, estimated from the images so far, is
subtracted by a prediction whose error is proportional to it, so dark measurements beside it carry less information. So
do lights that would cause highlights at many pixels, where the solver has fitted a lobe.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.light_plan import FrameExposure, Light
from acquisition.models.recipe import UNPLANNED_FACTOR, Exposure
from acquisition.models.result import NormalMap, SolveSettings
from acquisition.models.tuned import tuned
from acquisition.plan.criterion import Candidates, Samples
from acquisition.plan.visibility import Surface

MIN_COSINE = SolveSettings().shadow_threshold
"""Cosine of incidence below which a pixel counts as in attached shadow: the solver's threshold, a share of the peak."""


@dataclass(frozen=True)
class PlannedImagesSettings:
    """Tuned numbers of the images that a plan expects."""

    shadow_sigma: float = tuned(0.05, "1")
    """1 σ of the threshold of a shadow, in cosine of incidence or slope of clearance; combined with the normal's own
    σ. Errors are 0.998 times those with 0.06 for attached and 0.04 for cast shadows (sixteen scenes, eight images)."""
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


SETTINGS = PlannedImagesSettings()


@dataclass(frozen=True)
class Shading:
    """Near-light shading of P sample pixels by K lights, without shadows."""

    light: Float32Array  # (K, 3, P) light vectors s
    strength: Float32Array  # (K, P) ρ|s|
    distance: Float32Array  # (K, P) m
    cosine: Float32Array  # (K, P) of the angle of incidence
    value: Float32Array  # (K, P) y


@dataclass(frozen=True)
class Gloss:
    """Variance of y from highlights (Blinn lobe): (sigma |s| (n·h)^exponent)², h the half vector of lamp and camera."""

    sigma: float = 0.0
    exponent: float = 1.0

    @classmethod
    def of(cls, normal_map: NormalMap) -> "Gloss":
        """What the solver leaves of the lobe that it fitted, not the full highlight, since lights that avoid all
        highlights would leave the lobe undetermined."""
        lobe = normal_map.notes.get("lobe")
        if lobe is None or lobe["strength"] <= 0:
            return cls()
        return cls(photometry.SETTINGS.predicted_highlight_sigma * float(lobe["strength"]), float(lobe["exponent"]))

    def variance(self, sample: Samples, shading: Shading) -> FloatArray | float:
        """Variance (K, P) of y from highlights."""
        if self.sigma <= 0:
            return 0.0
        to_camera = -sample.ray_direction / np.sqrt(np.sum(sample.ray_direction**2, axis=0))
        length = shading.strength / sample.albedo
        half = shading.light / np.maximum(length, 1e-9)[:, None] + to_camera
        aligned = np.einsum("fcp,cp->fp", half, sample.normal)
        cosine = np.clip(aligned / np.sqrt(np.einsum("fcp,fcp->fp", half, half)), 0, 1)
        return (self.sigma * length * cosine**self.exponent) ** 2


@dataclass(frozen=True)
class PlannedImages:
    """What the images of any lights depend on: the object's surface (None: convex, without cast shadows) and gloss, the
    calibration, and the exposure that the recipe asks for."""

    surface: Surface | None
    calibration: Calibration
    exposure: Exposure
    gloss: Gloss = Gloss()

    def candidates(
        self, sample: Samples, lights: Sequence[Light], exposures: Sequence[Sequence[FrameExposure]] | None = None
    ) -> Candidates:
        """Whitened design rows and visibility probabilities of lights, at each light's own exposures.

        `exposures` None: the automatic one of each light, with planned exposures also one that is `UNPLANNED_FACTOR`
        times as long, until they are planned.
        """
        shaded, visible = self._shading_and_visibility(sample, lights)
        if exposures is None:
            factors = (1.0,) if self.exposure.plan == "fixed" else (1.0, UNPLANNED_FACTOR)
            seconds = self._seconds(shaded, visible)
            exposures = [[FrameExposure(exposure_s=float(one * factor)) for factor in factors] for one in seconds]
        sensor, saturated = sensor_variance(shaded.value, exposures, self.calibration)
        noise = variance(shaded, sensor, self.calibration, sample.indirect) + self.gloss.variance(sample, shaded)
        along = np.einsum("fcp,cp->fp", shaded.light, sample.ray_direction) * sample.albedo
        facing = np.einsum("cp,cp->p", sample.normal, sample.ray_direction) * shaded.strength
        slope = (3 * shaded.cosine * along - facing) / shaded.distance * sample.offset_sigma_m
        row = np.concatenate([shaded.light, slope[:, None]], axis=1) / np.sqrt(noise)[:, None]
        return Candidates(
            sample,
            np.ascontiguousarray(row, np.float32),
            np.ascontiguousarray(np.where(saturated, 0.0, visible), np.float32),
        )

    def automatic_seconds(self, sample: Samples, lights: Sequence[Light]) -> FloatArray:
        """The automatic exposure time (K,), s, of lights by the sample pixels' expected level."""
        return self._seconds(*self._shading_and_visibility(sample, lights))

    def _shading_and_visibility(self, sample: Samples, lights: Sequence[Light]) -> tuple[Shading, FloatArray]:
        """Shading, and the probability (K, P) of neither attached nor cast shadow."""
        lamp = photometry.lamps(lights)
        shaded = shading(sample, lamp, self.calibration)
        sigma = np.hypot(SETTINGS.shadow_sigma, sample.sigma / np.sqrt(2.0))
        lit = ndtr((shaded.cosine - MIN_COSINE) / sigma)
        if self.surface is not None:
            lit *= ndtr(self.surface.clearance(sample.point, lamp) / sigma)
        return shaded, lit

    def _seconds(self, shading: Shading, visible: FloatArray) -> FloatArray:
        brightest = np.maximum(np.quantile(np.where(visible > 0.5, shading.value, 0.0), 0.995, axis=1), 1e-4)
        if self.exposure.seconds is not None:
            return np.full_like(brightest, self.exposure.seconds)
        return self.exposure.target / brightest / self.calibration.lamp_intensity


def shading(sample: Samples, lamp: Float32Array, calibration: Calibration) -> Shading:
    """Shading of the sample pixels by lamps (K, 6 or 9) as of `photometry.lamps`."""
    light = photometry.light_vectors(sample.point, lamp, calibration)
    length = np.sqrt(np.einsum("fcp,fcp->fp", light, light))
    distance = np.sqrt(np.sum((lamp[:, :3, None] - sample.point[None]) ** 2, axis=1))
    cosine = np.einsum("fcp,cp->fp", light, sample.normal) / np.maximum(length, 1e-9)
    strength = sample.albedo * length
    return Shading(light, strength, distance, cosine, np.maximum(cosine, MIN_COSINE) * strength)


def sensor_variance(
    value: Float32Array, exposures: Sequence[Sequence[FrameExposure]], calibration: Calibration
) -> tuple[FloatArray, BoolArray]:
    """The sensor's part of the variance of values (K, P) by each light's exposures, and which are saturated."""
    variances, saturated = np.empty(value.shape), np.empty(value.shape, np.bool_)
    for number, (one, wanted) in enumerate(zip(value, exposures, strict=True)):
        variances[number], saturated[number] = photometry.merged_variance(one, wanted, calibration)
    return variances, saturated


def variance(shading: Shading, sensor: FloatArray, calibration: Calibration, indirect: Float32Array) -> FloatArray:
    """Heteroscedastic noise model of a diffuse surface: expected variance of y (K, P).

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
