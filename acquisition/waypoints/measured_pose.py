"""The tool's true pose: the pose that the controller states, corrected by the calibrated joint offsets.

The controller computes its pose from its own joint angles and kinematics. Joint offsets from a hand–eye calibration
turn that pose by a tenth of a degree and move it by a millimetre, more than the lamp's permitted error. Only the
difference due to the offsets is computed with this package's chain, so that the controller's factory kinematics stay in
the pose. Paths are planned without the offsets: the clearances are centimetres. A light is recorded at the lamp's
measured place, never at the planned one.
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
"""Step of numerical derivatives with respect to offsets, rad."""


def tool_pose(base_from_tool: FloatArray, joints: FloatArray, arm: ArmConfig, calibration: Calibration) -> FloatArray:
    """Corrects a stated tool pose (4, 4) at joints (6,), rad, by the calibration's joint offsets."""
    if calibration.joint_offsets_rad is None:
        return base_from_tool
    stated = tools(joints[None], arm, calibration.model_copy(update={"joint_offsets_rad": None}))[0]
    # The correction is applied in the tool's own frame, which holds for whatever is on the flange.
    return base_from_tool @ geometry.inverse(stated) @ tools(joints[None], arm, calibration)[0]


def tools(joints: FloatArray, arm: ArmConfig, calibration: Calibration) -> FloatArray:
    """Tool poses (N, 4, 4), base frame, by this package's chain with the calibration's joint offsets, from joints (N,
    6), rad, as the controller states them."""
    true = joints + np.array(calibration.joint_offsets_rad or (0.0,) * 6)
    return calibrated_kinematics.forward(calibrated_kinematics.of_arm(arm), true)[:, 6] @ arm.flange_from_tool.matrix


def by_offsets(joints: FloatArray, arm: ArmConfig, calibration: Calibration) -> FloatArray:
    """Derivatives (4, 4, 4), 1/rad, of the tool's pose at joints (6,) by the offsets of joints 2 to 5: central
    differences. The controller's own kinematics differ by millimetres, which is negligible in derivatives."""
    steps = np.zeros((len(OFFSET_JOINTS), 6))
    steps[np.arange(len(OFFSET_JOINTS)), OFFSET_JOINTS] = STEP_RAD
    ahead, behind = (tools(joints + sign * steps, arm, calibration) for sign in (1, -1))
    return (ahead - behind) / (2 * STEP_RAD)


def light(base_from_tool: FloatArray, joints: FloatArray, arm: ArmConfig, calibration: Calibration) -> Light:
    """Returns the light, view frame, for a tool pose (4, 4) that the controller states at joints (6,), rad."""
    return lamp_pose.light_from_tool(tool_pose(base_from_tool, joints, arm, calibration), calibration)
