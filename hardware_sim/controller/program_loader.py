"""Loader of uploaded programs, which compiles them in a child process and starts them in the order of arrival.

Compiling the library's control script takes tens of milliseconds, and a path of thousands of points a second. A thread
would delay the tick, because Python's compiler holds the interpreter's lock all the while. The process is forked before
any port is open. It ends with its parent, whose death closes its socket.
"""

import logging
import marshal
import os
import signal
import socket
import struct
from collections import deque
from collections.abc import Callable

from hardware_sim.controller.compiler import CompiledProgram, compile_program
from hardware_sim.controller.controller import Controller
from hardware_sim.controller.functions import VOCABULARY
from hardware_sim.controller.syntax import ScriptSyntaxError

LOG = logging.getLogger("hardware_sim.controller")
_SIZE = struct.Struct(">I?")  # size, and whether it is a statement
Answer = CompiledProgram | ScriptSyntaxError
_MOST_WAITING = 32  # programs
_NICENESS = 5  # above that of the ticks
_AT_ONCE = 1 << 16  # bytes


class ProgramLoader:
    """The programs that one controller has received and not yet started."""

    def __init__(self, controller: Controller) -> None:
        """Forks the compiling process."""
        self._controller = controller
        self._waiting: deque[Callable[[Answer], None]] = deque()
        self._unsent: deque[bytes] = deque()
        self._received = bytearray()
        self._link, other = socket.socketpair()
        self._process = os.fork()
        if self._process == 0:
            self._link.close()
            _compile_until_the_end(other)
        other.close()
        self._link.setblocking(False)

    def add(self, text: str) -> None:
        """Queues a program to be compiled and started."""
        if not self.compile(text, self._start, statement=False):
            self._controller.report(f"program refused: {_MOST_WAITING} others wait to be compiled")

    def compile(self, text: str, done: Callable[[Answer], None], *, statement: bool) -> bool:
        """Queues a program or statement to be compiled and passed to `done`; returns False if too many wait."""
        if len(self._waiting) >= _MOST_WAITING:
            return False
        self._waiting.append(done)
        data = text.encode()
        self._unsent.append(_SIZE.pack(len(data), statement) + data)
        self._send()
        return True

    def _start(self, answer: Answer) -> None:
        if isinstance(answer, ScriptSyntaxError):
            self._controller.refuse(answer)
        else:
            self._controller.start(answer)

    def start_compiled(self) -> None:
        """Starts compiled programs; it is called in every tick and never waits."""
        if not self._waiting:
            return
        self._send()
        try:
            data = self._link.recv(_AT_ONCE)
        except BlockingIOError:
            return
        if not data:
            raise RuntimeError("the process that compiles programs has ended")
        self._received += data
        while len(self._received) >= _SIZE.size:
            end = _SIZE.size + _SIZE.unpack_from(self._received)[0]
            if len(self._received) < end:
                return
            answer = marshal.loads(self._received[_SIZE.size : end])  # noqa: S302 - from our own child
            del self._received[:end]
            done = self._waiting.popleft()
            done(ScriptSyntaxError(answer) if isinstance(answer, str) else CompiledProgram(*answer))

    def _send(self) -> None:
        while self._unsent:
            data = self._unsent[0]
            try:
                sent = self._link.send(data[:_AT_ONCE])
            except BlockingIOError:
                return
            if sent < len(data):
                self._unsent[0] = data[sent:]
            else:
                self._unsent.popleft()

    def close(self) -> None:
        """Ends the process, even while it compiles."""
        self._link.close()
        os.kill(self._process, signal.SIGKILL)
        os.waitpid(self._process, 0)


def _compile_until_the_end(link: socket.socket) -> None:
    """Runs in the forked process: reads text, writes code or the reason for a refusal; never returns."""
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        os.nice(_NICENESS)
        stream = link.makefile("rwb")
        while header := stream.read(_SIZE.size):
            size, statement = _SIZE.unpack(header)
            text = stream.read(size).decode()
            try:
                program = compile_program(text, VOCABULARY, statement)
                answer = marshal.dumps((program.name, program.secondary, program.code, program.lines))
            except ScriptSyntaxError as error:
                answer = marshal.dumps(str(error))
            stream.write(_SIZE.pack(len(answer), statement) + answer)
            stream.flush()
    except (OSError, struct.error) as error:
        LOG.info("compiling ends: %s", error)
    finally:
        os._exit(0)
