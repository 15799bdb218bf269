"""UR's primary interface: the arm's factory calibration (Denavit–Hartenberg parameters), and a stop without dashboard.

No other interface gives the calibration. The controller sends it unasked soon after a client has connected, as the part
"kinematics info" (5) of a robot-state message (16): six checksums, then θ, a, d and α of all joints, drawing and
correction added. Ten times a second it sends the part "robot mode" (0), which states whether a program runs; this
confirms a stop. Sources: Universal Robots' client interface documents, "Primary and secondary interface"; for `stop
program`, UR's C++ client library (`PrimaryClient::commandStop`), which so ends programs without a dashboard.
"""

import contextlib
import struct
import time

from acquisition.devices.ur import tcp
from acquisition.models.cell_config import JointGeometry
from acquisition.models.errors import ErrorCode, RigError

PORT = 30001
_HEADER = struct.Struct(">iB")  # size with this header, type
_ROBOT_STATE, _KINEMATICS_INFO = 16, 5
_KINEMATICS = struct.Struct(">24x24d")
_ROBOT_MODE = 0
_PROGRAM = struct.Struct(">13x??")  # running, paused
_LONGEST = 1 << 16
_ENOUGH_S = 3.0
"""Time limit, s, for the calibration: the controller sends it within 0.1 s, but a busy machine may read it late, and
nobody would notice that the comparison was left out."""

CONFIRM_S = 0.5
"""Time, s, for the controller to report that no program runs: five of its messages."""

_STOP = """stop program
def lightpose_halt():
  stopj({deceleration})
end
"""


class PrimaryStop:
    """A connection to the primary interface that can end the controller's program; see `StopConnection`.

    `stop program` ends a program that runs or is paused. The program sent after it replaces the running one and brakes
    at the cell's own deceleration; it is documented for all versions and does the same where that line is not
    understood. A connection opened in local control stays read-only: then nothing is confirmed, and a new one may be
    obeyed.
    """

    def __init__(self, address: str, timeout_s: float, deceleration_rad_s2: float) -> None:
        """Connects. Raises OSError."""
        self.socket = tcp.connect(address, PORT, timeout_s)
        self._timeout_s = timeout_s
        self._deceleration_rad_s2 = deceleration_rad_s2
        self._data = b""

    def stop(self) -> str:
        """Ends the program, at once, and waits for CONFIRM_S. Raises OSError (TimeoutError if one still runs)."""
        self.socket.settimeout(self._timeout_s)
        self.socket.sendall(_STOP.format(deceleration=self._deceleration_rad_s2).encode())
        deadline = time.monotonic() + CONFIRM_S
        self.socket.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            self._program(self.socket.recv(_LONGEST))  # reports from before
        while (program := self._program(tcp.receive(self.socket, deadline))) is None or any(program):
            if time.monotonic() > deadline:
                raise TimeoutError("still reports a program")
        return "no program runs"

    def read_unasked(self) -> None:
        """Reads the controller's reports. Raises OSError at the connection's end."""
        self._program(tcp.receive(self.socket, time.monotonic()))

    def close(self) -> None:
        """Closes the connection."""
        self.socket.close()

    def _program(self, data: bytes) -> tuple[bool, bool] | None:
        """Returns whether a program runs and whether one is paused, by the newest report in the data; else None."""
        self._data += data
        newest = None
        while (message := _cut(self._data)) is not None:
            kind, body, self._data = message
            content = _part(body, _ROBOT_MODE) if kind == _ROBOT_STATE else None
            if content is not None and len(content) >= _PROGRAM.size:
                newest = _PROGRAM.unpack_from(content)
        return newest


def kinematics(address: str, within_s: float = _ENOUGH_S) -> list[JointGeometry] | None:
    """Returns the factory calibration; None if it does not come in time. Raises RigError arm.unreachable."""
    try:
        return _received(address, within_s)
    except OSError as error:
        detail = f"Port {PORT} of {address} cannot be used: {error or 'time-out'}."
        raise RigError(ErrorCode.ARM_UNREACHABLE, detail, address=address, port=PORT) from error


def _received(address: str, within_s: float) -> list[JointGeometry] | None:
    deadline = time.monotonic() + within_s
    data = b""
    with tcp.connect(address, PORT, within_s) as connection:
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
                content = _part(body, _KINEMATICS_INFO) if kind == _ROBOT_STATE else None
                if content is not None and len(content) >= _KINEMATICS.size:
                    numbers = _KINEMATICS.unpack_from(content)
                    rows = zip(numbers[0:6], numbers[6:12], numbers[12:18], numbers[18:24], strict=True)
                    return [
                        JointGeometry(theta_rad=theta, a_m=a, d_m=d, alpha_rad=alpha) for theta, a, d, alpha in rows
                    ]
    return None


def _cut(data: bytes) -> tuple[int, bytes, bytes] | None:
    """Returns the first message's type and body, and what follows it; None while it is incomplete."""
    if len(data) < _HEADER.size:
        return None
    size, kind = _HEADER.unpack_from(data)
    if not _HEADER.size <= size <= _LONGEST:
        raise ConnectionError("does not speak the primary interface")
    return None if len(data) < size else (kind, data[_HEADER.size : size], data[size:])


def _part(body: bytes, wanted: int) -> bytes | None:
    """Returns the content of one part of a robot state; None if it has no such part."""
    while (part := _cut(body)) is not None:
        kind, content, body = part
        if kind == wanted:
            return content
    return None
