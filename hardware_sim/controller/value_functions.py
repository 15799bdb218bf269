"""URScript's functions on plain values: numbers, lists and strings. Each error names its function."""

import math
import random
from collections.abc import Callable
from typing import Any

from hardware_sim.controller import poses
from hardware_sim.controller.robot import Robot
from hardware_sim.controller.script_values import FunctionGroup, frame, integer_below, number, numbers
from hardware_sim.controller.semantics import MOST_CHARACTERS, ScriptError, integer, script_text, truth

_BITS = 32


def _of_numbers(name: str, function: Callable[..., float]) -> Callable[..., float]:
    """Makes a method of a function of numbers; its errors name the function."""

    def method(self: FunctionGroup, *arguments: Any) -> float:
        del self
        values = [number(argument, f"{name}: an argument") for argument in arguments]
        try:
            result = function(*values)
            return result if isinstance(result, float) else integer(result)
        except (TypeError, ValueError, OverflowError) as error:
            given = ", ".join(map(script_text, values))
            raise ScriptError(f"{name}({given}) has no value: {error}") from error

    return method


class Arithmetic(FunctionGroup):
    """Numbers and lists."""

    def __init__(self, robot: Robot) -> None:
        super().__init__(robot)
        self._random = random.Random(0)  # noqa: S311 - the same in every run

    sqrt = _of_numbers("sqrt", math.sqrt)
    sin = _of_numbers("sin", math.sin)
    cos = _of_numbers("cos", math.cos)
    tan = _of_numbers("tan", math.tan)
    asin = _of_numbers("asin", math.asin)
    acos = _of_numbers("acos", math.acos)
    atan = _of_numbers("atan", math.atan)
    atan2 = _of_numbers("atan2", math.atan2)
    pow = _of_numbers("pow", math.pow)
    ceil = _of_numbers("ceil", math.ceil)
    floor = _of_numbers("floor", math.floor)
    d2r = _of_numbers("d2r", math.radians)
    r2d = _of_numbers("r2d", math.degrees)

    def log(self, b: Any, f: Any) -> float:
        base, value = number(b, "log: the base"), number(f, "log: the value")
        if base <= 0.0 or base == 1.0 or value <= 0.0:
            raise ScriptError(f"log({script_text(base)}, {script_text(value)}) has no value")
        return math.log(value, base)

    def random(self) -> float:
        return self._random.random()

    def norm(self, a: Any) -> float:
        return math.hypot(*numbers(a, len(a), "norm: the list")) if isinstance(a, list) else abs(number(a, "norm: a"))

    def normalize(self, v: Any) -> list[float]:
        if not isinstance(v, list):
            raise ScriptError(f"normalize: v must be a list, not {script_text(v)}")
        values = numbers(v, len(v), "normalize: v")
        length = math.hypot(*values)
        if length == 0.0:
            raise ScriptError("normalize: v has no direction")
        return [value / length for value in values]

    def length(self, v: Any) -> int:
        if not isinstance(v, list | str):
            raise ScriptError(f"length: {script_text(v)} is neither a list nor a string")
        return len(v)

    get_list_length = length

    def point_dist(self, p_from: Any, p_to: Any) -> float:
        return poses.distance(frame(p_from, "p_from"), frame(p_to, "p_to"))[0]

    def rpy2rotvec(self, rpy: Any) -> list[float]:
        roll, pitch, yaw = numbers(rpy, 3, "rpy2rotvec: the angles")
        turned = poses.IDENTITY
        for turn in ((0.0, 0.0, yaw), (0.0, pitch, 0.0), (roll, 0.0, 0.0)):
            turned = poses.rotated(turned, turn)
        return list(poses.rotation_vector(turned))

    def rotvec2rpy(self, rotvec: Any) -> list[float]:
        f = poses.from_ur([0.0, 0.0, 0.0, *numbers(rotvec, 3, "rotvec2rpy: the rotation vector")])
        level = math.hypot(f[0], f[4])
        if level < 1e-9:  # straight up or down: roll and yaw turn about one line
            return [math.atan2(-f[6], f[5]), math.atan2(-f[8], level), 0.0]
        return [math.atan2(f[9], f[10]), math.atan2(-f[8], level), math.atan2(f[4], f[0])]

    def integer_to_binary_list(self, x: Any) -> list[bool]:
        if type(x) is not int:
            raise ScriptError(f"integer_to_binary_list: {script_text(x)} is not an integer")
        return [bool(x >> bit & 1) for bit in range(_BITS)]

    def binary_list_to_integer(self, values: Any) -> int:
        if not isinstance(values, list) or len(values) > _BITS:
            wanted = f"a list of up to {_BITS} truth values"
            raise ScriptError(f"binary_list_to_integer: the value must be {wanted}, not {script_text(values)}")
        unsigned = sum(truth(value) << bit for bit, value in enumerate(values))
        return unsigned - (1 << _BITS) if unsigned >> (_BITS - 1) else unsigned


class Strings(FunctionGroup):
    """Strings."""

    def to_str(self, val: Any) -> str:
        return _short(script_text(val))

    def to_num(self, str_repr: Any) -> float:
        text = _text(str_repr, "to_num")
        try:
            return integer(int(text))
        except ValueError:
            pass  # then it has a fraction, or is no number
        try:
            value = float(text)
        except ValueError as error:
            raise ScriptError(f"to_num: {text!r} is not a number") from error
        return number(value, "to_num: the value")

    def str_at(self, src: Any, index: Any) -> str:
        text = _text(src, "str_at")
        return text[integer_below(index, "str_at: the index", len(text))]

    def str_cat(self, op1: Any, op2: Any) -> str:
        return _short(script_text(op1) + script_text(op2))

    def str_empty(self, str: Any) -> bool:  # noqa: A002 - URScript's name of it
        return not _text(str, "str_empty")

    def str_find(self, src: Any, target: Any, start_from: Any = 0) -> int:
        text = _text(src, "str_find")
        return text.find(_text(target, "str_find"), integer_below(start_from, "str_find: start_from", len(text) + 1))

    def str_len(self, str: Any) -> int:  # noqa: A002 - URScript's name of it
        return len(_text(str, "str_len"))

    def str_sub(self, src: Any, index: Any, len: Any = -1) -> str:  # noqa: A002 - URScript's name of it
        text = _text(src, "str_sub")
        begin = integer_below(index, "str_sub: the index", text.__len__() + 1)
        count = MOST_CHARACTERS if len == -1 else integer_below(len, "str_sub: the length", MOST_CHARACTERS)
        return text[begin : begin + count]


def _text(value: Any, function: str) -> str:
    if not isinstance(value, str):
        raise ScriptError(f"{function}: {script_text(value)} is not a string")
    return value


def _short(text: str) -> str:
    if len(text) > MOST_CHARACTERS:
        raise ScriptError(f"a string of more than {MOST_CHARACTERS} characters")
    return text
