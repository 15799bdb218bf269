"""Response of the camera by photon transfer (EMVA 1288 4.0): black level, gain, read noise, full well, linearity.

The arm rests at one light and only the exposure time changes, with two lit and two lamp-off frames at each. What two
frames of one exposure share (the object, fixed pattern, the room) cancels in their difference, whose variance over
brightness is the photon-transfer line (`normals.photon_transfer`). A lab has no integrating sphere, and a lamp on an
arm has another brightness each time. So linearity is not measured as brightness over exposure time: in each frame the
ratio of bright and dark parts must stay the same, whatever the lamp's brightness, and deviations are the sensor's. This
also gives the lamp's brightness in each frame: its scatter, and its drift as it warms up.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from acquisition import photometry
from acquisition.calibrate import defective_pixels, linearity, response_frames
from acquisition.calibrate.linearity import ExposurePoint
from acquisition.calibrate.response_frames import Exposure, ResponseFrame, read_cells
from acquisition.models.base import Float32Array, FloatArray
from acquisition.models.errors import ErrorCode, RigError
from acquisition.normals.uncertainty import photon_transfer
from acquisition.normals.uncertainty.photon_transfer import TransferCurve

USABLE_SHARE = 0.93
"""Share of the range up to which values count: above it the noise itself is clipped."""

PLATEAU = 1.15
"""A pixel counts as full if a shorter exposure predicts for it a value above the range by this factor."""

MIN_PLATEAU_PIXELS = 30
"""Least number of full pixels; with fewer only a lower bound of the full well is known."""


@dataclass(frozen=True)
class ResponseFit:
    """The camera's response. `values` (5,): black level in values, gain in electrons per value, read noise in
    electrons, full well in electrons, and the relative bend of the response at full scale; `covariance` (5, 5) of them.

    `full` states what limits a pixel: `pixel`, `converter`, or `not reached`. `room` is the light with the lamp off, in
    full scales per second (median, 99.5th percentile), and `room_over_lamp` its ratio to the lamp's; `lamp_sigma` is
    the scatter of the lamp's brightness from frame to frame, `drift` its trend per hour with 1 σ.
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


def estimate(frames: Sequence[ResponseFrame], bits: int) -> ResponseFit:
    """Estimates the response of a camera of `bits` from frames of one scene at several exposure times.

    Raises RigError calibration.infeasible for too few exposure times with two frames each, lamp off, no range of
    brightness, or everything clipped.
    """
    exposures = response_frames.by_exposure(frames)
    response_frames.require_lamp(exposures[-1])
    top = float(2**bits - 1)
    size = exposures[0].lit[0].read().shape
    cells = response_frames.cells_of(size)
    black, black_variance = _black_level(exposures)
    saturation, saturation_variance, full = _saturation(exposures, black, top)
    usable = black + USABLE_SHARE * (saturation - black)
    curve = _transfer(exposures, cells, black, usable)
    slope, floor, covariance = _line(curve)
    straight = linearity.fit(exposures, cells, black, saturation, usable)
    given = block_diag(
        *(np.atleast_2d(one) for one in (black_variance, covariance, saturation_variance, straight.bend_variance))
    )
    values, whole = _in_electrons(np.array([black, slope, floor, saturation, straight.bend]), given)
    longest = exposures[-1]
    range_dn = saturation - black
    room = _mean(longest.dark) - _mean(exposures[0].dark)
    room /= range_dn * (longest.seconds - exposures[0].seconds)
    return ResponseFit(
        values, whole, full, (float(np.median(room)), float(np.percentile(room, 99.5))), straight.room_over_lamp,
        *straight.lamp_trend, straight.points, curve, _defects(exposures, range_dn, usable), (size[1], size[0]),
    )  # fmt: skip


def _black_level(exposures: Sequence[Exposure]) -> tuple[float, float]:
    """Estimates the value without light and time, with its variance, by a line over the exposure time.

    The room's light and the dark current vanish with the time. The room's light changes from frame to frame by a share
    of itself, which is estimated along (iteratively reweighted least squares).
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
    return float(solution[0]), float(inverse[0, 0]) * max(1.0, misfit)


def _saturation(exposures: Sequence[Exposure], black: float, top: float) -> tuple[float, float, str]:
    """Returns the value of a full pixel, its variance, and what limits it."""
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
    exposures: Sequence[Exposure], cells: tuple[np.ndarray, np.ndarray], black: float, usable: float
) -> TransferCurve:
    """Photon-transfer curve of all pairs."""
    curves: list[TransferCurve] = []
    for one in exposures:
        for pair in (one.lit, one.dark):
            first, second = (read_cells(frame, cells) for frame in pair[:2])
            good = (np.maximum(first, second).max(axis=0) < usable) & (np.minimum(first, second).min(axis=0) > 0)
            if np.count_nonzero(good) < photometry.SETTINGS.min_sample:
                continue
            first, second = first[:, good] - black, second[:, good] - black
            # The lamp was a little brighter in one of the two: brought to one brightness, they have edges in common.
            ratio = float(first.sum() / second.sum()) if one.lit is pair and second.sum() > 0 else 1.0
            apart = first - ratio * second
            # Half the alternating sum of four independent differences has the variance of one.
            alternating = photon_transfer.quad_differences(apart) / np.sqrt(1 + ratio)
            level = (first + ratio * second).mean(axis=0) / 2
            curves.append(photon_transfer.transfer_curve(level, alternating, max(usable - black, 1.0), 1.0))
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


def _in_electrons(found: FloatArray, given: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Converts to values (5,) of `ResponseFit` and their covariance (5, 5), to first order, from black level, slope and
    floor of the photon-transfer line, value of a full pixel, and bend, with the covariance of these."""
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


def _defects(exposures: Sequence[Exposure], whole: float, usable: float) -> tuple[tuple[int, int, str], ...]:
    """Finds defective pixels by the longest dark exposure and the longest lit one that is not clipped."""
    lit = [one for one in exposures if np.mean(one.lit[0].read() > usable) < 0.01] or [exposures[0]]
    dark, scale = _mean(exposures[-1].dark), np.float32(1 / whole)
    return defective_pixels.find(scale * dark, scale * (_mean(lit[-1].lit) - _mean(lit[-1].dark)))


def _mean(frames: Sequence[ResponseFrame]) -> Float32Array:
    return np.mean([frame.read().astype(np.float32) for frame in frames], axis=0)
