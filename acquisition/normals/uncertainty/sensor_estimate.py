"""Gain and read noise of the sensor, estimated from a session's own frames (photon transfer, EMVA 1288).

A session contains an image taken twice under the same light, and lamp-off frames. Both give points of one
photon-transfer curve. The image and its repetition cover the whole range of brightness. Two lamp-off frames cover its
lower end; their exposure times may differ a little, because room light and fixed pattern then differ only by a share of
themselves. A single lamp-off frame contains its fixed pattern, so its read noise is too large, never too small.

An estimate replaces the calibration's value if its σ is small; otherwise the value is kept, and the note states this.
The clipping level stays the same in values, whatever the gain.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from acquisition import image_values
from acquisition.models.base import BoolArray, Float32Array
from acquisition.models.calibration import Calibration, SensorModel
from acquisition.models.shot import Observations, Shot
from acquisition.normals.uncertainty import photon_transfer
from acquisition.normals.uncertainty.photon_transfer import LinearFit, TransferCurve

MAX_EXPOSURE_RATIO = 1.27
"""Largest ratio of exposure times of two lamp-off frames that form a pair: neighbours in a series of ⅓ stops."""

MAX_PIXELS = 1_000_000
"""Pixels of a frame that are read; more do not improve the estimate."""

EMPTY_CURVE = TransferCurve(np.zeros(0), np.zeros(0), np.zeros(0))

Reader = Callable[[Shot], Float32Array]
"""Reads strips (n, w) of a shot's frame, in values above black."""


@dataclass(frozen=True)
class SensorEstimate:
    """Calibration with the estimated sensor, figures with their 1 σ (e⁻ per value, e⁻), a sentence on their source."""

    calibration: Calibration
    figures: dict[str, float]
    note: str


def estimate(observations: Observations, calibration: Calibration, rows: slice, columns: slice) -> SensorEstimate:
    """Estimates gain and read noise by photon transfer from repeated and lamp-off frames in a window of the frame."""
    sensor, black = calibration.sensor, np.float32(calibration.sensor.black_level_dn)
    strips = photon_transfer.strips(rows.stop - rows.start, MAX_PIXELS // (columns.stop - columns.start))

    def read(shot: Shot) -> Float32Array:
        lines = (slice(rows.start + one.start, rows.start + one.stop) for one in strips)
        parts = [observations.frames.rows(shot.frame, one.start, one.stop)[:, columns] for one in lines]
        return np.concatenate(parts).astype(np.float32) - black

    def of_size(*shots: Shot) -> bool:
        return all((one.frame.width, one.frame.height) == (calibration.width, calibration.height) for one in shots)

    off = [*observations.darks.values(), *(shot for shot in observations.repeats if shot.kind == "dark")]
    pairs = [pair for pair in _repeated_pairs(observations) if of_size(*pair)]
    lit = [curve for one, two in pairs if (curve := _pair_curve(read(one), read(two), sensor)) is not None]
    dark, source = _dark_curve(read, [shot for shot in off if of_size(shot)], sensor)
    source = f"{len(lit)} image{'' if len(lit) == 1 else 's'} taken twice, {source}"
    line = photon_transfer.fit_line(photon_transfer.concatenate([*lit, dark]))
    if line is not None and line.known and any(len(curve.level) for curve in lit):
        return _from_line(calibration, line, source)
    why = "too few pixels determine it" if lit else "there are no two frames of one light"
    note = f"kept from the calibration, {_in_words(sensor)}: {why} ({source})"
    return SensorEstimate(calibration, _figures(sensor), note)


def _from_line(calibration: Calibration, line: LinearFit, source: str) -> SensorEstimate:
    sensor, gain = calibration.sensor, 1 / line.slope
    gain_sigma = gain * line.slope_sigma / line.slope
    read_dn = float(np.sqrt(max(line.floor - 1 / 12, 0)))
    read_sigma_dn = line.floor_sigma / (2 * max(read_dn, 1e-9))
    known = read_sigma_dn <= photon_transfer.SETTINGS.max_relative_sigma * read_dn
    read_dn = read_dn if known else sensor.read_noise_e / sensor.gain_e_per_dn
    estimated = sensor.model_copy(
        update={
            "gain_e_per_dn": gain,
            "read_noise_e": read_dn * gain,
            "full_well_e": sensor.full_well_e * gain / sensor.gain_e_per_dn,
        }
    )
    figures = _figures(estimated) | {"gain_sigma": gain_sigma}
    if known:
        figures["read_noise_sigma"] = float(np.hypot(read_sigma_dn * gain, read_dn * gain_sigma))
    kept = "" if known else " (in values kept from the calibration, because too few dark pixels determine it)"
    note = (
        f"estimated from the frames ({source}): {_in_words(estimated)}{kept}; the calibration has {_in_words(sensor)}"
    )
    return SensorEstimate(calibration.model_copy(update={"sensor": estimated}), figures, note)


def _in_words(sensor: SensorModel) -> str:
    return f"gain {sensor.gain_e_per_dn:.3g} e⁻ per value, read noise {sensor.read_noise_e:.3g} e⁻"


def _figures(sensor: SensorModel) -> dict[str, float]:
    return {"gain_e_per_dn": sensor.gain_e_per_dn, "read_noise_e": sensor.read_noise_e}


def _repeated_pairs(observations: Observations) -> list[tuple[Shot, Shot]]:
    """Returns pairs of an image and its repetition. An image that was discarded and captured again is newer than its
    repetition, and forms no pair."""
    by_key = {shot.key: shot for shot in observations.shots}
    both = [(by_key.get(again.repeats), again) for again in observations.repeats if again.repeats is not None]
    return [
        (first, again)
        for first, again in both
        if first is not None and first.exposure_s == again.exposure_s and first.taken_at <= again.taken_at
    ]


def _pair_curve(first: Float32Array, second: Float32Array, sensor: SensorModel) -> TransferCurve | None:
    """Returns the photon-transfer curve of two frames of one light; none if one frame is stored twice.

    The second, slightly brighter or darker, is scaled to the first. Values whose noise would be clipped are left out.
    Var(first − scale · second) is slope · first (1 + scale) + floor (1 + scale²).
    """
    if np.array_equal(first, second):
        return None
    clipping = image_values.clipping_dn(sensor) - sensor.black_level_dn
    noise = np.sqrt(clipping / sensor.gain_e_per_dn + (sensor.read_noise_e / sensor.gain_e_per_dn) ** 2)
    level = (first + second) * np.float32(0.5)
    good = (np.maximum(first, second) < clipping) & (level < clipping - photon_transfer.CLIP_SIGMA * noise)
    power = float(np.sum(second * second * good, dtype=np.float64))
    if power == 0:
        return EMPTY_CURVE
    scale = float(np.sum(first * second * good, dtype=np.float64)) / power
    level *= np.float32(2 * scale / (1 + scale**2))
    apart = (first - second * np.float32(scale)) * np.float32((1 + scale**2) ** -0.5)
    return _quad_curve(level, np.asarray(apart, np.float32), sensor, good)


def _dark_curve(read: Reader, darks: list[Shot], sensor: SensorModel) -> tuple[TransferCurve, str]:
    """Returns the photon-transfer curve of lamp-off frames, and a phrase that names the frames."""
    by_exposure = sorted(darks, key=lambda shot: shot.exposure_s)
    if not by_exposure:
        return EMPTY_CURVE, "no lamp-off frame"
    for shorter, other in sorted(pairwise(by_exposure), key=lambda pair: pair[1].exposure_s / pair[0].exposure_s):
        if other.exposure_s > MAX_EXPOSURE_RATIO * shorter.exposure_s:
            break
        first, second = read(shorter), read(other)
        if not np.array_equal(first, second):  # else one frame is stored twice
            level, apart = (first + second) * np.float32(0.5), (first - second) * np.float32(0.5**0.5)
            return _quad_curve(level, apart, sensor), "two lamp-off frames"
    alone = read(by_exposure[0])
    return _quad_curve(alone, alone, sensor), "one lamp-off frame, its fixed pattern included"


def _quad_curve(
    level: Float32Array, scattered: Float32Array, sensor: SensorModel, good: BoolArray | None = None
) -> TransferCurve:
    """Returns the photon-transfer curve of `scattered` (n, w), of one frame's variance, by differences of four
    neighbours."""
    middle = photon_transfer.quads(level).mean(axis=0)
    apart = photon_transfer.quad_differences(photon_transfer.quads(scattered))
    if good is not None:
        all_good = photon_transfer.quads(good).all(axis=0)
        middle, apart = middle[all_good], apart[all_good]
    return photon_transfer.transfer_curve(middle.ravel(), apart.ravel(), sensor.full_scale_dn, 1.0)
