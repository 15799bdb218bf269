"""Safety limits of the arm: joint positions, joint speeds, tool speed, accelerations.

A program never exceeds them unnoticed. Programmed moves are planned within the speed limits; a stated time that is too
short is lengthened. A path that leaves the limits before its end causes a protective stop whose reason names the joint.
Accelerations are limited to those of the drives, so that no program stops an arm within one tick.
"""

import math
from collections.abc import Container, Sequence

JOINT_NAMES = ("base", "shoulder", "elbow", "wrist 1", "wrist 2", "wrist 3")
JOINT_LIMIT = 2.0 * math.pi  # rad, in both directions, of every joint with end stops
JOINT_ACCELERATION = 80.0  # rad/s², of every joint: twice the most that the library accepts
TOOL_SPEED = 5.0  # m/s, the most that a safety configuration allows
TOOL_TURN = 2.5  # rad/s, of straight and circular moves: wrists turn faster if other joints turn too
TOOL_ACCELERATION = 20.0  # m/s²
TOOL_TURN_ACCELERATION = 40.0  # rad/s²
FOLLOWED_ACCELERATION = 200.0  # rad/s²: a joint that would have to exceed it to follow the tool is at a singularity
_ROUNDING = 1e-9
_MARGIN = 1.02  # a speed more than this factor above its limit is a fault; less is rounding


def name_of(number: int) -> str:
    """Name of joint `number` (0–5) in log lines."""
    return f"joint {number} ({JOINT_NAMES[number]})"


def position_fault(joints: Sequence[float], unlimited: Container[int] = ()) -> str | None:
    """The first joint (rad) outside its position limits, as part of a sentence; None if all are inside.

    `unlimited` are the joints (0–5) that turn without end.
    """
    for number, q in enumerate(joints):
        if abs(q) > JOINT_LIMIT + _ROUNDING and number not in unlimited:
            limit = f"±{math.degrees(JOINT_LIMIT):.0f}°"
            return f"{name_of(number)} at {math.degrees(q):.1f}° is outside the joint limits of {limit}"
    return None


def speed_fault(speeds: Sequence[float], greatest: Sequence[float]) -> str | None:
    """The first joint that exceeds its greatest speed (rad/s), as part of a sentence; None if none does."""
    for number, (speed, limit) in enumerate(zip(speeds, greatest, strict=True)):
        if abs(speed) > limit * _MARGIN:
            return f"{name_of(number)} would have to turn at {abs(speed):.2f} rad/s, its limit is {limit:.2f}"
    return None


def acceleration_fault(before: Sequence[float], after: Sequence[float], seconds: float) -> str | None:
    """The first joint that would have to accelerate too hard, as part of a sentence; None if none would."""
    for number, (a, b) in enumerate(zip(before, after, strict=True)):
        if abs(b - a) > FOLLOWED_ACCELERATION * seconds:
            needed = f"{abs(b - a) / seconds:.0f} rad/s², its limit is {FOLLOWED_ACCELERATION:.0f}"
            return f"{name_of(number)} would have to accelerate at {needed}"
    return None


def tool_fault(velocity: Sequence[float]) -> str | None:
    """An excess of the tool's velocity (m/s, rad/s) over the tool speed limit, as part of a sentence; else None."""
    speed = math.hypot(velocity[0], velocity[1], velocity[2])
    if speed <= TOOL_SPEED * _MARGIN:
        return None
    return f"the tool would have to move at {speed:.2f} m/s, its limit is {TOOL_SPEED:.2f}"
