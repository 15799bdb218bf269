"""Interface of motions: a motion advances the arm's joints by a step of motion time and reports its end.

`pace` is the share of the programmed speed that slider, pause and resume leave (0–1). It stretches the time base of
programmed moves (`moves`, `process_path`, joined by `blend`). A stop (`steering`) brakes at its own deceleration,
whatever the slider. A motion that meets a limit or a pose without solution raises `MotionError`, which causes a
protective stop whose message names the joint and the reason.
"""

from collections.abc import Sequence
from typing import Protocol

from hardware_sim.controller import kinematics, limits, poses
from hardware_sim.controller.kinematics import ArmModel
from hardware_sim.controller.poses import Frame

Joints = list[float]
State = tuple[Joints, Joints]  # joints in rad, joint speeds in rad/s
Twist = tuple[float, ...]  # m/s and rad/s, base frame

STANDSTILL: Twist = (0.0,) * 6


class MotionError(Exception):
    """The arm cannot follow; the message says why."""


class Motion(Protocol):
    """A motion of the arm.

    `finished`: whether it has ended, at rest. `velocity`: the tool's velocity if the motion knows it; None if it
    follows from the joints. `step` advances by `dt` seconds of motion time and returns joints and joint speeds; it
    raises MotionError.
    """

    @property
    def finished(self) -> bool: ...
    @property
    def velocity(self) -> Twist | None: ...
    def step(self, dt: float, pace: float) -> State: ...


class Follower:
    """Joints that follow tool poses tick by tick: nearest solution, limits of position, speed and acceleration."""

    def __init__(
        self, arm: ArmModel, joints: Sequence[float], speeds: Sequence[float], flange_from_tool: Frame
    ) -> None:
        self.arm = arm
        self.joints = list(joints)
        self._speeds = list(speeds)
        self._tool_from_flange = poses.invert(flange_from_tool)

    def solve(self, base_from_tool: Frame, near: Sequence[float] | None = None) -> Joints:
        """Joints for a tool pose that continue `near`, by default the present ones. Raises MotionError if none do."""
        last = self.joints if near is None else near
        joints = kinematics.following(self.arm, poses.compose(base_from_tool, self._tool_from_flange), last)
        if joints is None:
            why = kinematics.near_singularity(self.arm, last)
            raise MotionError("the target pose is out of reach" + (f": {why}" if why else ""))
        return joints

    def follow(self, base_from_tool: Frame, dt: float) -> State:
        """Joints for the next tool pose, `dt` seconds after the last. Raises MotionError."""
        joints = self.solve(base_from_tool)
        fault = limits.position_fault(joints, self.arm.unlimited_joints)
        if fault is not None:
            raise MotionError(fault)
        speeds = [(b - a) / dt for a, b in zip(self.joints, joints, strict=True)]
        fault = limits.speed_fault(speeds, self.arm.joint_speeds) or limits.acceleration_fault(self._speeds, speeds, dt)
        if fault is not None:
            why = kinematics.near_singularity(self.arm, self.joints)
            raise MotionError(fault + (f": {why}" if why else ""))
        self.joints, self._speeds = joints, speeds
        return joints, speeds
