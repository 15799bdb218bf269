"""Frames for the camera's response, grouped by exposure time, and the cells of pixels that are read."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from acquisition.models.base import FloatArray
from acquisition.models.errors import ErrorCode, RigError

MIN_EXPOSURES = 5
"""Least number of exposure times for a line and its bend."""

MAX_CELLS = 150_000
"""Largest number of 2 × 2 cells that photon transfer and linearity read: more are not needed."""

LIT_PERCENTILE, LIT_SIGMAS = 99.5, 6.0
"""Percentile of the lamp's contribution at the longest exposure, and the multiple of the noise that it must reach."""


@dataclass(frozen=True)
class ResponseFrame:
    """One frame: exposure time, whether the lamp was on, when it was taken, s, and a reader of its pixels (H, W)."""

    name: str
    exposure_s: float
    lit: bool
    taken_at: float
    read: Callable[[], npt.NDArray[np.uint16]]


@dataclass(frozen=True)
class Exposure:
    """The frames of one exposure time."""

    seconds: float
    lit: tuple[ResponseFrame, ...]
    dark: tuple[ResponseFrame, ...]


def by_exposure(frames: Sequence[ResponseFrame]) -> list[Exposure]:
    """Groups the frames by exposure time, shortest first; keeps times with two frames with the lamp and two without.

    Raises RigError calibration.infeasible if these are too few.
    """
    times = sorted({frame.exposure_s for frame in frames})
    made: list[Exposure] = []
    for seconds in times:
        lit = tuple(frame for frame in frames if frame.exposure_s == seconds and frame.lit)
        dark = tuple(frame for frame in frames if frame.exposure_s == seconds and not frame.lit)
        if len(lit) >= 2 and len(dark) >= 2:
            made.append(Exposure(seconds, lit, dark))
    if len(made) < MIN_EXPOSURES:
        raise RigError(
            ErrorCode.CALIBRATION_INFEASIBLE,
            f"{len(made)} exposure times have two frames with the lamp and two without: {MIN_EXPOSURES} are needed",
        )
    return made


def require_lamp(longest: Exposure) -> None:
    """Raises RigError calibration.infeasible if the frames with the lamp are no brighter than those without."""
    lit, off, again = (one.read().astype(np.float64) for one in (longest.lit[0], *longest.dark[:2]))
    noise = float(np.std(off - again)) + 0.5
    if float(np.percentile(lit - off, LIT_PERCENTILE)) < LIT_SIGMAS * noise:
        raise RigError(
            ErrorCode.CALIBRATION_INFEASIBLE,
            f"At {longest.seconds:g} s the image with the lamp is no brighter than that without: is the lamp on, and "
            "does it light what the camera sees?",
        )


def cells_of(size: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Returns rows and columns of the upper left pixels of the 2 × 2 cells that are read, spread over the image."""
    rows, columns = np.meshgrid(np.arange(0, size[0] - 1, 2), np.arange(0, size[1] - 1, 2), indexing="ij")
    step = max(1, -(-rows.size // MAX_CELLS))
    return rows.ravel()[::step], columns.ravel()[::step]


def read_cells(frame: ResponseFrame, cells: tuple[np.ndarray, np.ndarray]) -> FloatArray:
    """Returns the values (4, N) of the cells: upper left, upper right, lower left, lower right."""
    pixels, (rows, columns) = frame.read(), cells
    return np.stack([pixels[rows + i, columns + j] for i in (0, 1) for j in (0, 1)]).astype(np.float64)
