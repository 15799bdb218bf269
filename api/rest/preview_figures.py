"""Figures of a preview image: histogram, clipped shares, level and focus, over the pixels where the object can be.

They are measured on the linear frame, not on the JPEG, which is brightened for display. The focus score is the
sharpness by which the capture checks its frames (`acquisition.capture.check`), so that a lens focused with it is sharp
by the same measure. The score depends on the object; compare it only with other scores of the same object.
"""

from datetime import datetime
from typing import Literal

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import Field

from acquisition.capture import check
from acquisition.models.base import BoolArray
from acquisition.models.calibration import SensorModel
from api.rest.schemas import Resource

BINS = 64
"""Number of bins of the histogram over all values of the sensor."""

DARK_SIGMAS = 3.0
"""Threshold of black pixels (no measurable light): standard deviations of the read noise above the black level."""

FILTER_PX = 8
"""Reach of the sharpness filters, px: four times σ of the wider one."""

MAX_SIDE_PX = 640
"""Longest side of the clipping overlay, px. A cell of the overlay is marked if any of its pixels is clipped."""

RED, BLUE, CLEAR = (0, 0, 255, 255), (255, 96, 0, 255), (0, 0, 0, 0)
"""Colours (blue, green, red, opacity) of saturated, black and other pixels in the overlay."""

Pixels = npt.NDArray[np.uint16]


class PreviewFigures(Resource):
    """Figures of one preview image; `frame` is the number in the header `X-Frame-Number` of that frame's picture."""

    frame: int = Field(description="Number of the frame, counted since the service began")
    taken_at: datetime | None = Field(description="When it was exposed, UTC; null for a stored frame of a session")
    exposure_s: float | None = Field(description="Its exposure time, s; null for a stored frame of a session")
    width_px: int = Field(description="Width of the frame, px")
    height_px: int = Field(description="Height of the frame, px")
    area: Literal["keep-out", "frame"] = Field(
        description="Which pixels the figures count: those where the object can be, or all where the frame has not the "
        "calibration's size"
    )
    histogram: list[int] = Field(description="Pixels in each bin, from the value 0 to the sensor's largest")
    bin_width_dn: float = Field(description="Width of a bin in values of the sensor, DN")
    black_level_dn: float = Field(description="The sensor's value without light, DN")
    saturated: float = Field(ge=0, le=1, description="Share of pixels at the sensor's largest value")
    black: float = Field(ge=0, le=1, description="Share of pixels without measurable light (within 3 σ of read noise)")
    bright_level: float = Field(description="99.5th percentile of the signal, fraction of full scale")
    focus: float | None = Field(
        description="Focus score, no unit: variance of detail of one pixel's size over that of two, noise removed; the "
        "larger the sharper; null where there is no detail"
    )


def measured(
    pixels: Pixels, keep_out: BoolArray, sensor: SensorModel, *, frame: int, taken_at: datetime | None,
    exposure_s: float | None,
) -> PreviewFigures:  # fmt: skip
    """Measures the figures of a frame (H, W, linear) over the pixels `keep_out`, or over all if its size differs."""
    fits = keep_out.shape == pixels.shape
    area = keep_out if fits else np.ones(pixels.shape, np.bool_)
    values = pixels[area]
    histogram, _ = np.histogram(values, bins=BINS, range=(0, 2**sensor.bits))
    bright = float(np.percentile(values, check.BRIGHT_PERCENTILE))
    height, width = pixels.shape
    box = _box_around(area)
    return PreviewFigures(
        frame=frame,
        taken_at=taken_at,
        exposure_s=exposure_s,
        width_px=width,
        height_px=height,
        area="keep-out" if fits else "frame",
        histogram=[int(count) for count in histogram],
        bin_width_dn=2**sensor.bits / BINS,
        black_level_dn=sensor.black_level_dn,
        saturated=float(np.mean(_is_saturated(values, sensor))),
        black=float(np.mean(_is_black(values, sensor))),
        bright_level=(bright - sensor.black_level_dn) / sensor.full_scale_dn,
        focus=check.sharpness(pixels[box], area[box], sensor),
    )


def clipping_overlay(pixels: Pixels, sensor: SensorModel) -> bytes:
    """Returns a transparent PNG to lay over the picture: red where the frame is saturated, blue where it is black."""
    step = max(1, -(-max(pixels.shape) // MAX_SIDE_PX))
    overlay = np.full((*(-(-side // step) for side in pixels.shape), 4), CLEAR, np.uint8)
    overlay[_any_in_cells(_is_black(pixels, sensor), step)] = BLUE
    overlay[_any_in_cells(_is_saturated(pixels, sensor), step)] = RED
    return cv2.imencode(".png", overlay)[1].tobytes()


def _box_around(area: BoolArray) -> tuple[slice, slice]:
    """Returns the rows and columns of the area and of the surroundings that the sharpness filters reach."""
    rows, columns = (np.flatnonzero(area.any(axis=axis)) for axis in (1, 0))
    first = max(rows[0] - FILTER_PX, 0), max(columns[0] - FILTER_PX, 0)
    return slice(first[0], rows[-1] + FILTER_PX + 1), slice(first[1], columns[-1] + FILTER_PX + 1)


def _is_saturated(values: Pixels, sensor: SensorModel) -> BoolArray:
    return values >= 2**sensor.bits - 1


def _is_black(values: Pixels, sensor: SensorModel) -> BoolArray:
    return values <= sensor.black_level_dn + DARK_SIGMAS * sensor.read_noise_e / sensor.gain_e_per_dn


def _any_in_cells(mask: BoolArray, step: int) -> BoolArray:
    """Returns whether any pixel of each cell of `step` × `step` pixels is set."""
    rows, columns = (np.arange(0, side, step) for side in mask.shape)
    return np.logical_or.reduceat(np.logical_or.reduceat(mask, rows, axis=0), columns, axis=1)
