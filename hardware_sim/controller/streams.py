"""Messages of the primary, secondary and real-time interfaces (30001–30003, read-only at 30011–30013), software 5.11.

Layouts are from UR's client interface manual, `Version5.10` and `RealTime5.10` (1220 bytes), the last that changed one
before 5.11. Sub-packages that the manual leaves out as internal (9, 10) hold zeros; they have the sizes in the robot
state of a UR5e recorded in UR's client library (`tests/test_primary_parser.cpp`). Sources of messages are also as
recorded there. Messages on global variables (type 25) are not sent.

Each layout is a `struct` format beside the names of the RTDE variables that fill it, so that no stream can differ from
another. All numbers are big-endian.
"""

import math
import operator
import re
import struct
from collections.abc import Iterator

from hardware_sim.controller.limits import JOINT_ACCELERATION, JOINT_LIMIT
from hardware_sim.controller.messages import MessageType, RobotMessage
from hardware_sim.controller.modes import RobotMode, RuntimeState, SafetyMode
from hardware_sim.controller.registers import OFFSETS, OUTPUT_TYPES, TYPES, Registers
from hardware_sim.controller.robot import Robot

PRIMARY, SECONDARY, REAL_TIME = 30001, 30002, 30003
READ_ONLY = 10  # added to a port's number: the same stream for clients that only listen
STATE_TICKS = 50  # 10 Hz

_HEADER = struct.Struct(">iB")
_STATE, _MESSAGE = 16, 20  # types of messages
_FROM_INTERFACE, _FROM_MACHINE = -2, -3  # sources of robot messages
_MICROSECONDS = 1e6
_VERSION_MESSAGE = 3
_BUILD_DATE = b"05-08-2021, 00:00:00"
_E_SERIES, _CONTROLLER_BOX, _MASTERBOARD = 3, 4, 6  # `robotSubType`, `controllerBoxType`, `masterboardVersion`
_DEFAULT_SPEEDS = (1.0472, 1.3963, 0.25, 1.2, 0.25)  # joint, tool: rad/s, rad/s², m/s, m/s²; equivalent radius in m
_CALIBRATED = 1

_REAL_TIME_FIELDS = """timestamp target_q target_qd target_qdd target_current target_moment actual_q actual_qd
    actual_current joint_control_output actual_TCP_pose actual_TCP_speed actual_TCP_force target_TCP_pose
    target_TCP_speed actual_digital_input_bits joint_temperatures actual_execution_time 1 robot_mode joint_mode
    safety_mode 6 actual_tool_accelerometer 6 speed_scaling actual_momentum 2 actual_main_voltage actual_robot_voltage
    actual_robot_current actual_joint_voltage actual_digital_output_bits runtime_state elbow_position elbow_velocity
    safety_status 3 payload payload_cog payload_inertia"""
"""The real-time packet after its size: variables, each number a double, and counts of doubles for UR's own use."""
_OF_EACH_JOINT = """actual_q target_q actual_qd actual_current actual_joint_voltage joint_temperatures
    joint_temperatures joint_mode"""


def _slots(fields: str) -> Iterator[int]:
    for field in fields.split():
        if field.isdecimal():
            yield from [-1] * int(field)  # the last value of the registers is always zero
        else:
            yield from range(OFFSETS[field], OFFSETS[field] + TYPES[OUTPUT_TYPES[field]][1])


_pick_real_time = operator.itemgetter(*_slots(_REAL_TIME_FIELDS))
_REAL_TIME = struct.Struct(">i152d")


def real_time_packet(registers: Registers) -> bytes:
    """The packet that the real-time interface sends in each tick."""
    return _REAL_TIME.pack(_REAL_TIME.size, *_pick_real_time(registers.values))


def _framed(kind: int, body: bytes) -> bytes:
    return _HEADER.pack(_HEADER.size + len(body), kind) + body


def robot_state(robot: Robot, *, short_mode: bool = False) -> bytes:
    """The robot state message; with `short_mode` its mode data lack the last byte, as before software 3.5."""
    parts = dict(_sub_packages(robot))
    if short_mode:
        parts[0] = parts[0][:-1]
    return _framed(_STATE, b"".join(_framed(kind, body) for kind, body in parts.items()))


def _sub_packages(robot: Robot) -> Iterator[tuple[int, bytes]]:
    """Types and contents of a robot state's sub-packages, in the order of a real one."""
    get, arm, model = robot.registers.get, robot.arm, robot.arm.model
    angles, lengths, distances = ([getattr(link, n) for link in model.links] for n in ("offset", "length", "distance"))
    twists = [math.atan2(link.sin_twist, link.cos_twist) for link in model.links]

    def one(*names: str) -> Iterator[float]:
        return (get(name)[0] for name in names)

    def packed(kind: int, layout: str, *values: float) -> tuple[int, bytes]:
        return kind, struct.pack(">" + layout, *values)

    stopped = robot.safety.safety_mode not in (SafetyMode.NORMAL, SafetyMode.REDUCED)
    protective = robot.safety.safety_mode in (SafetyMode.PROTECTIVE_STOP, SafetyMode.SAFEGUARD_STOP)
    yield packed(
        0,
        "Q7?BB3dB",
        round(robot.timestamp * _MICROSECONDS),
        *(
            True,
            True,
            robot.safety.robot_mode >= RobotMode.POWER_ON,
            stopped and not protective,
            protective,
            robot.playing,
        ),
        robot.runtime_state in (RuntimeState.PAUSED, RuntimeState.PAUSING),
        *(max(robot.safety.robot_mode, 0), 0),
        *(*one("target_speed_fraction", "speed_scaling"), 1.0, 0),
    )
    yield packed(1, "3d4fB" * 6, *(get(name)[joint] for joint in range(6) for name in _OF_EACH_JOINT.split()))
    yield packed(4, "12d", *get("actual_TCP_pose"), *arm.tcp)
    yield packed(5, "6I24dI", *[0] * 6, *angles, *lengths, *distances, *twists, _CALIBRATED)
    yield 9, bytes(48)
    types = int(get("analog_io_types")[0])
    yield packed(
        3,
        "iiBBddBBddffffB??IB?B",
        *(*one("actual_digital_input_bits", "actual_digital_output_bits"), types & 1, types >> 1 & 1),
        *(*one("standard_analog_input0", "standard_analog_input1"), types >> 2 & 1, types >> 3 & 1),
        *one("standard_analog_output0", "standard_analog_output1", "tool_temperature"),
        *one("actual_robot_voltage", "actual_robot_current", "io_current"),
        *(robot.safety.safety_mode, robot.safety.safety_mode is SafetyMode.REDUCED, False, 0, 1, True, 0),
    )
    tool_types = int(get("tool_analog_input_types")[0])
    yield packed(
        2,
        "BBddfBffB",
        *(tool_types & 1, tool_types >> 1 & 1, *one("tool_analog_input0", "tool_analog_input1")),
        *one("actual_robot_voltage", "tool_output_voltage", "tool_output_current", "tool_temperature", "tool_mode"),
    )
    yield packed(
        6,
        "53d4i",
        *[-JOINT_LIMIT, JOINT_LIMIT] * 6,
        *(limit for speed in model.joint_speeds for limit in (speed, JOINT_ACCELERATION)),
        *(*_DEFAULT_SPEEDS, *lengths, *distances, *twists, *angles),
        *(_MASTERBOARD, _CONTROLLER_BOX, model.robot_type, _E_SERIES),
    )
    yield packed(7, "7d", *get("actual_TCP_force"), 0.0)
    yield packed(8, "4?", False, True, False, True)  # teach button: pressed, enabled; freedrive by an input
    yield 10, bytes(38)
    yield packed(11, "?iiiff", False, 115200, 0, 1, 1.5, 3.5)  # the tool's serial line, off
    yield packed(12, "3B", *one("tool_output_mode", "tool_digital_output0_mode", "tool_digital_output1_mode"))


def _robot_message(kind: int, body: bytes, timestamp: float, source: int = _FROM_INTERFACE) -> bytes:
    return _framed(_MESSAGE, struct.pack(">Qbb", round(timestamp * _MICROSECONDS), source, kind) + body)


def version_message(version: tuple[int, int, int, int], timestamp: float) -> bytes:
    """The message that every client of the primary and secondary interfaces receives first."""
    name = b"URControl"
    body = struct.pack(">B9sBBii", len(name), name, *version) + _BUILD_DATE
    return _robot_message(_VERSION_MESSAGE, body, timestamp)


def message(said: RobotMessage, timestamp: float) -> bytes:
    """A robot message of the primary interface; for a runtime exception it holds the line in its text, or −1."""
    text, source = said.text.encode(), _FROM_INTERFACE
    title = said.title.encode()[:255]
    match said.type:
        case MessageType.RUNTIME_EXCEPTION:
            named = re.search(r"\bline (\d{1,9})\b", said.text)
            head, source = struct.pack(">ii", int(named[1]) if named else -1, -1), _FROM_MACHINE
        case MessageType.PROGRAM_LABEL:
            head = struct.pack(">i", said.number & 0x7FFFFFFF)
        case MessageType.POPUP:
            head = struct.pack(">IB3?B", said.number, 0, said.warning, said.error, said.blocking, len(title)) + title
        case MessageType.KEY:
            head = struct.pack(">iiB", said.number, 0, len(title)) + title
        case MessageType.SAFETY_MODE:
            head = struct.pack(">iiBII", 0, 0, said.number, 0, 0)
        case MessageType.TEXT:
            head = b""
    return _robot_message(said.type, head + text, timestamp, source)
