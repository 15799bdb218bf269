"""The controller's software, PolyScope 5 or PolyScope X: what the service needs from it besides ur-rtde.

Both move the arm by the same URScript and RTDE. They differ in how identity and remote control are read, how a person's
recovery is carried out, and what ends the program if the driver cannot: the dashboard of PolyScope 5; the Robot API
(REST) and the primary interface of PolyScope X, which has no dashboard. The cell file states which it is
(`arm.polyscope`), and each connection compares that with the version that RTDE reports. Guessing by open ports would
take a controller whose dashboard is switched off for the other generation.
"""

import socket
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from acquisition.devices import ArmIdentity, RecoveryStep


class Version(NamedTuple):
    """The software's version as RTDE reports it."""

    major: int
    minor: int
    bugfix: int
    build: int

    def __str__(self) -> str:
        return f"{self.major}.{self.minor}.{self.bugfix}"

    @property
    def polyscope(self) -> str:
        """The value of `arm.polyscope` for this version; CB3 (version 3) is handled as PolyScope 5."""
        return "x" if self.major >= 10 else "5"


@dataclass(frozen=True)
class ControllerState:
    """Identity of the controller, and whether it may be commanded from outside."""

    identity: ArmIdentity
    remote_control: bool


class StopConnection(Protocol):
    """A connection that is open in advance, to end the controller's program; used by one thread."""

    @property
    def socket(self) -> socket.socket:
        """The socket, to wait for what arrives unasked."""
        ...

    def stop(self) -> str:
        """Ends the program, at once; returns the controller's confirmation. Raises OSError without one."""
        ...

    def read_unasked(self) -> None:
        """Reads what has arrived. Raises OSError at the connection's end."""
        ...

    def close(self) -> None:
        """Closes the connection."""
        ...


class Software(Protocol):
    """One generation of PolyScope at one address."""

    stop_path: str
    """Name of the second halt path's connection, for logs."""

    def probe(self, version: Version) -> None:
        """Raises RigError arm.unreachable unless its own ports answer in time, config.invalid for a version too old."""
        ...

    def state(self) -> ControllerState:
        """Returns identity and remote control. Raises RigError arm.unreachable."""
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
        """Lists what cannot be done, or cannot be checked, with this software; for `lightpose check`."""
        ...
