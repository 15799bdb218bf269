"""All functions of URScript that this controller has, and those it refuses.

What is not simulated is refused as a runtime exception that names the function; nothing answers "done" without having
been done.
"""

import inspect
import logging
import math
from collections.abc import Callable, Generator
from typing import TYPE_CHECKING, Any, NoReturn

from hardware_sim.controller.compiler import Vocabulary
from hardware_sim.controller.motion_functions import MotionFunctions
from hardware_sim.controller.program import ScriptError
from hardware_sim.controller.registers import DOUBLE_IN, DOUBLE_OUT, INT_IN, INT_OUT, REGISTERS
from hardware_sim.controller.script_values import STEP_TIME, Bound, not_negative, positive
from hardware_sim.controller.state_functions import StateFunctions

if TYPE_CHECKING:
    from hardware_sim.controller.controller import Controller

LOG = logging.getLogger("hardware_sim.controller")
Waiting = Generator[None, None, None]

REFUSED = frozenset(
    """servoc force_mode end_force_mode zero_ftsensor tool_contact ft_rtde_input_enable enable_external_ft_sensor
    set_gravity direct_torque get_mass_matrix get_coriolis_and_centrifugal_torques get_target_joint_accelerations
    get_jacobian get_jacobian_time_derivative get_joint_torques get_tcp_force""".split()  # noqa: SIM905 - names, not strings
)


class RegisterFunctions(Bound):
    """Registers, messages, time, watchdog, outputs."""

    def textmsg(self, message: Any, value: Any = "") -> None:
        LOG.debug("textmsg %s%s", message, value)

    popup = textmsg

    def _slot(self, base: int, index: Any) -> int:
        number = int(index)
        if not 0 <= number < REGISTERS:
            raise ScriptError(f"there is no register {index}")
        return base + number

    def read_input_float_register(self, address: int) -> float:
        return self._values[self._slot(DOUBLE_IN, address)]

    def read_input_integer_register(self, address: int) -> int:
        return int(self._values[self._slot(INT_IN, address)])

    def read_input_boolean_register(self, address: int) -> bool:
        registers = self._controller.registers
        if 0 <= address < 64:
            word = registers.get(f"input_bit_registers{'0_to_31' if address < 32 else '32_to_63'}")[0]
            return bool(int(word) >> (address % 32) & 1)
        if address >= 128:
            raise ScriptError(f"there is no register {address}")
        return bool(registers.get(f"input_bit_register_{address}")[0])

    def read_output_float_register(self, address: int) -> float:
        return self._values[self._slot(DOUBLE_OUT, address)]

    def read_output_integer_register(self, address: int) -> int:
        return int(self._values[self._slot(INT_OUT, address)])

    def write_output_float_register(self, address: int, value: float) -> None:
        self._values[self._slot(DOUBLE_OUT, address)] = float(value)

    def write_output_integer_register(self, address: int, value: int) -> None:
        number = int(value)
        if not -(2**31) <= number < 2**31:
            raise ScriptError(f"{value} does not fit an integer register")
        self._values[self._slot(INT_OUT, address)] = number

    def sync(self) -> Waiting:
        yield

    def sleep(self, t: float) -> Waiting:
        for _ in range(max(1, round(not_negative(t, "t") / STEP_TIME))):
            yield

    def get_steptime(self) -> float:
        return STEP_TIME

    def rtde_set_watchdog(self, variable_name: str, min_frequency: float, action: str = "pause") -> None:
        if action.lower() not in ("ignore", "pause", "stop"):
            raise ScriptError(f"rtde_set_watchdog: unknown action {action!r}")
        self._controller.set_watchdog(variable_name, positive(min_frequency, "min_frequency"), action.lower())

    def _set_output(self, n: int, first: int, count: int, level: Any) -> None:
        if not 0 <= int(n) < count:
            raise ScriptError(f"there is no digital output {n}")
        self._controller.outputs.set_bit(first + int(n), bool(level))

    def set_digital_out(self, n: int, b: bool) -> None:
        self._set_output(n, 0, 18, b)

    def set_standard_digital_out(self, n: int, b: bool) -> None:
        self._set_output(n, 0, 8, b)

    def set_configurable_digital_out(self, n: int, b: bool) -> None:
        self._set_output(n, 8, 8, b)

    def set_tool_digital_out(self, n: int, b: bool) -> None:
        self._set_output(n, 16, 2, b)

    def get_digital_out(self, n: int) -> bool:
        if not 0 <= int(n) < 18:
            raise ScriptError(f"there is no digital output {n}")
        return bool(self._controller.outputs.levels >> int(n) & 1)

    get_standard_digital_out = get_digital_out


class Arithmetic(Bound):
    """Numbers."""

    def norm(self, a: Any) -> float:
        return math.hypot(*a) if isinstance(a, list) else abs(a)

    sqrt = staticmethod(math.sqrt)
    sin = staticmethod(math.sin)
    cos = staticmethod(math.cos)
    tan = staticmethod(math.tan)
    asin = staticmethod(math.asin)
    acos = staticmethod(math.acos)
    atan = staticmethod(math.atan)
    atan2 = staticmethod(math.atan2)
    pow = staticmethod(math.pow)
    ceil = staticmethod(math.ceil)
    floor = staticmethod(math.floor)
    d2r = staticmethod(math.radians)
    r2d = staticmethod(math.degrees)
    length = staticmethod(len)
    to_str = staticmethod(str)

    def log(self, base: float, value: float) -> float:
        return math.log(value, base)


_GROUPS: tuple[type[Bound], ...] = (RegisterFunctions, MotionFunctions, StateFunctions, Arithmetic)
_MEMBERS = {
    name: member
    for group in _GROUPS
    for name, member in inspect.getmembers(group)
    if not name.startswith("_") and callable(member)
}
_WAITING = frozenset(name for name, member in _MEMBERS.items() if inspect.isgeneratorfunction(member))
VOCABULARY = Vocabulary(immediate=(frozenset(_MEMBERS) - _WAITING) | REFUSED, waiting=_WAITING)


def table(controller: "Controller") -> dict[str, Callable[..., Any]]:
    """All functions by name, bound to one controller."""
    groups = [group(controller) for group in _GROUPS]
    bound: dict[str, Callable[..., Any]] = {
        name: getattr(group, name) for name in _MEMBERS for group in groups if hasattr(group, name)
    }
    return bound | {name: _refusal(name) for name in REFUSED}


def _refusal(name: str) -> Callable[..., NoReturn]:
    def refuse(*arguments: Any, **keywords: Any) -> NoReturn:
        del arguments, keywords
        raise ScriptError(f"{name} is not simulated by this controller")

    return refuse
