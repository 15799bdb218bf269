"""Normalised images in a window of the frame, read in blocks of rows: the input of solvers, from any source.

Solvers may read them several times. A small stack is read once and held in memory. A large one is read again each time,
because reading a file costs less than the memory that would hold it.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import Light

MAX_HELD_BYTES = 1 << 28
"""Size up to which stacks of values and clipped pixels are held in memory."""

BYTES_PER_VALUE, BYTES_PER_EXTRA = 5, 4
"""Bytes of a float32 value and clipped flag, and of a float32 variance beyond the stated one (merged frames only)."""

BLOCK_ROWS = 64
"""Number of rows that are read at once."""


class ImageBlock(NamedTuple):
    """Values y and clipped pixels (F, n, w) of n rows of a window, and their sensor variance beyond shot·y + floor.

    `extra` is none if all pixels of an image have the noise that `shot` and `floor` state.
    """

    values: Float32Array
    clipped: BoolArray
    extra: Float32Array | None = None

    def rows(self, start: int, stop: int) -> "ImageBlock":
        """Returns the rows [start, stop)."""
        extra = None if self.extra is None else self.extra[:, start:stop]
        return ImageBlock(self.values[:, start:stop], self.clipped[:, start:stop], extra)


@dataclass(frozen=True)
class Images:
    """Images in the window `rows`, `columns` of the frame, with the light of each (F).

    `read` returns the rows [start, stop), counted from the window's first. `shot` and `floor` (F,) are the sensor's
    part of the variance of y, shot·y + floor. If the sensor is unknown they are zero and the quantisation variance, and
    the rest is estimated from the residuals. `labels` (F,) name the images in messages; empty: their numbers, from 0.
    `metric` is false if lights and camera stand at distances that nobody stated, so that messages name no lengths.
    """

    read: Callable[[int, int], ImageBlock]
    lights: tuple[Light, ...]
    rows: slice
    columns: slice
    shot: FloatArray
    floor: FloatArray
    labels: tuple[str, ...] = ()
    metric: bool = True

    def label(self, number: int) -> str:
        """Returns the name of an image in messages: its number, counted from 0, and its file if it has one."""
        return self.labels[number] if self.labels else str(number)

    @property
    def height(self) -> int:
        """Number of rows of the window."""
        return int(self.rows.stop - self.rows.start)

    @property
    def whole(self) -> ImageBlock:
        """All rows of the window."""
        return self.read(0, self.height)


def row_blocks(height: int) -> Iterator[slice]:
    """Partitions rows into blocks of BLOCK_ROWS."""
    return (slice(start, min(start + BLOCK_ROWS, height)) for start in range(0, height, BLOCK_ROWS))


def held_if_small(images: Images, *, merged: bool = False) -> Images:
    """Reads images up to MAX_HELD_BYTES into memory; larger ones are not held. `merged`: the images have `extra`."""
    size = (len(images.lights), images.height, int(images.columns.stop - images.columns.start))
    if (BYTES_PER_VALUE + BYTES_PER_EXTRA * merged) * np.prod(size) > MAX_HELD_BYTES:
        return images
    held = ImageBlock(
        np.empty(size, np.float32), np.empty(size, np.bool_), np.zeros(size, np.float32) if merged else None
    )
    for rows in row_blocks(images.height):
        for into, part in zip(held, images.read(rows.start, rows.stop), strict=True):
            if into is not None and part is not None:
                into[:, rows] = part
    return replace(images, read=held.rows)


def refuse_few(count: int) -> None:
    """Raises RigError normals.infeasible for fewer than three lit images."""
    if count < 3:
        raise RigError(
            ErrorCode.NORMALS_INFEASIBLE,
            f"there are {count} lit images and at least three are needed: take more lights",
            lights=count,
        )
