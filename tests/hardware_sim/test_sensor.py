import numpy as np
import pytest

from acquisition.models.calibration import SensorModel
from hardware_sim import sensor

MODEL = SensorModel(bits=12, gain_e_per_dn=2.5, read_noise_e=5.0, full_well_e=10077.5, black_level_dn=64.0)


def flat(level: float) -> np.ndarray:
    return np.full((400, 400), level, dtype=np.float32)


@pytest.mark.parametrize("level", [0.0, 0.02, 0.3, 0.8])
def test_expose_noise_has_expected_mean_and_variance(level: float) -> None:
    frame = sensor.expose(flat(level), MODEL, np.random.default_rng(1)).astype(float)
    electrons = level * 10077.5
    variance = (electrons + 25.0) / 2.5**2 + 1 / 12  # shot, read, rounding
    assert frame.mean() == pytest.approx(64 + electrons / 2.5, abs=5 * np.sqrt(variance) / 400)
    assert frame.var() == pytest.approx(variance, rel=0.02)


def test_expose_without_noise_rounds() -> None:
    frame = sensor.expose(flat(0.3), MODEL, None)
    assert frame.dtype == np.uint16
    assert np.all(frame == round(64 + 0.3 * 4031))


def test_expose_saturates_at_full_well_and_last_value() -> None:
    assert np.all(sensor.expose(flat(1.0), MODEL, None) == 4095)
    assert np.all(sensor.expose(flat(50.0), MODEL, None) == 4095)
    shallow = MODEL.model_copy(update={"full_well_e": 5000.0})
    assert np.all(sensor.expose(flat(1.0), shallow, None) == 64 + 2000)
    assert sensor.expose(flat(1e9), MODEL, np.random.default_rng(1)).max() == 4095


def test_expose_dark_signal_is_never_negative() -> None:
    low = MODEL.model_copy(update={"black_level_dn": 2.0, "read_noise_e": 50.0})
    frame = sensor.expose(flat(0.0), low, np.random.default_rng(1))
    assert frame.min() == 0
    assert frame.max() < 200


def test_expose_same_generator_repeats_frame() -> None:
    frames = [sensor.expose(flat(0.5), MODEL, np.random.default_rng(seed)) for seed in (7, 7, 8)]
    assert np.array_equal(frames[0], frames[1])
    assert not np.array_equal(frames[0], frames[2])
