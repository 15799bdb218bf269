"""The library's dashboard client: every method, and the power cycle from off to running and back."""

from typing import Any

import pytest

from hardware_sim.controller.process import ControllerProcess
from tests.hardware_sim.controller.cells import HOME, Cell, restart_program, wait_until


class Noted:
    """A client that notes which of its methods were called."""

    def __init__(self, client: Any) -> None:
        self.used: set[str] = set()
        self._client = client

    def __getattr__(self, name: str) -> Any:
        self.used.add(name)
        return getattr(self._client, name)


def test_dashboard_client_methods_get_valid_replies(cell: Cell) -> None:
    """Check 30."""
    import dashboard_client

    board = Noted(dashboard_client.DashboardClient(cell.address))
    assert not board.isConnected()
    board.connect()
    assert board.isConnected()
    assert "5.11.1.108318" in board.polyscopeVersion()
    assert board.getSerialNumber().isdigit()
    assert board.isInRemoteControl()
    assert board.running()
    assert board.programState() == "PLAYING rtde_control"
    assert board.robotmode() == "Robotmode: RUNNING"
    assert board.safetymode() == "Safetymode: NORMAL"
    assert board.safetystatus() == "Safetystatus: NORMAL"
    assert board.getRobotModel() == "UR5"
    assert board.getLoadedProgram() == "No program loaded"
    assert not board.isProgramSaved()
    with pytest.raises(RuntimeError, match="File not found: nope"):
        board.loadURP("nope.urp")
    with pytest.raises(RuntimeError, match="Failed to execute: play"):
        board.play()
    with pytest.raises(RuntimeError, match="Unlock protective stop failure"):
        board.unlockProtectiveStop()
    board.popup("hello")
    board.closePopup()
    board.closeSafetyPopup()
    board.restartSafety()  # nothing to restart: nothing happens
    assert board.robotmode() == "Robotmode: RUNNING"
    board.addToLog("a line of the client")
    with cell.process.control() as control:
        assert any("a line of the client" in line for line in control.log())
    board.send("setUserRole restricted\n")
    assert board.receive() == "Setting user role: restricted"
    board.send("no such command\n")
    assert "no such command" in board.receive()
    board.pause()
    wait_until(lambda: board.programState() == "PAUSED rtde_control")
    board.play()
    wait_until(lambda: board.programState() == "PLAYING rtde_control")
    board.stop()
    assert board.programState() == "STOPPED rtde_control"
    assert not board.running()
    board.stop()  # "Stopped" also where nothing runs
    board.powerOff()
    assert board.robotmode() == "Robotmode: POWER_OFF"
    board.powerOn()
    wait_until(lambda: board.robotmode() == "Robotmode: IDLE")
    board.brakeRelease()
    wait_until(lambda: board.robotmode() == "Robotmode: RUNNING")
    board.quit()
    board.disconnect()
    with cell.process.control() as control:
        control.fault("local_mode")
    board.connect()
    board.shutdown()  # refused: the library does not look at the answer
    assert board.robotmode() == "Robotmode: RUNNING"
    board.disconnect()
    methods = {name for name in dir(dashboard_client.DashboardClient) if not name.startswith("_")}
    # Its argument is of a type that the library does not export.
    assert methods - board.used == {"setUserRole"}


def test_dashboard_client_power_cycle_returns_to_running(cell: Cell) -> None:
    board = cell.dashboard
    board.powerOff()
    wait_until(lambda: not cell.control.isProgramRunning())
    wait_until(lambda: (cell.receive.getRobotMode(), cell.receive.getSafetyMode()) == (3, 1))
    assert cell.receive.getJointMode() == [239] * 6
    assert not cell.control.moveJ(HOME, 1.0, 1.0)
    board.brakeRelease()  # powers on where needed
    assert board.robotmode() == "Robotmode: POWER_ON"
    wait_until(lambda: board.robotmode() == "Robotmode: RUNNING")
    board.powerOff()
    board.powerOn()
    wait_until(lambda: board.robotmode() == "Robotmode: IDLE")
    cell.control.reuploadScript()  # says True, and nothing starts while the brakes are closed
    before = cell.receive.getTimestamp()
    wait_until(lambda: cell.receive.getTimestamp() > before + 0.1)
    assert not cell.control.isProgramRunning()
    board.brakeRelease()
    wait_until(lambda: board.robotmode() == "Robotmode: RUNNING")
    restart_program(cell)
    wait_until(lambda: cell.receive.getJointMode() == [253] * 6)
    assert cell.control.moveJ([q + 0.05 for q in HOME], 3.0, 20.0)
    board.powerOff()
    wait_until(lambda: cell.receive.getRobotMode() == 3)


def test_dashboard_client_restart_safety_clears_violation_and_fault(cell: Cell) -> None:
    for kind, status, bit in (("violation", "VIOLATION", 8), ("fault", "FAULT", 9)):
        with cell.process.control() as control:
            control.fault("clear")
            control.fault(kind)
        wait_until(lambda bit=bit: cell.receive.getSafetyStatusBits() >> bit & 1)
        assert cell.dashboard.safetystatus() == f"Safetystatus: {status}"
        assert not cell.control.moveJ(HOME, 1.0, 1.0)
        cell.dashboard.powerOn()
        assert cell.dashboard.robotmode() == "Robotmode: POWER_OFF"
    cell.dashboard.restartSafety()
    assert cell.dashboard.safetystatus() == "Safetystatus: NORMAL"
    assert cell.dashboard.robotmode() == "Robotmode: BOOTING"
    wait_until(lambda: cell.dashboard.robotmode() == "Robotmode: POWER_OFF")
    cell.dashboard.brakeRelease()
    wait_until(lambda: cell.dashboard.robotmode() == "Robotmode: RUNNING")
    restart_program(cell)


def test_dashboard_client_pause_and_play_resume_move(cell: Cell) -> None:
    target = [q + 0.4 for q in HOME]
    assert cell.control.moveJ(target, 1.05, 1.4, True)
    wait_until(lambda: cell.receive.getActualQd()[0] > 0.5)
    cell.dashboard.pause()
    wait_until(lambda: cell.receive.getRuntimeState() == 4)
    wait_until(lambda: cell.receive.getActualQd() == [0.0] * 6)
    assert cell.dashboard.programState() == "PAUSED rtde_control"
    assert cell.receive.getActualQ()[0] < target[0] - 0.05
    cell.dashboard.play()
    wait_until(lambda: cell.receive.getActualQ() == pytest.approx(target, abs=1e-6))
    wait_until(lambda: not cell.control.getAsyncOperationProgressEx().isAsyncOperationRunning())


def test_dashboard_client_local_control_refuses_motion_commands(controller: ControllerProcess) -> None:
    import dashboard_client

    board = dashboard_client.DashboardClient(controller.address)
    board.connect()
    with controller.control() as control:
        control.fault("local_mode")
    assert not board.isInRemoteControl()
    assert board.robotmode() == "Robotmode: RUNNING"
    with pytest.raises(RuntimeError, match="switch robot to Remote Control"):
        board.play()
    with pytest.raises(RuntimeError, match="switch robot to Remote Control"):
        board.pause()
    board.powerOff()  # the library does not look at the answer
    assert board.robotmode() == "Robotmode: RUNNING"
    board.disconnect()
