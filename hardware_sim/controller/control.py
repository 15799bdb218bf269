"""Client of the simulated controller's control port: reads the true state and orders faults."""

import json
import socket
from collections.abc import Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

PORT = 30200


class ControlClient(AbstractContextManager["ControlClient"]):
    """One connection; use as a context manager or call `close`."""

    def __init__(self, address: str, timeout_s: float = 3.0) -> None:
        """Connects. Raises ConnectionError if no controller listens."""
        self._address = address
        try:
            self._socket = socket.create_connection((address, PORT), timeout_s)
        except OSError as error:
            raise ConnectionError(f"the simulated controller at {address}:{PORT} does not answer: {error}") from error
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._lines = self._socket.makefile("rb")

    def request(self, **fields: Any) -> dict[str, Any]:
        """Sends one request and returns the reply. Raises ConnectionError, and ValueError if it is refused."""
        try:
            self._socket.sendall((json.dumps(fields) + "\n").encode())
            line = self._lines.readline()
        except OSError as error:
            raise ConnectionError(f"the connection to the simulated controller is lost: {error}") from error
        if not line:
            raise ConnectionError(f"the simulated controller at {self._address} closed the connection")
        reply: dict[str, Any] = json.loads(line)
        if not reply.get("ok"):
            raise ValueError(str(reply.get("error")))
        return reply

    def state(self) -> dict[str, Any]:
        """True state of the arm, its outputs, modes and program (see `control_port.state`)."""
        return self.request(command="state")

    def fault(self, kind: str, **parameters: Any) -> None:
        """Orders a fault (see `faults.FAULTS`), after `at_s` seconds if given."""
        self.request(command="fault", kind=kind, **parameters)

    def set_digital_input(self, number: int, level: bool) -> None:
        """Sets a digital input: 0–7 standard, 8–15 configurable, 16–17 tool."""
        self.request(command="input", digital=number, level=level)

    def set_analog_input(self, number: int, value: float) -> None:
        """Sets an analogue input in V, or in A if it is set to current: 0–1 standard, 2–3 tool."""
        self.request(command="input", analog=number, value=value)

    def surface(self, point: Sequence[float], normal: Sequence[float], stiffness: float) -> None:
        """Places a spring plane (base frame, m, N/m) that the TCP can touch; stiffness 0 removes it."""
        self.request(command="surface", point=list(point), normal=list(normal), stiffness=stiffness)

    def collisions(self) -> list[dict[str, Any]]:
        """All collisions so far: timestamp (s), first and second part, true joints (rad)."""
        return list(self.request(command="collisions")["collisions"])

    def surround(self, path: Path) -> None:
        """Reads the arm's surroundings from a file (see `surroundings`)."""
        self.request(command="surroundings", file=str(path.resolve()))

    def log(self) -> list[str]:
        """The controller's latest messages."""
        return list(self.request(command="log")["messages"])

    def close(self) -> None:
        self._lines.close()
        self._socket.close()

    def __exit__(self, *exception: object) -> None:
        self.close()
