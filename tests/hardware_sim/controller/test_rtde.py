"""RTDE as a plain client sees it: recipes, types, owners, rates, and what bad frames do."""

import itertools
import socket
import struct

import pytest

from hardware_sim.controller.process import ControllerProcess
from tests.hardware_sim.controller.cells import HOME, wait_until
from tests.hardware_sim.controller.plain_client import PlainClient

RECORD = (
    "timestamp,target_q,target_qd,target_qdd,target_current,target_moment,actual_q,actual_qd,actual_current,"
    "joint_control_output,actual_TCP_pose,actual_TCP_speed,actual_TCP_force,target_TCP_pose,target_TCP_speed,"
    "actual_digital_input_bits,joint_temperatures,actual_execution_time,robot_mode,joint_mode,safety_mode,"
    "safety_status,actual_tool_accelerometer,speed_scaling,target_speed_fraction,actual_momentum,actual_main_voltage,"
    "actual_robot_voltage,actual_robot_current,actual_joint_voltage,actual_digital_output_bits,runtime_state,"
    "standard_analog_input0,standard_analog_input1,standard_analog_output0,standard_analog_output1,"
    "robot_status_bits,safety_status_bits,payload,payload_cog,payload_inertia,joint_position_deviation_ratio"
)


@pytest.fixture
def client(controller: ControllerProcess) -> PlainClient:
    """A client that has agreed on version 2."""
    return PlainClient(controller.address)


def test_versions(controller: ControllerProcess) -> None:
    client = PlainClient(controller.address, version=None)
    assert client.request("V", struct.pack(">H", 1)) == b"\x00"
    assert client.request("V", b"") == b"\x00"
    # Set-ups are those of version 1 until version 2 is agreed upon: refused.
    assert client.request("O", struct.pack(">d", 500.0) + b"timestamp") == b"\x00"
    assert client.request("I", b"input_int_register_0") == b"\x00"
    assert client.request("V", struct.pack(">H", 2)) == b"\x01"
    assert struct.unpack(">4I", client.request("v")) == (5, 11, 1, 108318)


def test_every_variable_of_a_recorder_arrives_500_times_a_second_without_a_gap(client: PlainClient) -> None:
    recipe, types = client.outputs(RECORD)
    assert recipe == 1
    assert len(types) == RECORD.count(",") + 1
    assert "NOT_FOUND" not in types
    assert client.request("S") == b"\x01"
    samples = [client.sample() for _ in range(500)]
    steps = [round(b[0] - a[0], 9) for a, b in itertools.pairwise(samples)]
    assert set(steps) == {0.002}
    joints = samples[0][31:37]
    assert joints == pytest.approx(HOME)


def test_pause_ends_the_stream_and_start_resumes_it(client: PlainClient) -> None:
    client.outputs("timestamp,", 10.0)
    client.request("S")
    first = client.sample()[0]
    assert client.sample()[0] - first == pytest.approx(0.1)
    assert client.request("P") == b"\x01"
    assert struct.unpack(">4I", client.request("v"))[0] == 5  # nothing comes between request and reply
    client.request("S")
    assert client.sample()[0] > first


def test_pause_without_a_recipe_is_answered(client: PlainClient) -> None:
    assert client.request("P") == b"\x01"


def test_unknown_names_are_refused(client: PlainClient) -> None:
    assert client.outputs("timestamp,nothing") == (0, ["DOUBLE", "NOT_FOUND"])
    assert client.inputs("input_int_register_0,nothing") == (0, ["INT32", "NOT_FOUND"])


def test_inputs_have_one_owner_until_it_hangs_up(controller: ControllerProcess, client: PlainClient) -> None:
    assert client.inputs("input_int_register_0,input_double_register_3")[0] == 1
    assert client.inputs("input_int_register_0")[0] == 2  # its owner may list it again
    other = PlainClient(controller.address)
    assert other.inputs("input_int_register_0,input_int_register_1") == (0, ["IN_USE", "INT32"])
    assert other.inputs("input_int_register_1")[0] == 1  # nothing was taken by the refused set-up
    client.close()
    wait_until(lambda: other.inputs("input_int_register_0")[0])


def test_one_packet_is_applied_at_once_and_wrong_lengths_are_survived(client: PlainClient) -> None:
    client.outputs("timestamp,input_int_register_5,input_double_register_5")
    recipe, _ = client.inputs("input_int_register_5,input_double_register_5")
    client.request("S")
    client.write(recipe, 7, 2.5)

    def arrived(values: tuple[int, float]) -> None:
        wait_until(lambda: client.sample()[1:] == values)

    arrived((7, 2.5))
    client.send("U", struct.pack(">Bid", recipe, 8, 3.5) + b"more than the recipe holds")
    arrived((8, 3.5))
    client.send("U", struct.pack(">Bi", recipe, 9))  # too short: ignored
    client.send("U", struct.pack(">Bid", 77, 9, 9.5))  # no such recipe: ignored
    client.send("Z", b"unknown")
    client.write(recipe, 10, 4.5)
    arrived((10, 4.5))


def test_outputs_and_slider_obey_their_masks(client: PlainClient) -> None:
    client.outputs("actual_digital_output_bits,target_speed_fraction")
    digital, _ = client.inputs("standard_digital_output_mask,standard_digital_output")
    slider, _ = client.inputs("speed_slider_mask,speed_slider_fraction")
    client.request("S")
    client.write(digital, 0b0110, 0b1111)
    client.write(slider, 1, 0.25)
    wait_until(lambda: client.sample() == (0b0110, 0.25))
    client.write(digital, 0b0010, 0)
    client.write(slider, 0, 0.75)
    wait_until(lambda: client.sample() == (0b0100, 0.25))


def test_client_that_does_not_read_loses_packets_and_delays_nobody(controller: ControllerProcess) -> None:
    lazy = PlainClient(controller.address)
    lazy.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    lazy.outputs(RECORD)
    lazy.request("S")
    other = PlainClient(controller.address)
    other.outputs("timestamp")
    other.request("S")
    stamps = [other.sample()[0] for _ in range(600)]
    assert {round(b - a, 9) for a, b in itertools.pairwise(stamps)} == {0.002}


def test_stalled_port_is_silent_and_comes_back(controller: ControllerProcess, client: PlainClient) -> None:
    client.outputs("timestamp")
    client.request("S")
    before = client.sample()[0]
    with controller.control() as faults:
        faults.fault("stall", port=30004, seconds=0.3)
    stamps = [before, *(client.sample()[0] for _ in range(200))]
    gaps = [b - a for a, b in itertools.pairwise(stamps)]
    assert max(gaps) == pytest.approx(0.3, abs=0.02)


def test_half_a_packet_and_a_jump_in_time(controller: ControllerProcess, client: PlainClient) -> None:
    client.outputs("timestamp")
    client.request("S")
    with controller.control() as faults:
        before = client.sample()[0]
        faults.fault("time_jump", seconds=100.0)
        wait_until(lambda: client.sample()[0] > before + 100.0)
        faults.fault("half_packet")
    with pytest.raises(EOFError):
        wait_until(lambda: client.sample()[0] < 0.0)
    assert 0 < len(client.unread) < 12
