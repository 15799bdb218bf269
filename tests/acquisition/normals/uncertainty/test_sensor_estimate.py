"""Gain and read noise estimated from a session's frames, of simulated sensors of known gain and read noise."""

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acquisition import image_values, normals
from acquisition.models.calibration import Calibration, SensorModel
from acquisition.models.result import SolveSettings
from acquisition.models.shot import Observations, Shot, ShotKey
from acquisition.normals.uncertainty import sensor_estimate
from hardware_sim import sensor as simulated
from tests.acquisition import scenes

SIZE = 384
ALL = slice(0, SIZE)
SENSORS = {
    "12 bits": SensorModel(bits=12, gain_e_per_dn=2.5, read_noise_e=5, full_well_e=10077.5, black_level_dn=64),
    "16 bits": SensorModel(bits=16, gain_e_per_dn=0.5, read_noise_e=2, full_well_e=32000, black_level_dn=500),
    "small pixels": SensorModel(bits=10, gain_e_per_dn=2.5, read_noise_e=4, full_well_e=2400, black_level_dn=32),
}


def scene(rng: np.random.Generator, albedo: tuple[float, float] = (0.4, 1.0)) -> np.ndarray:
    """A ball, light as fractions of full scale, painted in blotches, with a shadow that has a sharp edge."""
    y, x = np.mgrid[-1 : 1 : SIZE * 1j, -1 : 1 : SIZE * 1j]
    paint = np.kron(rng.uniform(*albedo, (SIZE // 16, SIZE // 16)), np.ones((16, 16)))
    lit = np.sqrt(np.maximum(0.9 - x * x - y * y, 0)) * (x + 0.5 * y < 0.5)
    return (0.85 * lit * paint).astype(np.float32)


def session(
    known: SensorModel, light: np.ndarray, seed: int = 0, again: np.ndarray | None = None, darks: int = 2
) -> Observations:
    """An image, its repetition under a lamp that is a little brighter or darker, and lamp-off frames."""
    rng = np.random.default_rng(seed)
    frames = scenes.Frames()

    def shot(number: int, kind: str, signal: np.ndarray, seconds: float = 0.05, **values: Any) -> Shot:
        path = f"{kind}_{number}.tiff"
        frames.stored[path] = simulated.expose(signal, known, rng)
        return Shot.model_validate(
            {
                "key": {"pass_number": 0, "number": number}, "kind": kind, "exposure_s": seconds,
                "frame": {"path": path, "width": light.shape[1], "height": light.shape[0], "sha256": ""},
                "taken_at": float(number), "quality": {"saturated": 0, "bright_level": 0.8, "accepted": True},
            }
            | values
        )  # fmt: skip

    first = shot(0, "light", light)
    second = shot(1000, "reference", (light if again is None else again) * (1 + 0.01 * rng.normal()), repeats=first.key)
    off = [shot(1 + number, "dark", 0 * light, seconds=0.05 * 1.26**number) for number in range(darks)]
    return Observations([first], {one.exposure_s: one for one in off}, frames, [second])


def said(known: SensorModel, wrong_by: float = 1.0) -> Calibration:
    """A calibration whose gain is wrong by a factor; the values that pixels clip at are right."""
    gain, well = known.gain_e_per_dn * wrong_by, known.full_well_e * wrong_by
    return scenes.calibration(SIZE, sensor=known.model_copy(update={"gain_e_per_dn": gain, "full_well_e": well}))


@pytest.mark.parametrize("name", SENSORS)
@settings(max_examples=4, deadline=None)
@given(seed=st.integers(0, 2**32), wrong_by=st.sampled_from([0.5, 1.0, 2.0]), darks=st.integers(1, 2))
def test_estimate_wrong_calibration_recovers_gain_and_read_noise(
    name: str, seed: int, wrong_by: float, darks: int
) -> None:
    known = SENSORS[name]
    calibration = said(known, wrong_by)
    observations = session(known, scene(np.random.default_rng(seed)), seed, darks=darks)
    estimate = sensor_estimate.estimate(observations, calibration, ALL, ALL)
    sensor = estimate.calibration.sensor
    assert sensor.gain_e_per_dn == pytest.approx(known.gain_e_per_dn, rel=0.05)
    assert sensor.read_noise_e == pytest.approx(known.read_noise_e, rel=0.15)
    assert image_values.clipping_dn(sensor) == pytest.approx(image_values.clipping_dn(calibration.sensor))
    assert estimate.figures["gain_e_per_dn"] == sensor.gain_e_per_dn
    assert 0 < estimate.figures["gain_sigma"] < 0.05 * sensor.gain_e_per_dn
    assert "estimated from the frames (1 image taken twice" in estimate.note


def discarded(observations: Observations) -> Observations:
    """The first image was taken anew, after its repetition."""
    return replace(observations, shots=[observations.shots[0].model_copy(update={"taken_at": 2000.0})])


def stored_twice(observations: Observations) -> Observations:
    return replace(
        observations, repeats=[observations.repeats[0].model_copy(update={"frame": observations.shots[0].frame})]
    )


def longer(observations: Observations) -> Observations:
    return replace(observations, repeats=[observations.repeats[0].model_copy(update={"exposure_s": 0.1})])


def of_another(observations: Observations) -> Observations:
    return replace(
        observations, repeats=[observations.repeats[0].model_copy(update={"repeats": ShotKey(pass_number=3, number=1)})]
    )


def never(observations: Observations) -> Observations:
    return replace(observations, repeats=[])


@pytest.mark.parametrize("how", [never, discarded, stored_twice, longer, of_another])
def test_estimate_without_repeated_frame_keeps_calibration(how: Any) -> None:
    known = SENSORS["12 bits"]
    calibration = said(known, 2.0)
    estimate = sensor_estimate.estimate(how(session(known, scene(np.random.default_rng(0)))), calibration, ALL, ALL)
    assert estimate.calibration == calibration
    assert estimate.figures == {"gain_e_per_dn": 5.0, "read_noise_e": 5.0}
    assert "kept from the calibration" in estimate.note
    assert "no two frames of one light" in estimate.note


@pytest.mark.parametrize("what", ["few pixels", "saturated", "black"])
def test_estimate_too_few_usable_pixels_keeps_calibration(what: str) -> None:
    known, light = SENSORS["12 bits"], scene(np.random.default_rng(1))
    light = light + 2 if what == "saturated" else 0 * light if what == "black" else light
    window = slice(100, 116) if what == "few pixels" else ALL
    calibration = said(known, 2.0)
    estimate = sensor_estimate.estimate(session(known, light), calibration, window, window)
    assert estimate.calibration == calibration
    assert "too few pixels determine it (1 image taken twice" in estimate.note
    assert "gain_sigma" not in estimate.figures


@pytest.mark.parametrize("pixels", [0.5, 1, 7])
def test_estimate_scene_shifted_between_frames_recovers_gain(pixels: float) -> None:
    """Of soft detail and of sharp edges; a session lets half a pixel pass."""
    known, rng = SENSORS["12 bits"], np.random.default_rng(2)
    grain = cv2.GaussianBlur(rng.normal(size=(SIZE, SIZE)).astype(np.float32), (0, 0), 4.0)
    light = scene(rng) * (1 + 0.1 * grain / np.std(grain))
    away = np.array([[1, 0, pixels], [0, 1, 0]], np.float32)
    moved = cv2.warpAffine(light, away, (SIZE, SIZE), flags=cv2.INTER_CUBIC)
    estimate = sensor_estimate.estimate(session(known, light, again=moved), said(known, 2.0), ALL, ALL)
    assert estimate.calibration.sensor.gain_e_per_dn == pytest.approx(known.gain_e_per_dn, rel=0.05)


def test_estimate_fine_detail_shifted_keeps_calibration() -> None:
    known, rng = SENSORS["12 bits"], np.random.default_rng(4)
    light = rng.uniform(0.1, 0.8, (SIZE, SIZE)).astype(np.float32)
    calibration = said(known)
    assert (
        sensor_estimate.estimate(session(known, light, again=np.roll(light, 1, 1)), calibration, ALL, ALL).calibration
        is calibration
    )
    assert sensor_estimate.estimate(session(known, light), calibration, ALL, ALL).calibration is not calibration


def test_estimate_lamp_off_frames_of_one_exposure_are_a_pair() -> None:
    """Room light with fine detail is in both; in one of them alone it would count as noise."""
    known, rng = SENSORS["12 bits"], np.random.default_rng(3)
    observations = session(known, scene(rng), darks=1)
    room = rng.uniform(0, 0.02, (SIZE, SIZE)).astype(np.float32)
    (off,) = observations.darks.values()
    later = off.model_copy(update={"frame": off.frame.model_copy(update={"path": "later.tiff"}), "taken_at": 3000.0})
    assert isinstance(observations.frames, scenes.Frames)
    for shot in (off, later):
        observations.frames.stored[shot.frame.path] = simulated.expose(room, known, rng)
    alone = sensor_estimate.estimate(observations, said(known), ALL, ALL)
    both = sensor_estimate.estimate(
        replace(observations, repeats=[*observations.repeats, later]), said(known), ALL, ALL
    )
    assert "one lamp-off frame, its fixed pattern included" in alone.note
    assert "two lamp-off frames" in both.note
    assert both.calibration.sensor.read_noise_e == pytest.approx(known.read_noise_e, rel=0.15)


@pytest.mark.long
@pytest.mark.parametrize("wrong_by", [0.5, 2.0])
@pytest.mark.parametrize("lights", [4, 8])
def test_solve_wrong_gain_in_calibration_sigma_is_calibrated(lights: int, wrong_by: float) -> None:
    """Of a sensor whose shot noise outweighs all else. Four lights leave no residuals that reveal a wrong gain;
    circulations of the normals reveal noise that is larger than stated, but no smaller one."""
    known = SensorModel(bits=12, gain_e_per_dn=0.15, read_noise_e=3, full_well_e=600, black_level_dn=64)
    true = scenes.scene(scenes.bumps, scenes.calibration(144, sensor=known))
    calibration = true.calibration.model_copy(update={"sensor": said(known, wrong_by).sensor})
    ring = scenes.ring(4, 30.0) if lights == 4 else [*scenes.ring(4, 25.0), *scenes.ring(4, 50.0, 0.4)]
    estimated, believed = [], []
    for seed in range(4):
        observations = scenes.capture(true, ring, seed=seed)
        first = observations.shots[0]
        other = scenes.capture(true, ring[:1], seed=seed + 1000, exposure_s=first.exposure_s)
        assert isinstance(observations.frames, scenes.Frames)
        assert isinstance(other.frames, scenes.Frames)
        observations.frames.stored["again.tiff"] = other.frames.stored["0.tiff"]
        again = first.model_copy(
            update={
                "kind": "reference", "repeats": first.key, "key": ShotKey(pass_number=0, number=1000),
                "frame": first.frame.model_copy(update={"path": "again.tiff"}),
            }
        )  # fmt: skip
        for within, repeats in ((estimated, [again]), (believed, [])):
            images = replace(observations, repeats=repeats)
            result = normals.solve(images, calibration, SolveSettings(), normals.ObjectPlace(scenes.TABLE_DEPTH - 0.03))
            assert ("gain_sigma" in result.noise) == bool(repeats)
            sigma = result.sigma_deg[true.graded]
            solved = np.isfinite(sigma)
            within.append(np.mean(true.error_deg(result.normals)[solved] < sigma[solved]))
    print(f"{lights} lights, gain wrong by {wrong_by}: P(e < σ) {np.mean(estimated):.3f}, else {np.mean(believed):.3f}")
    assert 0.55 < np.mean(estimated) < 0.75
    if lights == 4 and wrong_by < 1:
        assert np.mean(believed) > 0.9
    elif lights == 4:
        assert 0.55 < np.mean(believed) < 0.75
