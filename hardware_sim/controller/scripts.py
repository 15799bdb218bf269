"""Input of the primary, secondary and real-time ports: programs as text, and raw commands.

A program has no length and no terminator: it is complete when its blocks are closed again. A program that is only half
sent is dropped when the client closes. A raw command is a line outside a program that UR's client library sends in
place of a dashboard command (`primary_client.cpp`). It has the same effect, and is refused in local control as well.
With PolyScope X a connection opened in local control stays read-only. The output of these ports is in `streams`.
"""

import logging
import socket

from hardware_sim.controller import dashboard
from hardware_sim.controller.controller import Controller
from hardware_sim.controller.program_loader import ProgramLoader
from hardware_sim.controller.sockets import Connection, LineConnection
from hardware_sim.controller.syntax import depth_change

LOG = logging.getLogger("hardware_sim.controller")
_LONGEST_PROGRAM = 1 << 20  # characters; a path of 10,000 waypoints
_RAW_COMMANDS = {
    "power on": "power on",
    "power off": "power off",
    "set robotmode run": "brake release",
    "set unlock protective stop": "unlock protective stop",
    "stop program": "stop",
    "pause program": "pause",
}
"""Raw commands and the dashboard commands of the same effect."""


class ReadOnlyConnection(Connection):
    """One client that only listens; its data are dropped."""

    def received(self, data: bytes) -> None:
        """Drops the data."""


class ScriptConnection(LineConnection):
    """One sender of programs."""

    def __init__(self, stream: socket.socket, controller: Controller, uploads: ProgramLoader) -> None:
        super().__init__(stream)
        self._controller = controller
        self._uploads = uploads
        self._read_only = controller.version[0] >= 10 and not controller.safety.remote_control
        self._lines: list[str] = []
        self._depth = 0
        self._size = 0

    def line(self, text: str) -> None:
        """Collects lines until all blocks are closed, then passes the program on."""
        if self._read_only:
            return
        if not self._lines:
            words = " ".join(text.split("#", 1)[0].split())
            if not words:
                return
            command = _RAW_COMMANDS.get(words.lower())
            if command is not None:
                remote = self._controller.safety.remote_control
                self._controller.report(f"{words}: {dashboard.answer(self._controller, command, remote)}", logging.INFO)
                return
        self._lines.append(text)
        self._size += len(text)
        self._depth += depth_change(text)
        if self._size > _LONGEST_PROGRAM:
            # Its remaining lines would be read as separate programs.
            LOG.warning("a program of more than %d characters: connection closed", _LONGEST_PROGRAM)
            self.closed = True
        elif self._depth <= 0:
            lines, self._lines, self._depth, self._size = self._lines, [], 0, 0
            self._uploads.add("\n".join(lines) + "\n")
