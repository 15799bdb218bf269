"""Frames to normalised values: the images of a session within a window, in blocks of rows.

The lamp-off frame of the same exposure time removes ambient light, black level and dark current at once. Solvers are
given `Images`, which they may read several times: a small stack is read once and held in memory, a large one is read
again each time, because reading a file costs less than the memory that would hold it.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np

from acquisition import lamp_pose, photometry
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import Light
from acquisition.models.shot import Observations, Shot
from acquisition.normals import exposure_merge

MAX_HELD_BYTES = 1 << 28
"""Size up to which stacks of values and clipped pixels are held in memory."""

BYTES_PER_VALUE, BYTES_PER_EXTRA = 5, 4
"""float32 value and clipped flag; float32 variance beyond the stated one, of merged exposures only."""

BLOCK_ROWS = 64
"""Rows that are read at once."""


class ImageBlock(NamedTuple):
    """Values y and clipped pixels (F, n, w) of n rows of a window, and their sensor variance beyond shot·y + floor.

    `extra` is none where all pixels of an image have the noise that `shot` and `floor` state.
    """

    values: Float32Array
    clipped: BoolArray
    extra: Float32Array | None = None


class Images(Protocol):
    """Images in a window of the frame, from any source, with their lights and sensor noise.

    `shot` and `floor` (F,) are the sensor's part of the variance of y, shot·y + floor; where nothing is known of the
    sensor they are zero and the quantisation variance, and the rest is estimated from the residuals.
    """

    @property
    def lights(self) -> tuple[Light, ...]:
        """The light of each image (F)."""
        ...

    @property
    def rows(self) -> slice:
        """The window's rows in the frame."""
        ...

    @property
    def columns(self) -> slice:
        """The window's columns in the frame."""
        ...

    @property
    def shot(self) -> FloatArray: ...

    @property
    def floor(self) -> FloatArray: ...

    def read(self, start: int, stop: int, /) -> ImageBlock:
        """Reads the rows [start, stop), counted from the window's first."""
        ...


@dataclass(frozen=True)
class ImageStack:
    """`Images` in memory: values y and clipped pixels (F, h, w)."""

    values: Float32Array
    clipped: BoolArray
    lights: tuple[Light, ...]
    rows: slice
    columns: slice
    shot: FloatArray
    floor: FloatArray
    extra: Float32Array | None = None

    def read(self, start: int, stop: int) -> ImageBlock:
        """Slices the rows [start, stop)."""
        extra = None if self.extra is None else self.extra[:, start:stop]
        return ImageBlock(self.values[:, start:stop], self.clipped[:, start:stop], extra)


@dataclass(frozen=True)
class StoredImages:
    """`Images` that are read from their files each time; `merged`: of some, several exposures were merged."""

    read: Callable[[int, int], ImageBlock]
    lights: tuple[Light, ...]
    rows: slice
    columns: slice
    shot: FloatArray
    floor: FloatArray
    merged: bool = False


def derived(
    images: Images, read: Callable[[int, int], ImageBlock], shot: FloatArray | None = None,
    floor: FloatArray | None = None,
) -> StoredImages:  # fmt: skip
    """Images with the lights and the window of others, read otherwise, and with another noise (F,) where given."""
    return StoredImages(
        read,
        images.lights,
        images.rows,
        images.columns,
        images.shot if shot is None else shot,
        images.floor if floor is None else floor,
    )


def part(images: Images, rows: slice) -> StoredImages:
    """Some rows of a window, counted from its first, as images of their own; they are read through the whole
    window's."""
    inside = derived(images, lambda start, stop: images.read(rows.start + start, rows.start + stop))
    return replace(inside, rows=slice(images.rows.start + rows.start, images.rows.start + rows.stop))


def held_if_small(images: StoredImages) -> ImageStack | StoredImages:
    """Reads images up to MAX_HELD_BYTES into memory; larger ones stay in their files."""
    count, height, width = len(images.lights), _length(images.rows), _length(images.columns)
    size = (count, height, width)
    if (BYTES_PER_VALUE + BYTES_PER_EXTRA * images.merged) * count * height * width > MAX_HELD_BYTES:
        return images
    values, clipped = np.empty(size, np.float32), np.empty(size, np.bool_)
    extra = np.zeros(size, np.float32) if images.merged else None
    for start in range(0, height, BLOCK_ROWS):
        rows = slice(start, min(start + BLOCK_ROWS, height))
        block = images.read(rows.start, rows.stop)
        values[:, rows], clipped[:, rows] = block.values, block.clipped
        if extra is not None and block.extra is not None:
            extra[:, rows] = block.extra
    return ImageStack(values, clipped, images.lights, images.rows, images.columns, images.shot, images.floor, extra)


def lit_shots(observations: Observations) -> list[tuple[Shot, Light]]:
    """The lit shots, each with its light. Raises RigError normals.infeasible when there are fewer than three."""
    shots = [(shot, shot.light) for shot in observations.shots if shot.kind == "light" and shot.light is not None]
    if len(shots) < 3:
        raise RigError(
            ErrorCode.NORMALS_INFEASIBLE,
            f"there are {len(shots)} lit images and at least three are needed: take more lights",
            lights=len(shots),
        )
    positions = np.array([light.position for _, light in shots])
    if not np.all(np.isfinite(positions)):
        raise RigError(ErrorCode.NORMALS_INFEASIBLE, "a light's position is not a number: measure the pose again")
    return shots


def read(
    observations: Observations, calibration: Calibration, rows: slice, columns: slice,
    log_intensity: FloatArray | None = None,
) -> ImageStack | StoredImages:  # fmt: skip
    """Dark-frame subtraction, normalisation and flat field of all lit images within a window of rows and columns.

    `log_intensity` (F,): how much brighter than calibrated each image's lamp was, where that is known; divided out.
    An image of several exposures is merged from them (`exposure_merge`). The sensor's noise is stated
    for pixels in the image's centre: it differs by the lens's few per cent elsewhere.

    Raises RigError normals.infeasible when a frame's size is not the calibration's or a lamp-off frame is missing.
    """
    shots, lights = zip(*lit_shots(observations), strict=True)
    sets = [exposure_merge.groups(observations.frames_of(shot)) for shot in shots]
    frames = [shot for groups in sets for group in groups for shot in group]
    darks = {shot.exposure_s: _lamp_off_shot(observations, shot) for shot in frames}
    factors = np.exp(np.zeros(len(shots)) if log_intensity is None else log_intensity)
    for shot in (*frames, *darks.values()):
        _refuse_other_size(shot, calibration)
    black = calibration.sensor.black_level_dn
    ambient = {seconds: _window_mean(observations, dark, rows, columns) - black for seconds, dark in darks.items()}
    noise = [exposure_merge.Noise.of(groups, calibration, ambient) for groups in sets]
    merged = any(len(groups) > 1 or len(groups[0]) > 1 for groups in sets)

    def block(start: int, stop: int) -> ImageBlock:
        lines = rows.start + start, rows.start + stop

        def window(shot: Shot) -> np.ndarray:
            return observations.frames.rows(shot.frame, *lines)[:, columns]

        dark = {seconds: window(shot) for seconds, shot in darks.items()}
        extra = np.zeros((len(shots), stop - start, _length(columns)), np.float32) if merged else None
        sensitivity = photometry.sensitivity(calibration, slice(*lines), columns)
        size = (len(shots), stop - start, _length(columns))
        values, clipped = np.empty(size, np.float32), np.empty(size, np.bool_)
        for index, groups in enumerate(sets):
            one = exposure_merge.merge(groups, window, dark, noise[index], calibration)
            values[index], clipped[index] = one.values, one.clipped
            if extra is not None and one.extra is not None:
                extra[index] = one.extra / np.float32(factors[index] ** 2)
        if sensitivity is not None:
            values /= sensitivity
        if log_intensity is not None:
            values /= factors.astype(np.float32)[:, None, None]
        return ImageBlock(values, clipped, extra)

    photons, floor = (np.array([getattr(one, name) for one in noise]) for name in ("all_shot", "all_floor"))
    stored = StoredImages(block, lights, rows, columns, photons / factors, floor / factors**2, merged)
    return held_if_small(stored)


def common_lamp_errors(observations: Observations, calibration: Calibration) -> FloatArray | None:
    """`lamp_pose.common_errors` of the lit images (F, 3, C); none where a tool pose is not on record."""
    poses = [shot.base_from_tool for shot, _ in lit_shots(observations)]
    known = [pose for pose in poses if pose is not None]
    return lamp_pose.common_errors(np.array(known), calibration) if len(known) == len(poses) else None


def _length(part: slice) -> int:
    return int(part.stop - part.start)


def _window_mean(observations: Observations, shot: Shot, rows: slice, columns: slice) -> float:
    """The mean of a frame's window."""
    total = 0.0
    for start in range(rows.start, rows.stop, BLOCK_ROWS):
        stop = min(start + BLOCK_ROWS, rows.stop)
        total += float(np.sum(observations.frames.rows(shot.frame, start, stop)[:, columns], dtype=np.float64))
    return total / (_length(rows) * _length(columns))


def _lamp_off_shot(observations: Observations, shot: Shot) -> Shot:
    try:
        return observations.darks[shot.exposure_s]
    except KeyError:
        raise RigError(
            ErrorCode.NORMALS_INFEASIBLE,
            f"there is no lamp-off frame for the exposure time {shot.exposure_s:.6g} s of {shot.frame.path}: take one",
            file=shot.frame.path,
        ) from None


def _refuse_other_size(shot: Shot, calibration: Calibration) -> None:
    frame = shot.frame
    if (frame.width, frame.height) != (calibration.width, calibration.height):
        raise RigError(
            ErrorCode.NORMALS_INFEASIBLE,
            f"{frame.path} is {frame.width} × {frame.height} pixels, the calibration {calibration.width} × "
            f"{calibration.height}: use the images and the calibration of one camera",
            file=frame.path,
        )
