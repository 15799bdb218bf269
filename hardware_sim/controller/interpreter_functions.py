"""URScript's functions of the interpreter mode (`interpreter`)."""

from collections.abc import Generator
from typing import Any

from hardware_sim.controller.script_values import FunctionGroup
from hardware_sim.controller.semantics import truth


class InterpreterFunctions(FunctionGroup):
    """What a program and its statements say to the interpreter."""

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
