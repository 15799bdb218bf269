"""Script ports (30001–30003): programs as text, without length or terminator.

A program is complete when its blocks are closed again; what a client leaves half sent is forgotten when it closes.
Nothing is sent back but, on the primary port, the arm's calibration once and runtime exceptions as robot messages.
"""

import logging
import math
import re
import socket
import struct
from collections.abc import Iterable

from hardware_sim.controller.kinematics import ArmModel
from hardware_sim.controller.program_loader import ProgramLoader
from hardware_sim.controller.sockets import Connection, LineConnection
from hardware_sim.controller.syntax import depth_change

LOG = logging.getLogger("hardware_sim.controller")
PRIMARY_PORT = 30001
PORTS = (PRIMARY_PORT, 30002, 30003)
_LONGEST_PROGRAM = 1 << 20  # characters; a path of 10,000 waypoints
# Size, type, time in µs, source, type of robot message, line and column of the script; then the text.
_ROBOT_MESSAGE = struct.Struct(">iBQbbii")
_IS_ROBOT_MESSAGE, _FROM_CONTROLLER, _IS_RUNTIME_EXCEPTION = 20, 7, 10
_HEADER = struct.Struct(">iB")
_KINEMATICS = struct.Struct(">6I24dI")  # checksums; angles, lengths, distances and twists of all joints; status
_IS_ROBOT_STATE, _IS_KINEMATICS_INFO, _IS_CALIBRATED = 16, 5, 1


class ScriptConnection(LineConnection):
    """One sender of programs."""

    def __init__(self, stream: socket.socket, uploads: ProgramLoader, greeting: bytes = b"") -> None:
        super().__init__(stream)
        if greeting:
            self.offer(greeting)
        self._uploads = uploads
        self._lines: list[str] = []
        self._depth = 0
        self._size = 0

    def line(self, text: str) -> None:
        """Collects lines until the depth of blocks is back to none, then hands the program over."""
        if not self._lines and not text.split("#", 1)[0].strip():
            return
        self._lines.append(text)
        self._size += len(text)
        self._depth += depth_change(text)
        if self._size > _LONGEST_PROGRAM:
            # Its other lines would be read as programs of their own.
            LOG.warning("a program of more than %d characters: connection closed", _LONGEST_PROGRAM)
            self.closed = True
        elif self._depth <= 0:
            lines, self._lines, self._depth, self._size = self._lines, [], 0, 0
            self._uploads.add("\n".join(lines) + "\n")


def kinematics_message(arm: ArmModel) -> bytes:
    """A robot state of the primary interface that holds the arm's calibration and nothing else."""
    links = arm.links
    twists = [math.atan2(link.sin_twist, link.cos_twist) for link in links]
    numbers = [*(link.offset for link in links), *(link.length for link in links), *(link.distance for link in links)]
    body = _KINEMATICS.pack(*[0] * 6, *numbers, *twists, _IS_CALIBRATED)
    part = _HEADER.pack(_HEADER.size + len(body), _IS_KINEMATICS_INFO) + body
    return _HEADER.pack(_HEADER.size + len(part), _IS_ROBOT_STATE) + part


def exception_message(text: str, timestamp: float) -> bytes:
    """A runtime exception as a robot message of the primary interface, with the line that the text names, or −1."""
    named = re.search(r"\bline (\d{1,9})\b", text)
    words = text.encode()
    return (
        _ROBOT_MESSAGE.pack(
            _ROBOT_MESSAGE.size + len(words),
            _IS_ROBOT_MESSAGE,
            round(timestamp * 1e6),
            _FROM_CONTROLLER,
            _IS_RUNTIME_EXCEPTION,
            int(named[1]) if named else -1,
            -1,
        )
        + words
    )


def announce(connections: Iterable[Connection], text: str, timestamp: float) -> None:
    """Sends a program's runtime exception to clients of the primary port."""
    message = exception_message(text, timestamp)
    for connection in connections:
        connection.offer(message)
