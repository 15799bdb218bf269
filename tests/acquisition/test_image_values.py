"""Values of frames and their noise against their formulas and counted electrons."""

import numpy as np
import pytest

from acquisition import image_values, photometry
from acquisition.models.calibration import Calibration
from tests.acquisition import scenes


@pytest.fixture(scope="module")
def known() -> Calibration:
    return scenes.calibration(96)


def test_normalised_white_surface_has_value_one(known: Calibration) -> None:
    """`lamp_intensity` is the share of full scale per second there: units are absolute."""
    seconds, sensor = 0.02, known.sensor
    share = known.lamp_intensity * seconds
    dark = np.full((2, 2), 64, np.uint16)
    frame = (dark + np.round(share * sensor.full_scale_dn)).astype(np.uint16)
    np.testing.assert_allclose(image_values.normalised(frame, dark, seconds, known), 1.0, atol=1e-3)
    counted = share * sensor.full_scale_dn * sensor.gain_e_per_dn
    assert image_values.electrons_per_value(known, seconds) == pytest.approx(counted)


def test_normalised_frame_darker_than_dark_does_not_wrap(known: Calibration) -> None:
    frame, dark = np.array([[60]], np.uint16), np.array([[64]], np.uint16)
    assert -1e-2 < image_values.normalised(frame, dark, 0.02, known)[0, 0] < 0


@pytest.mark.parametrize("level", [0.003, 0.1, 0.9])
def test_sensor_noise_agrees_with_counted_electrons(level: float) -> None:
    known = scenes.calibration(32)
    seconds, count = 0.03, 200_000
    rng = np.random.default_rng(1)
    sensor = known.sensor
    value = level / (seconds * known.lamp_intensity)

    def read(electrons: float) -> np.ndarray:
        counted = rng.poisson(electrons, count) + rng.normal(0, sensor.read_noise_e, count)
        return np.clip(np.round(sensor.black_level_dn + counted / sensor.gain_e_per_dn), 0, 4095).astype(np.uint16)

    lit = read(level * sensor.full_scale_dn * sensor.gain_e_per_dn)
    values = image_values.normalised(lit, read(0.0), seconds, known)
    shot, floor = image_values.sensor_noise(known, [seconds])
    predicted = shot[0] * value + floor[0]
    assert np.mean(values) == pytest.approx(value, abs=4 * np.sqrt(predicted / count))
    assert np.var(values) == pytest.approx(predicted, rel=0.02)


def test_noise_lamp_errors_give_intensity_and_direction_terms() -> None:
    """A facing surface feels the lamp's distance, a grazing one its direction; the flat field is beside both."""
    known = scenes.calibration(32)
    rng = np.random.default_rng(2)
    r, count = 0.45, 100_000
    lamp = np.array([0, 0, r])[:, None] + rng.normal(0, known.lamp_position_sigma_m, (3, count))
    s = known.reference_m**2 * lamp / np.linalg.norm(lamp, axis=0) ** 3
    s = (
        s
        * (1 + rng.normal(0, known.intensity_sigma, count))
        * (1 + rng.normal(0, photometry.SETTINGS.flat_field_sigma, count))
    )
    sensor = image_values.sensor_noise(known, [10.0])  # long enough that electrons do not matter
    noise = image_values.model_noise(known, *sensor, r)
    assert np.std(s[2]) == pytest.approx(noise.intensity, rel=0.03)
    across = np.hypot(np.std(s[0]), photometry.SETTINGS.depth_sigma_m / r)
    assert across == pytest.approx(noise.direction, rel=0.03)


def test_noise_variance_adds_its_four_terms() -> None:
    noise = image_values.Noise(np.array([2e-4, 1e-4]), np.array([3e-6, 1e-6]), 0.012, 0.004)
    value, strength = np.array([[0.5, -0.1], [0.2, 0.0]]), np.array([[0.6, 0.6], [0.3, 0.3]])
    by_hand = [
        [2e-4 * 0.5 + 3e-6 + (0.012 * 0.5) ** 2 + (0.004 * 0.6) ** 2, 3e-6 + (0.012 * 0.1) ** 2 + (0.004 * 0.6) ** 2],
        [1e-4 * 0.2 + 1e-6 + (0.012 * 0.2) ** 2 + (0.004 * 0.3) ** 2, 1e-6 + (0.004 * 0.3) ** 2],
    ]
    np.testing.assert_allclose(noise.variance(value, strength), by_hand)


def test_sensor_noise_ambient_adds_shot_noise_twice() -> None:
    known = scenes.calibration(32)
    without, with_it = (image_values.sensor_noise(known, [0.02], [ambient])[1][0] for ambient in (0.0, 100.0))
    scale = image_values.electrons_per_value(known, 0.02)
    assert (with_it - without) * scale**2 == pytest.approx(2 * 100.0 * known.sensor.gain_e_per_dn)


@pytest.mark.parametrize("full_well_e", [10077.5, 5000.0])
def test_clipping_dn_is_just_below_lower_of_converter_and_well(full_well_e: float) -> None:
    sensor = scenes.calibration(32).sensor.model_copy(update={"full_well_e": full_well_e})
    end = min(4095.0, 64 + full_well_e / sensor.gain_e_per_dn)
    frame = np.array([[round(0.97 * end), round(end - 1), min(round(end), 4095)]], np.uint16)
    assert image_values.saturated(frame, sensor).tolist() == [[False, True, True]]
