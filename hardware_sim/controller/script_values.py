"""Argument checks of URScript's functions: a wrong value raises a runtime exception that names it."""

import math
from typing import Any

from hardware_sim.controller import poses
from hardware_sim.controller.poses import Frame
from hardware_sim.controller.robot import Robot
from hardware_sim.controller.semantics import ScriptError, script_text

STEP_TIME = 0.002  # s
_SMALLEST = 1e-6  # of speeds and accelerations, below which a move would outlast the robot


def number(value: Any, what: str) -> float:
    """`value` as a finite number, which a truth value is not. Raises ScriptError naming `what`."""
    if type(value) is not float and type(value) is not int:
        raise ScriptError(f"{what} must be a number, not {script_text(value)}")
    if not math.isfinite(value):
        raise ScriptError(f"{what} is not finite")
    return float(value)


def integer_below(value: Any, what: str, count: int) -> int:
    """`value` as an integer from 0 to `count` − 1. Raises ScriptError naming `what`."""
    if type(value) is not int:
        raise ScriptError(f"{what} must be an integer, not {script_text(value)}")
    if not 0 <= value < count:
        raise ScriptError(f"{what} must be from 0 to {count - 1}, not {value}")
    return value


def numbers(value: Any, count: int, what: str) -> list[float]:
    """`value` as a list of `count` finite numbers. Raises ScriptError naming `what`."""
    if not isinstance(value, list) or len(value) != count:
        raise ScriptError(f"{what} must be {count} numbers, not {script_text(value)}")
    return [number(v, what) for v in value]


def positive(value: Any, what: str) -> float:
    """`value` as a number above zero. Raises ScriptError naming `what`."""
    result = number(value, what)
    if result < _SMALLEST:
        raise ScriptError(f"{what} must be above zero, not {script_text(value)}")
    return result


def not_negative(value: Any, what: str) -> float:
    """`value` as a finite number that is zero or above. Raises ScriptError naming `what`."""
    result = number(value, what)
    if result < 0.0:
        raise ScriptError(f"{what} must be zero or above, not {script_text(value)}")
    return result


def frame(pose: Any, what: str = "the pose") -> Frame:
    """A UR pose as a frame. Raises ScriptError naming `what`."""
    return poses.from_ur(numbers(pose, 6, what))


class FunctionGroup:
    """A group of functions bound to one robot; methods without underscore are visible to programs."""

    def __init_subclass__(cls) -> None:
        for name, member in vars(cls).items():
            if "<locals>" in getattr(member, "__qualname__", ""):
                member.__qualname__ = name  # its name in Python's messages

    def __init__(self, robot: Robot) -> None:
        self.robot = self._robot = robot
        self._arm = robot.arm
        self._values = robot.registers.values
