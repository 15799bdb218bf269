"""URScript's functions on registers, messages, time and watchdogs, and on the interpreter mode (`interpreter`)."""

import logging
from collections.abc import Callable, Generator
from typing import Any

from hardware_sim.controller.messages import MessageType, RobotMessage
from hardware_sim.controller.registers import BIT_REGISTERS, DOUBLE_IN, DOUBLE_OUT, INT_IN, INT_OUT, REGISTERS
from hardware_sim.controller.script_values import (
    STEP_TIME,
    FunctionGroup,
    integer_below,
    not_negative,
    number,
    positive,
)
from hardware_sim.controller.semantics import ScriptError, script_text, truth

_NUMBER = "a register's number"
Waiting = Generator[None, None, None]


def _reads(base: int, kind: type[float]) -> Callable[["RegisterFunctions", int], float]:
    def method(self: "RegisterFunctions", address: int) -> float:
        return kind(self.robot.registers.values[base + integer_below(address, _NUMBER, REGISTERS)])

    return method


def _reads_bit(bank: str) -> Callable[["RegisterFunctions", int], bool]:
    def method(self: "RegisterFunctions", address: int) -> bool:
        return self.robot.registers.bit(bank, integer_below(address, _NUMBER, BIT_REGISTERS))

    return method


class RegisterFunctions(FunctionGroup):
    """Registers, messages, time, watchdog."""

    def textmsg(self, s1: Any, s2: Any = "") -> None:
        text = script_text(s1) + script_text(s2)
        self._robot.report(f"textmsg {text}", logging.INFO)
        self._robot.announce(RobotMessage(MessageType.TEXT, text))

    def program_label(self, number: int, text: str) -> None:
        # What a line `$ 3 "MoveJ"` of PolyScope's own scripts compiles to.
        self._robot.announce(RobotMessage(MessageType.PROGRAM_LABEL, text, number=number))

    def popup(
        self, s: Any, title: Any = "Popup", warning: bool = False, error: bool = False, blocking: bool = False
    ) -> None:
        text, head = script_text(s), script_text(title)
        self._robot.report(f"popup {head}: {text}", logging.INFO)
        self._robot.announce(
            RobotMessage(
                MessageType.POPUP, text, head, warning=truth(warning), error=truth(error), blocking=truth(blocking)
            )
        )
        if blocking:
            self._robot.pause()

    read_input_float_register, read_output_float_register = _reads(DOUBLE_IN, float), _reads(DOUBLE_OUT, float)
    read_input_integer_register, read_output_integer_register = _reads(INT_IN, int), _reads(INT_OUT, int)

    read_input_boolean_register, read_output_boolean_register = _reads_bit("input"), _reads_bit("output")

    def write_output_boolean_register(self, address: int, value: bool) -> None:
        slot = integer_below(address, _NUMBER, BIT_REGISTERS)
        self._robot.registers.set_bit(slot, truth(value))

    def write_output_float_register(self, address: int, value: float) -> None:
        self._values[DOUBLE_OUT + integer_below(address, _NUMBER, REGISTERS)] = number(value, "the value")

    def write_output_integer_register(self, address: int, value: int) -> None:
        # A float is truncated to an integer, on which `ur-rtde`'s own scripts rely; a truth value is refused.
        integer = int(number(value, "the value"))
        if not -(2**31) <= integer < 2**31:
            raise ScriptError(f"{value} does not fit an integer register")
        self._values[INT_OUT + integer_below(address, _NUMBER, REGISTERS)] = integer

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
        frequency = positive(min_frequency, "min_frequency")
        self.robot.watchdogs.set(variable_name, frequency, action.lower(), self.robot.now)


class InterpreterFunctions(FunctionGroup):
    """Functions by which a program and its statements control the interpreter."""

    def interpreter_mode(
        self, namespace: dict[str, Any], clearQueueOnEnter: bool = True, clearOnEnd: bool = True
    ) -> Generator[None, None, None]:
        interpreter = self._robot.interpreter
        interpreter.enter(namespace, truth(clearQueueOnEnter))
        try:
            while interpreter.active:
                if interpreter.waiting:
                    interpreter.executed, compiled = interpreter.waiting.popleft()
                    exec(compiled.code, namespace)  # noqa: S102 - written by the compiler, names prefixed
                    yield from namespace["program"]()
                if self._arm.corner is None:  # else the next move may blend into this one
                    yield
        finally:
            interpreter.end(truth(clearOnEnd))

    def end_interpreter(self) -> None:
        self._robot.interpreter.active = False

    def clear_interpreter(self) -> None:
        self._robot.interpreter.clear()
