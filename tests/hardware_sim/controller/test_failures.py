"""What the unmodified ur-rtde returns, raises and leaves behind when the controller fails.

Where the library may abort its process or block for minutes, the client is a process of its own.
"""

import subprocess
import sys
import textwrap
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from hardware_sim.controller.process import ControllerProcess
from tests.hardware_sim.controller.cells import HOME, Cell, at_home, restart_program, start, wait_until

FAR = [q + 1.0 for q in HOME]
NEAR = [q + 0.1 for q in HOME]
SPEED, ACCELERATION = 1.05, 1.4
PROTECTIVE_BITS, EMERGENCY_BITS = 1028, 1216


def run_client(code: str, address: str, seconds: float = 20.0) -> subprocess.CompletedProcess[str]:
    """Runs a client program in a process of its own; `address` is its first argument."""
    return subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code), address],
        capture_output=True,
        text=True,
        timeout=seconds,
        check=False,
        cwd=Path.cwd(),
    )


@pytest.fixture
def cell(shared_cell: Cell) -> Iterator[Cell]:
    """The shared cell at home; afterwards every fault and the program are taken away again."""
    at_home(shared_cell)
    yield shared_cell
    with shared_cell.process.control() as control:
        control.fault("clear")
        control.fault("program_stop")
    wait_until(lambda: not shared_cell.control.isProgramRunning())
    wait_until(lambda: shared_cell.receive.getActualQd() == [0.0] * 6)


def test_nobody_listens(controller: ControllerProcess) -> None:
    import rtde_receive

    controller.close()
    with pytest.raises(RuntimeError, match="Could not connect to"):
        rtde_receive.RTDEReceiveInterface(controller.address)


def test_local_control_refuses_clients_and_programs(controller: ControllerProcess) -> None:
    import rtde_control

    with controller.control() as faults:
        faults.fault("local_mode")
        with pytest.raises(RuntimeError, match="enable remote control"):
            rtde_control.RTDEControlInterface(controller.address)
        faults.fault("remote_mode")
        rtde_control.RTDEControlInterface(controller.address).disconnect()


def test_program_stopped_during_a_synchronous_move(cell: Cell) -> None:
    with cell.process.control() as faults:
        faults.fault("program_stop", at_s=0.3)
        assert not cell.control.moveJ(FAR, SPEED, ACCELERATION)
    wait_until(lambda: cell.receive.getActualQd() == [0.0] * 6)
    assert HOME[0] < cell.receive.getActualQ()[0] < FAR[0]
    wait_until(lambda: not cell.control.isProgramRunning())
    # Afterwards each call says no in its own way.
    assert not cell.control.moveJ(HOME, SPEED, ACCELERATION)
    assert not cell.control.setTcp([0.0] * 6)
    with pytest.raises(RuntimeError):
        cell.control.getTCPOffset()
    with pytest.raises(RuntimeError):
        cell.control.getForwardKinematics()
    assert cell.control.getInverseKinematics(cell.receive.getActualTCPPose()) == []
    assert not cell.control.isSteady()
    restart_program(cell)
    assert cell.control.moveJ(HOME, 3.0, 20.0)


def test_program_stopped_by_the_dashboard_during_an_asynchronous_move(cell: Cell) -> None:
    assert cell.io.setStandardDigitalOut(0, True)
    assert cell.io.setStandardDigitalOut(1, True)
    assert cell.control.moveJ(FAR, SPEED, ACCELERATION, True)
    wait_until(lambda: cell.receive.getActualQd()[0] > 0.5)
    cell.dashboard.stop()
    wait_until(lambda: not cell.control.isProgramRunning())
    wait_until(lambda: cell.receive.getActualQd() == [0.0] * 6)
    # The progress word stays at "running" for ever.
    assert cell.control.getAsyncOperationProgressEx().isAsyncOperationRunning()
    # The lamp's output goes low when no program runs, others keep their level.
    wait_until(lambda: cell.receive.getActualDigitalOutputBits() == 1 << 1)
    assert cell.io.setStandardDigitalOut(0, True)
    time.sleep(0.02)
    assert not cell.receive.getDigitalOutState(0)
    restart_program(cell)
    time.sleep(0.02)
    assert not cell.receive.getDigitalOutState(0)


def test_protective_stop_during_a_move_and_the_way_back(cell: Cell) -> None:
    with cell.process.control() as faults:
        faults.fault("protective_stop", at_s=0.3)
        assert not cell.control.moveJ(FAR, SPEED, ACCELERATION)
        wait_until(lambda: cell.receive.getSafetyStatusBits() == PROTECTIVE_BITS)
        stopped = time.monotonic()
        assert cell.receive.isProtectiveStopped()
        assert cell.receive.getSafetyMode() == 3
        assert cell.receive.getRobotMode() == 7
        assert cell.dashboard.safetystatus() == "Safetystatus: PROTECTIVE_STOP"
        assert cell.dashboard.programState() == "PAUSED rtde_control"
        wait_until(lambda: cell.receive.getActualQd() == [0.0] * 6)
        assert not cell.control.moveJ(HOME, SPEED, ACCELERATION)
        with pytest.raises(RuntimeError, match="until 5s after occurrence"):
            cell.dashboard.unlockProtectiveStop()
        # An upload during the stop says yes and does nothing.
        cell.control.reuploadScript()
        time.sleep(0.1)
        assert not cell.control.isProgramRunning()
        time.sleep(max(0.0, stopped + 5.1 - time.monotonic()))
        cell.dashboard.unlockProtectiveStop()
    wait_until(lambda: cell.receive.getSafetyStatusBits() == 1)
    assert not cell.control.moveJ(HOME, SPEED, ACCELERATION)
    restart_program(cell)
    assert cell.control.moveJ(HOME, 3.0, 20.0)


def test_protective_stop_asked_for_by_the_client(cell: Cell) -> None:
    assert not cell.control.triggerProtectiveStop()  # it works, and says no
    wait_until(cell.receive.isProtectiveStopped)


def test_emergency_stop_takes_the_power_and_the_program(cell: Cell) -> None:
    with cell.process.control() as faults:
        faults.fault("emergency_stop", at_s=0.3)
        assert not cell.control.moveJ(FAR, SPEED, ACCELERATION)
        wait_until(lambda: cell.receive.getSafetyStatusBits() == EMERGENCY_BITS)
        assert cell.receive.isEmergencyStopped()
        assert cell.receive.getRobotMode() == 3
        assert cell.receive.getRuntimeState() == 1
        assert cell.dashboard.safetystatus() == "Safetystatus: ROBOT_EMERGENCY_STOP"
        cell.dashboard.powerOn()
        assert cell.dashboard.robotmode() == "Robotmode: POWER_OFF"  # the button is still pressed
        faults.fault("release_emergency_stop")
    wait_until(lambda: cell.receive.getSafetyStatusBits() == 1)
    assert cell.dashboard.robotmode() == "Robotmode: POWER_OFF"
    cell.dashboard.powerOn()
    assert cell.dashboard.robotmode() == "Robotmode: IDLE"
    cell.control.reuploadScript()
    time.sleep(0.1)
    assert not cell.control.isProgramRunning()
    cell.dashboard.brakeRelease()
    assert cell.dashboard.robotmode() == "Robotmode: RUNNING"
    restart_program(cell)
    assert cell.control.moveJ(HOME, 3.0, 20.0)


def test_pose_without_solution_ends_the_program(cell: Cell) -> None:
    assert cell.control.getInverseKinematics([5.0, 0.0, 0.5, 0.0, 3.1, 0.0]) == []
    wait_until(lambda: not cell.control.isProgramRunning())
    with cell.process.control() as control:
        assert any("no solution" in line for line in control.log())


def test_refused_function_ends_the_program_and_is_named(cell: Cell) -> None:
    assert not cell.control.zeroFtSensor()
    wait_until(lambda: not cell.control.isProgramRunning())
    with cell.process.control() as control:
        assert any("zero_ftsensor is not simulated" in line for line in control.log())


def test_straight_move_out_of_reach_is_a_protective_stop(cell: Cell) -> None:
    pose = cell.receive.getActualTCPPose()
    assert not cell.control.moveL([pose[0], pose[1], pose[2] + 3.0, *pose[3:]])
    wait_until(cell.receive.isProtectiveStopped)


def test_watchdog_ends_a_synchronous_move(cell: Cell) -> None:
    assert cell.control.setWatchdog(10.0)
    before = cell.receive.getTimestamp()
    assert not cell.control.moveJ(FAR, SPEED, ACCELERATION)
    assert cell.receive.getTimestamp() - before < 0.5
    wait_until(lambda: cell.receive.getActualQd() == [0.0] * 6)


def test_foreign_program_takes_the_arm_until_it_ends(cell: Cell) -> None:
    import socket

    time.sleep(0.05)  # the script is ready for a command; else the library waits 4 s for that
    with socket.create_connection((cell.address, 30002)) as script:
        script.sendall(b"def foreign():\n  sleep(0.6)\nend\n")
        wait_until(lambda: cell.dashboard.programState() == "PLAYING foreign")
        assert cell.control.isProgramRunning()
        assert not cell.control.moveJ(HOME, SPEED, ACCELERATION)
    assert cell.dashboard.programState() == "STOPPED foreign"
    restart_program(cell)


def test_bad_program_is_refused_and_the_running_one_lives(cell: Cell) -> None:
    import socket

    with socket.create_connection((cell.address, 30002)) as script:
        script.sendall(b"def broken():\n  movej([0,0,\nend\n")
        script.sendall(b"def unknown():\n  no_such_function()\nend\n")
        script.sendall(b"def half():\n  sleep(10)\n")
    with cell.process.control() as control:
        wait_until(lambda: any("no_such_function" in line for line in control.log()))
    assert cell.control.isProgramRunning()
    assert cell.dashboard.programState() == "PLAYING rtde_control"


def test_output_that_is_stuck_does_not_follow(cell: Cell) -> None:
    with cell.process.control() as faults:
        faults.fault("output_stuck", output=2, level=False)
        assert cell.io.setStandardDigitalOut(2, True)
        time.sleep(0.03)
        assert not cell.receive.getDigitalOutState(2)
        faults.fault("output_stuck", output=2, level=None)
        wait_until(lambda: cell.receive.getDigitalOutState(2))


def test_arm_that_is_not_where_it_says(cell: Cell) -> None:
    with cell.process.control() as control:
        control.fault("joint_offset", offsets_rad=[0.01, 0, 0, 0, 0, 0])
        assert control.state()["joints"][0] == pytest.approx(HOME[0] + 0.01)
        assert cell.receive.getActualQ() == pytest.approx(HOME)


def test_link_cut_is_seen_by_the_receive_client(controller: ControllerProcess) -> None:
    result = run_client(
        """
        import sys, time
        import rtde_receive
        from hardware_sim.controller.control import ControlClient
        receive = rtde_receive.RTDEReceiveInterface(sys.argv[1])
        with ControlClient(sys.argv[1]) as control:
            control.fault("cut", port=30004)
        deadline = time.monotonic() + 3
        while receive.isConnected() and time.monotonic() < deadline:
            time.sleep(0.01)
        print("connected", receive.isConnected())
        print("again", receive.reconnect(), receive.getTimestamp() > 0)
        """,
        controller.address,
    )
    assert result.stdout.splitlines() == ["connected False", "again True True"], result.stderr


def test_controller_killed(controller: ControllerProcess) -> None:
    client = subprocess.Popen(
        [
            sys.executable,
            "-c",
            textwrap.dedent("""
            import os, sys, time
            import rtde_control, rtde_receive
            receive = rtde_receive.RTDEReceiveInterface(sys.argv[1])
            control = rtde_control.RTDEControlInterface(sys.argv[1])
            print("ready", flush=True)
            sys.stdin.readline()
            deadline = time.monotonic() + 6
            while (control.isConnected() or receive.isConnected()) and time.monotonic() < deadline:
                time.sleep(0.01)
            print(control.isConnected(), receive.isConnected(), control.isProgramRunning(), flush=True)
            os._exit(0)
            """),
            controller.address,
        ],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert client.stdout is not None
    assert client.stdout.readline() == "ready\n"
    controller.kill()
    output, _ = client.communicate("\n", timeout=15)
    # Only isConnected tells: the program is said to run for ever.
    assert output.splitlines()[-1] == "False False True"


def test_controller_ends_with_its_parent() -> None:
    code = """
    import os, sys
    from tests.hardware_sim.controller.cells import start
    process = start()
    print(process.address, process.process.pid, flush=True)
    os._exit(1)
    """
    result = run_client(code, "")
    address, number = result.stdout.split()
    wait_until(lambda: not Path(f"/proc/{number}").exists() or _is_zombie(int(number)))
    with start() as other:  # the machine still serves
        assert other.address != ""
    assert address.startswith("127.0.1.")


def _is_zombie(number: int) -> bool:
    return Path(f"/proc/{number}/stat").read_text().rsplit(")", 1)[1].split()[0] == "Z"


@pytest.mark.long
def test_frozen_controller_makes_the_library_reconnect(controller: ControllerProcess) -> None:
    import signal

    client = subprocess.Popen(
        [
            sys.executable,
            "-c",
            textwrap.dedent("""
            import os, sys
            import rtde_control, rtde_receive
            receive = rtde_receive.RTDEReceiveInterface(sys.argv[1])
            control = rtde_control.RTDEControlInterface(sys.argv[1])
            print("ready", flush=True)
            print(control.moveJ([2.0, -1.9, 1.9, -1.57, -1.57, 0.0], 0.4, 1.0), flush=True)
            print(receive.isConnected(), control.isConnected(), flush=True)
            os._exit(0)
            """),
            controller.address,
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert client.stdout is not None
    assert client.stdout.readline() == "ready\n"
    time.sleep(0.5)
    controller.process.send_signal(signal.SIGSTOP)
    time.sleep(4.0)
    controller.process.send_signal(signal.SIGCONT)
    output, _ = client.communicate(timeout=20)
    moved, connected = output.splitlines()[-2:]
    assert moved == "False"
    assert connected.startswith("False")
