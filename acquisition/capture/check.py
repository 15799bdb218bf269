"""Whether a frame is good: bright enough, not burnt out, lit at all.

A wrong exposure is mended by another exposure time; a frame without light is a fault that no exposure mends, so it is
told from the dark frame of a failed lamp by its level against the noise, not against the target.
"""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from acquisition.capture import exposure
from acquisition.config import CameraConfig
from acquisition.types import BoolArray, Exposure, FrameQuality, SensorModel

BRIGHT_PERCENTILE = 99.5
MOST_SATURATED = 0.01
"""Share of the region's pixels that may be at full scale."""
LEAST_OF_TARGET = 0.4
"""A level below this share of the target is worth another exposure."""
LEAST_OVER_NOISE = 6.0
"""A lamp that is on brings the brightest pixels this many times the read noise above black."""


@dataclass(frozen=True)
class Verdict:
    """A frame's quality, the exposure time to retake it with (none: no other would be better), and its use."""

    quality: FrameQuality
    retake_s: float | None
    usable: bool = True  # a frame that is badly exposed but holds light is better than none


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
    read_noise = sensor.read_noise_e / sensor.gain_e_per_dn / sensor.full_scale_dn
    if level < LEAST_OVER_NOISE * max(read_noise, 0.5 / sensor.full_scale_dn) and exposure_s >= camera.min_exposure_s:
        longer = exposure.in_range(exposure_s * 8, camera) if wanted.seconds is None else exposure_s
        reason = f"no light: the brightest pixels are at {level:.1%} of full scale; is the lamp on and in view?"
        dark = quality.model_copy(update={"accepted": False, "reason": reason})
        return Verdict(dark, longer if longer > exposure_s else None, usable=False)
    if wanted.seconds is not None:
        return Verdict(quality, None)
    if saturated > MOST_SATURATED:
        # How far above full scale the clipped pixels are is unknown; halving finds out.
        shorter = exposure.series(exposure_s * 0.5, camera)
        if shorter < exposure_s:
            reason = f"{saturated:.1%} of the pixels are saturated"
            return Verdict(quality.model_copy(update={"accepted": False, "reason": reason}), shorter)
    elif level < LEAST_OF_TARGET * wanted.target:
        longer = exposure.series(exposure_s * wanted.target / level, camera)
        if longer > exposure_s * 1.01:
            reason = f"dark: the brightest pixels are at {level:.1%} of full scale"
            return Verdict(quality.model_copy(update={"accepted": False, "reason": reason}), longer)
    return Verdict(quality, None)


MOVED_PX = 0.5
"""An image that is taken again and has shifted by more shows that the object or the camera has moved."""
MOST_CHANGED = 0.02
"""Share of the region's pixels that may look otherwise in an image that is taken again."""
MOST_BRIGHTNESS = 0.1
"""The lamp may be this much brighter or darker in an image that is taken again, as a fraction."""
CHANGED_BY = 0.05
"""Of the brightest pixels: a pixel that differs by more than this, noise and brightness allowed for, has changed."""


@dataclass(frozen=True)
class Comparison:
    """An image and the same image taken again."""

    shift_px: float
    brightness: float  # of the second to the first
    changed: float  # share of the pixels
    accepted: bool
    detail: str


def same_scene(
    first: npt.NDArray[np.uint16], again: npt.NDArray[np.uint16], region: BoolArray, sensor: SensorModel
) -> Comparison:
    """Whether an image (H, W) that is taken again shows what the first one did, by the pixels of `region` (H, W)."""
    before, after = (np.where(region, image - sensor.black_level_dn, 0.0) for image in (first, again))
    here = before[region]
    brightness = float(here @ after[region]) / max(float(here @ here), 1e-9)
    bright = float(np.percentile(here, BRIGHT_PERCENTILE))
    noise = np.sqrt(np.maximum(here, 0) / sensor.gain_e_per_dn + (sensor.read_noise_e / sensor.gain_e_per_dn) ** 2)
    differs = np.abs(after[region] - brightness * here) > CHANGED_BY * bright + 6 * np.sqrt(2) * noise
    shift_px = shift(before, after, region)
    changed = float(np.mean(differs))
    found = [
        f"has shifted by {shift_px:.2f} pixels" if shift_px > MOVED_PX else "",
        f"differs in {changed:.1%} of its pixels" if changed > MOST_CHANGED else "",
        f"has {brightness:.0%} of its brightness" if abs(brightness - 1) > MOST_BRIGHTNESS else "",
    ]
    detail = " and ".join(item for item in found if item)
    return Comparison(round(shift_px, 3), round(brightness, 4), round(changed, 4), not detail, detail)


def shift(first: npt.NDArray[np.float64], second: npt.NDArray[np.float64], region: BoolArray) -> float:
    """By how many pixels the second image (H, W) is shifted against the first, from the phase of their spectra."""
    rows, columns = np.flatnonzero(region.any(axis=1)), np.flatnonzero(region.any(axis=0))
    box = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    window = cv2.createHanningWindow((columns[-1] - columns[0] + 1, rows[-1] - rows[0] + 1), cv2.CV_64F)
    (right, down), _ = cv2.phaseCorrelate(np.ascontiguousarray(first[box]), np.ascontiguousarray(second[box]), window)
    return float(np.hypot(right, down))


def dark_frame(pixels: npt.NDArray[np.uint16], region: BoolArray, sensor: SensorModel) -> FrameQuality:
    """The quality of a lamp-off frame: too much ambient light leaves no room for the lamp's."""
    quality = _measure(pixels, region, sensor)
    if quality.bright_level > 0.5:
        reason = (
            f"with the lamp off the brightest pixels are at {quality.bright_level:.0%} of full scale: darken the room"
        )
        return quality.model_copy(update={"accepted": False, "reason": reason})
    return quality


def _measure(pixels: npt.NDArray[np.uint16], region: BoolArray, sensor: SensorModel) -> FrameQuality:
    values = pixels[region]
    top = 2**sensor.bits - 1
    level = (float(np.percentile(values, BRIGHT_PERCENTILE)) - sensor.black_level_dn) / sensor.full_scale_dn
    return FrameQuality(saturated=float(np.mean(values >= top)), bright_level=level, accepted=True)
