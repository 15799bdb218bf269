"""Linearity of the response by the ratios of bright and dark parts of each frame, and the lamp's brightness in it.

A lamp on an arm has another brightness each time. So linearity is not measured as brightness over exposure time, but
within each frame: whatever the lamp's brightness, the ratio of two parts of a frame must stay the same.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from acquisition.calibrate.response_frames import Exposure, read_cells
from acquisition.models.base import FloatArray
from acquisition.models.errors import ErrorCode, RigError

GROUPS = 12
"""Groups of cells of similar brightness by which linearity is judged."""

MIN_GROUP_DN = 12.0
"""Least mean signal of a group, values: below it the black level's error would matter."""

BEND_ITERATIONS = 8
"""Gauss–Newton steps for the bend: each gives two more digits."""


@dataclass(frozen=True)
class ExposurePoint:
    """Result of one exposure time: mean signal of the lit frames (lamp-off subtracted) and of the lamp-off frames above
    black; lamp brightness of each lit frame over the mean; rms deviation of the frames' groups from linearity."""

    exposure_s: float
    mean_dn: float
    dark_dn: float
    lamp: tuple[float, ...]
    nonlinear: float


@dataclass(frozen=True)
class Linearity:
    """Bend of the response at full scale with its variance; the result of each exposure time; the lamp's scatter, as a
    share, and its trend per hour with 1 σ; the ratio of the room's light to the lamp's."""

    bend: float
    bend_variance: float
    points: tuple[ExposurePoint, ...]
    lamp_trend: tuple[float, tuple[float, float]]
    room_over_lamp: float


def fit(
    exposures: Sequence[Exposure], cells: tuple[np.ndarray, np.ndarray], black: float, saturation: float, usable: float
) -> Linearity:
    """Fits the bend of the response, each frame's brightness and each group's by Gauss–Newton on ln signal.

    A signal is z (1 + bend z); z is the product of the lamp's brightness in the frame and of the group's own. The
    variance is the jackknife's over frames, because effects that move brightness within the image do so in a whole
    frame. Raises RigError calibration.infeasible if brightness has no range.
    """
    group = _groups(exposures, cells, black, usable)
    rows: list[tuple[int, int, float]] = []
    taken: list[tuple[float, float, float]] = []  # exposure, time, signal
    room_over_lamp = 1.0
    for one in exposures:
        dark = np.mean([read_cells(frame, cells).mean(axis=0) for frame in one.dark], axis=0)
        for frame in one.lit:
            values = read_cells(frame, cells)
            clipped = np.bincount(group, values.max(axis=0) > usable, GROUPS) > 0
            count = np.bincount(group, minlength=GROUPS)
            signal = np.bincount(group, values.mean(axis=0) - dark, GROUPS) / np.maximum(count, 1)
            number = len(taken)
            kept = np.flatnonzero(~clipped & (signal > MIN_GROUP_DN) & (count > 0))
            if len(kept) < 2:
                continue
            rows += [(number, int(which), float(signal[which])) for which in kept]
            taken.append((one.seconds, frame.taken_at, float(np.mean(signal))))
            room_over_lamp = float(dark.mean() - black) / max(float(signal.max()), 1e-9)
    if len({seconds for seconds, _, _ in taken}) < 3:
        raise RigError(
            ErrorCode.CALIBRATION_INFEASIBLE,
            "The image is too dark, clipped, or equally bright all over: let it show an object or a plane that is "
            "bright in one part and dark in another, well lit and not clipped",
        )
    frame_of = np.array([row[0] for row in rows])
    signal = np.array([row[2] for row in rows])
    share = signal / (saturation - black)
    frames = np.eye(len(taken))[frame_of]
    groups = np.eye(GROUPS)[np.array([row[1] for row in rows])]
    groups = groups[:, groups.sum(axis=0) > 0][:, 1:]  # the frames' brightness is in units of the first group
    others = np.hstack([frames, groups])
    weight = np.sqrt(np.minimum(signal, 400.0))  # noise and black level matter more in dark groups
    bend, straight, by_bend, target = 0.0, share, share, np.log(signal)
    for _ in range(BEND_ITERATIONS):
        straight = share / (1 + bend * straight)
        by_bend = straight / (1 + bend * straight)
        target = np.log(signal) - np.log1p(bend * straight) + bend * by_bend
        bend = _slope(by_bend, others, target, weight)
    without = [_slope(by_bend, others, target, weight * (frame_of != number)) for number in range(len(taken))]
    bend_variance = (len(taken) - 1) * float(np.mean((np.array(without) - bend) ** 2))
    rest = target - bend * by_bend
    solution = np.linalg.lstsq(others * weight[:, None], rest * weight, rcond=None)[0]
    residual = rest - others @ solution
    brightness = np.exp(solution[: len(taken)]) / np.array([seconds for seconds, _, _ in taken])
    brightness /= brightness.mean()
    misfit = np.sqrt(np.bincount(frame_of, residual**2, len(taken)) / np.bincount(frame_of, minlength=len(taken)))
    points = tuple(
        ExposurePoint(
            one.seconds,
            float(np.mean([taken[number][2] for number in own])),
            float(np.mean([np.mean(frame.read()) for frame in one.dark])) - black,
            tuple(float(brightness[number]) for number in own),
            float(np.mean(misfit[own])),
        )
        for one in exposures
        if (own := [number for number, (seconds, _, _) in enumerate(taken) if seconds == one.seconds])
    )
    when = np.array([time for _, time, _ in taken])
    return Linearity(bend, bend_variance, points, _lamp_trend(brightness, when), room_over_lamp)


def _slope(column: FloatArray, others: FloatArray, target: FloatArray, weight: FloatArray) -> float:
    """Coefficient of `column` (N,) in weighted least squares on it and `others` (N, M)."""
    weighted = others * weight[:, None]
    away = column - others @ np.linalg.lstsq(weighted, column * weight, rcond=None)[0]
    return float(np.sum(weight**2 * away * target) / np.sum(weight**2 * away**2))


def _groups(
    exposures: Sequence[Exposure], cells: tuple[np.ndarray, np.ndarray], black: float, usable: float
) -> np.ndarray:
    """Group number (N,) of each cell: quantiles of brightness in the longest exposure in which at most 1 % of the cells
    clip."""
    chosen = read_cells(exposures[0].lit[0], cells).mean(axis=0)
    for one in exposures:
        values = read_cells(one.lit[0], cells)
        if np.mean(values.max(axis=0) > usable) > 0.01:
            break
        chosen = values.mean(axis=0)
    above = np.maximum(chosen - black, 0)
    edges = np.quantile(above, np.linspace(0, 1, GROUPS + 1)[1:-1])
    return np.searchsorted(edges, above)


def _lamp_trend(lamp: FloatArray, times: FloatArray) -> tuple[float, tuple[float, float]]:
    """Returns the scatter of the lamp's brightness, as a share, and its trend per hour with 1 σ."""
    hours = (times - times.mean()) / 3600
    spread = float(np.sum(hours**2))
    if len(lamp) < 3 or spread == 0:
        return float(np.std(lamp)), (0.0, float("inf"))
    slope = float(np.sum(hours * lamp)) / spread
    sigma = float(np.sqrt(np.sum((lamp - lamp.mean() - slope * hours) ** 2) / (len(lamp) - 2)))
    return sigma, (slope, sigma / float(np.sqrt(spread)))
