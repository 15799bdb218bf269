"""Checks that URScript's functions share: a wrong value is a runtime exception that names it."""

import math
from typing import TYPE_CHECKING, Any

from hardware_sim.controller import poses
from hardware_sim.controller.poses import Frame
from hardware_sim.controller.program import ScriptError

if TYPE_CHECKING:
    from hardware_sim.controller.controller import Controller

STEP_TIME = 0.002  # s
_SMALLEST = 1e-6  # of speeds and accelerations: below, a move would outlast the robot


def numbers(value: Any, count: int, what: str) -> list[float]:
    """`value` as a list of `count` finite numbers. Raises ScriptError naming `what`."""
    if not isinstance(value, list) or len(value) != count:
        raise ScriptError(f"{what} must be {count} numbers, not {value!r}")
    try:
        found = [float(v) for v in value]
    except (TypeError, ValueError) as error:
        raise ScriptError(f"{what} must be {count} numbers, not {value!r}") from error
    if not all(map(math.isfinite, found)):
        raise ScriptError(f"{what} holds a number that is not finite")
    return found


def positive(value: Any, what: str) -> float:
    """`value` as a number above zero. Raises ScriptError naming `what`."""
    number = float(value)
    if not (number >= _SMALLEST and math.isfinite(number)):
        raise ScriptError(f"{what} must be above zero, not {value!r}")
    return number


def not_negative(value: Any, what: str) -> float:
    """`value` as a finite number that is zero or above. Raises ScriptError naming `what`."""
    number = float(value)
    if not (number >= 0.0 and math.isfinite(number)):
        raise ScriptError(f"{what} must be zero or above, not {value!r}")
    return number


def frame(pose: Any, what: str = "the pose") -> Frame:
    """A UR pose as a frame. Raises ScriptError naming `what`."""
    return poses.from_ur(numbers(pose, 6, what))


class Bound:
    """A group of functions bound to one controller; methods without underscore are visible to programs."""

    def __init__(self, controller: "Controller") -> None:
        self._controller = controller
        self._arm = controller.arm
        self._values = controller.registers.values
