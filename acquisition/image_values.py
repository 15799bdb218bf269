"""Normalised values of frames, and their variance.

A value y (`photometry`) is the signal of a lit frame less that of a lamp-off frame, divided by the signal of a white
surface. Its variance has four terms: shot noise; read noise and quantisation, of the lit frame and of the dark frame
that is subtracted from it; (c y)² for intensity errors; and (σ_d ρ|s|)² for errors of the light's direction. The last
two dominate in practice. Without the last one, a surface at the terminator would seem to carry infinite information.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import hypot

import numpy as np
import numpy.typing as npt

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.calibration import Calibration, SensorModel
from acquisition.models.light_plan import FrameExposure

SATURATION_SHARE = 0.985
"""Share of the clipping level above which a value counts as clipped."""


@dataclass(frozen=True)
class Noise:
    """Variance of y: v = shot·y + floor + (intensity·y)² + (direction·ρ|s|)², the first two per image.

    `shot` and `floor` (F,) follow from sensor and exposure; `intensity` (fraction) and `direction` (rad) from the
    calibration's own uncertainty.
    """

    shot: FloatArray
    floor: FloatArray
    intensity: float
    direction: float

    def variance(self, values: FloatArray | Float32Array, strength: FloatArray | Float32Array) -> FloatArray:
        """Variance of y (F, N) where a surface of strength ρ|s| (F, N) gives `values` (F, N)."""
        return (
            self.shot[:, None] * np.maximum(values, 0.0)
            + self.floor[:, None]
            + (self.intensity * values) ** 2
            + (self.direction * strength) ** 2
        )

    def single_precision(self) -> "Noise":
        """Returns the same noise in float32: the variance of float32 images then takes half the memory."""
        return replace(self, shot=self.shot.astype(np.float32), floor=self.floor.astype(np.float32))


def electrons_per_value(calibration: Calibration, exposure_s: float) -> float:
    """Electrons that y = 1 gives in one exposure."""
    sensor = calibration.sensor
    return sensor.gain_e_per_dn * sensor.full_scale_dn * exposure_s * calibration.lamp_intensity


def normalised(
    frame: npt.NDArray[np.uint16], dark: npt.NDArray[np.uint16], exposure_s: float, calibration: Calibration
) -> Float32Array:
    """Values y of a frame (..) in DN, its lamp-off frame of the same exposure time subtracted."""
    scale = 1.0 / (calibration.sensor.full_scale_dn * exposure_s * calibration.lamp_intensity)
    return (frame.astype(np.float32) - dark.astype(np.float32)) * np.float32(scale)


def flat_terms(pixels: FloatArray, width: int, height: int) -> FloatArray:
    """Terms (N, 5) of ln sensitivity (`FlatField`) at pixels (N, 2), column and row: zero in the image's centre."""
    half = np.hypot(width, height) / 2
    u, v = ((pixels - (np.array([width, height]) - 1) / 2) / half).T
    return np.stack([u, v, u * u, u * v, v * v], axis=1)


def sensitivity(calibration: Calibration, rows: slice, columns: slice) -> Float32Array | None:
    """Sensitivity (h, w) of a window of pixels by the calibrated flat field; None: there is no flat field."""
    if calibration.flat_field is None:
        return None
    v, u = np.mgrid[rows, columns]
    pixels = np.stack([u.ravel(), v.ravel()], axis=1).astype(np.float64)
    logarithm = flat_terms(pixels, calibration.width, calibration.height) @ np.array(calibration.flat_field.terms)
    return np.exp(logarithm).reshape(u.shape).astype(np.float32)


def clipping_dn(sensor: SensorModel) -> float:
    """The value above which pixels count as saturated: the converter's end or the full well, whichever is lower."""
    return sensor.black_level_dn + SATURATION_SHARE * min(
        sensor.full_scale_dn, sensor.full_well_e / sensor.gain_e_per_dn
    )


def saturated(frame: npt.NDArray[np.uint16], sensor: SensorModel) -> BoolArray:
    """Which pixels of a frame in DN are clipped."""
    return frame >= clipping_dn(sensor)


def sensor_noise(
    calibration: Calibration, exposures_s: Sequence[float], ambient_dn: Sequence[float] | None = None
) -> tuple[FloatArray, FloatArray]:
    """The sensor's part of the variance of y, shot·y + floor, as `shot` (F,) and `floor` (F,).

    `ambient_dn` is the mean signal of each image's lamp-off frame above black, whose shot noise enters twice.
    """
    sensor = calibration.sensor
    scale = np.array([electrons_per_value(calibration, t) for t in exposures_s])
    ambient_e = sensor.gain_e_per_dn * np.asarray(ambient_dn if ambient_dn is not None else np.zeros(len(scale)))
    floor = 2.0 * (sensor.read_noise_e**2 + sensor.gain_e_per_dn**2 / 12.0 + np.maximum(ambient_e, 0.0)) / scale**2
    return 1.0 / scale, floor


def frames_noise(
    calibration: Calibration, exposures: Sequence[FrameExposure], ambient_dn: Sequence[float] | None = None
) -> tuple[FloatArray, FloatArray]:
    """`sensor_noise` (G,) of the mean of each exposure's equal frames, less one lamp-off frame."""
    frames = np.array([one.frames for one in exposures], dtype=np.float64)
    shot, floor = sensor_noise(calibration, [one.exposure_s for one in exposures], ambient_dn)
    return shot / frames, floor * (1 + 1 / frames) / 2


def merged_variance(
    value: FloatArray | Float32Array, exposures: Sequence[FrameExposure], calibration: Calibration
) -> tuple[FloatArray, BoolArray]:
    """The sensor's part of the variance of values y (P,) merged from several exposures, and which of them saturate in
    the shortest. Ambient light is left out.

    Frames count where they do not saturate, weighted by inverse variances.
    """
    shot, floor = frames_noise(calibration, exposures)
    sensor = calibration.sensor
    clipping = (clipping_dn(sensor) - sensor.black_level_dn) / (sensor.full_scale_dn * calibration.lamp_intensity)
    information, shortest = np.zeros(value.shape), min(one.exposure_s for one in exposures)
    for one, photons, constant in zip(exposures, shot, floor, strict=True):
        counts = (value * one.exposure_s <= clipping) | (one.exposure_s == shortest)
        information += np.where(counts, 1 / (photons * np.maximum(value, 0) + constant), 0)
    return 1 / information, np.asarray(value * shortest > clipping)


def model_noise(calibration: Calibration, shot: FloatArray, floor: FloatArray, distance_m: float) -> Noise:
    """The noise of images with a sensor's `shot` and `floor` (F,) and lamps at about `distance_m` from the object.

    An error of the lamp's position changes the intensity by 2/r along the ray, and the direction by 1/r across it.
    """
    position = calibration.lamp_position_sigma_m
    return Noise(
        shot=shot,
        floor=floor,
        intensity=float(
            np.sqrt(
                calibration.intensity_sigma**2
                + (2 * position / distance_m) ** 2
                + photometry.SETTINGS.flat_field_sigma**2
            )
        ),
        direction=hypot(position, photometry.SETTINGS.depth_sigma_m) / distance_m,
    )
