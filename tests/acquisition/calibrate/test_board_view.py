"""Where a planned view has the board in the image, beside what the planner of the views computes."""

from pathlib import Path

import numpy as np

from acquisition.calibrate import board_session, board_view, charuco, view_planning
from acquisition.calibrate.bundle_adjustment import Model
from acquisition.models import cell_config
from acquisition.waypoints import calibrated_kinematics, mounted_tool
from acquisition.waypoints.roadmap import connected_views
from hardware_sim import nominal

CELL = cell_config.load(Path(__file__).parents[3] / "tests" / "data" / "cell.test.toml")


def test_expected_view_is_where_planner_has_board() -> None:
    cell, calibration = mounted_tool.with_tool(CELL, "board"), nominal.calibration(128)
    joints = connected_views(cell, calibration, 3, seed=3)[0]
    model = Model(charuco.of_cell(mounted_tool.require_board(cell)), calibrated_kinematics.of_arm(cell.arm))
    size = (calibration.width, calibration.height)
    planned = view_planning.predicted_view(model, board_session.prior(cell, calibration), joints, size)
    expected = board_view.expected(tuple(joints.tolist()), cell, calibration)
    assert planned is not None
    assert expected is not None
    seen = np.array(expected.corners_px)
    assert max(np.linalg.norm(seen - one, axis=1).min() for one in planned.pixels) < 0.02
    low, high = np.min(expected.outline_px, axis=0), np.max(expected.outline_px, axis=0)
    assert ((seen > low) & (seen < high)).all()
    assert 0 <= expected.tilt_deg < 60


def test_board_behind_camera_is_no_view() -> None:
    calibration = nominal.calibration(128)
    pose = np.array(calibration.base_from_camera)
    pose[:3, 2] *= -1
    pose[:3, 0] *= -1  # looks up
    turned = calibration.model_copy(update={"base_from_camera": tuple(map(tuple, pose.tolist()))})
    assert board_view.expected(CELL.arm.home, CELL, turned) is None
