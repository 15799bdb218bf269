"""Interpreter mode (URScript manual): statements that a program executes while it waits in `interpreter_mode()`.

They run in order, in the thread that called it. They see the program's global variables, variables and functions of
earlier statements, and the controller's functions, but not the program's own functions and local variables.
"""

from collections import deque
from typing import Any

from hardware_sim.controller.compiler import CompiledProgram


class Interpreter:
    """The statements of one controller: their numbers, the waiting ones, and the definitions made by them."""

    def __init__(self) -> None:
        self.active = False
        self.waiting: deque[tuple[int, CompiledProgram]] = deque()
        self.interpreted = self.executed = self.cleared = 0  # numbers of statements
        self._definitions: dict[str, str] = {}
        self._namespace: dict[str, Any] = {}
        self._own: set[str] = set()

    def program(self, statement: str) -> str:
        """A program that holds the definitions of earlier statements and executes a statement."""
        return "def interpreter():\n" + "".join(self._definitions.values()) + statement + "\nend\n"

    def take(self, statement: str, compiled: CompiledProgram) -> int:
        """Appends a compiled statement to the queue; returns its number."""
        self.interpreted += 1
        self.waiting.append((self.interpreted, compiled))
        words = statement.replace("(", " ").split()
        if words[0] in ("def", "thread"):
            self._definitions[words[1]] = statement + "\n"
        return self.interpreted

    def enter(self, namespace: dict[str, Any], clear_queue: bool) -> None:
        """Begins to execute statements in a program's namespace."""
        if clear_queue:
            self.waiting.clear()
        self.active, self._namespace, self._own = True, namespace, set(namespace)

    def clear(self) -> None:
        """Forgets what statements have defined."""
        self.cleared = self.executed
        self._definitions.clear()
        for name in [n for n in self._namespace if n.startswith("g_") and n not in self._own]:
            del self._namespace[name]

    def end(self, clear: bool) -> None:
        """Ends the mode; called also when its program ends."""
        self.active = False
        if clear:
            self.clear()
        self._namespace = {}
