"""Port 30020 of the interpreter mode (URScript manual, "Interpreter mode"): statements in, one line out for each.

`ack: 3: movej(…)` states a statement's number, `discard: reason: …` why it is refused, and `state: 3: …` answers
commands that ask for numbers. Commands act at once. Statements are compiled beside the ticks and answered in order.
"""

import socket

from hardware_sim.controller.compiler import CompiledProgram
from hardware_sim.controller.controller import Controller
from hardware_sim.controller.program_loader import ProgramLoader
from hardware_sim.controller.sockets import LineConnection
from hardware_sim.controller.syntax import ScriptSyntaxError, depth_change

PORT = 30020
_MOST_WAITING = 1000  # statements
_LONGEST = 1 << 17  # characters of a statement and of all functions defined before it
_ABORT_DECELERATION = 6.0  # rad/s²


class InterpreterConnection(LineConnection):
    """One sender of statements."""

    def __init__(self, stream: socket.socket, controller: Controller, loader: ProgramLoader) -> None:
        super().__init__(stream)
        self._controller, self._loader = controller, loader
        self._lines: list[str] = []
        self._depth = 0

    def line(self, text: str) -> None:
        """Answers a command, or collects lines until a statement is complete."""
        interpreter = self._controller.interpreter
        words = text.strip()
        if not self._lines and words in ("skipbuffer", "abort"):
            if words == "abort":
                self._controller.arm.abort(_ABORT_DECELERATION)
            else:
                interpreter.waiting.clear()
            self._reply("ack", str(interpreter.interpreted), words)
            return
        numbers = {
            "statelastexecuted": interpreter.executed,
            "statelastinterpreted": interpreter.interpreted,
            "statelastcleared": interpreter.cleared,
            "stateunexecuted": len(interpreter.waiting),
        }
        if not self._lines and words in numbers:
            self._reply("state", str(numbers[words]), words)
        elif words or self._lines:
            self._lines.append(text)
            self._depth += depth_change(text)
            if sum(map(len, self._lines)) > self.longest:
                self.closed = True
            elif self._depth <= 0:
                statement, self._lines, self._depth = "\n".join(self._lines), [], 0
                self._submit(statement)

    def _submit(self, statement: str) -> None:
        interpreter = self._controller.interpreter
        text = interpreter.program(statement)
        if not self._controller.playing:
            self._reply("discard", "Program is not running", statement)
        elif len(interpreter.waiting) >= _MOST_WAITING or len(text) > _LONGEST:
            self._reply("discard", "Too many interpreted messages", statement)
        else:

            def done(compiled: CompiledProgram | ScriptSyntaxError) -> None:
                if isinstance(compiled, ScriptSyntaxError):
                    self._reply("discard", str(compiled), statement)
                else:
                    self._reply("ack", str(interpreter.take(statement, compiled)), statement)
                self.flush()

            if not self._loader.compile(text, done, statement=True):
                self._reply("discard", "Too many interpreted messages", statement)

    def _reply(self, kind: str, about: str, statement: str) -> None:
        self.send(f"{kind}: {about}: {' '.join(statement.split())}\n".encode())
