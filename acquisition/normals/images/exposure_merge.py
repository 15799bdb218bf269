"""Linear merge of several exposures of one light, by inverse variances of the sensor's noise.

Frames of one light by a linear sensor differ only in exposure time. Each frame, less the lamp-off frame of its time and
divided by that time, measures the same y. They are averaged with the weights 1/v, where v = shot·y + floor of the
frame's own time. A frame counts at a pixel if it is neither saturated nor black there; black is zero, below which a
converter cuts off noise. A pixel that is saturated in every frame is no measurement (`clipped`). One that is black in
every frame keeps its dark value, which the solver takes for shadow. The y in the weights is the mean over the pixel's
total exposure time; it is right to a few σ, and errors of weights have a second-order effect only.

The noise of a pixel depends on which frames count there. The noise stated for an image is that of pixels at which all
frames count; `extra` is the additional variance of the others.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from acquisition import image_values
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.shot import Shot
from acquisition.normals.images.normalised_images import ImageBlock

FrameGroup = Sequence[Shot]
"""Frames of one light and one exposure time."""


def groups(frames: Sequence[Shot]) -> list[FrameGroup]:
    """Groups the frames of one light by exposure time, the shortest first."""
    times = sorted({shot.exposure_s for shot in frames})
    return [[shot for shot in frames if shot.exposure_s == seconds] for seconds in times]


def all_counting(noise: FloatArray) -> FloatArray:
    """Returns shot noise and floor (2,) of pixels at which all frames count, from those of each group (2, G)."""
    return 1 / np.sum(1 / np.maximum(noise, np.finfo(float).tiny), axis=1)


def merge(
    frame_groups: Sequence[FrameGroup], read: Callable[[Shot], npt.NDArray[np.uint16]],
    darks: Mapping[float, npt.NDArray[np.uint16]], noise: FloatArray, calibration: Calibration,
) -> ImageBlock:  # fmt: skip
    """Averages one light's frames, whose pixels (n, w) `read` returns, by inverse variances. `darks` are the lamp-off
    frames' pixels by exposure time, `noise` (2, G) are shot and floor of each group's variance."""
    if len(frame_groups) == 1 and len(frame_groups[0]) == 1:
        shot = frame_groups[0][0]
        frame = read(shot)
        values = image_values.normalised(frame, darks[shot.exposure_s], shot.exposure_s, calibration)
        return ImageBlock(values, image_values.saturated(frame, calibration.sensor))
    means = [_mean(group, read, darks[group[0].exposure_s], calibration) for group in frame_groups]
    values, usable, saturated = (np.stack(parts) for parts in zip(*means, strict=True))
    time = np.array([sum(shot.exposure_s for shot in group) for group in frame_groups], np.float32)
    nowhere = ~np.any(usable, axis=0)
    usable[0] |= nowhere  # such pixels keep a value too
    rough = np.maximum(_weighted(values, usable.astype(np.float32) * time[:, None, None]), 0)
    photons, floor = noise.astype(np.float32)[..., None, None]
    weight = usable.astype(np.float32) / (photons * rough + np.maximum(floor, np.float32(1e-30)))
    merged = _weighted(values, weight)
    all_photons, all_floor = all_counting(noise).astype(np.float32)
    extra = 1 / np.sum(weight, axis=0) - (all_photons * np.maximum(merged, 0) + all_floor)
    # A pixel that saturates at the shortest time saturates at longer times too.
    return ImageBlock(merged, nowhere & saturated[0], np.maximum(extra, 0))


def _mean(
    group: FrameGroup, read: Callable[[Shot], npt.NDArray[np.uint16]], dark: npt.NDArray[np.uint16],
    calibration: Calibration,
) -> tuple[Float32Array, BoolArray, BoolArray]:  # fmt: skip
    """Returns the mean y of equal frames, the pixels at which they count, and those at which one is saturated."""
    total = np.zeros(dark.shape, np.float32)
    saturated, black = np.zeros(dark.shape, np.bool_), np.zeros(dark.shape, np.bool_)
    for shot in group:
        frame = read(shot)
        total += image_values.normalised(frame, dark, shot.exposure_s, calibration)
        saturated |= image_values.saturated(frame, calibration.sensor)
        black |= frame == 0
    return total / np.float32(len(group)), ~(saturated | black), saturated


def _weighted(values: Float32Array, weight: npt.NDArray[np.float32]) -> Float32Array:
    """Returns the mean (n, w) of values (G, n, w) by weights (G, n, w); at each pixel one is positive."""
    return np.asarray(np.sum(weight * values, axis=0) / np.sum(weight, axis=0), np.float32)
