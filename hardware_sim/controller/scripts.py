"""The script ports: programs as text, without length or terminator (ports 30001–30003).

A program is complete when its blocks are closed again. Nothing is sent back; what a client leaves half sent is
forgotten when it closes.
"""

import logging
import socket

from hardware_sim.controller.controller import Controller
from hardware_sim.controller.sockets import LineConnection
from hardware_sim.controller.syntax import depth_change

LOG = logging.getLogger("hardware_sim.controller")
PORTS = (30001, 30002, 30003)
_LONGEST_PROGRAM = 4 << 20


class ScriptConnection(LineConnection):
    """One sender of programs."""

    def __init__(self, stream: socket.socket, controller: Controller) -> None:
        super().__init__(stream)
        self._controller = controller
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
        if self._depth <= 0 or self._size > _LONGEST_PROGRAM:
            lines, self._lines, self._depth, self._size = self._lines, [], 0, 0
            self._controller.load("\n".join(lines) + "\n")
