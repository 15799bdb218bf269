"""Safety limits of the arm: joint positions, joint speeds, tool speed, accelerations.

A program never exceeds them unnoticed. Programmed moves are planned within the speed limits, and a stated time that is
too short grows; a path that leaves them before its end is a protective stop whose reason names the joint. Accelerations
beyond what drives give are cut to it, so that no program stops an arm within one tick.
"""

import math
from collections.abc import Container, Sequence

JOINT_NAMES = ("base", "shoulder", "elbow", "wrist 1", "wrist 2", "wrist 3")
JOINT_LIMIT = 2.0 * math.pi  # rad, every joint that has end stops, either way
JOINT_ACCELERATION = 80.0  # rad/s², every joint: twice what the library lets its users ask for
TOOL_SPEED = 5.0  # m/s, the most that a safety configuration allows
TOOL_TURN = 2.5  # rad/s, of straight and circular moves: the wrists need more where other joints turn too
TOOL_ACCELERATION = 20.0  # m/s²
TOOL_TURN_ACCELERATION = 40.0  # rad/s²
FOLLOWED_ACCELERATION = 200.0  # rad/s²: a joint that had to follow the tool harder than this is at a singularity
_ROUNDING = 1e-9
_MARGIN = 1.02  # a speed this much above its limit is a fault; less is rounding


def name_of(number: int) -> str:
    """How a log line calls joint `number` (0–5)."""
    return f"joint {number} ({JOINT_NAMES[number]})"


def position_fault(joints: Sequence[float], unlimited: Container[int] = ()) -> str | None:
    """Which joint (rad) is outside its position limits, as a sentence's part; None where all are inside.

    `unlimited`: the joints (0–5) that turn without end.
    """
    for number, q in enumerate(joints):
        if abs(q) > JOINT_LIMIT + _ROUNDING and number not in unlimited:
            limit = f"±{math.degrees(JOINT_LIMIT):.0f}°"
            return f"{name_of(number)} at {math.degrees(q):.1f}° is outside the joint limits of {limit}"
    return None


def speed_fault(speeds: Sequence[float], greatest: Sequence[float]) -> str | None:
    """Which joint turns faster than its greatest speed (rad/s), as a sentence's part; None where none does."""
    for number, (speed, limit) in enumerate(zip(speeds, greatest, strict=True)):
        if abs(speed) > limit * _MARGIN:
            return f"{name_of(number)} would have to turn at {abs(speed):.2f} rad/s, its limit is {limit:.2f}"
    return None


def acceleration_fault(before: Sequence[float], after: Sequence[float], seconds: float) -> str | None:
    """Which joint would have to change its speed (rad/s) too hard, as a sentence's part; None where none would."""
    for number, (a, b) in enumerate(zip(before, after, strict=True)):
        if abs(b - a) > FOLLOWED_ACCELERATION * seconds:
            needed = f"{abs(b - a) / seconds:.0f} rad/s², its limit is {FOLLOWED_ACCELERATION:.0f}"
            return f"{name_of(number)} would have to accelerate at {needed}"
    return None


def tool_fault(velocity: Sequence[float]) -> str | None:
    """Whether the tool's velocity (m/s, rad/s) is beyond the tool speed limit, as a sentence's part."""
    speed = math.hypot(velocity[0], velocity[1], velocity[2])
    if speed <= TOOL_SPEED * _MARGIN:
        return None
    return f"the tool would have to move at {speed:.2f} m/s, its limit is {TOOL_SPEED:.2f}"
