"""The tool's pose with the joint offsets of a calibration."""

import numpy as np

from acquisition.models import cell_config
from acquisition.waypoints import calibrated_kinematics, measured_pose
from hardware_sim import nominal

CELL = cell_config.load(nominal.default_cell_file())
JOINTS = np.array([-2.6641, -0.9534, 1.6785, 2.607, 1.8307, 2.423])
OFFSETS = (0.0, 2e-3, -1e-3, 1.5e-3, 5e-4, 0.0)


def stated(joints: np.ndarray) -> np.ndarray:
    chain = calibrated_kinematics.of_arm(CELL.arm)
    return calibrated_kinematics.forward(chain, joints[None])[0, 6] @ CELL.arm.flange_from_tool.matrix


def test_tool_pose_joint_offsets_give_pose_at_true_joints() -> None:
    known = nominal.calibration(96).model_copy(update={"joint_offsets_rad": OFFSETS})
    moved = measured_pose.tool_pose(stated(JOINTS), JOINTS, CELL.arm, known)
    np.testing.assert_allclose(moved, stated(JOINTS + np.array(OFFSETS)), atol=1e-12)
    light, before = (
        measured_pose.light(stated(JOINTS), JOINTS, CELL.arm, one) for one in (known, nominal.calibration(96))
    )
    assert 5e-4 < np.linalg.norm(np.subtract(light.position, before.position)) < 5e-3


def test_tool_pose_factory_kinematics_of_controller_are_kept() -> None:
    known = nominal.calibration(96).model_copy(update={"joint_offsets_rad": OFFSETS})
    off = np.eye(4)
    off[:3, 3] = 1e-3, -2e-3, 5e-4  # the controller knows more of its arm than the cell file
    plain = measured_pose.tool_pose(stated(JOINTS), JOINTS, CELL.arm, known)
    np.testing.assert_allclose(measured_pose.tool_pose(off @ stated(JOINTS), JOINTS, CELL.arm, known), off @ plain)


def test_tool_pose_without_offsets_is_as_stated() -> None:
    pose = stated(JOINTS)
    assert measured_pose.tool_pose(pose, JOINTS, CELL.arm, nominal.calibration(96)) is pose
