"""Camera and hand–eye calibration against a truth whose noise, warp and joint offsets are random."""

import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from acquisition import geometry
from acquisition.calibrate import hand_eye, intrinsics, view_planning
from acquisition.calibrate.bundle_adjustment import CAMERA, JOINT_OFFSETS, Model
from acquisition.calibrate.charuco import View
from acquisition.models.base import FloatArray
from acquisition.models.errors import ErrorCode, RigError
from tests.acquisition.calibrate.coverage import require_covered, squared
from tests.acquisition.calibrate.synthetic import BOARD, NOMINAL, SIZE, Truth, joints_of, truth, views


def captured(seed: int, count: int = 15) -> tuple[Truth, list[View]]:
    known = truth(seed)
    return known, views(known, joints_of(known, count, seed), seed)


def error_of_pose(found: FloatArray, true: FloatArray) -> FloatArray:
    """Small motion (6,) in the camera's frame from one pose to the other: m, rad."""
    between = geometry.inverse(found) @ true
    return np.concatenate([between[:3, 3], Rotation.from_matrix(between[:3, :3]).as_rotvec()])


def test_intrinsics_many_views_are_found_within_their_covariance() -> None:
    known, seen = captured(1, 20)
    found = intrinsics.fit(BOARD, seen, SIZE)
    camera = found.adjusted.parameters.camera
    assert camera[0] == pytest.approx(known.camera[0], rel=1e-3)
    assert found.adjusted.corner_sigma_px == pytest.approx(known.corner_sigma_px, rel=0.1)
    error = camera - known.camera
    assert error @ np.linalg.solve(found.adjusted.covariance[CAMERA, CAMERA], error) < chi2.ppf(0.999, 9)
    opencv = cv2.calibrateCamera(
        [BOARD.corners_m[view.corners].astype(np.float32) for view in seen],
        [view.pixels.astype(np.float32).reshape(-1, 1, 2) for view in seen], SIZE, np.eye(3), np.zeros(5),
    )[1]  # fmt: skip
    assert abs(camera[0] - known.camera[0]) < abs(opencv[0, 0] - known.camera[0])  # it takes the warp for focal length


def test_projection_sigma_is_least_where_boards_were_seen() -> None:
    _, seen = captured(2)
    sigma = intrinsics.projection_sigma(intrinsics.fit(BOARD, seen, SIZE))
    rows, columns = sigma.shape
    assert sigma[rows // 2, columns // 2] < 0.5 * sigma[0, 0]
    assert 0 < sigma.min() < sigma.max() < 2


def test_misread_corner_is_left_out_and_named() -> None:
    _, seen = captured(3)
    pixels = seen[4].pixels.copy()
    pixels[7] += (3.0, -2.0)
    found = intrinsics.fit(BOARD, [*seen[:4], replace(seen[4], pixels=pixels), *seen[5:]], SIZE)
    assert found.adjusted.left_out == ((seen[4].name, int(seen[4].corners[7])),)
    assert found.adjusted.corner_sigma_px < 0.06


def test_blurred_view_is_left_out_as_a_whole() -> None:
    """Of a view whose corners all scatter by pixels, no corner is left; it once ended in an error of numpy."""
    known, seen = captured(3)
    pixels = seen[3].pixels + np.random.default_rng(0).normal(0, 3, seen[3].pixels.shape)
    camera = intrinsics.fit(BOARD, [*seen[:3], replace(seen[3], pixels=pixels), *seen[4:]], SIZE)
    assert {name for name, _ in camera.adjusted.left_out} == {seen[3].name}
    assert [view.name for view in camera.adjusted.views] == [view.name for view in seen if view is not seen[3]]
    found = hand_eye.fit(BOARD, NOMINAL, seen, camera)
    error = error_of_pose(found.base_from_camera, known.base_from_camera)
    assert error @ np.linalg.solve(found.covariance, error) < chi2.ppf(0.999, 6)
    assert found.furthest is None


def test_joints_of_another_image_are_refused() -> None:
    """All joints shifted by an image left no corner; those of two images exchanged gave a camera far from its place."""
    _, seen = captured(3)
    shifted = [replace(view, joints=seen[(n + 1) % len(seen)].joints) for n, view in enumerate(seen)]
    assert "do the joints stated for each image belong to it?" in refusal(shifted)
    exchanged = [
        *seen[:2],
        replace(seen[2], joints=seen[7].joints),
        *seen[3:7],
        replace(seen[7], joints=seen[2].joints),
    ]
    exchanged += seen[8:]
    found = hand_eye.fit(BOARD, NOMINAL, exchanged, intrinsics.fit(BOARD, exchanged, SIZE))
    assert found.furthest in (seen[2].name, seen[7].name)


def test_hand_eye_fifteen_views_meet_the_accuracy_asked() -> None:
    known, seen = captured(4)
    found = hand_eye.fit(BOARD, NOMINAL, seen, intrinsics.fit(BOARD, seen, SIZE))
    error = error_of_pose(found.base_from_camera, known.base_from_camera)
    assert np.linalg.norm(error[:3]) < 8e-4
    assert np.degrees(np.linalg.norm(error[3:])) < 0.1  # with the principal point it largely cancels
    assert error @ np.linalg.solve(found.covariance, error) < chi2.ppf(0.999, 6)
    assert np.degrees(np.abs(found.adjusted.parameters.joint_offsets - known.joint_offsets)).max() < 0.06
    assert 1e-5 < found.adjusted.arm_sigma[0] < 1e-4


def test_hand_eye_perfect_data_is_recovered_exactly() -> None:
    known = replace(truth(5), corner_sigma_px=0.0, arm_sigma=(0.0, 0.0))
    seen = views(known, joints_of(known, 15, 5), 5)
    found = hand_eye.fit(BOARD, NOMINAL, seen, intrinsics.fit(BOARD, seen, SIZE))
    error = error_of_pose(found.base_from_camera, known.base_from_camera)
    assert np.linalg.norm(error[:3]) < 2e-5
    assert np.degrees(np.linalg.norm(error[3:])) < 2e-3


def test_park_of_exact_poses_is_exact() -> None:
    known = replace(truth(6), joint_offsets=np.zeros(6))
    joints = joints_of(known, 5, 6)
    from acquisition.waypoints import calibrated_kinematics

    flange = calibrated_kinematics.forward(NOMINAL, joints)[:, 6]
    boards = geometry.inverse(known.base_from_camera) @ flange @ known.flange_from_board
    np.testing.assert_allclose(hand_eye.park(flange, boards), known.base_from_camera, atol=1e-9)


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_covariance_of_fifty_calibrations_covers_truth() -> None:
    """Camera, base from camera, joint offsets."""
    of_camera, of_pose, of_joints = list[float](), list[float](), list[float]()
    for seed in range(100, 150):
        known, seen = captured(seed)
        camera = intrinsics.fit(BOARD, seen, SIZE)
        found = hand_eye.fit(BOARD, NOMINAL, seen, camera)
        adjusted = found.adjusted
        error = camera.adjusted.parameters.camera - known.camera
        of_camera.append(squared(error, camera.adjusted.covariance[CAMERA, CAMERA]))
        of_pose.append(squared(error_of_pose(found.base_from_camera, known.base_from_camera), found.covariance))
        off = adjusted.parameters.joint_offsets[1:5] - known.joint_offsets[1:5]
        of_joints.append(squared(off, adjusted.covariance[JOINT_OFFSETS, JOINT_OFFSETS]))
    require_covered("base from camera", of_pose, 6)
    require_covered("joint offsets", of_joints, 4)
    require_covered("camera", of_camera, 9)


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_planned_views_reach_accuracy_with_fewer_than_random() -> None:
    """Views until base from camera is as certain as after sixteen random ones."""
    needed: list[int] = []
    for seed in range(200, 206):
        known = truth(seed)
        pool = joints_of(known, 60, seed, tilt_deg=(0.0, 45.0))
        taken = list(range(6))
        fitted = [fit_of(known, pool, range(16), seed), fit_of(known, pool, taken, seed)]
        wanted = view_planning.loss(fitted[0].covariance)
        while view_planning.loss(fitted[-1].covariance) > wanted:
            left = [number for number in range(6, 60) if number not in taken]
            best = view_planning.next_view(
                Model(BOARD, NOMINAL), fitted[-1].adjusted, [pool[number] for number in left], SIZE
            )
            assert best is not None
            taken.append(left[best[0]])
            fitted.append(fit_of(known, pool, taken, seed))
        needed.append(len(taken))
    print(f"planned views that reach what 16 random ones do: {needed}, {np.mean(needed) / 16:.0%}")
    assert np.mean(needed) <= 0.7 * 16


def fit_of(known: Truth, pool: FloatArray, taken: list[int] | range, seed: int) -> hand_eye.HandEyeFit:
    everything = {view.name: view for view in views(known, pool, seed)}
    seen = [everything[f"{number:03}.png"] for number in taken if f"{number:03}.png" in everything]
    return hand_eye.fit(BOARD, NOMINAL, seen, intrinsics.fit(BOARD, seen, SIZE))


def test_next_view_prefers_tilted_board_over_repetition() -> None:
    _, seen = captured(7, 8)
    found = hand_eye.fit(BOARD, NOMINAL, seen, intrinsics.fit(BOARD, seen, SIZE))
    model = Model(BOARD, NOMINAL)
    away = seen[0].joints + np.array([np.pi / 2, 0, 0, 0, 0, 0])  # type: ignore[operator]
    new = joints_of(truth(7), 1, 77)[0]
    best = view_planning.next_view(model, found.adjusted, [away, seen[0].joints, new], SIZE)  # type: ignore[list-item]
    assert best is not None
    assert best[0] == 2
    assert best[1] < view_planning.loss(found.covariance)
    assert view_planning.next_view(model, found.adjusted, [away], SIZE) is None


def refusal(seen: list[View], code: ErrorCode = ErrorCode.CALIBRATION_INFEASIBLE) -> str:
    with pytest.raises(RigError) as refused:
        hand_eye.fit(BOARD, NOMINAL, seen, intrinsics.fit(BOARD, seen, SIZE))
    assert refused.value.code is code
    return refused.value.detail


def test_fit_too_few_views_is_refused() -> None:
    _, seen = captured(8)
    assert "5 are needed" in refusal(seen[:4])
    assert "6 are needed" in refusal(seen[:5])


def test_fit_boards_tilted_alike_are_refused() -> None:
    known = truth(9)
    joints = np.tile(joints_of(known, 1, 9), (8, 1))
    joints[:, 5] += np.linspace(-0.05, 0.05, 8)
    assert "tilted alike" in refusal(views(known, joints, 9))


def test_fit_flange_turned_about_one_axis_is_refused() -> None:
    _, seen = captured(10)
    turned = [replace(view, joints=seen[0].joints + np.array([0, 0, 0, 0, 0, 0.2 * n])) for n, view in enumerate(seen)]  # type: ignore[operator]
    assert "about one axis" in refusal(turned)


def test_fit_wrong_side_of_squares_is_refused_with_the_right_one() -> None:
    known = replace(truth(11), scale=0.03)
    detail = refusal(views(known, joints_of(known, 15, 11), 11), ErrorCode.CALIBRATION_BOARD_WRONG)
    said = re.search(r"squares are (.*) % larger than stated", detail)
    assert said is not None
    assert float(said[1]) == pytest.approx(3, abs=0.5)
