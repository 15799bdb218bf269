"""Several clients, several cells, rates, versions and flags: the library's connections."""

import itertools
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from hardware_sim.controller.process import ControllerProcess
from tests.hardware_sim.controller.cells import HOME, Cell, send_script, start, wait_until
from tests.hardware_sim.controller.plain_client import PlainClient

NEAR = [q + 0.1 for q in HOME]


@pytest.fixture(scope="module")
def controller() -> Iterator[ControllerProcess]:
    """One controller for clients that come and go; what uses the shared cell comes last, for that cell takes a quarter
    of a core."""
    with start() as process:
        yield process


def test_packets_reach_three_clients_at_500_hz(controller: ControllerProcess) -> None:
    """Check 25, for two seconds."""
    rate(controller, 1000)


@pytest.mark.long
def test_packets_reach_three_clients_at_500_hz_for_ten_seconds(controller: ControllerProcess) -> None:
    """Check 25."""
    rate(controller, 5000)


def rate(controller: ControllerProcess, packets: int) -> None:
    with ExitStack() as stack:
        clients = [stack.enter_context(PlainClient(controller.address)) for _ in range(3)]
        for client in clients:
            client.outputs("timestamp,actual_q,actual_TCP_pose")
            client.request("S")
        stamps: list[list[int]] = [[], [], []]
        control = stack.enter_context(controller.control())

        def clock() -> tuple[float, float, float]:
            """The controller's time, and this machine's before and after it was read."""
            asked = time.monotonic()
            return control.state()["timestamp"], asked, time.monotonic()

        first, first_asked, first_read = clock()
        for _ in range(packets):
            for client, arrivals in zip(clients, stamps, strict=True):
                arrivals.append(round(client.sample()[0] / 0.002))

        def keeps_pace() -> bool:
            """The controller's clock has advanced as this machine's, within what reading both leaves open."""
            last, asked, read = clock()
            least, most = asked - first_read, read - first_asked
            return 0.99 * least - 0.1 <= last - first <= 1.01 * most + 0.1

        wait_until(keeps_pace)  # a controller that the machine has held up catches up
    for arrivals in stamps:
        assert {b - a for a, b in itertools.pairwise(arrivals)} == {1}


@pytest.mark.parametrize(("frequency", "steps"), [(125.0, {4}), (10.0, {50})])
def test_receive_frequency_matches_request(shared_cell: Cell, frequency: float, steps: set[int]) -> None:
    """Check 26."""
    import rtde_receive

    receive = rtde_receive.RTDEReceiveInterface(shared_cell.address, frequency, ["timestamp"])
    stamps: set[float] = set()
    wait_until(lambda: stamps.add(receive.getTimestamp()) or len(stamps) > 12)
    receive.disconnect()
    intervals = [round((b - a) / 0.002) for a, b in itertools.pairwise(sorted(stamps))]
    # The library keeps the newest packet only; a busy machine may skip some between two looks.
    assert min(intervals) in steps
    assert all(step % min(steps) == 0 for step in intervals)


def test_unknown_output_variable_is_named(shared_cell: Cell) -> None:
    """Check 27."""
    import rtde_receive

    with pytest.raises(RuntimeError, match="no_such_variable"):
        rtde_receive.RTDEReceiveInterface(shared_cell.address, 500.0, ["timestamp", "no_such_variable"])


def test_cells_two_at_once_run_independently() -> None:
    """Check 28."""
    import rtde_receive

    with start() as first, start(model="ur10e", home=NEAR) as second:
        readers = [rtde_receive.RTDEReceiveInterface(process.address) for process in (first, second)]
        assert readers[0].getActualQ() == pytest.approx(HOME)
        assert readers[1].getActualQ() == pytest.approx(NEAR)
        assert readers[0].getActualTCPPose() != pytest.approx(readers[1].getActualTCPPose(), abs=0.01)
        for reader in readers:
            reader.disconnect()


def test_client_killed_in_move_frees_inputs_and_arm_continues(controller: ControllerProcess) -> None:
    """Check 29."""
    import rtde_control

    code = """
import os, signal, sys, time
import rtde_control
control = rtde_control.RTDEControlInterface(sys.argv[1])
control.moveJ([1.0, -1.9, 1.9, -1.57, -1.57, 0.0], 0.1, 1.0, True)
os.kill(os.getpid(), signal.SIGKILL)
"""
    result = subprocess.run(
        [sys.executable, "-c", code, controller.address], capture_output=True, timeout=90, check=False
    )
    assert result.returncode == -signal.SIGKILL
    with controller.control() as truth:
        assert truth.state()["program_running"]
        wait_until(lambda: truth.state()["joint_speeds"][0] > 0.0)
        control = rtde_control.RTDEControlInterface(controller.address)
        assert control.isProgramRunning()
        control.disconnect()
        wait_until(lambda: truth.state()["joint_speeds"][0] == 0.0)
        assert truth.state()["joints"][0] < 1.0
        # A client that disconnects leaves its program running.
        assert truth.state()["program_running"]


def test_new_client_replaces_previous_program(controller: ControllerProcess) -> None:
    """Failure: an old control program still runs."""
    import rtde_control
    import rtde_io

    rtde_control.RTDEControlInterface(controller.address).disconnect()
    rtde_io.RTDEIOInterface(controller.address).disconnect()
    with controller.control() as truth:
        assert truth.state()["program_running"]
        before = len(truth.log())
        control = rtde_control.RTDEControlInterface(controller.address)
        assert control.moveJ(NEAR, 3.0, 20.0)
        assert any("program rtde_control started" in line for line in truth.log()[before:])
        control.disconnect()
        rtde_io.RTDEIOInterface(controller.address).disconnect()


def test_upper_register_range_leaves_lower_free() -> None:
    import rtde_control
    import rtde_io

    with ExitStack() as stack:
        controller = stack.enter_context(start())
        io = rtde_io.RTDEIOInterface(controller.address)
        stack.callback(io.disconnect)
        interface = rtde_control.RTDEControlInterface
        flags = interface.FLAG_UPLOAD_SCRIPT | interface.FLAG_UPPER_RANGE_REGISTERS
        control = interface(controller.address, 500.0, flags)
        stack.callback(control.disconnect)
        assert control.moveJ(NEAR, 3.0, 20.0)
        assert control.getTCPOffset() == [0.0] * 6
        plain = stack.enter_context(PlainClient(controller.address))
        assert plain.inputs("input_int_register_0,input_double_register_0")[0] == 1
        assert plain.inputs("input_int_register_24") == (0, ["IN_USE"])
        with controller.control() as truth:
            assert truth.state()["joints"] == pytest.approx(NEAR, abs=1e-6)


@pytest.mark.long
def test_local_control_refuses_programs_despite_flag() -> None:
    """The flag that turns the check off alone also turns the upload off: the library wants them together."""
    import rtde_control

    interface = rtde_control.RTDEControlInterface
    with start() as controller, controller.control() as truth:
        truth.fault("local_mode")
        flags = interface.FLAG_UPLOAD_SCRIPT | interface.FLAG_DISABLE_REMOTE_CONTROL_CHECK
        with pytest.raises(RuntimeError, match="Failed to start control script"):
            interface(controller.address, 500.0, flags)
        assert any("local control" in line for line in truth.log())
        assert not truth.state()["program_running"]


def test_rtde_and_dashboard_versions_agree(shared_cell: Cell) -> None:
    with PlainClient(shared_cell.address) as plain:
        version = ".".join(map(str, struct.unpack(">4I", plain.request("v"))))
    assert version in shared_cell.dashboard.polyscopeVersion()


def test_speed_factor_shortens_moves_only() -> None:
    with start(speed=8.0) as process, process.control() as truth:
        program = (
            "def f():\n movej([1.0,-1.9,1.9,-1.57,-1.57,0], a=1.4, v=1.05)\n write_output_integer_register(0, 1)\nend\n"
        )
        with PlainClient(process.address) as plain:
            plain.outputs("timestamp,actual_qd,output_int_register_0")
            plain.request("S")
            send_script(process.address, program)
            samples = [plain.sample()]
            while not samples[-1][-1]:
                samples.append(plain.sample())
        moving = [sample[0] for sample in samples if any(sample[1:7])]
        assert moving[-1] - moving[0] == pytest.approx((1.0 / 1.05 + 1.05 / 1.4) / 8.0, abs=0.01)
        assert truth.state()["joints"][0] == 1.0
        assert {round(b[0] - a[0], 9) for a, b in itertools.pairwise(samples)} == {0.002}


def test_interfaces_connect_and_read_arm(cell: Cell) -> None:
    """Check 1; how fast they construct is in the benchmarks."""
    import script_client

    script = script_client.ScriptClient(cell.address, 5, 11)
    script.connect()
    assert all(client.isConnected() for client in (cell.control, cell.receive, cell.io, cell.dashboard, script))
    assert cell.control.isProgramRunning()
    assert cell.receive.getRobotStatus() == cell.control.getRobotStatus() == 0b1011
    assert script.sendScriptCommand("sec quick():\n  set_digital_out(6, True)\nend\n")
    wait_until(lambda: cell.receive.getDigitalOutState(6))
    script.disconnect()


def test_second_clients_are_refused(shared_cell: Cell) -> None:
    """Check 22; a new one after a disconnect is below."""
    import rtde_control
    import rtde_io

    for interface in (rtde_control.RTDEControlInterface, rtde_io.RTDEIOInterface):
        with pytest.raises(RuntimeError, match="already in use"):
            interface(shared_cell.address)
