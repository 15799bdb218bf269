"""What the unmodified ur-rtde returns, raises and leaves behind when arm, program or safety fail.

`test_failing_links` has what fails between library and controller.
"""

import math
import struct
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import pytest

from tests.hardware_sim.controller.cells import (
    HOME,
    Cell,
    at_home,
    fault_in_move,
    let_pass,
    restart_program,
    send_script,
    wait_until,
)
from tests.hardware_sim.controller.plain_client import PlainClient
from tests.hardware_sim.controller.stream_client import StreamClient

FAR = [HOME[0] + 2.5, *HOME[1:]]
SPEED, ACCELERATION = 1.05, 1.4
PROTECTIVE_BITS, EMERGENCY_BITS = 1028, 1216
STOPPED = 1  # a program's runtime state


@pytest.fixture
def cell(cell_cleared_afterwards: Cell) -> Cell:
    return cell_cleared_afterwards


def test_synchronous_move_program_stopped_returns_false(cell: Cell) -> None:
    """Failure: the program is stopped in a synchronous move, and what each call says afterwards."""
    with fault_in_move(cell, "program_stop"):
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
    assert cell.control.stopJ(2.0) is None
    restart_program(cell)
    assert cell.control.moveJ(HOME, 3.0, 20.0)


def test_asynchronous_move_dashboard_stop_ends_program(cell: Cell) -> None:
    """Failure: the program is stopped in an asynchronous move."""
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
    let_pass(cell.receive, 0.1)
    assert not cell.receive.getDigitalOutState(0)
    restart_program(cell)
    let_pass(cell.receive, 0.1)
    assert not cell.receive.getDigitalOutState(0)


def test_move_protective_stop_returns_false_until_recovery(cell: Cell) -> None:
    """Failure: protective stop in a synchronous move; unlocking too early; uploads during it; after it."""
    with fault_in_move(cell, "protective_stop"):
        assert not cell.control.moveJ(FAR, SPEED, ACCELERATION)
    wait_until(lambda: cell.receive.getSafetyStatusBits() == PROTECTIVE_BITS)
    stopped = cell.receive.getTimestamp()
    assert cell.receive.isProtectiveStopped()
    assert cell.receive.getSafetyMode() == 3
    assert cell.receive.getRobotMode() == 7
    assert cell.dashboard.safetystatus() == "Safetystatus: PROTECTIVE_STOP"
    assert cell.dashboard.programState() == "PAUSED rtde_control"
    wait_until(lambda: cell.receive.getActualQd() == [0.0] * 6)
    with pytest.raises(RuntimeError, match="until 5s after occurrence"):
        cell.dashboard.unlockProtectiveStop()
    assert not cell.control.moveJ(HOME, SPEED, ACCELERATION)
    # An upload during the stop says yes and does nothing.
    cell.control.reuploadScript()
    let_pass(cell.receive, 0.1)
    assert not cell.control.isProgramRunning()
    wait_until(lambda: cell.receive.getTimestamp() > stopped + 5.1)
    cell.dashboard.unlockProtectiveStop()
    wait_until(lambda: cell.receive.getSafetyStatusBits() == 1)
    assert not cell.control.moveJ(HOME, SPEED, ACCELERATION)
    restart_program(cell)
    assert cell.control.moveJ(HOME, 3.0, 20.0)


def test_trigger_protective_stop_returns_false(cell: Cell) -> None:
    """Failure: triggerProtectiveStop."""
    assert not cell.control.triggerProtectiveStop()  # it works, and says no
    wait_until(cell.receive.isProtectiveStopped)


def test_emergency_stop_removes_power_and_program(cell: Cell) -> None:
    """Failure: emergency stop in a synchronous move."""
    with fault_in_move(cell, "emergency_stop"):
        assert not cell.control.moveJ(FAR, SPEED, ACCELERATION)
    with cell.process.control() as faults:
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
    wait_until(lambda: cell.dashboard.robotmode() == "Robotmode: IDLE")
    cell.control.reuploadScript()
    let_pass(cell.receive, 0.1)
    assert not cell.control.isProgramRunning()
    cell.dashboard.brakeRelease()
    wait_until(lambda: cell.dashboard.robotmode() == "Robotmode: RUNNING")
    restart_program(cell)
    assert cell.control.moveJ(HOME, 3.0, 20.0)


def test_pose_without_solution_ends_program(cell: Cell) -> None:
    """Check 9. Failure: inverse kinematics without solution."""
    nowhere = [5.0, 0.0, 0.5, 0.0, 3.1, 0.0]
    for call, answer in ((cell.control.getInverseKinematics, []), (cell.control.moveJ_IK, False)):
        assert call(nowhere) == answer
        wait_until(lambda: not cell.control.isProgramRunning())
        with cell.process.control() as control:
            assert "no solution" in control.log()[-1]
        restart_program(cell)


REFUSED = {
    "ftRtdeInputEnable": ("ft_rtde_input_enable", False, (True,)),
    "enableExternalFtSensor": ("enable_external_ft_sensor", False, (True,)),
    # These are sent and forgotten by the library: it says that they worked.
    "forceMode": ("force_mode: type 1", True, ([0.0] * 6, [0] * 6, [0.0] * 6, 1, [1.0] * 6)),
    "servoC": ("servoc", True, ([0.3, -0.3, 0.3, 0.0, 3.1, 0.0],)),
}


@pytest.mark.parametrize("method", REFUSED)
def test_unsupported_function_ends_program_and_is_named(cell: Cell, method: str) -> None:
    """Failure: a function that is not simulated; its name and line reach the log and every RTDE client."""
    name, answer, arguments = REFUSED[method]
    with PlainClient(cell.address) as listener:
        listener.outputs("timestamp")
        listener.request("S")
        assert getattr(cell.control, method)(*arguments) is answer
        wait_until(lambda: not cell.control.isProgramRunning())
        wait_until(lambda: listener.sample() and listener.texts)
        ((words, source, level),) = listener.texts
    assert f"{name} is not simulated by this controller" in words
    assert "line" in words
    assert (source, level) == ("Controller", 0)
    with cell.process.control() as control:
        assert control.log()[-1].endswith(words)
    # What was sent and forgotten is still asked for; the next call that fails takes it back.
    assert not cell.control.setTcp([0.0] * 6)


def test_movel_out_of_reach_causes_protective_stop(cell: Cell) -> None:
    pose = cell.receive.getActualTCPPose()
    assert not cell.control.moveL([pose[0], pose[1], pose[2] + 3.0, *pose[3:]])
    wait_until(cell.receive.isProtectiveStopped)


def test_watchdog_ends_synchronous_move(cell: Cell) -> None:
    """Failure: a watchdog and a synchronous move; timed by the controller's clock, tick by tick."""
    with PlainClient(cell.address) as every_tick:
        every_tick.outputs("timestamp,runtime_state")
        every_tick.request("S")
        assert cell.control.setWatchdog(10.0)
        before = cell.receive.getTimestamp()
        assert not cell.control.moveJ(FAR, SPEED, ACCELERATION)
        wait_until(lambda: not cell.control.isProgramRunning())
        samples = [every_tick.sample()]
        while samples[-1][1] != STOPPED:
            samples.append(every_tick.sample())
    assert samples[-1][0] - before < 0.5
    wait_until(lambda: cell.receive.getActualQd() == [0.0] * 6)


def test_foreign_program_holds_arm_until_its_end(cell: Cell) -> None:
    """Failure: a foreign program."""
    import socket

    let_pass(cell.receive, 0.05)  # the script is ready for a command; else the library waits 4 s for that
    with socket.create_connection((cell.address, 30002)) as script:
        script.sendall(b"def foreign():\n  sleep(3)\nend\n")
        wait_until(lambda: cell.dashboard.programState() == "PLAYING foreign")
        assert cell.control.isProgramRunning()
        assert not cell.control.moveJ(HOME, SPEED, ACCELERATION)
    assert cell.dashboard.programState() == "STOPPED foreign"
    restart_program(cell)


def test_foreign_program_in_move_stops_it_and_blocks_caller(cell: Cell) -> None:
    """Failure: a foreign program in a synchronous move."""
    with ThreadPoolExecutor(1) as pool:
        foreign = "def foreign():\n  sleep(0.5)\n  write_output_integer_register(30, 7)\nend\n"

        def send() -> float:
            wait_until(lambda: cell.receive.getActualQd()[0] > 0.3)
            before = cell.receive.getTimestamp()
            send_script(cell.address, foreign)
            return before

        sent = pool.submit(send)
        assert not cell.control.moveJ(FAR, SPEED, ACCELERATION)
        ended = cell.receive.getTimestamp()
    assert 0.5 < ended - sent.result() < 20.0, "as long as the foreign program, far from the library's limit of a move"
    assert cell.dashboard.programState() == "STOPPED foreign"
    assert HOME[0] < cell.receive.getActualQ()[0] < FAR[0]


def test_asynchronous_move_protective_stop_keeps_progress_running(cell: Cell) -> None:
    """Failure: protective stop in an asynchronous move."""
    assert cell.control.moveJ(FAR, SPEED, ACCELERATION, True)
    wait_until(lambda: cell.receive.getActualQd()[0] > 0.5)
    with cell.process.control() as faults:
        faults.fault("protective_stop")
    wait_until(cell.receive.isProtectiveStopped)
    wait_until(lambda: cell.receive.getActualQd() == [0.0] * 6)
    assert cell.control.getAsyncOperationProgressEx().isAsyncOperationRunning()
    # The control client has no such question; the receive client and the dashboard have.
    assert not hasattr(cell.control, "isProtectiveStopped")


def test_upload_returns_before_program_runs(cell: Cell) -> None:
    """Failure: reuploadScript and a move right after it."""
    for _ in range(3):
        assert cell.control.reuploadScript()
        assert not cell.control.moveJ(HOME, SPEED, ACCELERATION)
        wait_until(cell.control.isProgramRunning)
    assert cell.control.moveJ(HOME, SPEED, ACCELERATION)


def test_values_out_of_range_raise_in_library(cell: Cell) -> None:
    """Failure: bad speeds and accelerations."""
    pose = cell.receive.getActualTCPPose()
    for call, values in (
        (cell.control.moveJ, (HOME, 3.2, 1.0)),
        (cell.control.moveJ, (HOME, 1.0, 41.0)),
        (cell.control.moveJ, (HOME, math.nan, 1.0)),
        (cell.control.moveL, (pose, 3.5, 1.0)),
        (cell.control.moveL, (pose, 0.1, 151.0)),
        (cell.control.servoJ, (HOME, 0.0, 0.0, 0.002, 0.01, 300)),
        (cell.control.servoJ, (HOME, 0.0, 0.0, 0.002, 0.1, 3000)),
        (cell.control.moveJ, ([[*HOME, 1.0, 1.0, 3.0]],)),
    ):
        with pytest.raises(ValueError, match="The value is"):
            call(*values)
    assert cell.control.isProgramRunning()


def test_stopl_and_stopj_use_unit_of_first_asynchronous_stop(cell: Cell) -> None:
    """stopL first runs stopj; once a stop was asynchronous, stopJ runs stopl, for the program's life."""
    restart_program(cell)

    def turned_while_stopping(stop: Callable[[], None]) -> float:
        at_home(cell)
        assert cell.control.moveJ([HOME[0] + 2.0, *HOME[1:]], 1.0, 5.0, True)
        wait_until(lambda: cell.receive.getActualQd()[0] == pytest.approx(1.0))
        before = cell.receive.getActualQ()[0]
        stop()
        wait_until(lambda: cell.receive.getActualQd() == [0.0] * 6)
        return cell.receive.getActualQ()[0] - before

    radius = math.hypot(*cell.receive.getActualTCPPose()[:2])
    turned = turned_while_stopping(lambda: cell.control.stopL(2.0))
    assert turned == pytest.approx(1.0 / (2 * 2.0), abs=0.05)  # 2 rad/s²
    turned_while_stopping(lambda: cell.control.stopJ(2.0, True))
    turned = turned_while_stopping(lambda: cell.control.stopJ(2.0))
    assert turned == pytest.approx(1.0 / (2 * 2.0 / radius), abs=0.05)  # 2 m/s² at the tool's radius


def test_invalid_program_is_refused_and_running_one_continues(cell: Cell) -> None:
    import socket

    with (
        PlainClient(cell.address) as listener,
        StreamClient(cell.address, 30001) as primary,
        socket.create_connection((cell.address, 30002)) as script,
    ):
        listener.outputs("timestamp")
        listener.request("S")
        assert primary.message()[0] == 20, "the version comes first"
        script.sendall(b"def broken():\n  movej([0,0,\nend\n")
        script.sendall(b"def unknown():\n  textmsg(1)\n  no_such_function()\nend\n")
        script.sendall(b"def half():\n  sleep(10)\n")
        wait_until(lambda: listener.sample() and len(listener.texts) == 2)
        assert "line 3" in listener.texts[1][0]
        assert "no_such_function" in listener.texts[1][0]
        assert listener.texts[1][1:] == ("Controller", 0)
        said = primary.robot_message(10)
        assert struct.unpack_from(">ii", said) == (3, -1)
        assert said[8:].decode() == listener.texts[0][0]
    with cell.process.control() as control:
        wait_until(lambda: any("no_such_function" in line for line in control.log()))
    assert cell.control.isProgramRunning()
    assert cell.dashboard.programState() == "PLAYING rtde_control"


def test_stuck_output_keeps_level(cell: Cell) -> None:
    with cell.process.control() as faults:
        faults.fault("output_stuck", output=2, level=False)
        assert cell.io.setStandardDigitalOut(2, True)
        let_pass(cell.receive, 0.1)
        assert not cell.receive.getDigitalOutState(2)
        faults.fault("output_stuck", output=2, level=None)
        wait_until(lambda: cell.receive.getDigitalOutState(2))


def test_joint_offset_shows_in_true_state_only(cell: Cell) -> None:
    with cell.process.control() as control:
        control.fault("joint_offset", offsets_rad=[0.01, 0, 0, 0, 0, 0])
        assert control.state()["joints"][0] == pytest.approx(HOME[0] + 0.01)
        assert cell.receive.getActualQ() == pytest.approx(HOME)
