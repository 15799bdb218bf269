"""RTDE against a plain client: recipes, types, owners, rates, invalid frames."""

import itertools
import math
import socket
import struct
from collections.abc import Iterator

import pytest

from hardware_sim.controller.process import ControllerProcess
from hardware_sim.controller.rtde import Level, text_frame
from tests.hardware_sim.controller.cells import HOME, send_script, start, wait_until
from tests.hardware_sim.controller.plain_client import PlainClient

# The protocol's own table for PolyScope 5.11, written down anew: the variables that the clients here know of.
OUTPUTS = {
    "VECTOR6D": """target_q target_qd target_qdd target_current target_moment actual_q actual_qd actual_current
        actual_current_window joint_control_output tcp_offset
        actual_TCP_pose actual_TCP_speed actual_TCP_force target_TCP_pose target_TCP_speed
        joint_temperatures actual_joint_voltage ft_raw_wrench payload_inertia""",
    "DOUBLE": """timestamp actual_execution_time speed_scaling target_speed_fraction actual_momentum actual_main_voltage
        actual_robot_voltage actual_robot_current standard_analog_input0 standard_analog_input1 standard_analog_output0
        standard_analog_output1 payload joint_position_deviation_ratio tcp_force_scalar io_current tool_temperature
        tool_analog_input0 tool_analog_input1 tool_output_current euromap67_24V_voltage euromap67_24V_current""",
    "UINT64": "actual_digital_input_bits actual_digital_output_bits",
    "UINT32": """runtime_state robot_status_bits safety_status_bits analog_io_types tool_mode tool_analog_input_types
        euromap67_input_bits euromap67_output_bits output_bit_registers0_to_31 output_bit_registers32_to_63
        input_bit_registers0_to_31 input_bit_registers32_to_63 script_control_line""",
    "INT32": "robot_mode safety_mode safety_status tool_output_voltage encoder0_raw encoder1_raw",
    "UINT8": "tool_output_mode tool_digital_output0_mode tool_digital_output1_mode",
    "VECTOR3D": "actual_tool_accelerometer payload_cog elbow_position elbow_velocity",
    "VECTOR6INT32": "joint_mode",
}
INPUTS = {
    "UINT32": "speed_slider_mask input_bit_registers0_to_31 input_bit_registers32_to_63",
    "DOUBLE": "speed_slider_fraction standard_analog_output_0 standard_analog_output_1",
    "UINT8": """standard_digital_output_mask standard_digital_output configurable_digital_output_mask
        configurable_digital_output tool_digital_output_mask tool_digital_output standard_analog_output_mask
        standard_analog_output_type""",
    "VECTOR6D": "external_force_torque",
}
REGISTERS = {
    "int_register": ("INT32", range(48)),
    "double_register": ("DOUBLE", range(48)),
    "bit_register": ("BOOL", range(64, 128)),
}
SIZES = {
    "UINT8": 1,
    "UINT32": 4,
    "INT32": 4,
    "UINT64": 8,
    "DOUBLE": 8,
    "VECTOR3D": 24,
    "VECTOR6INT32": 24,
    "VECTOR6D": 48,
}
RECORD = ",".join(name for names in OUTPUTS.values() for name in names.split())


@pytest.fixture(scope="module")
def controller() -> Iterator[ControllerProcess]:
    """One controller for all of these: clients that hang up leave nothing behind."""
    with start() as process:
        yield process


@pytest.fixture
def client(controller: ControllerProcess) -> Iterator[PlainClient]:
    """A client that has agreed on version 2."""
    with PlainClient(controller.address) as client:
        yield client


def test_rtde_reports_protocol_and_controller_version(controller: ControllerProcess) -> None:
    with PlainClient(controller.address, version=None) as client:
        agree(client)


def agree(client: PlainClient) -> None:
    assert client.request("V", struct.pack(">H", 1)) == b"\x00"
    assert client.request("V", b"") == b"\x00"
    # Set-ups are those of version 1 until version 2 is agreed upon: refused.
    assert client.request("O", struct.pack(">d", 500.0) + b"timestamp") == b"\x00"
    assert client.request("I", b"input_int_register_0") == b"\x00"
    assert client.request("V", struct.pack(">H", 2)) == b"\x01"
    assert struct.unpack(">4I", client.request("v")) == (5, 11, 1, 108318)


def test_rtde_outputs_have_documented_types_and_sizes(client: PlainClient) -> None:
    for kind, names in OUTPUTS.items():
        wanted = names.split()
        assert client.outputs(",".join(wanted)) == (1, [kind] * len(wanted))
    for stem, (kind, numbers) in REGISTERS.items():
        for direction in ("output", "input"):
            for part in (numbers[:24], numbers[24:48], numbers[48:]):
                wanted = [f"{direction}_{stem}_{n}" for n in part]
                if wanted:
                    assert client.outputs(",".join(wanted)) == (1, [kind] * len(wanted))
    # What came after 5.11 is not there yet, and registers end where they do.
    for later in ("actual_current_as_torque", "time_scale_source", "output_int_register_48", "output_bit_register_63"):
        assert client.outputs(later) == (0, ["NOT_FOUND"])


def test_rtde_inputs_have_documented_types(client: PlainClient) -> None:
    recipes = []
    for kind, names in INPUTS.items():
        wanted = names.split()
        recipe, types = client.inputs(",".join(wanted))
        assert types == [kind] * len(wanted)
        recipes.append(recipe)
    for stem, (kind, numbers) in REGISTERS.items():
        recipe, types = client.inputs(",".join(f"input_{stem}_{n}" for n in numbers))
        assert types == [kind] * len(numbers)
        recipes.append(recipe)
    assert recipes == [1, 2, 3, 4, 5, 6, 7]
    assert client.inputs("output_int_register_0") == (0, ["NOT_FOUND"])
    assert client.inputs("input_int_register_48,input_bit_register_63") == (0, ["NOT_FOUND", "NOT_FOUND"])


def test_rtde_recorder_recipe_streams_at_500_hz_without_gap(client: PlainClient) -> None:
    """Its packets are as long as their types say, and hold what they are named for."""
    recipe, types = client.outputs(RECORD)
    assert recipe == 1
    assert client.request("S") == b"\x01"
    kind, payload = client.receive()
    assert kind == "U"
    assert len(payload) == 1 + sum(SIZES[t] for t in types)
    assert payload[0] == 1
    client.request_between_packets("P")
    client.outputs("timestamp,actual_q,actual_TCP_pose,target_q,robot_mode,safety_mode,joint_mode,robot_status_bits")
    client.request("S")
    samples = [client.sample() for _ in range(250)]
    assert {round(b[0] - a[0], 9) for a, b in itertools.pairwise(samples)} == {0.002}
    joints, pose, target, modes = samples[0][1:7], samples[0][7:13], samples[0][13:19], samples[0][19:]
    assert joints == target == pytest.approx(HOME)
    assert all(map(math.isfinite, pose))
    assert modes == (7, 1, *[253] * 6, 0b1001)


def test_rtde_registers_of_both_ranges_pass_through_program(controller: ControllerProcess, client: PlainClient) -> None:
    numbers = (0, 23, 24, 47)
    bits = (3, 35, 64, 127)
    lines = [f"write_output_integer_register({n}, read_input_integer_register({n}))" for n in numbers]
    lines += [f"write_output_float_register({n}, read_input_float_register({n}))" for n in numbers]
    lines += [f"write_output_boolean_register({n}, read_input_boolean_register({n}))" for n in bits]
    low, high = "input_bit_registers0_to_31,input_bit_registers32_to_63", "input_bit_register_64,input_bit_register_127"
    ints, _ = client.inputs(",".join(f"input_int_register_{n}" for n in numbers))
    doubles, _ = client.inputs(",".join(f"input_double_register_{n}" for n in numbers))
    booleans, types = client.inputs(f"{low},{high}")
    assert types == ["UINT32", "UINT32", "BOOL", "BOOL"]
    listed = [f"output_{stem}_register_{n}" for stem in ("int", "double") for n in numbers]
    client.outputs(",".join([*listed, low.replace("input", "output"), high.replace("input", "output")]))
    client.request("S")
    for values in ((1, -2, 2**31 - 1, -(2**31)), (0, 0, 0, 0)):
        client.write(ints, *values)
        client.write(doubles, *(v + 0.5 for v in values))
        level = bool(values[0])
        client.write(booleans, level << 3, level << 3, level, level)
        send_script(controller.address, "def f():\n" + "".join(f"  {line}\n" for line in lines) + "end\n")
        wanted = (*values, *(v + 0.5 for v in values), level << 3, level << 3, level, level)
        wait_until(lambda wanted=wanted: client.sample() == wanted)


def test_rtde_text_messages_go_both_ways(controller: ControllerProcess, client: PlainClient) -> None:
    client.outputs("timestamp")
    client.say("a client's words", "a test", 2)
    client.send("M", b"")
    client.send("M", b"\xff\x00")
    client.send("M", b"\x00\x00")
    client.request("S")
    with PlainClient(controller.address) as silent:  # has not started: a text would come between request and reply
        send_script(controller.address, "def f():\n  sync()\n  get_mass_matrix()\nend\n")
        wait_until(lambda: client.sample() and client.texts)
        assert silent.request("v")
        assert silent.unread == b""
    ((words, source, level),) = client.texts
    assert words == "runtime exception in f: f, line 3: get_mass_matrix is not simulated by this controller"
    assert (source, level) == ("Controller", 0)


def test_rtde_intermediate_frequency_holds_on_average(client: PlainClient) -> None:
    for frequency, steps in ((125.0, {4}), (200.0, {2, 3}), (1e6, {1})):
        client.outputs("timestamp", frequency)
        client.request("S")
        stamps = [round(client.sample()[0] / 0.002) for _ in range(41)]
        client.request_between_packets("P")
        assert {b - a for a, b in itertools.pairwise(stamps)} == steps
        assert stamps[-1] - stamps[0] == pytest.approx(40 * 500.0 / min(frequency, 500.0), abs=1)
    for bad in (0.0, -1.0, math.nan):
        assert client.outputs("timestamp", bad)[0] == 0
    assert client.request("O", b"\x00\x01") == b"\x00"  # no room for a frequency


def test_rtde_name_list_over_2048_bytes_is_refused(client: PlainClient) -> None:
    names = "timestamp," * 204
    assert client.outputs(names)[0] == 1
    assert client.outputs(names + "payload,")[0] == 1  # 2048 bytes
    assert client.outputs(names + "payload,,")[0] == 0
    assert client.inputs("input_int_register_1," * 100)[0] == 0


def test_rtde_recipes_of_connection_end_at_255(client: PlainClient) -> None:
    assert [client.inputs("input_int_register_7")[0] for _ in range(256)] == [*range(1, 256), 0]


def test_rtde_pause_ends_stream_and_start_resumes(client: PlainClient) -> None:
    client.outputs("timestamp,", 10.0)
    client.request("S")
    first = client.sample()[0]
    assert client.sample()[0] - first == pytest.approx(0.1)
    assert client.request("P") == b"\x01"
    assert struct.unpack(">4I", client.request("v"))[0] == 5  # nothing comes between request and reply
    client.request("S")
    assert client.sample()[0] > first


def test_rtde_pause_without_recipe_is_answered(client: PlainClient) -> None:
    assert client.request("P") == b"\x01"


def test_rtde_unknown_names_are_refused(client: PlainClient) -> None:
    assert client.outputs("timestamp,nothing") == (0, ["DOUBLE", "NOT_FOUND"])
    assert client.inputs("input_int_register_0,nothing") == (0, ["INT32", "NOT_FOUND"])


def test_rtde_inputs_have_one_owner_until_disconnect(controller: ControllerProcess, client: PlainClient) -> None:
    assert client.inputs("input_int_register_0,input_double_register_3")[0] == 1
    assert client.inputs("input_int_register_0")[0] == 2  # its owner may list it again
    with PlainClient(controller.address) as other:
        assert other.inputs("input_int_register_0,input_int_register_1") == (0, ["IN_USE", "INT32"])
        assert other.inputs("input_int_register_1")[0] == 1  # nothing was taken by the refused set-up
        client.close()
        wait_until(lambda: other.inputs("input_int_register_0")[0])


def test_rtde_packet_applies_at_once_and_wrong_length_is_ignored(client: PlainClient) -> None:
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


def test_rtde_outputs_and_slider_follow_masks(client: PlainClient) -> None:
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


def test_rtde_client_that_does_not_read_delays_nobody(controller: ControllerProcess) -> None:
    with PlainClient(controller.address) as lazy, PlainClient(controller.address) as other:
        lazy.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        lazy.outputs(RECORD)
        lazy.request("S")
        other.outputs("timestamp")
        other.request("S")
        stamps = [other.sample()[0] for _ in range(600)]
    assert {round(b - a, 9) for a, b in itertools.pairwise(stamps)} == {0.002}


def test_rtde_stalled_port_is_silent_and_resumes(controller: ControllerProcess, client: PlainClient) -> None:
    client.outputs("timestamp")
    client.request("S")
    before = client.sample()[0]
    with controller.control() as faults:
        faults.fault("stall", port=30004, seconds=0.3)
    stamps = [before, *(client.sample()[0] for _ in range(200))]
    gaps = [b - a for a, b in itertools.pairwise(stamps)]
    assert max(gaps) == pytest.approx(0.3, abs=0.02)


def test_rtde_half_packet_and_time_jump_are_sent(controller: ControllerProcess, client: PlainClient) -> None:
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


def test_text_frame_long_text_ends_with_whole_character() -> None:
    frame = text_frame("a" + "é" * 200, Level.EXCEPTION)
    assert PlainClient.text(frame[3:]) == ("a" + "é" * 127, "Controller", 0)
