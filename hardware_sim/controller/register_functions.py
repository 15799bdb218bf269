"""URScript's functions on registers, messages, time and watchdogs."""

import logging
from collections.abc import Generator
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

Waiting = Generator[None, None, None]


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

    def _slot(self, base: int, index: Any) -> int:
        return base + integer_below(index, "a register's number", REGISTERS)

    def read_input_float_register(self, address: int) -> float:
        return self._values[self._slot(DOUBLE_IN, address)]

    def read_input_integer_register(self, address: int) -> int:
        return int(self._values[self._slot(INT_IN, address)])

    def read_input_boolean_register(self, address: int) -> bool:
        return self._robot.registers.bit("input", integer_below(address, "a register's number", BIT_REGISTERS))

    def read_output_boolean_register(self, address: int) -> bool:
        return self._robot.registers.bit("output", integer_below(address, "a register's number", BIT_REGISTERS))

    def write_output_boolean_register(self, address: int, value: bool) -> None:
        slot = integer_below(address, "a register's number", BIT_REGISTERS)
        self._robot.registers.set_bit(slot, truth(value))

    def read_output_float_register(self, address: int) -> float:
        return self._values[self._slot(DOUBLE_OUT, address)]

    def read_output_integer_register(self, address: int) -> int:
        return int(self._values[self._slot(INT_OUT, address)])

    def write_output_float_register(self, address: int, value: float) -> None:
        self._values[self._slot(DOUBLE_OUT, address)] = number(value, "the value")

    def write_output_integer_register(self, address: int, value: int) -> None:
        # A float is cut to an integer, as `ur-rtde`'s own scripts rely on; a truth value is not.
        integer = int(number(value, "the value"))
        if not -(2**31) <= integer < 2**31:
            raise ScriptError(f"{value} does not fit an integer register")
        self._values[self._slot(INT_OUT, address)] = integer

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
        self._robot.set_watchdog(variable_name, positive(min_frequency, "min_frequency"), action.lower())
