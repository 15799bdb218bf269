"""Speed and duration of straight joint segments: trapezoidal velocity profile under joint, tool and elbow limits.

The controller's `moveJ` drives the leading joint (the one with the largest displacement) with a trapezoidal velocity
profile and the others in proportion. So a segment's time has a closed form, and a limit on the tool's or elbow's speed
is a limit on the leading joint's.
"""

from dataclasses import dataclass

import numpy as np

from acquisition.models.base import FloatArray
from acquisition.models.cell_config import CellConfig
from acquisition.waypoints import motion_kernels, mounted_tool
from acquisition.waypoints.kinematics import arm_model

_SAMPLING_MARGIN = 0.97
"""Fraction of the limits that is used: between 33 samples the speed exceeds their maximum by up to 1 %."""


@dataclass(frozen=True)
class Legs:
    """Leading joint's speed (N,) in rad/s and time (N,) in s of N segments."""

    speeds: FloatArray
    seconds: FloatArray


def legs(starts: FloatArray, ends: FloatArray, cell: CellConfig, samples: int = 33) -> Legs:
    """Returns the largest allowed speed and the shortest time of each straight joint segment (N, 6) to (N, 6), rad.

    Tool and elbow speed are limited at `samples` points of the forward kinematics along each segment. Which points
    are the tool's depends on what the cell has on the flange.
    """
    arm = cell.arm
    model = arm_model(arm.model)
    tool = mounted_tool.speed_points(cell)
    starts, ends = np.ascontiguousarray(starts), np.ascontiguousarray(ends)
    turn = np.abs(ends - starts)
    leading = turn.max(axis=1)
    reach = motion_kernels.path_lengths_per_share(starts, ends, model.dh, tool, samples)
    with np.errstate(divide="ignore", invalid="ignore"):
        speeds = np.minimum.reduce(
            [
                np.full(len(leading), arm.max_joint_speed_rad_s),
                leading * np.min(model.max_joint_speed_rad_s / turn, axis=1),
                leading * _SAMPLING_MARGIN * arm.max_tool_speed_m_s / reach[:, 0],
                leading * _SAMPLING_MARGIN * arm.max_elbow_speed_m_s / reach[:, 1],
            ]
        )
    # A segment of zero length has no leading joint; its speed is arbitrary.
    speeds = np.where(leading > 0, speeds, arm.max_joint_speed_rad_s)
    return Legs(speeds, trapezoid_seconds(leading, speeds, arm.max_joint_acceleration_rad_s2))


def trapezoid_seconds(angle: FloatArray, speed: FloatArray, acceleration: float) -> FloatArray:
    """Time, s, from rest to rest over `angle` (rad) with a trapezoidal velocity profile: at up to `speed` (rad/s), with
    `acceleration` (rad/s²)."""
    ramped = angle < speed**2 / acceleration
    return np.where(ramped, 2 * np.sqrt(angle / acceleration), angle / speed + speed / acceleration)
