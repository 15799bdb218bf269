"""Motions: each advances the arm's joints by a step of motion time and knows when it has ended.

`pace` is the share of the programmed speed that slider, pause and resume leave (0–1). It stretches the time base of
programmed moves; a stop brakes at its own deceleration whatever the slider says. A motion that meets a pose without
solution, or a joint faster than its limit, raises `MotionError`: a protective stop.
"""

import math
from collections.abc import Sequence
from typing import Protocol

from hardware_sim.controller import kinematics, poses
from hardware_sim.controller.kinematics import ArmModel
from hardware_sim.controller.poses import Frame
from hardware_sim.controller.profile import Trapezoid

Joints = list[float]
State = tuple[Joints, Joints]  # joints in rad, joint speeds in rad/s

_AT_REST: Joints = [0.0] * 6
_SPEED_MARGIN = 1.02  # a joint this much above its limit is a fault; less is rounding


class MotionError(Exception):
    """The arm cannot follow; the message says why."""


class Motion(Protocol):
    """What moves the arm at present."""

    finished: bool

    @property
    def velocity(self) -> tuple[float, ...] | None:
        """The tool's velocity (m/s, rad/s; base frame) where the motion knows it; else it follows from the joints."""
        ...

    def step(self, dt: float, pace: float) -> State:
        """Advances by `dt` seconds of motion time; returns joints and joint speeds."""
        ...


def stopping_time(speeds: Sequence[float], deceleration: float) -> float:
    """Seconds in which the fastest joint comes to rest."""
    return max(abs(s) for s in speeds) / deceleration


class JointMove:
    """A straight segment in joint space from rest to rest, the leading axis on a trapezoid."""

    velocity = None

    def __init__(self, start: Sequence[float], target: Sequence[float], profile: Trapezoid) -> None:
        self.end = list(target)
        self._start = list(start)
        self.profile = profile
        self.time = 0.0
        self._way = [b - a for a, b in zip(start, target, strict=True)]
        self.finished = profile.length <= 0.0

    def step(self, dt: float, pace: float) -> State:
        """See Motion."""
        self.time += dt * pace
        profile = self.profile
        if self.time >= profile.duration:
            self.finished = True
            return self.end[:], _AT_REST[:]
        share = profile.position(self.time) / profile.length
        rate = pace * profile.speed_at(self.time) / profile.length
        return [a + share * w for a, w in zip(self._start, self._way, strict=True)], [rate * w for w in self._way]


def planned_joint_move(
    arm: ArmModel, start: Sequence[float], target: Sequence[float], speed: float, acceleration: float, seconds: float
) -> JointMove:
    """The move of `movej`: leading axis under `speed` (rad/s) and `acceleration` (rad/s²), or lasting `seconds`."""
    way = [abs(b - a) for a, b in zip(start, target, strict=True)]
    length = max(way)
    if length > 0.0:
        # Each joint keeps its own limit; the leading axis slows down for a slower one.
        speed = min([speed, *(limit * length / w for limit, w in zip(arm.joint_speeds, way, strict=True) if w > 0.0)])
    profile = Trapezoid.lasting(length, seconds) if seconds > 0.0 else Trapezoid.under(length, speed, acceleration)
    return JointMove(start, target, profile)


class Follower:
    """Joints that follow tool poses tick by tick: nearest solution, joint limits and joint speed limits."""

    def __init__(self, arm: ArmModel, joints: Sequence[float], flange_from_tool: Frame) -> None:
        self.arm = arm
        self.joints = list(joints)
        self.speeds = _AT_REST[:]
        self.tool_from_flange = poses.invert(flange_from_tool)

    def solve(self, base_from_tool: Frame) -> Joints:
        """The joints nearest to the present ones for a tool pose. Raises MotionError where none reach it."""
        joints = kinematics.inverse(self.arm, poses.compose(base_from_tool, self.tool_from_flange), self.joints)
        if joints is None:
            raise MotionError("the target pose is out of reach")
        return joints

    def follow(self, base_from_tool: Frame, dt: float) -> State:
        """Joints for the next tool pose, `dt` seconds after the last. Raises MotionError."""
        joints = self.solve(base_from_tool)
        speeds = [(b - a) / dt for a, b in zip(self.joints, joints, strict=True)]
        for number, (speed, limit) in enumerate(zip(speeds, self.arm.joint_speeds, strict=True)):
            if abs(speed) > limit * _SPEED_MARGIN:
                raise MotionError(f"joint {number} would have to turn at {speed:.2f} rad/s, its limit is {limit:.2f}")
        self.joints, self.speeds = joints, speeds
        return joints, speeds


class LinearMove:
    """A straight line of the tool, its rotation in step, the distance on a trapezoid."""

    def __init__(self, follower: Follower, start: Frame, target: Frame, profile: Trapezoid) -> None:
        """Raises MotionError where the target is out of reach."""
        self._follower = follower
        self._start = start
        self._target = target
        self.end = follower.solve(target)
        turn = poses.rotate(start, poses.rotation_vector(poses.compose(poses.invert(start), target)))
        self._way = (target[3] - start[3], target[7] - start[7], target[11] - start[11], *turn)
        self.velocity: tuple[float, ...] = (0.0,) * 6
        self.profile = profile
        self.time = 0.0
        self.finished = profile.length <= 0.0

    def step(self, dt: float, pace: float) -> State:
        """See Motion."""
        self.time += dt * pace
        if self.time >= self.profile.duration:
            self.finished = True
            self.velocity = (0.0,) * 6
            return self._follower.follow(self._target, dt)[0], _AT_REST[:]
        rate = pace * self.profile.speed_at(self.time) / self.profile.length
        self.velocity = tuple(rate * w for w in self._way)
        share = self.profile.position(self.time) / self.profile.length
        return self._follower.follow(poses.interpolate(self._start, self._target, share), dt)


def linear_profile(start: Frame, target: Frame, speed: float, acceleration: float, seconds: float) -> Trapezoid:
    """The profile of `movel` over the tool's way in m, or over its angle in rad where it only turns."""
    way, angle = poses.distance(start, target)
    length = way if way > 1e-6 else angle
    if length < 1e-9:
        return Trapezoid(0.0, speed, acceleration)
    return Trapezoid.lasting(length, seconds) if seconds > 0.0 else Trapezoid.under(length, speed, acceleration)


class Blend:
    """A move round a corner: the next one runs while what is left of the one before fades out, both on their profiles.

    The sum cuts the corner within about the blend radius and its speed has no jump.
    """

    velocity = None

    def __init__(self, before: Motion, corner: Sequence[float], following: Motion) -> None:
        """`corner` are the joints in rad at which `before` ends and `following` begins."""
        self._before: Motion | None = before
        self._corner = corner
        self._following = following
        self._rest: State = (list(corner), _AT_REST[:])
        self.finished = False

    def step(self, dt: float, pace: float) -> State:
        """See Motion."""
        joints, speeds = self._following.step(dt, pace) if not self._following.finished else self._rest
        self._rest = (joints, _AT_REST[:])
        if self._before is not None:
            rest, rest_speeds = self._before.step(dt, pace)
            joints = [q + r - c for q, r, c in zip(joints, rest, self._corner, strict=True)]
            speeds = [s + r for s, r in zip(speeds, rest_speeds, strict=True)]
            if self._before.finished:
                self._before = None
        self.finished = self._following.finished and self._before is None
        return joints, speeds


class JointBrake:
    """All joints come to rest together, the fastest at the deceleration asked for (`stopj`)."""

    velocity = None

    def __init__(self, joints: Sequence[float], speeds: Sequence[float], deceleration: float) -> None:
        self._start = list(joints)
        self._speeds = list(speeds)
        self._seconds = stopping_time(speeds, deceleration)
        self._time = 0.0
        self.finished = self._seconds <= 0.0

    def step(self, dt: float, pace: float) -> State:
        """See Motion."""
        del pace
        self._time = min(self._time + dt, self._seconds)
        self.finished = self._time >= self._seconds
        covered = self._time - 0.5 * self._time**2 / self._seconds
        left = 1.0 - self._time / self._seconds
        joints = [q + covered * s for q, s in zip(self._start, self._speeds, strict=True)]
        return joints, [0.0 if self.finished else left * s for s in self._speeds]


class LinearBrake:
    """The tool comes to rest on the line it is on (`stopl`), `velocity` in m/s and rad/s in the base frame."""

    def __init__(self, follower: Follower, start: Frame, velocity: Sequence[float], deceleration: float) -> None:
        self._follower = follower
        self._start = start
        self._velocity = velocity
        self.velocity = tuple(velocity)
        speed = math.hypot(*velocity[:3])
        self._seconds = (speed if speed > 1e-6 else math.hypot(*velocity[3:])) / deceleration
        self._time = 0.0
        self.finished = self._seconds <= 0.0

    def step(self, dt: float, pace: float) -> State:
        """See Motion."""
        del pace
        self._time = min(self._time + dt, self._seconds)
        self.finished = self._time >= self._seconds
        covered = self._time - 0.5 * self._time**2 / self._seconds
        left = 1.0 - self._time / self._seconds
        self.velocity = tuple(left * v for v in self._velocity)
        joints, speeds = self._follower.follow(moved(self._start, self._velocity, covered), dt)
        return joints, _AT_REST[:] if self.finished else speeds


def moved(base_from_tool: Frame, velocity: Sequence[float], seconds: float) -> Frame:
    """A tool pose after `seconds` at a constant velocity (m/s, rad/s; base frame)."""
    vx, vy, vz, wx, wy, wz = (v * seconds for v in velocity)
    turned = poses.compose(poses.from_ur((0.0, 0.0, 0.0, wx, wy, wz)), base_from_tool)
    return (
        *turned[0:3], base_from_tool[3] + vx,
        *turned[4:7], base_from_tool[7] + vy,
        *turned[8:11], base_from_tool[11] + vz,
    )  # fmt: skip


class JointSpeed:
    """Joint speeds led to a target at an acceleration (`speedj`); the target may change while it runs."""

    velocity = None

    def __init__(self, arm: ArmModel, joints: Sequence[float], speeds: Sequence[float]) -> None:
        self._arm = arm
        self._joints = list(joints)
        self._speeds = list(speeds)
        self.target: Sequence[float] = _AT_REST
        self.acceleration = 1.0
        self.finished = False

    def step(self, dt: float, pace: float) -> State:
        """See Motion."""
        target = [
            max(-limit, min(limit, pace * t)) for t, limit in zip(self.target, self._arm.joint_speeds, strict=True)
        ]
        self._speeds = _approached(self._speeds, target, self.acceleration * dt)
        self._joints = [q + s * dt for q, s in zip(self._joints, self._speeds, strict=True)]
        return self._joints[:], self._speeds[:]


class ToolSpeed:
    """Tool velocity led to a target at an acceleration (`speedl`)."""

    def __init__(self, follower: Follower, start: Frame, velocity: Sequence[float]) -> None:
        self._follower = follower
        self._pose = start
        self.velocity = tuple(velocity)
        self.target: Sequence[float] = _AT_REST
        self.acceleration = 1.0
        self.finished = False

    def step(self, dt: float, pace: float) -> State:
        """See Motion."""
        target = [pace * t for t in self.target]
        self.velocity = tuple(_approached(self.velocity, target, self.acceleration * dt))
        self._pose = moved(self._pose, self.velocity, dt)
        return self._follower.follow(self._pose, dt)


def _approached(values: Sequence[float], target: Sequence[float], greatest: float) -> list[float]:
    """`values` brought nearer to `target` in a straight line, no component by more than `greatest`."""
    way = [t - v for v, t in zip(values, target, strict=True)]
    largest = max(abs(w) for w in way)
    if largest <= greatest:
        return list(target)
    return [v + w * greatest / largest for v, w in zip(values, way, strict=True)]


class JointServo:
    """Joints pulled to a target that may change at any time (`servoj`).

    A low-pass of time constant `lookahead`, its speeds limited; the gain stiffens it in proportion to its default.
    """

    velocity = None

    def __init__(self, arm: ArmModel, joints: Sequence[float], speeds: Sequence[float]) -> None:
        self._arm = arm
        self._joints = list(joints)
        self._speeds = list(speeds)
        self.target = list(joints)
        self.lookahead = 0.1
        self.gain = 300.0
        self.finished = False

    def step(self, dt: float, pace: float) -> State:
        """See Motion."""
        # Critically damped, so that speeds stay continuous and a standing target is reached without overshoot.
        rate = 2.0 / self.lookahead * math.sqrt(self.gain / 300.0) * pace
        joints, speeds = self._joints, self._speeds
        decay = math.exp(-rate * dt)
        for i, limit in enumerate(self._arm.joint_speeds):
            away = joints[i] - self.target[i]
            slope = speeds[i] + rate * away
            position = self.target[i] + (away + slope * dt) * decay
            speed = (slope - rate * (away + slope * dt)) * decay
            if abs(position - joints[i]) > limit * dt:
                speed = math.copysign(limit, position - joints[i])
                position = joints[i] + speed * dt
            joints[i], speeds[i] = position, speed
        return joints[:], speeds[:]
