"""The image-formation model against its formulas, another library's projection, and counted electrons."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acquisition import image_values, photometry
from acquisition.models.base import FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.light_plan import Light
from tests.acquisition import scenes

LENS = (-0.12, 0.07, 0.0015, -0.001, 0.01)


@pytest.fixture(scope="module")
def known() -> Calibration:
    return scenes.calibration(96, distortion=LENS)


def lamp_above(distance: float, lateral: float = 0.0) -> Light:
    return Light(position=(lateral, 0.0, -0.9 + distance), axis=(0.0, 0.0, -1.0))


def vectors(points: list[list[float]], light: Light, known: Calibration) -> FloatArray:
    point = np.ascontiguousarray(np.array(points, np.float32).T)
    return photometry.light_vectors(point, photometry.lamps([light]), known)[0].astype(float)


def test_light_vectors_strength_falls_with_squared_distance(known: Calibration) -> None:
    near, far = (np.linalg.norm(vectors([[0, 0, -0.9]], lamp_above(r), known)) for r in (0.3, 0.9))
    assert near / far == pytest.approx(9.0, rel=1e-4)


def test_light_vectors_on_axis_at_reference_distance_is_one(known: Calibration) -> None:
    vector = vectors([[0, 0, -0.9]], lamp_above(known.reference_m), known)[:, 0]
    np.testing.assert_allclose(vector, [0, 0, 1], atol=1e-5)


@pytest.mark.parametrize("angle_deg", [10, 30, 50])
def test_light_vectors_off_axis_follows_cosine_power(angle_deg: float, known: Calibration) -> None:
    lateral = 0.45 * np.tan(np.radians(angle_deg))
    computed = np.linalg.norm(vectors([[lateral, 0, -0.9]], lamp_above(0.45), known))
    cosine = np.cos(np.radians(angle_deg))
    assert computed == pytest.approx(cosine**known.lobe_exponent * cosine**2, rel=1e-4)


def test_light_vectors_behind_lamp_is_zero(known: Calibration) -> None:
    assert not np.any(vectors([[0.1, 0, -0.2]], lamp_above(0.3), known))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**31 - 1))
def test_light_vectors_agree_with_formula(seed: int) -> None:
    rng = np.random.default_rng(seed)
    known = scenes.calibration(32, lobe_exponent=float(rng.uniform(0, 3)))
    x, p = rng.uniform(-0.1, 0.1, (3, 5)) - [[0], [0], [0.9]], rng.uniform(-0.3, 0.3, 3) - [0, 0, 0.5]
    axis = np.array([0, 0, -0.9]) - p
    axis /= np.linalg.norm(axis)
    light = Light(position=tuple(p.tolist()), axis=tuple(axis.tolist()))
    d = p[:, None] - x
    r = np.linalg.norm(d, axis=0)
    expected = (known.reference_m / r) ** 2 * np.maximum(-axis @ d / r, 0) ** known.lobe_exponent * d / r
    computed = photometry.light_vectors(np.ascontiguousarray(x, np.float32), photometry.lamps([light]), known)[0]
    np.testing.assert_allclose(computed, expected, rtol=2e-4, atol=2e-5)


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


def test_rays_distorted_lens_round_trips(known: Calibration) -> None:
    ray = photometry.rays(known, slice(10, 90), slice(5, 70)).astype(float)
    points = np.stack([ray[0], ray[1], np.ones_like(ray[0])], axis=-1).reshape(-1, 3) * 0.77
    pixels, _ = cv2.projectPoints(
        points, np.zeros(3), np.zeros(3), np.array(known.camera_matrix), np.array(known.distortion)
    )
    rows, columns = np.mgrid[10:90, 5:70]
    np.testing.assert_allclose(pixels[:, 0, 0], columns.ravel(), atol=2e-3)
    np.testing.assert_allclose(pixels[:, 0, 1], rows.ravel(), atol=2e-3)


@given(lens=st.tuples(st.floats(-0.3, 0.3), st.floats(-0.2, 0.2), *[st.floats(-0.01, 0.01)] * 2, st.floats(-0.1, 0.1)))
@settings(max_examples=20)
def test_camera_rays_any_lens_equal_opencv(lens: tuple[float, ...]) -> None:
    matrix, distortion = np.array([[90.0, 0, 40.5], [0, 80.0, 33.0], [0, 0, 1]]), np.array(lens)
    rows, columns = np.mgrid[7:60, 3:80].astype(float)
    pixels = np.stack([columns.ravel(), rows.ravel()], axis=-1)[:, None]
    expected = cv2.undistortPoints(pixels, matrix, distortion)[:, 0].T.reshape(2, *rows.shape)
    ray = photometry.camera_rays(matrix, distortion, slice(7, 60), slice(3, 80))
    np.testing.assert_allclose(ray, expected, rtol=1e-6, atol=1e-6)


def test_project_points_returns_their_pixels(known: Calibration) -> None:
    ray = photometry.rays(known, slice(0, 96), slice(0, 96))
    depth = np.random.default_rng(0).uniform(0.7, 1.0, (96, 96)).astype(np.float32)
    point = photometry.points(ray, depth)
    np.testing.assert_allclose(-point[2], depth)
    pixels = photometry.project(known, point.reshape(3, -1).T).reshape(96, 96, 2)
    rows, columns = np.mgrid[0:96, 0:96]
    np.testing.assert_allclose(pixels[..., 0], columns, atol=2e-3)
    np.testing.assert_allclose(pixels[..., 1], rows, atol=2e-3)


def test_points_view_frame_has_x_right_y_up(known: Calibration) -> None:
    point = photometry.points(photometry.rays(known, slice(0, 96), slice(0, 96)), np.full((96, 96), 0.9, np.float32))
    assert point[0, 48, 95] > 0 > point[0, 48, 0]
    assert point[1, 0, 48] > 0 > point[1, 95, 48]


def test_ray_directions_are_derivative_of_points_by_depth(known: Calibration) -> None:
    ray = photometry.rays(known, slice(0, 96), slice(0, 96))
    near, far = (photometry.points(ray, np.full((96, 96), z, np.float32)) for z in (0.8, 0.9))
    np.testing.assert_allclose(far - near, 0.1 * photometry.ray_directions(ray), atol=1e-6)


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
    noise = image_values.noise(known, [seconds], 0.45)
    predicted = noise.shot[0] * value + noise.floor[0]
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
    noise = image_values.noise(known, [10.0], r)  # long enough that electrons do not matter
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
    without, with_it = (image_values.noise(known, [0.02], 0.45, [ambient]).floor[0] for ambient in (0.0, 100.0))
    scale = image_values.electrons_per_value(known, 0.02)
    assert (with_it - without) * scale**2 == pytest.approx(2 * 100.0 * known.sensor.gain_e_per_dn)


@pytest.mark.parametrize("full_well_e", [10077.5, 5000.0])
def test_clipping_dn_is_just_below_lower_of_converter_and_well(full_well_e: float) -> None:
    sensor = scenes.calibration(32).sensor.model_copy(update={"full_well_e": full_well_e})
    end = min(4095.0, 64 + full_well_e / sensor.gain_e_per_dn)
    frame = np.array([[round(0.97 * end), round(end - 1), min(round(end), 4095)]], np.uint16)
    assert image_values.saturated(frame, sensor).tolist() == [[False, True, True]]
