"""The lamp's place from highlights on a mirror sphere: found within its covariance, and what is refused."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.stats import chi2

from acquisition import geometry
from acquisition.calibrate import lamp_position
from acquisition.calibrate.lamp_position import Highlight
from acquisition.models import cell_config
from acquisition.models.base import FloatArray
from acquisition.models.errors import ErrorCode, RigError
from acquisition.waypoints import kinematics, measured_pose
from acquisition.waypoints.collision import scene
from hardware_sim import nominal
from tests.acquisition.calibrate.coverage import require_covered, squared
from tests.acquisition.calibrate.mirror_sphere import (
    CALIBRATION,
    CENTER_M,
    POSE_COVARIANCE,
    RADIUS_M,
    Truth,
    highlights,
    tools,
    truth,
)

CELL = cell_config.load(nominal.default_cell_file())
OFFSET_SIGMA_RAD = 1e-3


def fitted(seen: list[Highlight]) -> lamp_position.LampFit:
    return lamp_position.fit(seen, CALIBRATION, POSE_COVARIANCE, RADIUS_M, CENTER_M)


def test_reflection_obeys_the_law_of_reflection() -> None:
    camera, lamps = np.array([0.5, 0.1, 0.9]), np.array([[0.9, 0.2, 0.3], [0.3, -0.2, 0.4]])
    points = lamp_position.reflection(CENTER_M, RADIUS_M, camera, lamps)
    normal = (points - CENTER_M) / RADIUS_M
    to_camera, to_lamp = (
        side / np.linalg.norm(side, axis=1, keepdims=True) for side in (camera - points, lamps - points)
    )
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1, atol=1e-12)
    np.testing.assert_allclose(2 * np.sum(normal * to_camera, axis=1)[:, None] * normal - to_camera, to_lamp, atol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_fit_tilted_lamps_is_found_within_its_covariance(seed: int) -> None:
    known = truth(seed)
    found = fitted(highlights(known, tools(30, seed), seed))
    error = found.tool_from_lamp_m - known.lamp_m
    assert np.linalg.norm(error) < 1.5e-3
    assert error @ np.linalg.solve(found.covariance, error) < chi2.ppf(0.999, 3)
    assert np.linalg.norm(found.sphere_center_m - known.center_m) < 2e-3
    assert found.highlight_sigma_px == pytest.approx(0.1, rel=0.35)


def window_highlights(known: Truth, poses: FloatArray, radius_m: float) -> list[Highlight]:
    """Highlights of a luminous disc without noise, each in the middle of its image's area by `cv2.moments`."""
    around = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    disc = known.lamp_m + radius_m * np.stack([np.cos(around), np.sin(around), 0 * around], axis=1)
    outlines = [
        np.stack([one.pixel for one in highlights(replace(known, lamp_m=point), poses, 0, noise_px=0.0)])
        for point in disc
    ]
    made: list[Highlight] = []
    for number, tool in enumerate(poses):
        outline = np.stack([outline[number] for outline in outlines])
        start = outline.mean(axis=0)
        area = cv2.moments((1000 * (outline - start)).astype(np.float32))
        middle = np.array([area["m10"], area["m01"]]) / area["m00"] / 1000
        made.append(Highlight(f"{number}", start + middle, tool))
    return made


def test_fit_tilted_window_is_no_point() -> None:
    known, poses = truth(2), tools(10, 2)
    seen = window_highlights(known, poses, 0.02)
    found = lamp_position.fit(seen, CALIBRATION, POSE_COVARIANCE, RADIUS_M, CENTER_M, 0.02)
    as_point = lamp_position.fit(seen, CALIBRATION, POSE_COVARIANCE, RADIUS_M, CENTER_M)
    off, off_as_point = (np.linalg.norm(one.tool_from_lamp_m - known.lamp_m) for one in (found, as_point))
    assert off_as_point > 5e-4
    assert off < 0.5 * off_as_point


def test_choose_poses_tell_more_than_as_many_random_ones() -> None:
    known, offered = truth(1), tools(120, 1)
    chosen = lamp_position.choose_poses(offered, CALIBRATION, POSE_COVARIANCE, CENTER_M, RADIUS_M, 14)
    assert len(set(chosen)) == 14
    planned = fitted(highlights(known, offered[chosen], 1)).sigma_m
    at_random = [fitted(highlights(known, offered[14 * n : 14 * n + 14], 1)).sigma_m for n in range(5)]
    assert planned < 0.95 * np.mean(at_random)


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_fit_covariance_covers_truth_in_fifty_cells() -> None:
    squares = list[float]()
    for seed in range(100, 150):
        known = truth(seed)
        found = fitted(highlights(known, tools(30, seed), seed))
        squares.append(squared(found.tool_from_lamp_m - known.lamp_m, found.covariance))
    require_covered("lamp", squares, 3)


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_fit_covariance_holds_that_of_joint_offsets() -> None:
    """Offsets that are known to 0.06° only: with their covariance errors are covered, without it they are larger."""
    squares, without = list[float](), list[float]()
    for seed in range(100, 150):
        known, seen = truth(seed), list[Highlight]()
        offsets = OFFSET_SIGMA_RAD * np.random.default_rng(seed).standard_normal(4)
        joints = joints_of(tools(60, seed))[:30]
        derivatives = np.stack([measured_pose.by_offsets(one, CELL.arm, CALIBRATION) for one in joints])
        stated = measured_pose.tools(joints, CELL.arm, CALIBRATION)
        shown = highlights(known, stated + np.einsum("j,njkl->nkl", offsets, derivatives), seed)
        for one, tool, moved in zip(shown, stated, derivatives, strict=True):
            seen.append(replace(one, base_from_tool=tool, by_offsets=moved))
        both = block_diag(POSE_COVARIANCE, OFFSET_SIGMA_RAD**2 * np.eye(4))
        for covariance, kept in ((both, squares), (POSE_COVARIANCE, without)):
            found = lamp_position.fit(seen, CALIBRATION, covariance, RADIUS_M, CENTER_M)
            kept.append(squared(found.tool_from_lamp_m - known.lamp_m, found.covariance))
    require_covered("lamp with uncertain joints", squares, 3)
    assert np.mean(without) > 1.1 * np.mean(squares)  # 1.41 and 1.19: the sphere takes up most of what offsets do


def joints_of(poses: FloatArray) -> FloatArray:
    """Joints (N, 6) of the simulated cell's arm at poses of the tool (M, 4, 4), where it reaches them."""
    flanges = poses @ geometry.inverse(CELL.arm.flange_from_tool.matrix)
    branches = kinematics.inverse(scene(CELL, CALIBRATION).model, flanges)
    solved = [one[~np.isnan(one[:, 0])] for one in branches]
    return np.array([one[0] for one in solved if len(one)])


def refusal(seen: list[Highlight]) -> str:
    with pytest.raises(RigError) as refused:
        fitted(seen)
    assert refused.value.code is ErrorCode.CALIBRATION_INFEASIBLE
    return refused.value.detail


def test_fit_lamps_that_aim_at_sphere_are_refused() -> None:
    assert "tilt the lamp" in refusal(highlights(truth(1), tools(30, 1, tilt_deg=0.0), 1))


def test_fit_lamps_on_one_side_or_few_are_refused() -> None:
    seen = highlights(truth(2), tools(30, 2, slant_deg=11.0), 2)
    assert "use the whole dome" in refusal(seen)
    assert "8 are needed" in refusal(seen[:7])


def test_fit_highlight_that_is_not_the_lamps_is_named() -> None:
    """The lamp's tilt, to which the refusal once attributed it, is as it should be."""
    known = truth(1)
    seen = highlights(known, tools(32, 1), 1)
    seen[5] = replace(seen[5], pixel=seen[5].pixel + np.array([40.0, -30.0]))
    detail = refusal(seen)
    assert "most of all in 005.png" in detail
    assert "tilt" not in detail
