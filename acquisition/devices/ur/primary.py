"""Reading the factory calibration of the arm (Denavit–Hartenberg parameters) from UR's primary interface.

No other interface gives it. The controller sends it unasked, as part "kinematics info" (5) of a robot-state message
(16), soon after a client has connected: six checksums, then θ, a, d and α of all joints, drawing and correction added.
Source: Universal Robots' client interface documents, "Primary and secondary interface".
"""

import socket
import struct
import time

from acquisition.devices.ur.dashboard import refuse_foreign
from acquisition.models.cell_config import JointGeometry
from acquisition.models.errors import ErrorCode, RigError

PORT = 30001
_HEADER = struct.Struct(">iB")  # size with this header, type
_ROBOT_STATE, _KINEMATICS_INFO = 16, 5
_KINEMATICS = struct.Struct(">24x24d")
_LONGEST = 1 << 16
_ENOUGH_S = 1.0


def kinematics(address: str, within_s: float = _ENOUGH_S) -> list[JointGeometry] | None:
    """The arm as built; None when the controller does not send it in time. Raises RigError arm.unreachable."""
    refuse_foreign(address)
    try:
        return _received(address, within_s)
    except OSError as error:
        detail = f"Port {PORT} of {address} fails: {error or 'time-out'}."
        raise RigError(ErrorCode.ARM_UNREACHABLE, detail, address=address, port=PORT) from error


def _received(address: str, within_s: float) -> list[JointGeometry] | None:
    deadline = time.monotonic() + within_s
    data = b""
    with socket.create_connection((address, PORT), within_s) as connection:
        while (left := deadline - time.monotonic()) > 0:
            connection.settimeout(left)
            try:
                more = connection.recv(4096)
            except TimeoutError:
                return None
            if not more:
                return None
            data += more
            while (message := _cut(data)) is not None:
                kind, body, data = message
                if kind == _ROBOT_STATE and (joints := _in_state(body)) is not None:
                    return joints
    return None


def _cut(data: bytes) -> tuple[int, bytes, bytes] | None:
    """The first message's type and body, and what follows it; None while it is incomplete."""
    if len(data) < _HEADER.size:
        return None
    size, kind = _HEADER.unpack_from(data)
    if not _HEADER.size <= size <= _LONGEST:
        raise ConnectionError("does not speak the primary interface")
    return None if len(data) < size else (kind, data[_HEADER.size : size], data[size:])


def _in_state(body: bytes) -> list[JointGeometry] | None:
    """The kinematics among the parts of a robot state."""
    while (part := _cut(body)) is not None:
        kind, content, body = part
        if kind == _KINEMATICS_INFO and len(content) >= _KINEMATICS.size:
            numbers = _KINEMATICS.unpack_from(content)
            rows = zip(numbers[0:6], numbers[6:12], numbers[12:18], numbers[18:24], strict=True)
            return [JointGeometry(theta_rad=theta, a_m=a, d_m=d, alpha_rad=alpha) for theta, a, d, alpha in rows]
    return None
