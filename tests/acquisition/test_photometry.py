"""The image-formation model against its formulas and another library's projection."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acquisition import photometry
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


def test_rays_distorted_lens_round_trips(known: Calibration) -> None:
    ray = photometry.rays(known, slice(10, 90), slice(5, 70)).astype(float)
    points = np.stack([ray[0], ray[1], np.ones_like(ray[0])], axis=-1).reshape(-1, 3) * 0.77
    pixels, _ = cv2.projectPoints(
        points, np.zeros(3), np.zeros(3), np.array(known.camera_matrix), np.array(known.distortion)
    )
    rows, columns = np.mgrid[10:90, 5:70]
    np.testing.assert_allclose(pixels[:, 0, 0], columns.ravel(), atol=2e-3)
    np.testing.assert_allclose(pixels[:, 0, 1], rows.ravel(), atol=2e-3)


@pytest.mark.parametrize(
    ("focal_widths", "lens"),
    [(0.7, (-0.28, 0.08, 0, 0, -0.01)), (0.5, (-0.25, 0.05, 0, 0, 0)), (0.8, (0.3, 0.1, 0, 0, 0))],
)
def test_camera_rays_of_wide_lens_meet_their_pixels(focal_widths: float, lens: tuple[float, ...]) -> None:
    width, height = 1280, 960
    matrix = np.array([[focal_widths * width, 0, 640], [0, focal_widths * width, 480], [0, 0, 1]])
    x, y = photometry.camera_rays(matrix, np.array(lens), slice(0, height), slice(0, width))[:, ::40, ::40].astype(
        float
    )
    directions = np.stack([x.ravel(), y.ravel(), np.ones(x.size)], axis=-1)
    pixels, _ = cv2.projectPoints(directions, np.zeros(3), np.zeros(3), matrix, np.array(lens))
    rows, columns = np.mgrid[:height:40, :width:40]
    np.testing.assert_allclose(pixels[:, 0], np.stack([columns.ravel(), rows.ravel()], axis=-1), atol=2e-3)


@given(lens=st.tuples(st.floats(-0.3, 0.3), st.floats(-0.2, 0.2), *[st.floats(-0.01, 0.01)] * 2, st.floats(-0.1, 0.1)))
@settings(max_examples=20)
def test_camera_rays_any_lens_equal_opencv(lens: tuple[float, ...]) -> None:
    matrix, distortion = np.array([[90.0, 0, 40.5], [0, 80.0, 33.0], [0, 0, 1]]), np.array(lens)
    rows, columns = np.mgrid[7:60, 3:80].astype(float)
    pixels = np.stack([columns.ravel(), rows.ravel()], axis=-1)[:, None]
    converged = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-10)
    expected = cv2.undistortPoints(pixels, matrix, distortion, criteria=converged)
    expected = expected[:, 0].T.reshape(2, *rows.shape)
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
