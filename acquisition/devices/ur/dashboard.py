"""PolyScope 5: queries, recovery and the second halt path by the Dashboard Server, over plain TCP (port 29999).

ur-rtde's dashboard client hides its socket. The second halt path needs one that is open in advance and sends at once.
So all commands go over sockets of our own, each with a time-out.
"""

import time
from types import TracebackType

from acquisition.devices import ArmIdentity, RecoveryStep
from acquisition.devices.ur import tcp
from acquisition.devices.ur.software import ControllerState, Version
from acquisition.models.errors import ErrorCode, RigError

DASHBOARD_PORT = 29999

_LONGEST_LINE = 4096

_RECOVERY: dict[RecoveryStep, tuple[str, str]] = {
    "unlock": ("unlock protective stop", "Protective stop releasing"),
    "power": ("power on", "Powering on"),
    "brakes": ("brake release", "Brake releasing"),
}
"""Command of each step, and the beginning of the answer if the controller agrees."""


class Dashboard:
    """One dashboard connection: sends a line, receives a line; also a `StopConnection`."""

    def __init__(self, address: str, timeout_s: float | None = None) -> None:
        """Connects and reads the greeting, each within `timeout_s`, by default `tcp.PROBE_S`.

        Raises OSError (TimeoutError if the server is silent).
        """
        timeout_s = tcp.PROBE_S if timeout_s is None else timeout_s
        self._timeout_s = timeout_s
        self._rest = b""
        deadline = time.monotonic() + timeout_s
        self.socket = tcp.connect(address, DASHBOARD_PORT, timeout_s)
        try:
            greeting = self._line(deadline)
            if not greeting.startswith("Connected"):
                raise ConnectionError(f"greeted with {greeting!r}")
        except OSError:
            self.socket.close()
            raise

    def ask(self, question: str) -> str:
        """Sends one line and returns the reply without its line end. Raises OSError."""
        self.socket.settimeout(self._timeout_s)
        self.socket.sendall(f"{question}\n".encode())
        return self._line(time.monotonic() + self._timeout_s)

    def stop(self) -> str:
        """Ends the program, if one runs. Raises OSError, also for a refusal.

        A connection that was opened in local control is refused for as long as it lives; a new one may be obeyed.
        """
        reply = self.ask("stop")
        if reply != "Stopped":
            raise ConnectionError(f"answers {reply!r}")
        return reply

    def read_unasked(self) -> None:
        """Reads what was sent unasked. Raises OSError at the end of the connection."""
        tcp.receive(self.socket, time.monotonic())

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
            self._rest += tcp.receive(self.socket, deadline)
            if len(self._rest) > _LONGEST_LINE:
                raise ConnectionError("sent no line end")
        line, _, self._rest = self._rest.partition(b"\n")
        return line.decode("utf-8", "replace").strip()


class PolyScope5:
    """A controller with a Dashboard Server; see the Protocol `Software`."""

    stop_path = "the dashboard"

    def __init__(self, address: str) -> None:
        self._address = address

    def probe(self, version: Version) -> None:
        """Raises RigError arm.unreachable unless the dashboard greets."""
        try:
            Dashboard(self._address).close()
        except OSError as error:
            raise tcp.unreachable(self._address, DASHBOARD_PORT, error) from error

    def state(self) -> ControllerState:
        """Asks the dashboard. Raises RigError arm.unreachable."""
        model, serial, software, remote = self._ask(
            "get robot model", "get serial number", "PolyscopeVersion", "is in remote control"
        )
        return ControllerState(ArmIdentity(model, serial, software), "true" in remote)

    def recover(self, step: RecoveryStep) -> None:
        """Carries out one step by the dashboard. Raises RigError safety.recovery_refused, arm.unreachable."""
        order, agreement = _RECOVERY[step]
        (reply,) = self._ask(order)
        if not reply.startswith(agreement):
            raise RigError(
                ErrorCode.SAFETY_RECOVERY_REFUSED, f"The controller answers: {reply}", step=step, reply=reply
            )

    def open_stop(self, timeout_s: float) -> Dashboard:
        """Opens a dashboard connection. Raises OSError."""
        return Dashboard(self._address, timeout_s)

    def limits(self) -> tuple[str, ...]:
        """Returns nothing: the dashboard has all that the service needs."""
        return ()

    def _ask(self, *questions: str) -> list[str]:
        try:
            with Dashboard(self._address) as dashboard:
                return [dashboard.ask(question) for question in questions]
        except OSError as error:
            detail = f"The dashboard of {self._address} does not answer: {error or 'time-out'}."
            raise RigError(ErrorCode.ARM_UNREACHABLE, detail, address=self._address) from error
