"""Primary, secondary and real-time interfaces against the published layouts, recorded messages, and commands."""

import itertools
import struct
from collections.abc import Iterator

import pytest

from hardware_sim.controller import streams
from hardware_sim.controller.controller import Controller
from hardware_sim.controller.dynamics import Dynamics
from hardware_sim.controller.kinematics import MODELS
from hardware_sim.controller.messages import MessageType, RobotMessage
from hardware_sim.controller.process import ControllerProcess
from tests.hardware_sim.controller.cells import start, wait_until
from tests.hardware_sim.controller.stream_client import REAL_TIME, RECORDED_SIZES, StreamClient, split, state, unpack

JOINTS = [0.1, -1.8, 1.7, -1.5, -1.4, 0.2]
MOVE = """def f():
  while True:
    movej([1.0, -1.9, 1.9, -1.57, -1.57, 0])
    movej([0, -1.9, 1.9, -1.57, -1.57, 0])
  end
end
"""


def controller() -> Controller:
    made = Controller(MODELS["ur5e"], JOINTS, now=0.0)
    made.arm.set_tcp([0.01, 0.02, 0.13, 0.1, 0.2, 0.3])
    made.arm.payload, made.arm.payload_center = 1.5, [0.0, 0.01, 0.05]
    made.outputs.set_bit(3, True)
    made.tool_changed()
    for tick in range(50):
        made.tick(tick * 0.002)
    Dynamics(made.arm, made.registers).publish(made.timestamp, brakes_open=True)
    return made


@pytest.fixture(scope="module")
def process() -> Iterator[ControllerProcess]:
    with start() as process:
        yield process


def test_robot_state_has_sub_packages_of_recorded_sizes() -> None:
    ((kind, body),) = split(streams.robot_state(controller()))
    assert kind == 16
    assert [(kind, 5 + len(content)) for kind, content in split(body)] == RECORDED_SIZES
    assert 5 + len(body) == 1386


def test_robot_state_fields_are_those_of_the_manual() -> None:
    made = controller()
    ((_, body),) = split(streams.robot_state(made))
    parts = state(body)
    mode = parts[0]
    assert (mode["timestamp"], mode["robot_mode"], mode["speed_fraction_limit"]) == (100_000, 7, 1.0)
    assert [mode[k] for k in ("connected", "enabled", "power_on")] == [True] * 3
    assert not any(mode[k] for k in ("emergency_stopped", "protective_stopped", "program_running", "program_paused"))
    assert [parts[1][f"q{i}"] for i in range(6)] == JOINTS == [parts[1][f"target{i}"] for i in range(6)]
    assert [parts[1][f"mode{i}"] for i in range(6)] == [253] * 6
    assert parts[1]["current1"] == pytest.approx(made.registers.get("actual_current")[1], rel=1e-6)
    assert parts[4]["tool"] == list(made.registers.get("actual_TCP_pose"))
    assert parts[4]["tcp_offset"] == [0.01, 0.02, 0.13, 0.1, 0.2, 0.3]
    assert parts[3]["outputs"] == 1 << 3
    assert (parts[3]["safety_mode"], parts[3]["robot_voltage"], parts[3]["euromap"]) == (1, 48.0, 0)
    assert parts[2]["mode"] == 253
    for part in (parts[5], parts[6]):
        assert part["a"] == [0, -0.425, -0.3922, 0, 0, 0]
        assert part["d"] == [0.1625, 0, 0, 0.1333, 0.0997, 0.0996]
        assert part["alpha"] == pytest.approx([1.570796327, 0, 0, 1.570796327, -1.570796327, 0])
        assert part["theta"] == [0.0] * 6
    assert (parts[6]["robot_type"], parts[6]["sub_type"]) == (1, 3)
    assert (parts[11]["baud_rate"], parts[11]["rx_idle"], parts[11]["tx_idle"]) == (115200, 1.5, 3.5)


def test_robot_state_short_mode_lacks_last_byte() -> None:
    made = controller()
    ((_, full),) = split(streams.robot_state(made))
    ((_, short),) = split(streams.robot_state(made, short_mode=True))
    (_, mode), *rest = split(full)
    assert list(split(short)) == [(0, mode[:-1]), *rest]


def test_real_time_packet_fields_are_those_of_the_manual() -> None:
    made = controller()
    data = streams.real_time_packet(made.registers)
    packet = unpack(REAL_TIME, data)
    assert packet["size"] == len(data) == 1220
    get = made.registers.get
    # The manual's offsets, counted by hand: after 31, 84, 116 and 142 doubles.
    assert struct.unpack_from(">6d", data, 4 + 8 * 31) == tuple(JOINTS)
    assert struct.unpack_from(">d", data, 4 + 8 * 94) == (7.0,)
    assert struct.unpack_from(">3d", data, 4 + 8 * 132) == tuple(get("elbow_position"))
    assert struct.unpack_from(">d", data, 4 + 8 * 142) == (1.5,)
    assert packet["time"] == pytest.approx(0.1)
    assert packet["m_target"] == list(get("target_moment")) != [0.0] * 6
    assert packet["i_control"] == packet["i_actual"] == list(get("actual_current"))
    assert packet["tool"] == packet["tool_target"] == list(get("actual_TCP_pose"))
    assert packet["joint_modes"] == [253.0] * 6
    assert (packet["outputs"], packet["safety_mode"], packet["safety_status"], packet["program_state"]) == (8, 1, 1, 1)
    assert packet["center"] == [0.0, 0.01, 0.05]
    assert packet["joint_voltages"] == [48.0] * 6


@pytest.mark.parametrize(
    ("said", "recorded"),
    [
        (
            RobotMessage(MessageType.KEY, "textmsg", "PROGRAM_XXX_STARTED"),
            "00000032140000000000000000fe07" + "00" * 8 + "1350524f4752414d5f5858585f53544152544544746578746d7367",
        ),
        (
            RobotMessage(MessageType.RUNTIME_EXCEPTION, "line 3: x"),
            "0000002014" + "00" * 8 + "fd0a00000003ffffffff" + b"line 3: x".hex(),
        ),
        (RobotMessage(MessageType.TEXT, "hello"), "0000001414" + "00" * 8 + "fe00" + b"hello".hex()),
        (
            RobotMessage(MessageType.POPUP, "b", "Title", warning=True, blocking=True),
            "0000001e14" + "00" * 8 + "fe02" + "00000000" + "00" + "010001" + "05" + b"Titleb".hex(),
        ),
        (RobotMessage(MessageType.PROGRAM_LABEL, "a", number=7), "0000001414" + "00" * 8 + "fe01" + "00000007" + "61"),
        (
            RobotMessage(MessageType.SAFETY_MODE, "", number=3),
            "0000002014" + "00" * 8 + "fe05" + "00" * 8 + "03" + "00" * 8,
        ),
    ],
)
def test_message_has_the_published_bytes(said: RobotMessage, recorded: str) -> None:
    """The first is a recorded one: `KEY_MESSAGE` of UR's client library."""
    assert streams.message(said, 0.0).hex() == recorded


def test_messages_extreme_values_still_fit() -> None:
    made = controller()
    made.arm.payload_center = [1e308, -1e308, 1e308]
    Dynamics(made.arm, made.registers).publish(made.timestamp, brakes_open=True)
    assert len(streams.robot_state(made)) == 1386
    assert len(streams.message(RobotMessage(MessageType.PROGRAM_LABEL, "a", number=10**30), 0.0)) == 20


def test_version_message_has_the_published_bytes() -> None:
    """Layout and source: `VERSION_MESSAGE` of UR's client library, with another version and date."""
    sent = streams.version_message((5, 11, 1, 108318), 0.0)
    assert sent.hex() == "0000003714" + "00" * 8 + "fe03" + "09" + b"URControl".hex() + "050b000000010001a71e" + (
        b"05-08-2021, 00:00:00".hex()
    )


@pytest.mark.parametrize("port", [30001, 30002, 30011, 30012])
def test_state_ports_send_version_then_states_at_10_hz(process: ControllerProcess, port: int) -> None:
    with StreamClient(process.address, port) as client:
        kind, body = client.message()
        assert (kind, body[9], body[11:20]) == (20, 3, b"URControl")
        times = [client.state()[0]["timestamp"] for _ in range(4)]
        assert [b - a for a, b in itertools.pairwise(times)] == [100_000] * 3


@pytest.mark.parametrize("port", [30003, 30013])
def test_real_time_ports_send_every_tick(process: ControllerProcess, port: int) -> None:
    with StreamClient(process.address, port) as client:
        times = [client.real_time()["time"] for _ in range(200)]
        assert times == pytest.approx([times[0] + 0.002 * n for n in range(200)])


def test_read_only_ports_drop_what_is_sent(process: ControllerProcess) -> None:
    with StreamClient(process.address, 30001) as primary:
        for port in (30011, 30012, 30013):
            with StreamClient(process.address, port) as client:
                client.send("power off\n" + MOVE)
        primary.send("def last():\n  textmsg(1)\nend\n")
        assert primary.robot_message(7).endswith(b"PROGRAM_XXX_STARTEDlast")
        mode = primary.state()[0]
        assert (mode["robot_mode"], mode["program_running"]) == (7, False)


def test_primary_port_says_what_programs_say(process: ControllerProcess) -> None:
    with StreamClient(process.address, 30001) as primary, StreamClient(process.address, 30002) as secondary:
        secondary.send('def talk():\n  textmsg("hello ", 5)\n  popup("look", "Title")\n  x = missing()\nend\n')
        assert primary.robot_message(10)[8:].find(b"missing") > 0  # refused: no such function
        secondary.send('def talk():\n  textmsg("hello ", 5)\n  popup("look", "Title")\n  x = [1]\n  y = x[3]\nend\n')
        assert primary.robot_message(7)[9:] == b"PROGRAM_XXX_STARTEDtalk"
        assert primary.robot_message(0) == b"hello 5"
        assert primary.robot_message(2)[8:] == b"\x05Titlelook"
        line, column = struct.unpack_from(">ii", primary.robot_message(10))
        assert (line, column) == (5, -1)
        assert primary.robot_message(7)[9:] == b"PROGRAM_XXX_STOPPEDtalk"
        kinds = [secondary.message()[0] for _ in range(4)]
        assert kinds == [20, 16, 16, 16], "the version, then only states"


def test_raw_commands_stop_power_off_and_release(process: ControllerProcess) -> None:
    with StreamClient(process.address, 30001) as primary, process.control() as control:
        primary.send(MOVE)
        wait_until(lambda: primary.state()[0]["program_running"])
        primary.send("stop program\n")
        wait_until(lambda: not primary.state()[0]["program_running"])
        primary.send("power off\n")
        wait_until(lambda: primary.state()[0]["robot_mode"] == 3)
        primary.send("  SET  robotmode run # as UR's client library\n")
        wait_until(lambda: primary.state()[0]["robot_mode"] == 4)
        control.fault("clear")


def test_raw_commands_in_local_control_are_refused(process: ControllerProcess) -> None:
    with process.control() as control, StreamClient(process.address, 30001) as primary:
        control.fault("local_mode")
        primary.send("power off\n")
        wait_until(lambda: any("power off: Command is not allowed" in line for line in control.log()))
        assert primary.state()[0]["robot_mode"] == 7
        control.fault("remote_mode")


def test_protective_stop_is_announced_and_unlock_is_understood(process: ControllerProcess) -> None:
    with process.control() as control, StreamClient(process.address, 30001) as primary:
        primary.state()
        control.fault("protective_stop")
        assert primary.robot_message(5)[8] == 3
        assert primary.state()[0]["protective_stopped"]
        primary.send("set unlock protective stop\n")
        wait_until(lambda: any("Cannot unlock protective stop until 5s" in line for line in control.log()))
        control.fault("clear")
        assert primary.robot_message(5)[8] == 1
