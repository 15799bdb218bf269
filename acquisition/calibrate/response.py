"""Response of the camera by photon transfer (EMVA 1288 4.0): black level, gain, read noise, full well, linearity.

The arm rests at one light and only the exposure time changes, twice with the lamp and twice without at each. What two
frames of one exposure share (the object, fixed pattern, the room) cancels in their difference, whose variance over
brightness is the photon-transfer line (`normals.photon_transfer`). A lab has no integrating sphere, and a lamp on an
arm comes back with another brightness each time. So linearity is not taken from brightness over exposure time: in each
frame bright and dark parts of the image must stay in one ratio, whatever the lamp gave, and by how much they do not is
the sensor's. The lamp's own brightness in each frame is then known too: its scatter, and its drift as it warms up.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.linalg import block_diag

from acquisition.calibrate import defective_pixels
from acquisition.models.base import Float32Array, FloatArray
from acquisition.models.errors import ErrorCode, RigError
from acquisition.normals import photon_transfer
from acquisition.normals.photon_transfer import TransferCurve

MIN_EXPOSURES = 5
"""Exposure times that a line and its bend are found from."""

MAX_CELLS = 150_000
"""Cells of 2 × 2 pixels that photon transfer and linearity read: more of them are not needed."""

USABLE_SHARE = 0.93
"""Share of the range up to which values count: above it noise itself is clipped."""

GROUPS = 12
"""Groups of cells of like brightness by which linearity is judged."""

MIN_GROUP_DN = 12.0
"""Least mean signal of a group, values: below it the black level's error would count."""

BEND_ITERATIONS = 8
"""Gauss–Newton steps for the bend: each brings two more digits."""

PLATEAU = 1.15
"""How far above the range a pixel should be by a shorter exposure before its value counts as that of a full pixel."""

MIN_PLATEAU_PIXELS = 30
"""Full pixels without which the full well is not known, only that it is larger than what was seen."""

LIT_PERCENTILE, LIT_SIGMAS = 99.5, 6.0
"""Percentile of what the lamp adds at the longest exposure, and the multiple of the noise that it has to reach."""


@dataclass(frozen=True)
class ResponseFrame:
    """One frame: exposure time, whether the lamp was on, when it was taken, s, and how its pixels (H, W) are read."""

    name: str
    exposure_s: float
    lit: bool
    taken_at: float
    read: Callable[[], npt.NDArray[np.uint16]]


@dataclass(frozen=True)
class ExposurePoint:
    """What one exposure time showed: mean value above black of the lit frames over that with the lamp off, each lit
    frame's lamp brightness over the mean, and by how much the frames differ in brightness from part to part."""

    exposure_s: float
    mean_dn: float
    dark_dn: float
    lamp: tuple[float, ...]
    nonlinear: float


@dataclass(frozen=True)
class ResponseFit:
    """The camera's response. `values` (5,): black level in values, gain in electrons per value, read noise in
    electrons, full well in electrons, and the relative bend of the response at full scale; `covariance` (5, 5) of them.

    `full` says what limits a pixel: `pixel`, `converter`, or `not reached`. `room` is the light with the lamp off, in
    full scales per second (median, 99.5th percentile), and `room_over_lamp` that over the lamp's; `lamp_sigma` is the
    scatter of the lamp's brightness from frame to frame, `drift` its trend per hour with 1 σ.
    """

    values: FloatArray
    covariance: FloatArray
    full: str
    room: tuple[float, float]
    room_over_lamp: float
    lamp_sigma: float
    drift: tuple[float, float]
    points: tuple[ExposurePoint, ...]
    curve: TransferCurve
    defects: tuple[tuple[int, int, str], ...]
    size: tuple[int, int]


@dataclass(frozen=True)
class _Exposure:
    """The frames of one exposure time."""

    seconds: float
    lit: tuple[ResponseFrame, ...]
    dark: tuple[ResponseFrame, ...]


def estimate(frames: Sequence[ResponseFrame], bits: int) -> ResponseFit:
    """Estimates the response of a camera of `bits` from frames of one scene at several exposure times.

    Raises RigError calibration.infeasible: too few exposure times with two frames each, lamp off, no range of
    brightness, everything clipped.
    """
    exposures = _exposures(frames)
    _require_lamp(exposures[-1])
    top = float(2**bits - 1)
    size = exposures[0].lit[0].read().shape
    cells = _cells(size)
    black, black_variance, dark_levels = _black_level(exposures)
    dark_of = {one.seconds: level for one, level in zip(exposures, dark_levels, strict=True)}
    saturation, saturation_variance, full = _saturation(exposures, black, top)
    usable = black + USABLE_SHARE * (saturation - black)
    curve = _transfer(exposures, cells, black, usable)
    slope, floor, covariance = _line(curve)
    bend, bend_variance, points, lamp, times, room_over_lamp = _linearity(
        exposures, cells, black, saturation, usable, dark_of
    )
    given = block_diag(
        *(np.atleast_2d(one) for one in (black_variance, covariance, saturation_variance, bend_variance))
    )
    values, whole = _in_electrons(np.array([black, slope, floor, saturation, bend]), given)
    longest = exposures[-1]
    range_dn = saturation - black
    darks = [frame.read().astype(np.float32) for frame in longest.dark]
    shortest = [frame.read().astype(np.float32) for frame in exposures[0].dark]
    room = (np.mean(darks, axis=0) - np.mean(shortest, axis=0)) / (range_dn * (longest.seconds - exposures[0].seconds))
    return ResponseFit(
        values, whole, full, (float(np.median(room)), float(np.percentile(room, 99.5))), room_over_lamp,
        *_lamp_trend(lamp, times), points, curve, _defects(exposures, saturation - black, usable), (size[1], size[0]),
    )  # fmt: skip


def _exposures(frames: Sequence[ResponseFrame]) -> list[_Exposure]:
    times = sorted({frame.exposure_s for frame in frames})
    made: list[_Exposure] = []
    for seconds in times:
        lit = tuple(frame for frame in frames if frame.exposure_s == seconds and frame.lit)
        dark = tuple(frame for frame in frames if frame.exposure_s == seconds and not frame.lit)
        if len(lit) >= 2 and len(dark) >= 2:
            made.append(_Exposure(seconds, lit, dark))
    if len(made) < MIN_EXPOSURES:
        raise RigError(
            ErrorCode.CALIBRATION_INFEASIBLE,
            f"{len(made)} exposure times have two frames with the lamp and two without: {MIN_EXPOSURES} are needed",
        )
    return made


def _require_lamp(longest: _Exposure) -> None:
    """Raises RigError calibration.infeasible where the frames with the lamp show no more than those without."""
    lit, off, again = (one.read().astype(np.float64) for one in (longest.lit[0], *longest.dark[:2]))
    noise = float(np.std(off - again)) + 0.5
    if float(np.percentile(lit - off, LIT_PERCENTILE)) < LIT_SIGMAS * noise:
        raise RigError(
            ErrorCode.CALIBRATION_INFEASIBLE,
            f"At {longest.seconds:g} s the image with the lamp is no brighter than that without: is the lamp on, and "
            "does it light what the camera sees?",
        )


def _cells(size: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the upper left pixels of the 2 × 2 cells that are read, spread over the image."""
    rows, columns = np.meshgrid(np.arange(0, size[0] - 1, 2), np.arange(0, size[1] - 1, 2), indexing="ij")
    step = max(1, -(-rows.size // MAX_CELLS))
    return rows.ravel()[::step], columns.ravel()[::step]


def _read_cells(frame: ResponseFrame, cells: tuple[np.ndarray, np.ndarray]) -> FloatArray:
    """Values (4, N) of the cells: upper left, upper right, lower left, lower right."""
    pixels, (rows, columns) = frame.read(), cells
    return np.stack([pixels[rows + i, columns + j] for i in (0, 1) for j in (0, 1)]).astype(np.float64)


def _black_level(exposures: Sequence[_Exposure]) -> tuple[float, float, list[float]]:
    """Value without light and time, with its variance, and the mean of the frames without lamp at each exposure.

    A line over the exposure time: what the room and the dark current add vanishes with it. The room's light changes
    from frame to frame by a share of itself, which is found along (iteratively reweighted least squares).
    """
    times = np.array([one.seconds for one in exposures for _ in one.dark])
    means, noise = np.zeros(len(times)), np.zeros(len(times))
    at = 0
    for one in exposures:
        pixels = [frame.read().astype(np.float64) for frame in one.dark]
        temporal = float(np.var(pixels[0] - pixels[1])) / 2
        for values in pixels:
            means[at], noise[at] = values.mean(), temporal / values.size
            at += 1
    design = np.stack([np.ones_like(times), times], axis=1)
    flicker, changing = 0.05, np.zeros(len(times))
    solution, inverse, residual = np.zeros(2), np.eye(2), np.zeros(len(times))
    for _ in range(8):
        changing = (flicker * max(float(solution[1]), 0.0) * times) ** 2
        weight = 1 / (noise + changing)
        inverse = np.asarray(np.linalg.inv((design * weight[:, None]).T @ design), np.float64)
        solution = inverse @ (design.T @ (weight * means))
        residual = means - design @ solution
        added = np.maximum(solution[1] * times, 1e-9)
        excess = np.sum(weight * (residual**2 - noise)) / np.sum(weight * added**2)
        flicker = float(np.sqrt(np.clip(excess, 1e-6, 1.0)))
    misfit = float(np.sum(residual**2 / (noise + changing))) / max(len(times) - 3, 1)
    levels = [float(np.mean(means[times == one.seconds])) for one in exposures]
    return float(solution[0]), float(inverse[0, 0]) * max(1.0, misfit), levels


def _saturation(exposures: Sequence[_Exposure], black: float, top: float) -> tuple[float, float, str]:
    """Value of a full pixel, its variance, and what limits it."""
    longest = exposures[-1]
    last = longest.lit[0].read()
    clipped = int(np.count_nonzero(last >= top))
    if clipped >= MIN_PLATEAU_PIXELS:
        return top, 0.0, "converter"
    highest = float(np.percentile(last, 99.9))
    for one in exposures[-2::-1]:
        before = one.lit[0].read()
        foretold = black + (before - black) * (longest.seconds / one.seconds)
        if float(before.max()) > black + 0.8 * (highest - black):
            continue
        full = last[foretold > black + PLATEAU * (highest - black)]
        if len(full) >= MIN_PLATEAU_PIXELS:
            return float(np.mean(full)), float(np.var(full)) / len(full), "pixel"
        break
    return highest, 0.0, "not reached"


def _transfer(
    exposures: Sequence[_Exposure], cells: tuple[np.ndarray, np.ndarray], black: float, usable: float
) -> TransferCurve:
    """Photon-transfer curve of all pairs, by sampling errors alone."""
    curves: list[TransferCurve] = []
    for one in exposures:
        for pair in (one.lit, one.dark):
            first, second = (_read_cells(frame, cells) for frame in pair[:2])
            good = (np.maximum(first, second).max(axis=0) < usable) & (np.minimum(first, second).min(axis=0) > 0)
            if np.count_nonzero(good) < photon_transfer.MIN_BIN_COUNT:
                continue
            first, second = first[:, good] - black, second[:, good] - black
            # The lamp was a little brighter in one of the two: brought to one brightness, they have edges in common.
            ratio = float(first.sum() / second.sum()) if one.lit is pair and second.sum() > 0 else 1.0
            apart = first - ratio * second
            # Half the alternating sum of four independent differences has the variance of one.
            alternating = (apart[0] - apart[1] - apart[2] + apart[3]) / 2 / np.sqrt(1 + ratio)
            level = (first + ratio * second).mean(axis=0) / 2
            curve = photon_transfer.transfer_curve(level, alternating, max(usable - black, 1.0), 1.0)
            curves.append(replace(curve, relative=curve.sampling))
    return photon_transfer.concatenate(curves)


def _line(curve: TransferCurve) -> tuple[float, float, FloatArray]:
    """Slope, 1 / gain, and floor of the photon-transfer line, and their covariance (2, 2)."""
    found = photon_transfer.fit_line(curve)
    if found is None or found.slope <= 0 or found.slope_sigma > 0.2 * found.slope:
        raise RigError(
            ErrorCode.CALIBRATION_INFEASIBLE,
            "The noise does not grow with brightness as that of light does: is the image linear (gamma 1, no noise "
            "reduction), is the lamp on, and does the image have bright parts that are not clipped?",
        )
    return found.slope, found.floor, np.array(
        [[found.slope_sigma**2, found.covariance], [found.covariance, found.floor_sigma**2]]
    )  # fmt: skip


def _linearity(
    exposures: Sequence[_Exposure], cells: tuple[np.ndarray, np.ndarray], black: float, saturation: float,
    usable: float, dark_of: dict[float, float],
) -> tuple[float, float, tuple[ExposurePoint, ...], FloatArray, FloatArray, float]:  # fmt: skip
    """Bend of the response at full scale with its variance; the lamp's brightness in each frame over time.

    A signal is z (1 + bend z), z the product of the lamp's brightness in the frame and of the group's own. The variance
    is the jackknife's over frames, because what moves brightness about the image moves it in a whole frame.
    """
    group = _groups(exposures, cells, black, usable)
    rows: list[tuple[int, int, float]] = []
    taken: list[tuple[float, float, float]] = []  # exposure, time, signal
    room_over_lamp = 1.0
    for one in exposures:
        dark = np.mean([_read_cells(frame, cells).mean(axis=0) for frame in one.dark], axis=0)
        for frame in one.lit:
            values = _read_cells(frame, cells)
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
    groups = groups[:, groups.sum(axis=0) > 0][:, 1:]  # the first is the frames' own unit
    others = np.hstack([frames, groups])
    weight = np.sqrt(np.minimum(signal, 400.0))  # of groups that are dark, noise and black level count more
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
            dark_of[one.seconds] - black,
            tuple(float(brightness[number]) for number in own),
            float(np.mean(misfit[own])),
        )
        for one in exposures
        if (own := [number for number, (seconds, _, _) in enumerate(taken) if seconds == one.seconds])
    )
    return bend, bend_variance, points, brightness, np.array([time for _, time, _ in taken]), room_over_lamp


def _slope(column: FloatArray, others: FloatArray, target: FloatArray, weight: FloatArray) -> float:
    """Coefficient of `column` (N,) in weighted least squares on it and `others` (N, M)."""
    weighted = others * weight[:, None]
    away = column - others @ np.linalg.lstsq(weighted, column * weight, rcond=None)[0]
    return float(np.sum(weight**2 * away * target) / np.sum(weight**2 * away**2))


def _groups(
    exposures: Sequence[_Exposure], cells: tuple[np.ndarray, np.ndarray], black: float, usable: float
) -> np.ndarray:
    """Number of each cell's group (N,), of like brightness: equal shares of the range of the longest exposure that
    clips next to nothing."""
    chosen = _read_cells(exposures[0].lit[0], cells).mean(axis=0)
    for one in exposures:
        values = _read_cells(one.lit[0], cells)
        if np.mean(values.max(axis=0) > usable) > 0.01:
            break
        chosen = values.mean(axis=0)
    above = np.maximum(chosen - black, 0)
    edges = np.quantile(above, np.linspace(0, 1, GROUPS + 1)[1:-1])
    return np.searchsorted(edges, above)


def _in_electrons(found: FloatArray, given: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Values (5,) of `ResponseFit` and their covariance (5, 5), to first order, from black level, slope and floor of
    the photon-transfer line, value of a full pixel, and bend, with the covariance of these."""
    black, slope, floor, saturation, bend = found.tolist()
    gain = 1 / slope
    read_variance = max(floor - 1 / 12, 1e-6)  # without rounding (EMVA 1288)
    read_e = gain * float(np.sqrt(read_variance))
    values = np.array([black, gain, read_e, gain * (saturation - black), bend])
    by = np.zeros((5, 5))
    by[0, 0] = 1
    by[1, 1] = -(gain**2)
    by[2, 1], by[2, 2] = -gain * read_e, gain / (2 * np.sqrt(read_variance))
    by[2, 0] = slope * by[2, 2]  # brightness counts from the black level
    by[3, 0], by[3, 1], by[3, 3] = -gain, -(gain**2) * (saturation - black), gain
    by[4, 4] = 1
    return values, by @ given @ by.T


def _lamp_trend(lamp: FloatArray, times: FloatArray) -> tuple[float, tuple[float, float]]:
    """Scatter of the lamp's brightness, as a share, and its trend per hour with 1 σ."""
    hours = (times - times.mean()) / 3600
    spread = float(np.sum(hours**2))
    if len(lamp) < 3 or spread == 0:
        return float(np.std(lamp)), (0.0, float("inf"))
    slope = float(np.sum(hours * lamp)) / spread
    sigma = float(np.sqrt(np.sum((lamp - lamp.mean() - slope * hours) ** 2) / (len(lamp) - 2)))
    return sigma, (slope, sigma / float(np.sqrt(spread)))


def _defects(exposures: Sequence[_Exposure], whole: float, usable: float) -> tuple[tuple[int, int, str], ...]:
    """Defective pixels by the longest exposure in the dark and the longest that is not clipped in the light."""
    lit = [one for one in exposures if np.mean(one.lit[0].read() > usable) < 0.01] or [exposures[0]]
    dark, scale = _mean(exposures[-1].dark), np.float32(1 / whole)
    return defective_pixels.find(scale * dark, scale * (_mean(lit[-1].lit) - _mean(lit[-1].dark)))


def _mean(frames: Sequence[ResponseFrame]) -> Float32Array:
    return np.mean([frame.read().astype(np.float32) for frame in frames], axis=0)
