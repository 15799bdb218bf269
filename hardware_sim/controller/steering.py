"""Motions without a programmed end (UR script manual): `stopj`, `stopl`, `speedj`, `speedl`, `servoj`."""

import math
from collections.abc import Sequence

from hardware_sim.controller import limits, poses
from hardware_sim.controller.kinematics import ArmModel
from hardware_sim.controller.motion import STANDSTILL, Follower, Joints, State, Twist
from hardware_sim.controller.poses import Frame
from hardware_sim.controller.profile import LinearDecay

_AT_REST: Joints = [0.0] * 6


def stopping_time(speeds: Sequence[float], deceleration: float) -> float:
    """Seconds in which the fastest joint (rad/s) comes to rest, at a deceleration that drives can give."""
    return max(map(abs, speeds)) / min(deceleration, limits.JOINT_ACCELERATION)


class _Brake:
    """A motion that fades out."""

    velocity: Twist | None = None
    _fading: LinearDecay

    @property
    def finished(self) -> bool:
        return self._fading.finished


class JointBrake(_Brake):
    """Brings all joints to rest together, the fastest at the requested deceleration (`stopj`)."""

    def __init__(self, joints: Sequence[float], speeds: Sequence[float], deceleration: float) -> None:
        self._start, self._speeds = list(joints), list(speeds)
        self._fading = LinearDecay(stopping_time(speeds, deceleration))

    def step(self, dt: float, pace: float) -> State:
        del pace
        covered, left = self._fading.advance(dt)
        joints = [q + covered * s for q, s in zip(self._start, self._speeds, strict=True)]
        return joints, [left * s for s in self._speeds]


class LinearBrake(_Brake):
    """Brings the tool to rest on the straight line of its present velocity (`stopl`)."""

    def __init__(
        self, follower: Follower, start: Frame, velocity: Sequence[float], speeds: Sequence[float], deceleration: float
    ) -> None:
        """`deceleration` is in m/s², or in rad/s² if the tool only turns; the joints' `speeds` (rad/s) limit it."""
        self._follower = follower
        self._start, self._first = start, tuple(velocity)
        self.velocity = tuple(velocity)
        speed = math.hypot(*velocity[:3])
        seconds = (speed if speed > 1e-6 else math.hypot(*velocity[3:])) / deceleration
        self._fading = LinearDecay(max(seconds, stopping_time(speeds, limits.JOINT_ACCELERATION)))

    def step(self, dt: float, pace: float) -> State:
        del pace
        covered, left = self._fading.advance(dt)
        self.velocity = tuple(left * v for v in self._first)
        joints, speeds = self._follower.follow(pose_after(self._start, self._first, covered), dt)
        return joints, _AT_REST[:] if self.finished else speeds


def pose_after(base_from_tool: Frame, velocity: Sequence[float], seconds: float) -> Frame:
    """A tool pose after `seconds` at a constant velocity (m/s, rad/s; base frame)."""
    vx, vy, vz, wx, wy, wz = (v * seconds for v in velocity)
    turned = poses.compose(poses.from_ur((0.0, 0.0, 0.0, wx, wy, wz)), base_from_tool)
    x, y, z = poses.position(base_from_tool)
    return poses.with_position(turned, (x + vx, y + vy, z + vz))


class _SteeredJoints:
    """Joints that are steered to a target, which may change at any time."""

    velocity: Twist | None = None
    finished = False
    target: Sequence[float] = _AT_REST

    def __init__(self, arm: ArmModel, joints: Sequence[float], speeds: Sequence[float]) -> None:
        self._arm = arm
        self._joints, self._speeds = list(joints), list(speeds)


class JointSpeed(_SteeredJoints):
    """Steers joint speeds to a target at an acceleration (`speedj`)."""

    acceleration = 1.0

    def step(self, dt: float, pace: float) -> State:
        target = [
            max(-limit, min(limit, pace * t)) for t, limit in zip(self.target, self._arm.joint_speeds, strict=True)
        ]
        change = min(self.acceleration, limits.JOINT_ACCELERATION) * dt
        self._speeds = _stepped_towards(self._speeds, target, change)
        self._joints = [q + s * dt for q, s in zip(self._joints, self._speeds, strict=True)]
        return self._joints[:], self._speeds[:]


class ToolSpeed:
    """Steers the tool's velocity to a target at an acceleration (`speedl`)."""

    finished = False

    def __init__(self, follower: Follower, start: Frame, velocity: Sequence[float]) -> None:
        self._follower = follower
        self._pose = start
        self.velocity: Twist | None = tuple(velocity)
        self.target: Sequence[float] = _AT_REST
        self.acceleration = 1.0

    def step(self, dt: float, pace: float) -> State:
        factor = pace * min(1.0, limits.TOOL_SPEED / max(math.hypot(*self.target[:3]), 1e-9))
        change = min(self.acceleration, limits.TOOL_ACCELERATION) * dt
        velocity = tuple(_stepped_towards(self.velocity or STANDSTILL, [factor * t for t in self.target], change))
        self.velocity = velocity
        self._pose = pose_after(self._pose, velocity, dt)
        return self._follower.follow(self._pose, dt)


def _stepped_towards(values: Sequence[float], target: Sequence[float], greatest: float) -> list[float]:
    """Moves `values` towards `target` on a straight line, no component by more than `greatest`."""
    change = [t - v for v, t in zip(values, target, strict=True)]
    largest = max(abs(w) for w in change)
    if largest <= greatest:
        return list(target)
    return [v + w * greatest / largest for v, w in zip(values, change, strict=True)]


class JointServo(_SteeredJoints):
    """Pulls joints to a target (`servoj`), initially their own position.

    It is a low-pass of time constant `lookahead` with limited speeds and accelerations. Its rate grows with the square
    root of the gain relative to its default.
    """

    lookahead = 0.1
    gain = 300.0

    def __init__(self, arm: ArmModel, joints: Sequence[float], speeds: Sequence[float]) -> None:
        super().__init__(arm, joints, speeds)
        self.target = list(joints)

    def step(self, dt: float, pace: float) -> State:
        # Critically damped, so that speeds stay continuous and a fixed target is reached without overshoot.
        rate = 2.0 / self.lookahead * math.sqrt(self.gain / 300.0) * pace
        joints, speeds = self._joints, self._speeds
        decay = math.exp(-rate * dt)
        change = limits.JOINT_ACCELERATION * dt
        for i, limit in enumerate(self._arm.joint_speeds):
            away = joints[i] - self.target[i]
            slope = speeds[i] + rate * away
            position = self.target[i] + (away + slope * dt) * decay
            speed = (slope - rate * (away + slope * dt)) * decay
            # No faster than the limit, and slow enough to brake before its target.
            fastest = min(limit, math.sqrt(2.0 * limits.JOINT_ACCELERATION * abs(away)))
            if abs(position - joints[i]) > fastest * dt or abs(speed - speeds[i]) > change:
                speed = max(-fastest, min(fastest, speed))
                speed = max(speeds[i] - change, min(speeds[i] + change, speed))
                position = joints[i] + speed * dt
            joints[i], speeds[i] = position, speed
        return joints[:], speeds[:]
