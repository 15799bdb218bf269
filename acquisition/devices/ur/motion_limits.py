"""Checks the limits of a move against the cell's before anything is sent."""

import math
from collections.abc import Sequence

from acquisition.devices import MotionLimits
from acquisition.models.cell_config import ArmConfig
from acquisition.models.errors import ErrorCode, RigError


def checked(
    config: ArmConfig, path: Sequence[Sequence[float]], limits: Sequence[MotionLimits]
) -> tuple[tuple[float, float], ...]:
    """Returns speed (rad/s) and acceleration (rad/s²) of each segment's leading joint.

    Raises RigError arm.move_failed for a path that is not of six finite joints each, or for limits beyond the cell's.
    """
    if len(path) != len(limits):
        raise RigError(
            ErrorCode.ARM_MOVE_FAILED, f"The path has {len(path)} segments, but {len(limits)} limits are given."
        )
    for joints in path:
        if len(joints) != 6 or not all(map(math.isfinite, joints)):
            raise RigError(
                ErrorCode.ARM_MOVE_FAILED, f"A joint configuration needs six finite angles, not {tuple(joints)}."
            )
    for limit in limits:
        speed, acceleration = limit.speed_rad_s, limit.acceleration_rad_s2
        if not 0 < speed <= config.max_joint_speed_rad_s * (1 + 1e-9):
            most = config.max_joint_speed_rad_s
            raise RigError(ErrorCode.ARM_MOVE_FAILED, f"Speed {speed} rad/s is not within the limit of {most} rad/s.")
        if not 0 < acceleration <= config.max_joint_acceleration_rad_s2 * (1 + 1e-9):
            most = config.max_joint_acceleration_rad_s2
            detail = f"Acceleration {acceleration} rad/s² is not within the limit of {most} rad/s²."
            raise RigError(ErrorCode.ARM_MOVE_FAILED, detail)
    return tuple((limit.speed_rad_s, limit.acceleration_rad_s2) for limit in limits)
