"""Semantics of URScript's values and operators (UR script manual).

Lists, poses and structs are values: assignment and passing make a copy. Types are never mixed silently. A negative
index, a truth value in a sum or a list times a number does not do what it does in Python: it is an error or has
URScript's meaning.
"""

import operator
from collections.abc import Callable
from typing import Any, NoReturn

Operation = Callable[[Any, Any], Any]

MOST_ELEMENTS = 20_000  # of one value
MOST_CHARACTERS = 10_000  # of one string
_LEAST_INTEGER, _MOST_INTEGER = -(2**31), 2**31 - 1


class ScriptError(Exception):
    """A runtime exception of a program; the message names the function or value at fault."""


class Pose(list[float]):
    """A pose value of URScript, a type distinct from lists of six numbers."""


class Struct(dict[str, Any]):
    """A value with named members, whose names are fixed when it is made."""


_NUMBERS = frozenset((int, float))
_CONTAINERS = frozenset((list, Pose, Struct))


def copy_of(value: Any) -> Any:
    """A copy of a value, so that changing one does not change the other. Raises ScriptError if it is too large."""
    kind: Any = type(value)
    if kind is Pose:
        return Pose(value)
    if kind not in _CONTAINERS:
        return value
    if kind is list and not any(type(element) in _CONTAINERS for element in value):
        return value[:]
    return _deep_copy(value, [MOST_ELEMENTS])


def _deep_copy(value: Any, left: list[int]) -> Any:
    kind: Any = type(value)
    if kind not in _CONTAINERS:
        return value
    left[0] -= len(value)
    if left[0] < 0:
        raise ScriptError(f"a value of more than {MOST_ELEMENTS} elements")
    if kind is Struct:
        return Struct({name: _deep_copy(element, left) for name, element in value.items()})
    return kind(_deep_copy(element, left) for element in value)


def script_text(value: Any) -> str:
    """A value as URScript writes it."""
    if isinstance(value, Struct):
        return "struct(" + ", ".join(f"{name} = {script_text(element)}" for name, element in value.items()) + ")"
    if isinstance(value, list):
        elements = ", ".join(script_text(element) for element in value)  # pyright: ignore[reportUnknownVariableType]
        return f"p[{elements}]" if isinstance(value, Pose) else f"[{elements}]"
    return f"{value:g}" if isinstance(value, float) else str(value)


def pose(elements: list[Any]) -> Pose:
    """`p[…]`. Raises ScriptError unless all six are numbers."""
    for element in elements:
        if type(element) not in _NUMBERS:
            raise ScriptError(f"a pose is made of numbers, not of {script_text(element)}")
    return Pose(elements)


def truth(value: Any) -> bool:
    """A condition. Raises ScriptError unless it is a truth value."""
    if value is True or value is False:
        return value
    raise ScriptError(f"a condition must be True or False, not {script_text(value)}")


def integer(value: Any) -> Any:
    """Checks an integer result of an operation. Raises ScriptError if it does not fit 32 bits."""
    if not _LEAST_INTEGER <= value <= _MOST_INTEGER:
        raise ScriptError(f"the integer {value} does not fit 32 bits" if abs(value) < 10**20 else "overflow")
    return value


def item(value: Any, index: Any) -> Any:
    """`value[index]`."""
    return value[_checked(value, index)]


def put(value: Any, index: Any, element: Any) -> None:
    """`value[index] = element`."""
    number = _checked(value, index)
    value[number] = pose([element])[0] if type(value) is Pose else element


def _checked(value: Any, index: Any) -> int:
    if type(value) is not list and type(value) is not Pose:
        raise ScriptError(f"{script_text(value)} has no elements")
    if type(index) is not int:
        raise ScriptError(f"an index must be an integer, not {script_text(index)}")
    if not 0 <= index < len(value):
        raise ScriptError(f"index {index} is outside a list of {len(value)}")
    return index


def member(value: Any, name: str) -> Any:
    """`value.name`."""
    _check_member(value, name)
    return value[name]


def put_member(value: Any, name: str, element: Any) -> None:
    """`value.name = element`."""
    _check_member(value, name)
    value[name] = element


def _check_member(value: Any, name: str) -> None:
    if type(value) is not Struct:
        raise ScriptError(f"{script_text(value)} has no member {name!r}: it is not a struct")
    if name not in value:
        raise ScriptError(f"the struct has no member {name!r}, only {', '.join(value)}")


def _refuse(sign: str, a: Any, b: Any) -> NoReturn:
    raise ScriptError(f"{script_text(a)} {sign} {script_text(b)}: unsupported operand types")


def _arithmetic(sign: str, operation: Operation) -> Operation:
    """An operator between numbers; with lists of numbers it works element by element, also with a number."""

    def calculate(a: Any, b: Any) -> Any:
        if type(a) in _NUMBERS and type(b) in _NUMBERS:
            try:
                result = operation(a, b)
            except ZeroDivisionError as error:
                raise ScriptError("division by zero") from error
            return result if type(result) is float else integer(result)
        if type(a) is list and type(b) is list and len(a) == len(b):
            return [calculate(x, y) for x, y in zip(a, b, strict=True)]
        if type(a) is list and type(b) in _NUMBERS:
            return [calculate(x, b) for x in a]
        if type(b) is list and type(a) in _NUMBERS:
            return [calculate(a, y) for y in b]
        _refuse(sign, a, b)

    return calculate


def _comparison(sign: str, operation: Operation) -> Operation:
    """A comparison of numbers by order."""

    def compare(a: Any, b: Any) -> bool:
        if type(a) in _NUMBERS and type(b) in _NUMBERS:
            return operation(a, b)
        _refuse(sign, a, b)

    return compare


OPERATIONS: dict[str, Operation] = {
    "+": _arithmetic("+", operator.add),
    "-": _arithmetic("-", operator.sub),
    "*": _arithmetic("*", operator.mul),
    "/": _arithmetic("/", operator.truediv),
    "%": _arithmetic("%", operator.mod),
    "<": _comparison("<", operator.lt),
    "<=": _comparison("<=", operator.le),
    ">": _comparison(">", operator.gt),
    ">=": _comparison(">=", operator.ge),
}
"""Operators by their signs; `==` and `!=` are Python's own, which compare by value."""
