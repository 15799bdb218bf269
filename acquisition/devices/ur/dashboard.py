"""The controller's dashboard over plain TCP, and the probe that comes before anything that could hang.

ur-rtde's constructors never return when a port is open but silent, and its dashboard client hides the socket; the
second halt path needs one that is open in advance and sends at once. So questions and `stop` go over sockets of our
own, each with a time-out.
"""

import ipaddress
import os
import socket
import struct
import time
from types import TracebackType

from acquisition.devices import RecoveryStep
from acquisition.models.errors import ErrorCode, RigError

DASHBOARD_PORT = 29999
SCRIPT_PORT = 30003
RTDE_PORT = 30004

PROBE_S = 0.7
"""Each port has this long to answer, so that all three are refused within 3 s."""

_RTDE_PROTOCOL = struct.pack(">HBH", 5, ord("V"), 2)
_LONGEST_LINE = 4096

_RECOVERY: dict[RecoveryStep, tuple[str, str]] = {
    "unlock": ("unlock protective stop", "Protective stop releasing"),
    "power": ("power on", "Powering on"),
    "brakes": ("brake release", "Brake releasing"),
}
"""What is asked for each step, and how the answer begins when the controller agrees."""


def refuse_foreign(address: str) -> None:
    """Raises RigError arm.unreachable for an arm that is not on loopback while LIGHTPOSE_LOOPBACK_ONLY is 1.

    The test suite sets the variable, and every process that it starts inherits it: no test can reach a real arm.
    """
    if os.environ.get("LIGHTPOSE_LOOPBACK_ONLY") != "1" or address == "localhost":
        return
    try:
        allowed = ipaddress.ip_address(address).is_loopback
    except ValueError:
        allowed = False
    if not allowed:
        raise RigError(
            ErrorCode.ARM_UNREACHABLE,
            f"{address} is not on loopback and LIGHTPOSE_LOOPBACK_ONLY is set.",
            address=address,
        )


class Dashboard:
    """One dashboard connection: a line out, a line back."""

    def __init__(self, address: str, timeout_s: float | None = None) -> None:
        """Connects and reads the greeting, each within `timeout_s`, by default `PROBE_S`.

        Raises OSError (TimeoutError when silent).
        """
        refuse_foreign(address)
        timeout_s = PROBE_S if timeout_s is None else timeout_s
        self._timeout_s = timeout_s
        self._rest = b""
        deadline = time.monotonic() + timeout_s
        self.socket = socket.create_connection((address, DASHBOARD_PORT), timeout_s)
        try:
            self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            greeting = self._line(deadline)
            if not greeting.startswith("Connected"):
                raise ConnectionError(f"greeted with {greeting!r}")
        except OSError:
            self.socket.close()
            raise

    def ask(self, question: str) -> str:
        """Sends one line and returns the reply without its line end. Raises OSError."""
        self.send(question)
        return self._line(time.monotonic() + self._timeout_s)

    def send(self, line: str) -> None:
        """Sends one line without waiting for the reply. Raises OSError."""
        self.socket.settimeout(self._timeout_s)
        self.socket.sendall(f"{line}\n".encode())

    def close(self) -> None:
        """Closes the connection."""
        self.socket.close()

    def __enter__(self) -> "Dashboard":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _line(self, deadline: float) -> str:
        while b"\n" not in self._rest:
            self._rest += _receive(self.socket, deadline)
            if len(self._rest) > _LONGEST_LINE:
                raise ConnectionError("sent no line end")
        line, _, self._rest = self._rest.partition(b"\n")
        return line.decode("utf-8", "replace").strip()


def ask(address: str, *questions: str) -> list[str]:
    """Asks on a connection of its own. Raises RigError arm.unreachable."""
    try:
        with Dashboard(address) as dashboard:
            return [dashboard.ask(question) for question in questions]
    except OSError as error:
        detail = f"The dashboard of {address} does not answer: {error or 'time-out'}."
        raise RigError(ErrorCode.ARM_UNREACHABLE, detail, address=address) from error


def recover(address: str, step: RecoveryStep) -> None:
    """Unlocks a protective stop, powers on, or releases the brakes. Raises RigError safety.recovery_refused."""
    order, agreement = _RECOVERY[step]
    (reply,) = ask(address, order)
    if not reply.startswith(agreement):
        raise RigError(ErrorCode.SAFETY_RECOVERY_REFUSED, f"The controller answers: {reply}", step=step, reply=reply)


def probe(address: str) -> None:
    """Raises RigError arm.unreachable, within 3 s, unless dashboard, script and RTDE ports are open and answer."""
    refuse_foreign(address)
    port = DASHBOARD_PORT
    try:
        Dashboard(address).close()
        port = SCRIPT_PORT
        socket.create_connection((address, port), PROBE_S).close()
        port = RTDE_PORT
        deadline = time.monotonic() + PROBE_S
        with socket.create_connection((address, port), PROBE_S) as connection:
            connection.sendall(_RTDE_PROTOCOL)
            reply = b""
            while len(reply) < 4:
                reply += _receive(connection, deadline)
            if reply[2:4] != b"V\x01":
                raise ConnectionError("does not speak RTDE version 2")
    except OSError as error:
        reason = "does not answer in time" if isinstance(error, TimeoutError) else f"fails: {error}"
        raise RigError(
            ErrorCode.ARM_UNREACHABLE, f"Port {port} of {address} {reason}.", address=address, port=port
        ) from error


def _receive(connection: socket.socket, deadline: float) -> bytes:
    connection.settimeout(max(deadline - time.monotonic(), 1e-3))
    data = connection.recv(_LONGEST_LINE)
    if not data:
        raise ConnectionError("closed the connection")
    return data
