"""A client of the primary, secondary and real-time interfaces, written from their manual; it shares no code with them.

Source of the layouts: UR's client interface manual, "Robot Software 5.10" and "RealTime 5.10". Those of sub-packages 9
and 10, which it leaves out, have the sizes recorded in UR's client library (`tests/test_primary_parser.cpp`).
"""

import socket
import struct
from collections.abc import Iterator
from typing import Any

RECORDED_SIZES = [
    (0, 47), (1, 251), (4, 101), (5, 225), (9, 53), (3, 75), (2, 37),
    (6, 445), (7, 61), (8, 9), (10, 43), (11, 26), (12, 8),
]  # fmt: skip
"""Types and sizes of the sub-packages in the first robot state of a UR5e (URSim 5.8), in their order."""
_ANY = "-"  # reserved, or UR's own
STATE = {
    0: "Q:timestamp ?:connected ?:enabled ?:power_on ?:emergency_stopped ?:protective_stopped ?:program_running"
    " ?:program_paused B:robot_mode B:control_mode d:speed_fraction d:speed_scaling d:speed_fraction_limit B:-",
    1: " ".join(
        f"d:q{i} d:target{i} d:speed{i} f:current{i} f:voltage{i} f:motor_temperature{i} f:- B:mode{i}"
        for i in range(6)
    ),
    2: "B:range2 B:range3 d:input2 d:input3 f:voltage B:output_voltage f:current f:temperature B:mode",
    3: "i:inputs i:outputs B:range0 B:range1 d:analog_input0 d:analog_input1 b:domain0 b:domain1 d:analog_output0"
    " d:analog_output1 f:temperature f:robot_voltage f:robot_current f:io_current B:safety_mode B:reduced"
    " b:euromap I:- B:operational_mode B:enabling_device B:-",
    4: "6d:tool 6d:tcp_offset",
    5: "6I:checksums 6d:theta 6d:a 6d:d 6d:alpha I:status",
    6: "12d:position_limits 12d:motion_limits d:v_joint d:a_joint d:v_tool d:a_tool d:radius 6d:a 6d:d 6d:alpha"
    " 6d:theta i:masterboard i:box i:robot_type i:sub_type",
    7: "6d:force d:dexterity",
    8: "?:teach_pressed ?:teach_enabled ?:freedrive_by_input B:-",
    9: "48s:-",
    10: "38s:-",
    11: "?:enabled i:baud_rate i:parity i:stop_bits f:rx_idle f:tx_idle",
    12: "B:output_mode B:digital0 B:digital1",
}  # fmt: skip
REAL_TIME = (
    "i:size d:time 6d:q_target 6d:qd_target 6d:qdd_target 6d:i_target 6d:m_target 6d:q_actual 6d:qd_actual 6d:i_actual"
    " 6d:i_control 6d:tool 6d:tcp_speed 6d:tcp_force 6d:tool_target 6d:tcp_speed_target d:inputs 6d:temperatures"
    " d:timer d:test d:robot_mode 6d:joint_modes d:safety_mode 6d:- 3d:accelerometer 6d:- d:speed_scaling d:momentum"
    " 2d:- d:main_voltage d:robot_voltage d:robot_current 6d:joint_voltages d:outputs d:program_state 3d:elbow"
    " 3d:elbow_velocity d:safety_status 3d:- d:payload 3d:center 6d:inertia"
)


def unpack(fields: str, data: bytes) -> dict[str, Any]:
    """Values by name; fails where `data` have another size."""
    values: dict[str, Any] = {}
    at = 0
    for field in fields.split():
        code, name = field.split(":")
        items = struct.unpack_from(">" + code, data, at)
        at += struct.calcsize(">" + code)
        values[name] = items[0] if len(items) == 1 else list(items)
    assert at == len(data)
    return values


def split(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Types and contents of the messages, or sub-packages, that `data` consist of."""
    while data:
        size, kind = struct.unpack_from(">iB", data)
        assert 5 <= size <= len(data)
        yield kind, data[5:size]
        data = data[size:]


def state(message: bytes) -> dict[int, dict[str, Any]]:
    """The sub-packages of a robot state's content, by their types."""
    return {kind: unpack(STATE[kind], body) for kind, body in split(message)}


class StreamClient:
    """One connection to a port that streams."""

    def __init__(self, address: str, port: int) -> None:
        self.socket = socket.create_connection((address, port), 60.0)

    def _take(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            more = self.socket.recv(count - len(data))
            if not more:
                raise EOFError("the controller has hung up")
            data += more
        return data

    def message(self) -> tuple[int, bytes]:
        """The next message: its type and content."""
        size, kind = struct.unpack(">iB", self._take(5))
        return kind, self._take(size - 5)

    def state(self) -> dict[int, dict[str, Any]]:
        """The next robot state."""
        kind, body = self.message()
        while kind != 16:
            kind, body = self.message()
        return state(body)

    def robot_message(self, subtype: int) -> bytes:
        """The next robot message of a type: what follows its head."""
        while True:
            kind, body = self.message()
            if kind == 20 and body[9] == subtype:
                return body[10:]

    def real_time(self) -> dict[str, Any]:
        """The next packet of the real-time interface."""
        return unpack(REAL_TIME, self._take(1220))

    def send(self, text: str) -> None:
        """Sends lines."""
        self.socket.sendall(text.encode())

    def __enter__(self) -> "StreamClient":
        return self

    def __exit__(self, *failure: object) -> None:
        self.socket.close()
