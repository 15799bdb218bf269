"""Gain and read noise of the sensor, estimated from a session's own frames (photon transfer, EMVA 1288).

A session captures some image twice, under the same light, and lamp-off frames. Both give points of one photon-transfer
curve: the image and its repetition over the whole range of brightness; two lamp-off frames near its lower end, where
they may differ a little in exposure time, because neither room light nor fixed pattern differs by more than a share of
itself. A single lamp-off frame contains its fixed pattern, so its read noise is too large, never too small.

An estimate replaces the calibration's value where its σ is below that of a usual calibration; otherwise the value is
kept, and the note says so. The clipping level stays where it is in values, whatever the gain.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array
from acquisition.models.calibration import Calibration, SensorModel
from acquisition.models.shot import FrameRef, FrameSource, Observations, Shot
from acquisition.models.tuned import tuned
from acquisition.normals import photon_transfer
from acquisition.normals.photon_transfer import TransferCurve

MAX_GAIN_SIGMA, MAX_READ_NOISE_SIGMA = 0.05, 0.15
"""1 σ, as fractions, up to which the frames' estimate replaces the calibration's value."""


@dataclass(frozen=True)
class SensorEstimateSettings:
    """Tuned numbers of the sensor's estimate."""

    max_level_share: float = tuned(0.95, "share")
    """Share of the clipping level up to which pixels are used: above it, noise itself is clipped."""


SETTINGS = SensorEstimateSettings()

MAX_EXPOSURE_RATIO = 1.27
"""Of the exposure times of two lamp-off frames that count as a pair: neighbours in a series of thirds of a stop."""

MAX_PIXELS = 1_000_000
STRIPS = 16
"""Of a frame at most so many pixels are read, in so many strips of rows: more do not improve the estimate."""

ScalarT = TypeVar("ScalarT", bound=np.generic)

EMPTY_CURVE = TransferCurve(np.zeros(0), np.zeros(0), np.zeros(0))


@dataclass(frozen=True)
class SensorEstimate:
    """The calibration with the estimated sensor, the figures with their 1 σ (e⁻ per value, e⁻), and a sentence on their
    source."""

    calibration: Calibration
    figures: dict[str, float]
    note: str


def estimate(observations: Observations, calibration: Calibration, rows: slice, columns: slice) -> SensorEstimate:
    """Photon-transfer estimate of gain and read noise from repeated and lamp-off frames in a window of the frame."""
    sensor, frames = calibration.sensor, observations.frames
    strips = _strips(rows, columns.stop - columns.start)
    size = (calibration.width, calibration.height)
    off = [*observations.darks.values(), *(shot for shot in observations.repeats if shot.kind == "dark")]
    darks = [shot for shot in off if (shot.frame.width, shot.frame.height) == size]
    curves = [_pair_curve(frames, pair, sensor, strips, columns) for pair in _repeated_pairs(observations, size)]
    pairs = [curve for curve in curves if curve is not None]
    dark, source = _dark_curve(frames, darks, sensor, strips, columns)
    twice = len(pairs)
    source = f"{twice} image{'' if twice == 1 else 's'} taken twice, {source}"
    if not twice:
        return _from_calibration(calibration, f"no two frames of one light ({source})")
    lit = photon_transfer.concatenate(pairs)
    line = photon_transfer.fit_line(photon_transfer.concatenate([lit, dark])) if len(lit.level) else None
    return _from_fit(calibration, line, source)


def _from_calibration(calibration: Calibration, why: str) -> SensorEstimate:
    sensor = calibration.sensor
    return SensorEstimate(calibration, _figures(sensor), f"as the calibration says, {_in_words(sensor)}: {why}")


def _from_fit(calibration: Calibration, fitted: photon_transfer.LinearFit | None, source: str) -> SensorEstimate:
    sensor = calibration.sensor
    if fitted is None or fitted.slope <= 0 or fitted.slope_sigma > MAX_GAIN_SIGMA * fitted.slope:
        return _from_calibration(calibration, f"too few pixels tell ({source})")
    gain = 1 / fitted.slope
    relative = fitted.slope_sigma / fitted.slope
    read_dn = float(np.sqrt(max(fitted.floor - 1 / 12, 0)))
    read_sigma_dn = fitted.floor_sigma / (2 * max(read_dn, 1e-9))
    known = read_sigma_dn <= MAX_READ_NOISE_SIGMA * read_dn
    read_dn = read_dn if known else sensor.read_noise_e / sensor.gain_e_per_dn
    estimated = sensor.model_copy(
        update={
            "gain_e_per_dn": gain,
            "read_noise_e": read_dn * gain,
            "full_well_e": sensor.full_well_e * gain / sensor.gain_e_per_dn,
        }
    )
    figures = _figures(estimated) | {"gain_sigma": gain * relative}
    if known:
        figures["read_noise_sigma"] = float(np.hypot(read_sigma_dn * gain, read_dn * gain * relative))
    kept = "" if known else ", read noise in values that of the calibration, for too few dark pixels tell"
    note = f"found in the frames ({source}): {_in_words(estimated)}{kept}; the calibration says {_in_words(sensor)}"
    return SensorEstimate(calibration.model_copy(update={"sensor": estimated}), figures, note)


def _in_words(sensor: SensorModel) -> str:
    return f"gain {sensor.gain_e_per_dn:.3g} e⁻ per value, read noise {sensor.read_noise_e:.3g} e⁻"


def _figures(sensor: SensorModel) -> dict[str, float]:
    return {"gain_e_per_dn": sensor.gain_e_per_dn, "read_noise_e": sensor.read_noise_e}


def _repeated_pairs(observations: Observations, size: tuple[int, int]) -> list[tuple[Shot, Shot]]:
    """Pairs of an image and its repetition. An image that was discarded and captured again is newer than its repeat,
    and makes no pair."""
    by_key = {shot.key: shot for shot in observations.shots}
    pairs: list[tuple[Shot, Shot]] = []
    for again in observations.repeats:
        first = None if again.repeats is None else by_key.get(again.repeats)
        if first is None or first.exposure_s != again.exposure_s or first.taken_at > again.taken_at:
            continue
        if all((shot.frame.width, shot.frame.height) == size for shot in (first, again)):
            pairs.append((first, again))
    return pairs


def _strips(rows: slice, width: int) -> list[slice]:
    height = rows.stop - rows.start
    each = max(2, min(-(-height // STRIPS), MAX_PIXELS // (STRIPS * width)) // 2 * 2)  # neighbours stay together
    starts = np.unique(np.linspace(0, max(height - each, 0), STRIPS).astype(int))
    if each * STRIPS >= height:
        starts = np.arange(0, height, each)
    return [slice(rows.start + int(at), min(rows.start + int(at) + each, rows.stop)) for at in starts]


def _pair_curve(
    frames: FrameSource, pair: tuple[Shot, Shot], sensor: SensorModel, strips: list[slice], columns: slice
) -> TransferCurve | None:
    """Photon-transfer curve of two frames of one light; none where one frame is stored twice. The second, a little
    brighter or darker, is scaled to the first.

    Var(first − scale · second) is slope · level (1 + scale) + floor (1 + scale²).
    """
    black, clipping = np.float32(sensor.black_level_dn), photometry.clipping_dn(sensor)
    first, second = (_read(frames, shot.frame, strips, columns) for shot in pair)
    if np.array_equal(first, second):
        return None
    good = (first < clipping) & (second < clipping)
    first -= black
    second -= black
    level = (first + second) * np.float32(0.5)
    good &= level < SETTINGS.max_level_share * (clipping - black)
    power = float(np.sum(second * second * good, dtype=np.float64))
    if power == 0:
        return EMPTY_CURVE
    scale = float(np.sum(first * second * good, dtype=np.float64)) / power
    level *= np.float32(0.5 * (1 + scale) ** 2 / (1 + scale**2))
    second *= np.float32(scale)
    first -= second
    first *= np.float32((1 + scale**2) ** -0.5)
    return _quad_curve(level, first, sensor, good)


def _dark_curve(
    frames: FrameSource, darks: Iterable[Shot], sensor: SensorModel, strips: list[slice], columns: slice
) -> tuple[TransferCurve, str]:
    """Photon-transfer curve of lamp-off frames, and a phrase on which frames it is of."""
    by_exposure = sorted(darks, key=lambda shot: shot.exposure_s)
    if not by_exposure:
        return EMPTY_CURVE, "no lamp-off frame"
    black = np.float32(sensor.black_level_dn)
    for shorter, other in sorted(pairwise(by_exposure), key=lambda pair: pair[1].exposure_s / pair[0].exposure_s):
        if other.exposure_s > MAX_EXPOSURE_RATIO * shorter.exposure_s:
            break
        first, second = (_read(frames, shot.frame, strips, columns) for shot in (shorter, other))
        if not np.array_equal(first, second):  # else one frame stored twice
            level = (first + second) * np.float32(0.5)
            level -= black
            return _quad_curve(level, (first - second) * np.float32(0.5**0.5), sensor), "two lamp-off frames"
    alone = _read(frames, by_exposure[0].frame, strips, columns)
    alone -= black
    return _quad_curve(alone, alone, sensor), "one lamp-off frame, its fixed pattern included"


def _quad_curve(
    level: Float32Array, scattered: Float32Array, sensor: SensorModel, good: BoolArray | None = None
) -> TransferCurve:
    """Photon-transfer curve of `scattered` (n, w) with one frame's variance, by differences of four neighbours."""
    one, right, below, across = _quads(level)
    middle = (one + right + below + across) * np.float32(0.25)
    one, right, below, across = _quads(scattered)
    apart = (one - right - below + across) * np.float32(0.5)
    if good is not None:
        all_good = np.logical_and.reduce(_quads(good))
        middle, apart = middle[all_good], apart[all_good]
    return photon_transfer.transfer_curve(middle.ravel(), apart.ravel(), sensor.full_scale_dn, 1.0)


def _quads(image: NDArray[ScalarT]) -> tuple[NDArray[ScalarT], ...]:
    """The four corners of each 2 × 2 square, each (h/2, w/2)."""
    height, width = (length // 2 * 2 for length in image.shape)
    return tuple(image[row:height:2, column:width:2] for row in (0, 1) for column in (0, 1))


def _read(frames: FrameSource, frame: FrameRef, strips: list[slice], columns: slice) -> Float32Array:
    blocks = [frames.rows(frame, strip.start, strip.stop)[:, columns] for strip in strips]
    return np.concatenate(blocks).astype(np.float32)
