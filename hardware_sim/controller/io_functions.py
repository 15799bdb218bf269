"""URScript's functions on digital and analogue inputs and outputs (UR script manual, module interfaces).

A PolyScope program begins with a dozen calls that set up inputs, outputs and the tool's connector. Those without an
effect here are accepted with any arguments.
"""

from collections.abc import Callable
from typing import Any, Literal

from hardware_sim.controller.script_values import FunctionGroup, integer_below, number
from hardware_sim.controller.semantics import ScriptError, truth
from hardware_sim.controller.signals import DIGITAL_OUTPUTS

_TOOL_VOLTAGES = (0, 12, 24)
_FLAGS = 33


def _accepted(self: FunctionGroup, *arguments: Any, **keywords: Any) -> None:
    """A setting without an effect here."""
    del self, arguments, keywords


def _set_output(first: int, count: int) -> Callable[..., None]:
    def method(self: "IoFunctions", n: Any, b: Any) -> None:
        self.robot.outputs.set_bit(first + integer_below(n, "a digital output's number", count), truth(b))

    return method


def _level(bank: Literal["inputs", "outputs"], first: int, count: int) -> Callable[..., bool]:
    def method(self: "IoFunctions", n: Any) -> bool:
        slot = first + integer_below(n, f"a digital {bank[:-1]}'s number", count)
        return bool(getattr(self.robot, bank).levels >> slot & 1)

    return method


def _analog_input(first: int, count: int) -> Callable[..., float]:
    def method(self: "IoFunctions", n: Any) -> float:
        return self.robot.inputs.analog[first + integer_below(n, "an analogue input's number", count)]

    return method


def _set_input_domain(first: int) -> Callable[..., None]:
    def method(self: "IoFunctions", port: Any, domain: Any) -> None:
        slot = first + integer_below(port, "an analogue input's number", 2)
        self.robot.inputs.analog_is_voltage[slot] = bool(integer_below(domain, "the domain", 2))

    return method


def _set_runstate(first: int, count: int) -> Callable[..., None]:
    def method(self: "IoFunctions", outputId: Any, state: Any) -> None:
        # 0 keeps the output, 1 puts it low while no program runs; values that would drive it are refused.
        slot = first + integer_below(outputId, "a digital output's number", count)
        self.robot.outputs.hold_low_when_stopped(slot, bool(integer_below(state, "the state", 2)))

    return method


class IoFunctions(FunctionGroup):
    """Inputs, outputs, the tool's connector, flags."""

    set_digital_out, get_digital_out = _set_output(0, DIGITAL_OUTPUTS), _level("outputs", 0, DIGITAL_OUTPUTS)
    set_standard_digital_out, get_standard_digital_out = _set_output(0, 8), _level("outputs", 0, 8)
    set_configurable_digital_out, get_configurable_digital_out = _set_output(8, 8), _level("outputs", 8, 8)
    set_tool_digital_out, get_tool_digital_out = _set_output(16, 2), _level("outputs", 16, 2)
    get_digital_in, get_standard_digital_in = _level("inputs", 0, DIGITAL_OUTPUTS), _level("inputs", 0, 8)
    get_configurable_digital_in, get_tool_digital_in = _level("inputs", 8, 8), _level("inputs", 16, 2)
    get_analog_in, get_standard_analog_in = _analog_input(0, 4), _analog_input(0, 2)
    get_tool_analog_in = _analog_input(2, 2)
    set_standard_analog_input_domain, set_tool_analog_input_domain = _set_input_domain(0), _set_input_domain(2)
    set_runstate_standard_digital_output_to_value = _set_runstate(0, 8)
    set_runstate_configurable_digital_output_to_value = _set_runstate(8, 8)
    set_runstate_tool_digital_output_to_value = _set_runstate(16, 2)
    set_analog_inputrange = set_input_actions_to_default = set_tool_communication = _accepted
    set_tool_output_mode = set_tool_digital_output_mode = set_safety_mode_transition_hardness = _accepted

    def get_standard_analog_out(self, n: Any) -> float:
        return self.robot.outputs.analog(integer_below(n, "an analogue output's number", 2))

    get_analog_out = get_standard_analog_out

    def set_standard_analog_out(self, n: Any, f: Any) -> None:
        slot, ratio = integer_below(n, "an analogue output's number", 2), number(f, "f")
        if not 0.0 <= ratio <= 1.0:
            raise ScriptError(f"an analogue output's level must be from 0 to 1, not {ratio:g}")
        self.robot.outputs.analog_ratio[slot] = ratio

    set_analog_out = set_standard_analog_out

    def set_analog_outputdomain(self, port: Any, domain: Any) -> None:
        slot = integer_below(port, "an analogue output's number", 2)
        self.robot.outputs.analog_is_voltage[slot] = bool(integer_below(domain, "the domain", 2))

    def set_tool_voltage(self, voltage: Any) -> None:
        if voltage not in _TOOL_VOLTAGES:
            raise ScriptError(f"set_tool_voltage: {voltage} is none of {', '.join(map(str, _TOOL_VOLTAGES))} V")
        self.robot.outputs.tool_voltage = voltage

    def set_flag(self, n: Any, b: Any) -> None:
        self.robot.outputs.flags[integer_below(n, "a flag's number", _FLAGS)] = truth(b)

    def get_flag(self, n: Any) -> bool:
        return self.robot.outputs.flags.get(integer_below(n, "a flag's number", _FLAGS), False)
