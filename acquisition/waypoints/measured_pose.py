"""Where the tool truly is: the pose that the controller states, moved by what the calibration knows of the joints.

The controller computes its pose from its own joint angles and kinematics; offsets of the joints that a hand–eye
calibration has found turn it by a tenth of a degree and move it by a millimetre, which is more than a lamp may be off.
Only the difference that the offsets make is taken from this package's chain, so that the controller's own factory
kinematics stay in what it states. Paths are planned without the offsets: the clearances are centimetres, and a light
is recorded from where the lamp was, never from where it was sent.
"""

import numpy as np

from acquisition import geometry, lamp_pose
from acquisition.models.base import FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import ArmConfig
from acquisition.models.light_plan import Light
from acquisition.waypoints import calibrated_kinematics

OFFSET_JOINTS = range(1, 5)
"""Joints with offsets of their own: those of the first and the last are part of the base's and the tool's pose."""

STEP_RAD = 1e-5
"""Step of numeric derivatives by offsets, rad."""


def tool_pose(base_from_tool: FloatArray, joints: FloatArray, arm: ArmConfig, calibration: Calibration) -> FloatArray:
    """The tool's pose (4, 4) with the calibration's joint offsets, from that stated (4, 4) at joints (6,), rad."""
    if calibration.joint_offsets_rad is None:
        return base_from_tool
    stated = tools(joints[None], arm, calibration.model_copy(update={"joint_offsets_rad": None}))[0]
    # The tool's motion, seen from the tool: what is on the flange goes with it.
    return base_from_tool @ geometry.inverse(stated) @ tools(joints[None], arm, calibration)[0]


def tools(joints: FloatArray, arm: ArmConfig, calibration: Calibration) -> FloatArray:
    """Poses (N, 4, 4) of the tool in the base frame by this package's chain, from joints (N, 6), rad, as the controller
    states them, with the calibration's joint offsets."""
    true = joints + np.array(calibration.joint_offsets_rad or (0.0,) * 6)
    return calibrated_kinematics.forward(calibrated_kinematics.of_arm(arm), true)[:, 6] @ arm.flange_from_tool.matrix


def by_offsets(joints: FloatArray, arm: ArmConfig, calibration: Calibration) -> FloatArray:
    """Derivatives (4, 4, 4), 1/rad, of the tool's pose at joints (6,) by the offsets of joints 2 to 5, by central
    differences: the controller's own kinematics differ by millimetres, which in derivatives is nothing."""
    steps = np.zeros((len(OFFSET_JOINTS), 6))
    steps[np.arange(len(OFFSET_JOINTS)), OFFSET_JOINTS] = STEP_RAD
    ahead, behind = (tools(joints + sign * steps, arm, calibration) for sign in (1, -1))
    return (ahead - behind) / (2 * STEP_RAD)


def light(base_from_tool: FloatArray, joints: FloatArray, arm: ArmConfig, calibration: Calibration) -> Light:
    """The light in the view frame from a tool pose (4, 4) that the controller states at joints (6,), rad."""
    return lamp_pose.light_from_tool(tool_pose(base_from_tool, joints, arm, calibration), calibration)
