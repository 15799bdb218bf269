"""The controller's software, PolyScope 5 or PolyScope X: what the service needs of it beside ur-rtde.

Both move the arm by the same URScript and RTDE. They differ in who says which arm it is and whether it is in remote
control, how a person's recovery is carried out, and what ends the program when the driver cannot: the dashboard of
PolyScope 5; the Robot API (REST) and the primary interface of PolyScope X, which has no dashboard. Which it is the
cell file says (`arm.polyscope`); the version that RTDE names is compared with it at each connection, because guessing
by open ports would take a dashboard that is switched off for another generation.
"""

import socket
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from acquisition.devices import ArmIdentity, RecoveryStep


class Version(NamedTuple):
    """The software's version as RTDE gives it."""

    major: int
    minor: int
    bugfix: int
    build: int

    def __str__(self) -> str:
        return f"{self.major}.{self.minor}.{self.bugfix}"

    @property
    def polyscope(self) -> str:
        """The value of `arm.polyscope` that it belongs to; CB3 (version 3) is handled as PolyScope 5."""
        return "x" if self.major >= 10 else "5"


@dataclass(frozen=True)
class ControllerState:
    """Who is there, and whether it may be commanded from outside."""

    identity: ArmIdentity
    remote_control: bool


class StopConnection(Protocol):
    """A connection that is open in advance, to end the controller's program; used by one thread."""

    @property
    def socket(self) -> socket.socket:
        """To wait for what arrives unasked."""
        ...

    def stop(self) -> str:
        """Ends the program, at once; returns the controller's confirmation. Raises OSError without one."""
        ...

    def read_unasked(self) -> None:
        """Takes what has arrived. Raises OSError at the connection's end."""
        ...

    def close(self) -> None:
        """Closes the connection."""
        ...


class Software(Protocol):
    """One generation of PolyScope at one address."""

    stop_path: str
    """What the second halt path goes through, for logs."""

    def probe(self, version: Version) -> None:
        """Raises RigError arm.unreachable unless its own ports answer in time, config.invalid for a version too old."""
        ...

    def state(self) -> ControllerState:
        """Asks who is there. Raises RigError arm.unreachable."""
        ...

    def recover(self, step: RecoveryStep) -> None:
        """Unlocks a protective stop, powers on, or releases the brakes: a person has asked for it.

        Raises RigError safety.recovery_refused with the controller's answer, arm.unreachable.
        """
        ...

    def open_stop(self, timeout_s: float) -> StopConnection:
        """Opens a connection that can end the program. Raises OSError."""
        ...

    def limits(self) -> tuple[str, ...]:
        """What cannot be done, or not be checked, with this software; for `lightpose check`."""
        ...
