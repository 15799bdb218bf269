"""Quality checks of a frame: exposure, saturation, presence of light, sharpness, and displacement of the object.

A wrong exposure is corrected by another exposure time. A frame without light is a fault that no exposure time corrects;
it is recognised by its level relative to the read noise, not relative to the target.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from acquisition import mosaic
from acquisition.capture import exposure
from acquisition.capture.expected import displacement
from acquisition.models.base import BoolArray, FloatArray
from acquisition.models.calibration import SensorModel
from acquisition.models.camera_config import CameraConfig
from acquisition.models.recipe import Exposure
from acquisition.models.rounding import percent
from acquisition.models.shot import FrameQuality

BRIGHT_PERCENTILE = 99.5
"""Percentile of the region's pixels that is taken as a frame's level."""
MAX_SATURATED_SHARE = 0.01
"""Largest fraction of the region's pixels at full scale; above, a shorter exposure time is tried."""
UNUSABLE_SATURATED_SHARE = 0.5
"""A frame with this fraction of the region's pixels at full scale is rejected."""
MIN_SHARE_OF_TARGET = 0.4
"""Level as a fraction of the target below which a longer exposure time is tried."""
MIN_SHARPNESS_RATIO = 0.35
"""A frame whose sharpness is below this fraction of the earlier frames' median is blurred."""
FINE_NOISE_GAIN, COARSE_NOISE_GAIN = 0.761, 0.0358
"""Variance gain for white noise of the detail bands of one and of two pixels (differences of Gaussians, σ 1 and 2)."""
LOW_QUANTILE, OF_NORMAL_SQUARED = 0.1, 0.0158
"""Quantile, low enough for pixels that show noise but no detail, and its value for a squared normal variable."""
MIN_LEVEL_OVER_NOISE = 6.0
"""Level, in multiples of the read noise above black, below which the lamp counts as off or out of view."""


@dataclass(frozen=True)
class Verdict:
    """A frame's quality, the exposure time, s, to retake it with (None: no other would be better), and its use."""

    quality: FrameQuality
    retake_s: float | None
    usable: bool = True  # a badly exposed frame with light is better than none
    moved: bool = False  # object or camera has moved: the frame is rejected, and a person has to look


def lit_frame(
    pixels: npt.NDArray[np.uint16],
    region: BoolArray,
    sensor: SensorModel,
    exposure_s: float,
    wanted: Exposure,
    camera: CameraConfig,
) -> Verdict:
    """Judges a frame (H, W) taken with the lamp on, by the pixels of `region` (H, W)."""
    quality = _measure(pixels, region, sensor)
    level, saturated = quality.bright_level, quality.saturated
    if level < MIN_LEVEL_OVER_NOISE * _read_noise(sensor) and exposure_s >= camera.min_exposure_s:
        longer = exposure.in_range(exposure_s * 8, camera) if wanted.seconds is None else exposure_s
        reason = f"no light: the brightest pixels are at {percent(level)} of full scale; is the lamp on and in view?"
        dark = quality.model_copy(update={"accepted": False, "reason": reason})
        return Verdict(dark, longer if longer > exposure_s else None, usable=False)
    usable = saturated < UNUSABLE_SATURATED_SHARE
    burnt = quality.model_copy(
        update={"accepted": False, "reason": f"{percent(saturated)} of the pixels are saturated"}
    )
    if wanted.seconds is not None:
        return Verdict(quality if usable else burnt, None, usable)
    if saturated > MAX_SATURATED_SHARE:
        # How far above full scale the clipped pixels are is unknown; halving finds out.
        shorter = exposure.series_value(exposure_s * 0.5, camera)
        if shorter < exposure_s or not usable:
            return Verdict(burnt, shorter if shorter < exposure_s else None, usable)
    elif level < MIN_SHARE_OF_TARGET * wanted.target:
        longer = exposure.series_value(exposure_s * wanted.target / level, camera)
        if longer > exposure_s * 1.01:
            reason = f"too dark: the brightest pixels are at {percent(level)} of full scale"
            return Verdict(quality.model_copy(update={"accepted": False, "reason": reason}), longer)
    return Verdict(quality, None)


def planned_frame(
    pixels: npt.NDArray[np.uint16], region: BoolArray, sensor: SensorModel, exposure_s: float, camera: CameraConfig
) -> Verdict:
    """Judges a frame (H, W) at an exposure time from the plan, which lets some pixels saturate on purpose.

    A frame without light, or with half of the region saturated, is not usable; the latter is retaken at a shorter time.
    """
    verdict = lit_frame(pixels, region, sensor, exposure_s, Exposure(seconds=exposure_s), camera)
    if verdict.usable or verdict.quality.saturated < UNUSABLE_SATURATED_SHARE:
        return verdict
    shorter = exposure.series_value(exposure_s * 0.25, camera)
    return Verdict(verdict.quality, shorter if shorter < exposure_s else None, usable=False)


def further_frame(pixels: npt.NDArray[np.uint16], region: BoolArray, sensor: SensorModel) -> FrameQuality:
    """Measures the quality of a further frame (H, W) of a light, and rejects one without light. Saturated pixels are
    accepted, because they do not count when frames are merged."""
    quality = _measure(pixels, region, sensor)
    if quality.bright_level < MIN_LEVEL_OVER_NOISE * _read_noise(sensor):
        reason = f"no light: the brightest pixels are at {percent(quality.bright_level)} of full scale; is the lamp on?"
        return quality.model_copy(update={"accepted": False, "reason": reason})
    return quality


def _read_noise(sensor: SensorModel) -> float:
    """Returns 1 σ of a dark pixel, but at least half a value, as a fraction of full scale."""
    return max(sensor.read_noise_e / sensor.gain_e_per_dn, 0.5) / sensor.full_scale_dn


def compare_with_earlier(
    quality: FrameQuality,
    pixels: npt.NDArray[np.uint16],
    region: BoolArray,
    sensor: SensorModel,
    exposure_s: float,
    earlier: Sequence[float],
    predicted: FloatArray | None,
) -> Verdict:
    """Checks a well exposed frame (H, W) by its sharpness relative to the median of `earlier`, and by its displacement
    from the predicted image (None: no prediction exists)."""
    sharp = sharpness(pixels, region, sensor)
    even = pixels if sensor.mosaic is None else mosaic.balanced_mean(pixels.astype(np.float32))
    shift = None if predicted is None else displacement(predicted, even, sensor.black_level_dn, 2**sensor.bits - 1)
    shift_px = None if shift is None else round(shift.shift_px, 2)
    measured = quality.model_copy(update={"sharpness": sharp, "shift_px": shift_px})
    usual = float(np.median(earlier)) if earlier else 0.0
    if sharp is not None and sharp < MIN_SHARPNESS_RATIO * usual:
        reason = f"blurred: its sharpness is {percent(sharp / usual, 0)} of that of earlier frames"
        return Verdict(measured.model_copy(update={"accepted": False, "reason": reason}), exposure_s, usable=False)
    if shift is not None and shift.moved:
        reason = f"the object seems to have shifted by {shift.shift_px:.1f} pixels since it was first seen"
        rejected = measured.model_copy(update={"accepted": False, "reason": reason})
        return Verdict(rejected, exposure_s, usable=False, moved=True)
    return Verdict(measured, None)


def sharpness(pixels: npt.NDArray[np.uint16], region: BoolArray, sensor: SensorModel) -> float | None:
    """Returns the ratio of the variances of one- and two-pixel detail (differences of Gaussians), less sensor noise.

    Blur removes the finest detail first, whatever the light. In simulated frames of an object under all its lights the
    ratio lies within a factor of 3.7 (a sphere; 2.6 otherwise), and a blur of 1.5 pixels divides it by four or five.
    None if there is no detail.

    The subtracted noise is the sensor model's, but at most what pixels without detail show. If a frame has less noise
    than its model (a simulated sensor without any), the difference would be taken from the detail, and a smooth object
    under a light without edges would seem blurred.
    """
    signal, averaged = pixels.astype(np.float64), 1
    if sensor.mosaic is not None:  # its pattern would be the finest detail
        signal, averaged, region = mosaic.cell_means(pixels), mosaic.CELL**2, _cells_of(region)
    signal = signal - sensor.black_level_dn
    noise = np.maximum(signal, 0) / sensor.gain_e_per_dn + (sensor.read_noise_e / sensor.gain_e_per_dn) ** 2
    noise /= averaged
    once, twice = (cv2.GaussianBlur(signal, (0, 0), width) for width in (1.0, 2.0))
    finest = (signal - once)[region] ** 2
    squares = finest / np.maximum(noise[region], 1e-9)
    shown = float(np.quantile(squares, LOW_QUANTILE)) / (OF_NORMAL_SQUARED * FINE_NOISE_GAIN)
    level = min(shown, 1.0) * float(np.mean(noise[region]))
    fine = float(np.mean(finest)) - FINE_NOISE_GAIN * level
    coarse = float(np.mean((once - twice)[region] ** 2)) - COARSE_NOISE_GAIN * level
    return None if coarse <= 0 or fine <= 0 else round(fine / coarse, 4)


def _cells_of(region: BoolArray) -> BoolArray:
    """Returns the mask of the cells (h/2, w/2) of a mosaic that lie in a region (H, W) with all their sites."""
    height, width = (side // mosaic.CELL for side in region.shape)
    inside = region[: mosaic.CELL * height, : mosaic.CELL * width]
    return np.asarray(inside.reshape(height, mosaic.CELL, width, mosaic.CELL).all(axis=(1, 3)), np.bool_)


def dark_frame(pixels: npt.NDArray[np.uint16], region: BoolArray, sensor: SensorModel) -> FrameQuality:
    """Measures the quality of a lamp-off frame; rejects it if ambient light leaves too little range for the lamp's."""
    quality = _measure(pixels, region, sensor)
    if quality.bright_level > 0.5:
        level = percent(quality.bright_level, 0)
        reason = f"with the lamp off, the brightest pixels are at {level} of full scale: darken the room"
        return quality.model_copy(update={"accepted": False, "reason": reason})
    return quality


def _measure(pixels: npt.NDArray[np.uint16], region: BoolArray, sensor: SensorModel) -> FrameQuality:
    values = pixels[region]
    top = 2**sensor.bits - 1
    channels = [values]
    if sensor.mosaic is not None:  # the brightest channel is the first to clip
        whole = slice(0, pixels.shape[0]), slice(0, pixels.shape[1])
        sites = mosaic.sites(sensor.mosaic, *whole)[region]
        channels = [values[sites == channel] for channel in range(3)]
    bright = max(float(np.percentile(one, BRIGHT_PERCENTILE)) for one in channels if len(one))
    level = (bright - sensor.black_level_dn) / sensor.full_scale_dn
    return FrameQuality(saturated=float(np.mean(values >= top)), bright_level=level, accepted=True)
