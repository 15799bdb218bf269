"""Execution of a compiled program: cooperative threads with time slots.

Once per tick every thread runs until it gives up its slot. The program ends with its first thread.

A thread is not interrupted inside a critical section: if its share of a tick runs out there, no other thread runs
before it continues. A function that waits by itself (`join`, `sync`, `sleep`, moves, reads from sockets) lets the
others run there too. UR's manual gives no more than the keywords' names, and scripts of its drivers servo, read and
join other threads inside critical sections, which could never end otherwise.
"""

import re
from collections.abc import Callable, Generator, Mapping
from functools import partial
from types import GeneratorType
from typing import Any

from hardware_sim.controller import semantics
from hardware_sim.controller.compiler import NAMES_OF_OPERATIONS, TURN_BUDGET, CompiledProgram
from hardware_sim.controller.semantics import ScriptError

_MAX_THREADS = 64
_VALUE_FUNCTIONS = ("copy_of", "pose", "truth", "item", "put", "member", "put_member")
_OWN_NAMES = re.compile(r"\b[fgvb]_(?=\w)|\b\w+(?:Functions|Arithmetic|Strings)\.")  # in Python's messages


class _Thread:
    """A generator and its name."""

    def __init__(self, name: str, steps: "GeneratorType[None, None, Any] | None") -> None:
        self.name = name
        self.steps = steps
        self.critical = False


class Program:
    """One program in execution."""

    def __init__(self, compiled: CompiledProgram, functions: Mapping[str, Callable[..., Any]]) -> None:
        """`functions` are the controller's own, by their URScript names."""
        self.name = compiled.name
        self.secondary = compiled.secondary
        self.finished = False
        self._lines = compiled.lines
        self._threads: dict[int, _Thread] = {}
        self._last_handle = 0
        self._current: _Thread | None = None
        self._handle = 0
        self._interrupted = 0  # the thread whose share of a tick ran out inside its critical section
        self._budget = 0
        namespace: dict[str, Any] = {f"b_{name}": function for name, function in functions.items()}
        namespace |= {
            "Struct": semantics.Struct,
            **{name: getattr(semantics, name) for name in _VALUE_FUNCTIONS},
            **{name: semantics.OPERATIONS[sign] for sign, name in NAMES_OF_OPERATIONS.items()},
            "run": self._run,
            "kill": self._kill,
            "join": self._join,
            "halt": self._halt,
            "set_critical": self._set_critical,
            "turn_is_spent": self._turn_is_spent,
        }
        namespace["b_interpreter_mode"] = partial(functions["interpreter_mode"], namespace)
        exec(compiled.code, namespace)  # noqa: S102 - written by the compiler above, names prefixed
        self._main = self._run(self.name, namespace["program"]())

    def turn(self) -> None:
        """Gives each thread its slot. Raises ScriptError."""
        for handle in sorted(self._threads, key=lambda handle: handle != self._interrupted):
            thread = self._threads.get(handle)
            if thread is None or self._interrupted not in (0, handle):
                continue
            self._interrupted = 0
            self._current, self._handle = thread, handle
            self._budget = TURN_BUDGET
            try:
                if thread.steps is not None:
                    next(thread.steps)
                    continue
            except StopIteration:
                pass
            except ScriptError as error:
                raise ScriptError(f"{thread.name}, line {self._line(error)}: {error}") from error
            except RecursionError as error:
                raise ScriptError(f"{thread.name}: calls are nested too deeply") from error
            except NameError as error:
                name = str(error.name or "")[2:]
                raise ScriptError(f"{thread.name}, line {self._line(error)}: {name!r} has no value yet") from error
            except (TypeError, ValueError, IndexError, ArithmeticError, AttributeError) as error:
                message = _OWN_NAMES.sub("", str(error))
                raise ScriptError(f"{thread.name}, line {self._line(error)}: {message}") from error
            self._end(handle)
            if handle == self._main:
                self.close()
                return

    def close(self) -> None:
        self.finished = True
        for handle in list(self._threads):
            self._end(handle)

    @property
    def line(self) -> int:
        """The URScript line on which the first thread waits, 0 if there is none."""
        line, thread = 0, self._threads.get(self._main)
        steps: Any = None if thread is None else thread.steps
        while isinstance(steps, GeneratorType):
            if steps.gi_frame is not None and steps.gi_code.co_filename == f"<{self.name}>":
                line = self._lines[steps.gi_frame.f_lineno]
            steps = steps.gi_yieldfrom
        return line

    def _line(self, error: BaseException) -> int:
        """The URScript line on which an error arose."""
        line, trace = 0, error.__traceback__
        while trace is not None:
            if trace.tb_frame.f_code.co_filename == f"<{self.name}>":
                line = self._lines[trace.tb_lineno]
            trace = trace.tb_next
        return line

    def _end(self, handle: int) -> None:
        thread = self._threads.pop(handle, None)
        if self._interrupted == handle:
            self._interrupted = 0
        # A thread that ends itself is executing and cannot be closed; it ends at its next yield.
        if thread is not None and thread.steps is not None and not thread.steps.gi_running:
            thread.steps.close()

    def _run(self, name: str, steps: Any) -> int:
        if len(self._threads) >= _MAX_THREADS:
            raise ScriptError("too many threads")
        self._last_handle += 1
        # A function that cannot wait has done its work already, so its handle lives for one turn.
        self._threads[self._last_handle] = _Thread(name, steps if isinstance(steps, GeneratorType) else None)
        return self._last_handle

    def _kill(self, handle: Any) -> None:
        # 0 and the handles of ended threads are ignored: the control script kills them as a matter of course.
        if isinstance(handle, int) and handle in self._threads:
            self._end(handle)

    def _join(self, handle: Any) -> Generator[None, None, None]:
        while isinstance(handle, int) and handle in self._threads:
            yield

    def _halt(self) -> Generator[None, None, None]:
        self.finished = True
        while True:
            yield

    def _set_critical(self, critical: bool) -> None:
        if self._current is not None:
            self._current.critical = critical

    def _turn_is_spent(self, cost: int) -> bool:
        self._budget -= cost
        if self._budget >= 0:
            return False
        if self._current is not None and self._current.critical:
            self._interrupted = self._handle
        return True
