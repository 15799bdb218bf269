"""Merging the exposures of one light: unbiased, of the stated noise, and without saturated or black pixels."""

import numpy as np
import pytest

from acquisition import image_values
from acquisition.models.light_plan import FrameExposure, Light
from acquisition.models.shot import FrameQuality, FrameRef, Observations, Shot, ShotKey
from acquisition.normals.images import exposure_merge, session_images
from acquisition.normals.images.normalised_images import ImageBlock
from tests.acquisition import scenes

SIZE = 64
KNOWN = scenes.calibration(SIZE)
SENSOR = KNOWN.sensor
LIGHT = Light(position=(0.1, 0.0, -0.5), axis=(0.0, 0.0, -1.0))
BASE_S, LONG_S = 0.01, 0.08


def frame(y: np.ndarray, seconds: float, seed: int) -> np.ndarray:
    """A frame of values y by the law of the sensor, written out again."""
    rng = np.random.default_rng(seed)
    electrons = y * seconds * KNOWN.lamp_intensity * SENSOR.full_scale_dn * SENSOR.gain_e_per_dn
    electrons = np.minimum(rng.poisson(electrons), SENSOR.full_well_e) + rng.normal(0, SENSOR.read_noise_e, y.shape)
    return np.clip(np.rint(SENSOR.black_level_dn + electrons / SENSOR.gain_e_per_dn), 0, 4095).astype(np.uint16)


def shot(name: str, number: int, kind: str, seconds: float, light_number: int | None = 0) -> Shot:
    return Shot(
        key=ShotKey(pass_number=0, number=number), kind=kind,  # type: ignore[arg-type]
        frame=FrameRef(path=name, width=SIZE, height=SIZE, sha256=""), exposure_s=seconds, light=LIGHT,
        light_number=light_number, taken_at=0.0, quality=FrameQuality(saturated=0.0, bright_level=0.5, accepted=True),
    )  # fmt: skip


def captured(y: np.ndarray, times: list[float]) -> Observations:
    """Three images of the same values y (H, W), the first of frames with exposure `times`, with noise of their own."""
    frames, shots = scenes.Frames(), []
    for index, seconds in enumerate(times):
        frames.stored[f"{index}"] = frame(y, seconds, index)
        shots.append(shot(f"{index}", 10_000 + index if index else 0, "bracket" if index else "light", seconds))
    for number in (1, 2):
        frames.stored[f"other {number}"] = frame(y, BASE_S, 50 + number)
        shots.append(shot(f"other {number}", number, "light", BASE_S, number))
    for number, seconds in enumerate({*times, BASE_S}):
        frames.stored[f"dark {seconds}"] = frame(np.zeros_like(y), seconds, 100 + number)
        shots.append(shot(f"dark {seconds}", 500 + number, "dark", seconds, None))
    return Observations.of(shots, frames)


def first_image(y: np.ndarray, times: list[float]) -> tuple[ImageBlock, float, float]:
    everything = slice(0, SIZE)
    images = session_images.read(captured(y, times), KNOWN, everything, everything)
    block = images.read(0, SIZE)
    assert block.extra is not None
    one = ImageBlock(block.values[0], block.clipped[0], block.extra[0])
    return one, float(images.shot[0]), float(images.floor[0])


@pytest.mark.parametrize("level", [0.02, 0.3])
@pytest.mark.parametrize("times", [[BASE_S, LONG_S], [BASE_S, BASE_S, BASE_S, LONG_S]], ids=["bracket", "averaged"])
def test_merge_values_scatter_as_variance_says(level: float, times: list[float]) -> None:
    """4,096 pixels of one value: the mean square error is the stated variance within 5 of its σ of √(2/N)."""
    y = np.full((SIZE, SIZE), level)
    merged, shot_noise, floor = first_image(y, times)
    assert merged.extra is not None
    stated = shot_noise * level + floor + float(np.mean(merged.extra))
    found = float(np.mean((merged.values - level) ** 2))
    assert found / stated == pytest.approx(1.0, abs=5 * (2 / y.size) ** 0.5)
    expected, saturated = image_values.merged_variance(np.array([level]), exposures(times), KNOWN)
    assert not saturated[0]
    assert expected[0] == pytest.approx(stated, rel=0.02)


def exposures(times: list[float]) -> list[FrameExposure]:
    return [FrameExposure(exposure_s=one, frames=times.count(one)) for one in sorted(set(times))]


def test_merge_pixel_saturated_in_long_frame_comes_from_short_one() -> None:
    y = np.full((SIZE, SIZE), 0.02)
    y[:, : SIZE // 2] = 3.0  # 0.6 of full scale in the short frame, 4.8 in the long one
    merged, shot_noise, floor = first_image(y, [BASE_S, LONG_S])
    assert merged.extra is not None
    assert not np.any(merged.clipped)
    bright, dark = (slice(None), slice(0, SIZE // 2)), (slice(None), slice(SIZE // 2, None))
    assert float(np.mean(merged.values[bright])) == pytest.approx(3.0, rel=1e-3)
    alone = image_values.sensor_noise(KNOWN, [BASE_S])
    np.testing.assert_allclose(
        merged.extra[bright] + shot_noise * merged.values[bright] + floor,
        alone[0][0] * merged.values[bright] + alone[1][0], rtol=1e-4,
    )  # fmt: skip
    assert float(np.max(merged.extra[dark])) < 0.1 * (0.02 * shot_noise + floor)  # all frames count there


def test_merge_pixel_saturated_in_all_frames_is_no_measurement() -> None:
    y = np.full((SIZE, SIZE), 0.1)
    y[:8] = 6.0
    merged, _, _ = first_image(y, [BASE_S, LONG_S])
    assert np.all(merged.clipped[:8])
    assert not np.any(merged.clipped[8:])


def test_merge_black_pixel_in_short_frame_does_not_count() -> None:
    """A pixel at zero has its noise cut off: the frame in which it is above zero decides alone."""
    observations = captured(np.full((SIZE, SIZE), 0.05), [BASE_S, LONG_S])
    observations.frames.stored["0"][5] = 0  # type: ignore[attr-defined]
    everything = slice(0, SIZE)
    block = session_images.read(observations, KNOWN, everything, everything).read(0, SIZE)
    assert float(np.mean(block.values[0, 5])) == pytest.approx(0.05, rel=0.02)


def test_merge_pixel_black_in_all_frames_is_shadow() -> None:
    observations = captured(np.full((SIZE, SIZE), 0.05), [BASE_S, LONG_S])
    for name in ("0", "1"):
        observations.frames.stored[name][5] = 0  # type: ignore[attr-defined]
    everything = slice(0, SIZE)
    block = session_images.read(observations, KNOWN, everything, everything).read(0, SIZE)
    assert np.all(block.values[0, 5] < 0)
    assert not np.any(block.clipped[0, 5])


def test_read_missing_dark_of_further_frame_is_named() -> None:
    observations = captured(np.full((SIZE, SIZE), 0.05), [BASE_S, LONG_S])
    del observations.darks[LONG_S]
    with pytest.raises(Exception, match=r"no lamp-off frame for the exposure time 0\.08 s"):
        session_images.read(observations, KNOWN, slice(0, SIZE), slice(0, SIZE))


def test_groups_frames_of_equal_time_are_together() -> None:
    shots = [shot("a", 0, "light", BASE_S), shot("b", 1, "bracket", LONG_S), shot("c", 2, "bracket", BASE_S)]
    assert [[one.frame.path for one in group] for group in exposure_merge.groups(shots)] == [["a", "c"], ["b"]]
