"""Rigid transforms against scipy, and the frames' conventions."""

import cv2
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from acquisition import geometry, photometry

VECTOR = st.tuples(*[st.floats(-7.0, 7.0)] * 3)


@given(VECTOR, VECTOR)
def test_pose_agrees_with_scipy_and_inverse_undoes_it(position: tuple[float, ...], turn: tuple[float, ...]) -> None:
    pose = geometry.pose(position, turn)
    assert np.allclose(pose[:3, :3], Rotation.from_rotvec(turn).as_matrix(), atol=1e-12)
    assert np.allclose(geometry.inverse(pose) @ pose, np.eye(4), atol=1e-12)
    assert np.allclose(geometry.transform(pose, [0.0, 0.0, 0.0]), position)
    assert np.allclose(
        geometry.transform(geometry.inverse(pose), geometry.transform(pose, position)), position, atol=1e-9
    )


@given(st.floats(0, 1e-6))
def test_pose_small_rotation_is_exact(angle: float) -> None:
    turn = angle * np.array([0.6, 0.0, 0.8])
    assert np.allclose(geometry.pose([0, 0, 0], turn)[:3, :3], Rotation.from_rotvec(turn).as_matrix(), atol=1e-15)


@given(st.floats(0.01, 3.1), st.floats(-3.1, 3.1))
def test_slant_azimuth_of_direction_round_trips(slant: float, azimuth: float) -> None:
    angles = geometry.slant_azimuth(3.0 * geometry.direction(slant, azimuth))
    assert np.allclose(angles, (slant, azimuth), atol=1e-9)


def test_base_from_view_is_camera_with_y_up_and_z_towards_it() -> None:
    above = np.diag([1.0, -1.0, -1.0, 1.0])  # a camera that looks down along -z of the base
    assert np.allclose(geometry.base_from_view(above), np.eye(4))
    assert np.allclose(geometry.rotate(geometry.VIEW_FROM_CAMERA, [0.1, 0.2, 0.3]), [0.1, -0.2, -0.3])


WIDE_LENS = (-0.25, 0.06, 0.001, -0.001, -0.004)
WIDE_MATRIX = np.array([[0.55 * 2000, 0, 999.5], [0, 0.55 * 2000, 749.5], [0, 0, 1]])


def test_undistorted_rays_of_wide_lens_meet_their_pixels_in_the_corners() -> None:
    pixels = np.array([[0.0, 0.0], [1999, 0], [0, 1499], [1999, 1499], [1000, 750]])
    rays = geometry.undistorted(pixels, WIDE_MATRIX, WIDE_LENS)
    projected, _ = cv2.projectPoints(
        np.column_stack([rays, np.ones(5)]), np.zeros(3), np.zeros(3), WIDE_MATRIX, np.array(WIDE_LENS)
    )
    np.testing.assert_allclose(projected[:, 0], pixels, atol=1e-5)


def test_undistorted_rays_are_those_that_the_solver_uses() -> None:
    pixels = np.array([[0.0, 0.0], [1999, 3], [1000, 3]])
    solved = photometry.camera_rays(WIDE_MATRIX, np.array(WIDE_LENS), slice(0, 4), slice(0, 2000))
    at = pixels.astype(int)
    np.testing.assert_allclose(
        geometry.undistorted(pixels, WIDE_MATRIX, WIDE_LENS), solved[:, at[:, 1], at[:, 0]].T, atol=1e-6
    )
