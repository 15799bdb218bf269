"""Linear merge of several exposures of one light, by inverse variances of the sensor's noise.

A linear sensor's frames of one light differ in exposure time alone: each, less the lamp-off frame of its time and over
that time, measures the same y. So they are averaged with the weights 1/v, v = shot·y + floor of the frame's own time. A
frame counts where it is neither saturated nor black, that is at zero, below which a converter cuts off noise. A pixel
that is saturated in every frame is no measurement (`clipped`); one that is black in every frame stays at its dark
value, which the solver takes for shadow. The weights need y, for which the mean over all the time in which the pixel
was exposed stands in: it is right to a few σ, and errors of weights matter in second order.

What noise a pixel has depends on which frames count there. For each image the solver is told that of pixels at which
all count; `extra` is what the others have beyond it.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.light_plan import FrameExposure
from acquisition.models.shot import Shot

FrameGroup = Sequence[Shot]
"""Frames of one light and one exposure time."""


@dataclass(frozen=True)
class Noise:
    """Variance of y of each group of equal frames, shot·y + floor, (G,) each."""

    shot: FloatArray
    floor: FloatArray

    @classmethod
    def of(cls, groups: Sequence[FrameGroup], calibration: Calibration, ambient_dn: Mapping[float, float]) -> "Noise":
        """Of groups of frames, given the mean signal above black of each exposure time's lamp-off frame."""
        times = [FrameExposure(exposure_s=group[0].exposure_s, frames=len(group)) for group in groups]
        ambient = [ambient_dn[one.exposure_s] for one in times]
        return cls(*photometry.frames_noise(calibration, times, ambient))

    @property
    def all_shot(self) -> float:
        """Shot noise of pixels at which all frames count."""
        return float(1 / np.sum(1 / self.shot))

    @property
    def all_floor(self) -> float:
        """Noise floor of pixels at which all frames count."""
        return float(1 / np.sum(1 / np.maximum(self.floor, np.finfo(float).tiny)))


@dataclass(frozen=True)
class Merged:
    """Values y, pixels that are saturated in every frame, and variance beyond that of all frames; each (n, w)."""

    values: Float32Array
    clipped: BoolArray
    extra: Float32Array | None


def groups(frames: Sequence[Shot]) -> list[FrameGroup]:
    """The frames of one light by exposure time, the shortest first."""
    times = sorted({shot.exposure_s for shot in frames})
    return [[shot for shot in frames if shot.exposure_s == seconds] for seconds in times]


def merge(
    frame_groups: Sequence[FrameGroup], read: Callable[[Shot], npt.NDArray[np.uint16]],
    darks: Mapping[float, npt.NDArray[np.uint16]], noise: Noise, calibration: Calibration,
) -> Merged:  # fmt: skip
    """Weighted mean of one light's frames, whose pixels (n, w) `read` gives; `darks` are the lamp-off frames' pixels by
    exposure time."""
    if len(frame_groups) == 1 and len(frame_groups[0]) == 1:
        shot = frame_groups[0][0]
        frame = read(shot)
        values = photometry.normalised(frame, darks[shot.exposure_s], shot.exposure_s, calibration)
        return Merged(values, photometry.saturated(frame, calibration.sensor), None)
    means = [_mean(group, read, darks[group[0].exposure_s], calibration) for group in frame_groups]
    values, usable, saturated = (np.stack(parts) for parts in zip(*means, strict=True))
    time = np.array([sum(shot.exposure_s for shot in group) for group in frame_groups], np.float32)
    nowhere = ~np.any(usable, axis=0)
    usable[0] |= nowhere  # its value is kept for whoever looks at it
    rough = np.maximum(_weighted(values, usable.astype(np.float32) * time[:, None, None]), 0)
    shot, floor = noise.shot.astype(np.float32), noise.floor.astype(np.float32)
    floor = np.maximum(floor, np.float32(1e-30))
    weight = usable.astype(np.float32) / (shot[:, None, None] * rough + floor[:, None, None])
    merged = _weighted(values, weight)
    present = np.maximum(merged, 0)
    variance = 1 / np.sum(weight, axis=0)
    extra = variance - (np.float32(noise.all_shot) * present + np.float32(noise.all_floor))
    # Where it saturates at the shortest time, longer ones do too.
    return Merged(merged, nowhere & saturated[0], np.maximum(extra, 0))


def _mean(
    group: FrameGroup, read: Callable[[Shot], npt.NDArray[np.uint16]], dark: npt.NDArray[np.uint16],
    calibration: Calibration,
) -> tuple[Float32Array, BoolArray, BoolArray]:  # fmt: skip
    """Mean y of equal frames, where they count, and where one is saturated; each (n, w)."""
    total = np.zeros(dark.shape, np.float32)
    saturated, black = np.zeros(dark.shape, np.bool_), np.zeros(dark.shape, np.bool_)
    for shot in group:
        frame = read(shot)
        total += photometry.normalised(frame, dark, shot.exposure_s, calibration)
        saturated |= photometry.saturated(frame, calibration.sensor)
        black |= frame == 0
    return total / np.float32(len(group)), ~(saturated | black), saturated


def _weighted(values: Float32Array, weight: npt.NDArray[np.float32]) -> Float32Array:
    """Mean (n, w) of values (G, n, w) by weights (G, n, w), one of which is positive everywhere."""
    return np.asarray(np.sum(weight * values, axis=0) / np.sum(weight, axis=0), np.float32)
