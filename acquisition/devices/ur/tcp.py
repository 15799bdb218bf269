"""Plain TCP to the controller: connections that wait for a limited time, and never leave loopback in tests."""

import ipaddress
import os
import socket
import time

from acquisition.models.errors import ErrorCode, RigError

PROBE_S = 0.7
"""Time, s, for each port to answer, so that a refusal by all of them takes less than 3 s."""

_MOST_BYTES = 4096


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
            f"{address} is not a loopback address, and LIGHTPOSE_LOOPBACK_ONLY is set.",
            address=address,
        )


def connect(address: str, port: int, timeout_s: float) -> socket.socket:
    """Opens a connection that sends at once. Raises OSError (TimeoutError if silent), RigError as `refuse_foreign`."""
    refuse_foreign(address)
    connection = socket.create_connection((address, port), timeout_s)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return connection


def receive(connection: socket.socket, deadline: float) -> bytes:
    """Returns the next bytes, by `deadline` (time.monotonic). Raises TimeoutError, ConnectionError at the end."""
    connection.settimeout(max(deadline - time.monotonic(), 1e-3))
    data = connection.recv(_MOST_BYTES)
    if not data:
        raise ConnectionError("closed the connection")
    return data


def unreachable(address: str, port: int, error: OSError) -> RigError:
    """Returns the RigError arm.unreachable for a port that fails."""
    reason = "does not answer in time" if isinstance(error, TimeoutError) else f"cannot be used: {error}"
    return RigError(ErrorCode.ARM_UNREACHABLE, f"Port {port} of {address} {reason}.", address=address, port=port)
