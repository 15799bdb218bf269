"""Comparison of a repeated image with the first one: whether object, camera and lamp are where they were.

After an interruption, and at the end of a pass without predicted images, an image is captured again and compared with
the first. Both have the same light, so any difference beyond noise is a change of the scene. A lamp that stands 1 mm
elsewhere each time shifts shadows by up to 0.46 pixels in 1024 (six simulated objects, three slants), and changes the
brightness by 4 %.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from acquisition.capture.check import BRIGHT_PERCENTILE
from acquisition.models.base import BoolArray, FloatArray
from acquisition.models.calibration import SensorModel
from acquisition.models.rounding import percent

LOW_PASS_CYCLES_PER_PIXEL = 0.12
"""Width of the Gaussian low-pass of the cross-power spectrum, cycles per pixel: finer detail is mostly noise."""
MAX_SHIFT_PX, MAX_SHIFT_OF_WIDTH = 0.5, 1 / 1024
"""Largest shift of a repeated image, px and as a fraction of the width; above both, object or camera has moved."""
MAX_CHANGED_SHARE = 0.02
"""Largest fraction of the region's pixels that may have changed in a repeated image."""
MAX_BRIGHTNESS_CHANGE = 0.1
"""Largest relative change of brightness of a repeated image."""
CHANGE_THRESHOLD = 0.05
"""Difference, as a fraction of the brightest pixels' level and beyond noise, above which a pixel has changed."""


@dataclass(frozen=True)
class Comparison:
    """A repeated image compared with the first one."""

    shift_px: float
    brightness: float  # of the second to the first
    changed: float  # share of the pixels
    accepted: bool
    detail: str


def has_shifted(shift_px: float, width: int) -> bool:
    """Whether a shift of a repeated image, which is `width` pixels wide, shows that something has moved."""
    return shift_px > max(MAX_SHIFT_PX, MAX_SHIFT_OF_WIDTH * width)


def same_scene(
    first: npt.NDArray[np.uint16], repeated: npt.NDArray[np.uint16], region: BoolArray, sensor: SensorModel
) -> Comparison:
    """Compares a repeated image (H, W) with the first one by shift, changed pixels and brightness within `region`."""
    before, after = (image.astype(np.float64) - sensor.black_level_dn for image in (first, repeated))
    reference = before[region]
    brightness = float(reference @ after[region]) / max(float(reference @ reference), 1e-9)
    bright = float(np.percentile(reference, BRIGHT_PERCENTILE))
    noise = np.sqrt(np.maximum(reference, 0) / sensor.gain_e_per_dn + (sensor.read_noise_e / sensor.gain_e_per_dn) ** 2)
    differs = np.abs(after[region] - brightness * reference) > CHANGE_THRESHOLD * bright + 6 * np.sqrt(2) * noise
    shift_px = shift(before, after, region)
    changed = float(np.mean(differs))
    differences = [
        f"has shifted by {shift_px:.2f} pixels" if has_shifted(shift_px, first.shape[1]) else "",
        f"differs in {percent(changed)} of its pixels" if changed > MAX_CHANGED_SHARE else "",
        f"has {percent(brightness, 0)} of its earlier brightness"
        if abs(brightness - 1) > MAX_BRIGHTNESS_CHANGE
        else "",
    ]
    detail = " and ".join(item for item in differences if item)
    return Comparison(round(shift_px, 3), round(brightness, 4), round(changed, 4), not detail, detail)


def shift(first: FloatArray, second: FloatArray, region: BoolArray) -> float:
    """Estimates the shift, px, of the second image (H, W) by phase correlation (Kuglin and Hines 1975).

    The images are windowed to the region. The cross-power spectrum is low-pass filtered against noise; the peak is
    refined by a parabola through its neighbours.
    """
    rows, columns = np.flatnonzero(region.any(axis=1)), np.flatnonzero(region.any(axis=0))
    box = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    height, width = first[box].shape
    window = np.outer(np.hanning(height), np.hanning(width))
    spectra = [
        np.fft.rfft2((image[box] - np.average(image[box], weights=window)) * window) for image in (first, second)
    ]
    cross = np.conj(spectra[0]) * spectra[1]
    down, across = np.fft.fftfreq(height)[:, None], np.fft.rfftfreq(width)
    coarse = np.exp(-(down**2 + across**2) / (2 * LOW_PASS_CYCLES_PER_PIXEL**2))
    peak = np.fft.irfft2(cross / np.maximum(np.abs(cross), 1e-12) * coarse, s=(height, width))
    row, column = np.unravel_index(int(np.argmax(peak)), peak.shape)
    offset = (_subpixel_peak(peak[:, column], int(row)), _subpixel_peak(peak[row], int(column)))
    return float(np.hypot(*offset))


def _subpixel_peak(values: FloatArray, peak: int) -> float:
    """Returns the sub-sample position of a periodic line's peak (parabolic interpolation), −half to half its length."""
    count = len(values)
    before, here, after = values[peak - 1], values[peak], values[(peak + 1) % count]
    bend = before - 2 * here + after
    place = peak + (0.0 if bend == 0 else 0.5 * (before - after) / bend)
    return place - count if place > count / 2 else place
