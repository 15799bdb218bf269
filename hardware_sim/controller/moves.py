"""Programmed moves of the UR script manual: moves to a known end, on a trapezoidal velocity profile.

`JointMove` (`movej`) is a straight segment in joint space. A `CartesianMove` (`movel`, `movec`, `movep`) moves the
tool, on a curve from rest to rest (`ToolMove`) or on a path at constant speed (`process_path.ProcessPath`). All give
`blend` what it needs to join two of them: how long they take to start and to stop, and where they are shortly after
their start and before their end.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Protocol

from hardware_sim.controller import kinematics, limits, poses
from hardware_sim.controller.curves import Curve
from hardware_sim.controller.kinematics import ArmModel
from hardware_sim.controller.motion import STANDSTILL, Follower, Joints, Motion, MotionError, State, Twist
from hardware_sim.controller.poses import Frame
from hardware_sim.controller.profile import Trapezoid

_AT_REST: Joints = [0.0] * 6
_STRIDE = 0.1  # m of the tool between the poses that follow a path to its end joints
_STRIDE_TURN = 0.5  # rad, likewise


class ProgrammedMove(Motion, Protocol):
    """A move to a known end.

    `time_left`: seconds of motion time until it stands at its end, as known now. `ramp_in`, `ramp_out`: seconds of
    acceleration at its start and of braking before its end. `joints_after`, `joints_before_end`: its joints within
    these; they raise MotionError. `hands_over`: whether the next move may take over, with a blend of `radius` (m).
    """

    end: Joints

    @property
    def time_left(self) -> float: ...
    @property
    def ramp_in(self) -> float: ...
    @property
    def ramp_out(self) -> float: ...
    def joints_after(self, seconds: float) -> Joints: ...
    def joints_before_end(self, seconds: float) -> Joints: ...
    def hands_over(self, base_from_tool: Frame, base_from_end: Frame, radius: float) -> bool: ...


class _TrapezoidalMove:
    """The properties of a move from rest to rest that follow from its profile."""

    def __init__(self, profile: Trapezoid) -> None:
        self.profile = profile
        self._time = 0.0
        self.finished = profile.length <= 0.0

    @property
    def time_left(self) -> float:
        return max(0.0, self.profile.duration - self._time)

    @property
    def ramp_in(self) -> float:
        return self.profile.ramp

    ramp_out = ramp_in

    def hands_over(self, base_from_tool: Frame, base_from_end: Frame, radius: float) -> bool:
        return self.time_left <= self.ramp_out and poses.distance(base_from_tool, base_from_end)[0] <= radius

    def _share(self, seconds: float) -> float:
        """Share of the path that is covered after `seconds`."""
        return self.profile.position(seconds) / self.profile.length if self.profile.length > 0.0 else 1.0

    def _share_rate(self) -> float:
        """Change of that share per second, now."""
        return self.profile.speed_at(self._time) / self.profile.length


class JointMove(_TrapezoidalMove):
    """A straight segment in joint space from rest to rest, the leading axis on a trapezoid."""

    velocity: Twist | None = None

    def __init__(self, start: Sequence[float], target: Sequence[float], profile: Trapezoid) -> None:
        super().__init__(profile)
        self.end = list(target)
        self._start = list(start)
        self._displacement = [b - a for a, b in zip(start, target, strict=True)]

    def joints_after(self, seconds: float) -> Joints:
        share = self._share(seconds)
        return [a + share * w for a, w in zip(self._start, self._displacement, strict=True)]

    def joints_before_end(self, seconds: float) -> Joints:
        return self.joints_after(self.profile.duration - seconds)

    def step(self, dt: float, pace: float) -> State:
        self._time += dt * pace
        if self._time >= self.profile.duration:
            self.finished = True
            return self.end[:], _AT_REST[:]
        rate = pace * self._share_rate()
        return self.joints_after(self._time), [rate * w for w in self._displacement]


def plan_joint_move(
    arm: ArmModel,
    start: Sequence[float],
    target: Sequence[float],
    flange_from_tool: Frame,
    speed: float,
    acceleration: float,
    seconds: float,
) -> JointMove:
    """Plans the move of `movej`: leading axis at `speed` (rad/s) and `acceleration` (rad/s²), or lasting `seconds`.

    The leading axis slows down so that every joint and the tool keep their limits. Raises MotionError if the target is
    outside the joint limits.
    """
    fault = limits.position_fault(target, arm.unlimited_joints)
    if fault is not None:
        raise MotionError(f"the target is outside the joint limits: {fault}")
    displacement = [b - a for a, b in zip(start, target, strict=True)]
    length = max(map(abs, displacement))
    if length <= 0.0:
        return JointMove(start, target, Trapezoid(0.0, speed, acceleration))
    fastest = min(limit * length / abs(w) for limit, w in zip(arm.joint_speeds, displacement, strict=True) if w)
    asked = min(fastest, length / (0.75 * seconds) if seconds > 0.0 else speed)
    arms_length = arm.reach + math.hypot(*poses.position(flange_from_tool))
    if asked * sum(map(abs, displacement)) / length * arms_length > limits.TOOL_SPEED:
        fastest = min(
            fastest, limits.TOOL_SPEED * length / _greatest_tool_speed(arm, start, displacement, flange_from_tool)
        )
    profile = Trapezoid.planned(length, speed, acceleration, seconds, fastest, limits.JOINT_ACCELERATION)
    return JointMove(start, target, profile)


def _greatest_tool_speed(
    arm: ArmModel, start: Sequence[float], displacement: Sequence[float], flange_from_tool: Frame
) -> float:
    """Greatest tool speed, in m per duration of the move, if joints turn at constant speeds; sampled along the move."""
    samples = 16
    fastest = 1e-9
    for number in range(samples + 1):
        joints = [a + number / samples * w for a, w in zip(start, displacement, strict=True)]
        axes, flange = kinematics.chain(arm, joints)
        tool = poses.position(poses.compose(flange, flange_from_tool))
        fastest = max(fastest, math.hypot(*kinematics.velocity(axes, displacement, tool)[:3]))
    return fastest


class CartesianMove(ABC):
    """A move that prescribes the tool's pose; the joints follow by inverse kinematics."""

    end: Joints
    base_from_end: Frame
    finished: bool
    follower: Follower
    rate: Twist = STANDSTILL  # of the tool, per second of motion time
    velocity: Twist | None = STANDSTILL

    @property
    @abstractmethod
    def time_left(self) -> float: ...

    @abstractmethod
    def advance(self, seconds: float) -> Frame:
        """The tool's pose after `seconds` more of motion time; sets `rate` and `finished`."""

    @abstractmethod
    def frame_after(self, seconds: float) -> Frame:
        """The tool's pose `seconds` after the start, within `ramp_in`."""

    @abstractmethod
    def frame_before_end(self, seconds: float) -> Frame:
        """The tool's pose `seconds` before the end, within `ramp_out`."""

    def joints_after(self, seconds: float) -> Joints:
        return self.follower.solve(self.frame_after(seconds))

    def joints_before_end(self, seconds: float) -> Joints:
        return self.follower.solve(self.frame_before_end(seconds), self.end)

    def step(self, dt: float, pace: float) -> State:
        joints, speeds = self.follower.follow(self.advance(dt * pace), dt)
        self.velocity = tuple(pace * r for r in self.rate)
        return joints, _AT_REST[:] if self.finished else speeds


class ToolMove(_TrapezoidalMove, CartesianMove):
    """A curve of the tool from rest to rest, its arc length on a trapezoid."""

    def __init__(self, follower: Follower, curve: Curve, profile: Trapezoid) -> None:
        """Raises MotionError if the end is out of reach."""
        super().__init__(profile)
        self.follower = follower
        self._curve = curve
        self.base_from_end = curve.at(1.0)
        self.end = end_joints(follower, curve, follower.joints)

    def advance(self, seconds: float) -> Frame:
        self._time += seconds
        if self._time >= self.profile.duration:
            self.finished = True
            self.rate = STANDSTILL
            return self.base_from_end
        share, factor = self._share(self._time), self._share_rate()
        self.rate = tuple(factor * r for r in self._curve.rate(share))
        return self._curve.at(share)

    def frame_after(self, seconds: float) -> Frame:
        return self._curve.at(self._share(seconds))

    def frame_before_end(self, seconds: float) -> Frame:
        return self.frame_after(self.profile.duration - seconds)


def end_joints(follower: Follower, curve: Curve, start: Joints) -> Joints:
    """The joints at a curve's end if the tool follows it from `start`. Raises MotionError."""
    strides = 1 + int(max(curve.length / _STRIDE, curve.angle / _STRIDE_TURN))
    joints = start
    try:
        # On a long path a joint may end on another turn than on the shortest way.
        for number in range(1, strides + 1):
            joints = follower.solve(curve.at(number / strides), joints)
    except MotionError:
        # Out of reach on the way: the arm moves up to there, unless the end itself is out of reach.
        return follower.solve(curve.at(1.0), start)
    return joints


def curve_profile(curve: Curve, speed: float, acceleration: float, seconds: float) -> Trapezoid:
    """Plans a profile over a curve's arc length in m (speed m/s, acceleration m/s²), or its angle in rad if it only
    turns, within the limits of tool speed, turn and acceleration.
    """
    if curve.length > 1e-6:
        turn = max(curve.angle / curve.length, 1e-9)
        fastest = min(limits.TOOL_SPEED, limits.TOOL_TURN / turn)
        hardest = min(limits.TOOL_ACCELERATION, limits.TOOL_TURN_ACCELERATION / turn)
        return Trapezoid.planned(curve.length, speed, acceleration, seconds, fastest, hardest)
    length = curve.angle if curve.angle > 1e-9 else 0.0
    return Trapezoid.planned(length, speed, acceleration, seconds, limits.TOOL_TURN, limits.TOOL_TURN_ACCELERATION)
