"""Safety, power, popups, local control and loaded programs, without sockets and with the real client."""

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from zipfile import ZipFile

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hardware_sim.controller import safety
from hardware_sim.controller.controller import Controller
from hardware_sim.controller.dashboard import answer
from hardware_sim.controller.kinematics import MODELS
from hardware_sim.controller.modes import RobotMode, SafetyMode
from hardware_sim.controller.safety import Safety
from tests.hardware_sim.controller.cells import HOME, Cell, connect, restart_program, start, wait_until

REFUSAL = (
    "Command is not allowed due to safety reasons, "
    "please switch robot to Remote Control mode and reconnect to port 29999"
)
SLOW = "def f():\n  sleep(60)\nend\n"


def controller(programs: Path | None = None) -> Controller:
    return Controller(MODELS["ur5e"], HOME, now=0.0, programs=programs)


def wait(machine: Controller, seconds: float) -> None:
    """Lets time pass."""
    for _ in range(round(seconds / 0.01)):
        machine.tick(machine.now + 0.01)


def test_power_on_takes_documented_steps_and_time() -> None:
    machine = controller()
    assert answer(machine, "power off", True) == "Powering off"
    assert machine.safety.robot_mode is RobotMode.POWER_OFF
    assert answer(machine, "POWER on", True) == "Powering on"
    assert machine.safety.robot_mode is RobotMode.POWER_ON
    wait(machine, safety.POWER_ON_SECONDS + 0.02)
    assert machine.safety.robot_mode is RobotMode.IDLE
    machine.load(SLOW)
    assert not machine.playing
    assert answer(machine, "brake release", True) == "Brake releasing"
    assert machine.safety.robot_mode is RobotMode.IDLE
    wait(machine, safety.BRAKE_SECONDS + 0.02)
    assert machine.safety.robot_mode is RobotMode.RUNNING
    machine.load(SLOW)
    assert machine.playing


def test_brake_release_powers_on_and_power_off_cancels_it() -> None:
    machine = controller()
    machine.power_off()
    machine.safety.release_brakes()
    wait(machine, safety.POWER_ON_SECONDS + safety.BRAKE_SECONDS + 0.05)
    assert machine.safety.robot_mode is RobotMode.RUNNING
    machine.power_off()
    machine.safety.release_brakes()
    wait(machine, safety.POWER_ON_SECONDS / 2)
    machine.power_off()
    wait(machine, 5.0)
    assert machine.safety.robot_mode is RobotMode.POWER_OFF


@pytest.mark.parametrize("mode", [SafetyMode.VIOLATION, SafetyMode.FAULT])
def test_restart_safety_is_needed_after_violation_and_fault(mode: SafetyMode) -> None:
    machine = controller()
    machine.emergency_stop("test", mode)
    for command in ("power on", "brake release", "unlock protective stop"):
        answer(machine, command, True)
        wait(machine, 3.0)
        assert (machine.safety.safety_mode, machine.safety.robot_mode) == (mode, RobotMode.POWER_OFF)
    assert answer(machine, "restart safety", True) == "Restarting safety"
    assert machine.safety.robot_mode is RobotMode.BOOTING
    answer(machine, "power on", True)
    wait(machine, safety.RESTART_SECONDS + 0.02)
    assert (machine.safety.safety_mode, machine.safety.robot_mode) == (SafetyMode.NORMAL, RobotMode.POWER_OFF)
    answer(machine, "brake release", True)
    wait(machine, safety.POWER_ON_SECONDS + safety.BRAKE_SECONDS + 0.05)
    assert machine.safety.may_run


def test_protective_stop_is_locked_for_five_seconds() -> None:
    machine = controller()
    machine.load(SLOW)
    machine.tick(0.01)
    machine.protective_stop("test")
    assert answer(machine, "programState", True) == "PAUSED f"
    wait(machine, 4.9)
    assert answer(machine, "unlock protective stop", True).startswith("Cannot unlock protective stop until 5s after")
    assert answer(machine, "play", True) == "Failed to execute: play"
    wait(machine, 0.2)
    assert answer(machine, "unlock protective stop", True) == "Protective stop releasing"
    assert answer(machine, "programState", True) == "PAUSED f"
    assert answer(machine, "play", True) == "Starting program"
    wait(machine, 0.02)
    assert machine.playing


def test_safeguard_stop_ends_on_release() -> None:
    machine = controller()
    machine.load(SLOW)
    machine.tick(0.01)
    machine.safeguard_stop("test")
    assert answer(machine, "safetystatus", True) == "Safetystatus: SAFEGUARD_STOP"
    assert answer(machine, "unlock protective stop", True).startswith("Cannot unlock")
    machine.safety.release_safeguard()
    assert machine.safety.may_run
    assert answer(machine, "play", True) == "Starting program"


def test_local_control_answers_queries_and_refuses_commands() -> None:
    machine = controller()
    machine.load(SLOW)
    machine.safety.remote_control = False
    for command in (
        "play", "pause", "stop", "load f.urp", "power on", "power off", "brake release", "unlock protective stop",
        "restart safety", "shutdown",
    ):  # fmt: skip
        assert answer(machine, command, False) == REFUSAL, command
    assert machine.playing
    machine.load("def other():\n  sleep(1)\nend\n")
    assert machine.program_name == "f"
    assert answer(machine, "robotmode", False) == "Robotmode: RUNNING"
    assert answer(machine, "popup careful", False) == "showing popup"
    assert machine.safety.popup == "careful"
    assert answer(machine, "close popup", False) == "closing popup"
    assert machine.safety.popup is None


def test_safety_popup_stays_until_closed_or_unlocked() -> None:
    machine = controller()
    machine.protective_stop("the reason")
    assert machine.safety.safety_popup == "PROTECTIVE_STOP: the reason"
    assert answer(machine, "close popup", True) == "closing popup"
    assert machine.safety.safety_popup is not None
    assert answer(machine, "close safety popup", True) == "closing safety popup"
    assert machine.safety.safety_popup is None
    assert machine.safety.safety_mode is SafetyMode.PROTECTIVE_STOP


def test_dashboard_loads_plays_pauses_and_stops_programs(tmp_path: Path) -> None:
    (tmp_path / "slow.urp").write_text(SLOW, encoding="utf-8")
    (tmp_path / "bad.urp").write_text("def f(:\n", encoding="utf-8")
    (tmp_path.parent / "outside.urp").write_text(SLOW, encoding="utf-8")
    machine = controller(tmp_path)
    assert answer(machine, "get loaded program", True) == "No program loaded"
    assert answer(machine, "isProgramSaved", True) == "false <unnamed>"
    assert answer(machine, "play", True) == "Failed to execute: play"
    for name in ("nope.urp", "../outside.urp", "slow", "/etc/passwd"):
        assert answer(machine, f"load {name}", True) == f"File not found: {name}"
    assert answer(machine, "load slow.urp", True) == "Loading program: slow.urp"
    assert answer(machine, "get loaded program", True) == "Loaded program: /programs/slow.urp"
    assert answer(machine, "isProgramSaved", True) == "true slow.urp"
    assert answer(machine, "programState", True) == "STOPPED slow.urp"
    assert answer(machine, "pause", True) == "Failed to execute: pause"
    for _ in range(2):
        assert answer(machine, "play", True) == "Starting program"
        wait(machine, 0.05)
        assert answer(machine, "running", True) == "Program running: true"
        assert answer(machine, "programState", True) == "PLAYING slow.urp"
        assert answer(machine, "pause", True) == "Pausing program"
        wait(machine, 0.5)
        assert answer(machine, "programState", True) == "PAUSED slow.urp"
        assert answer(machine, "play", True) == "Starting program"
        wait(machine, 0.05)
        assert answer(machine, "stop", True) == "Stopped"
        assert answer(machine, "programState", True) == "STOPPED slow.urp"
    assert answer(machine, "load bad.urp", True) == "Loading program: bad.urp"
    assert answer(machine, "play", True) == "Failed to execute: play"


def test_dashboard_loads_programs_and_installations_by_path(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "slow.urp").write_text(SLOW, encoding="utf-8")
    (tmp_path / "cell.installation").touch()
    machine = controller(tmp_path)
    for name in ("parts/slow.urp", "/programs/parts/slow.urp", "/ursim/programs/parts/slow.urp"):
        assert answer(machine, f"load {name}", True) == f"Loading program: {name}"
        assert answer(machine, "get loaded program", True) == "Loaded program: /programs/parts/slow.urp"
        assert answer(machine, "programState", True) == "STOPPED slow.urp"
    assert answer(machine, "load /programs/../slow.urp", True) == "File not found: /programs/../slow.urp"
    assert answer(machine, "play", True) == "Starting program"
    assert answer(machine, "load installation nope.installation", True) == "File not found: nope.installation"
    assert machine.playing
    assert answer(machine, "load installation cell.installation", False) == REFUSAL
    for name in ("cell.installation", "default.installation"):
        assert answer(machine, f"load installation {name}", True) == f"Loading installation: {name}"
    assert not machine.playing
    assert answer(machine, "get loaded program", True) == "Loaded program: /programs/parts/slow.urp"


def test_dashboard_modes_roles_and_reports_answer_as_published(tmp_path: Path) -> None:
    machine = controller(tmp_path)
    for said, reply in (
        ("getUserRole", "NONE"),
        ("setUserRole restricted", "Setting user role: restricted"),
        ("getUserRole", "RESTRICTED"),
        ("get operational mode", "NONE"),
        ("set operational mode manual", "Operational mode MANUAL is set"),
        ("get operational mode", "MANUAL"),
        ("clear operational mode", "No longer controlling the operational mode. Current operational mode: 'NONE'."),
        ("get operational mode", "NONE"),
        ("saveLog", "Log saved to disk"),
        ("addToLog", "No log message to add"),
        ("addToLog one line", "Added log message"),
        ("generate support file nowhere", "Error: no directory nowhere"),
    ):
        assert answer(machine, said, False) == reply
    for kind in ("", " controller", " software", " system"):
        assert answer(machine, f"generate flight report{kind}", False).startswith("Flight Report generated with id: ")
    done, name = answer(machine, "generate support file .", False).split(": ")
    assert done == "Completed successfully"
    with ZipFile(tmp_path / name) as archive:
        assert b"one line" in archive.read("log_history.txt")


@settings(max_examples=150, deadline=None)
@given(
    st.lists(
        st.sampled_from(
            ["stop", "guard", "emergency", "violation", "unlock", "release guard", "release button", "restart",
             "power on", "power off", "brakes", "boot", 0.3, 1.1, 5.2]
        ),
        max_size=30,
    )
)  # fmt: skip
def test_running_mode_needs_power_and_brake_release(story: list[str | float]) -> None:
    """Whatever happens: no unlocking, restart or wait powers the arm, and a stopped arm never may run."""
    state = Safety(0.0)
    now, asked = 0.0, True
    acts = {
        "stop": lambda: state.stop(SafetyMode.PROTECTIVE_STOP, ""),
        "guard": lambda: state.stop(SafetyMode.SAFEGUARD_STOP, ""),
        "emergency": lambda: state.emergency(SafetyMode.ROBOT_EMERGENCY_STOP, ""),
        "violation": lambda: state.emergency(SafetyMode.VIOLATION, ""),
        "unlock": state.unlock,
        "release guard": state.release_safeguard,
        "release button": state.release_emergency_stop,
        "restart": state.restart,
        "power on": state.power_on,
        "power off": state.power_off,
        "brakes": state.release_brakes,
        "boot": state.boot,
    }
    for act in story:
        before = state.robot_mode
        if isinstance(act, float):
            now += act
            state.tick(now)
        else:
            acts[act]()
            if act in ("emergency", "violation", "power off", "boot"):
                asked = False
            if act == "brakes":
                asked = True
        if before is not RobotMode.RUNNING and state.robot_mode is RobotMode.RUNNING:
            assert asked
        if state.safety_mode not in (SafetyMode.NORMAL, SafetyMode.REDUCED):
            assert not state.may_run
        if state.safety_mode in (SafetyMode.ROBOT_EMERGENCY_STOP, SafetyMode.VIOLATION):
            assert state.robot_mode in (RobotMode.POWER_OFF, RobotMode.BOOTING)


@pytest.fixture
def cell(tmp_path: Path) -> Iterator[Cell]:
    (tmp_path / "slow.urp").write_text(SLOW, encoding="utf-8")
    with ExitStack() as stack:
        yield connect(stack, programs=tmp_path)


def test_client_loads_and_plays_program_and_regains_arm(cell: Cell) -> None:
    board = cell.dashboard
    # The control connection hears of each change later than the dashboard, and would take an old program for the new
    # one: each change is waited for there before the next is asked for.
    board.loadURP("slow.urp")
    wait_until(lambda: not cell.control.isProgramRunning())
    assert board.getLoadedProgram() == "Loaded program: /programs/slow.urp"
    assert not board.isProgramSaved()  # the library looks for a capital letter that is never sent
    board.play()
    wait_until(cell.control.isProgramRunning)
    assert board.programState() == "PLAYING slow.urp"
    board.stop()
    wait_until(lambda: not cell.control.isProgramRunning())
    restart_program(cell)
    assert cell.control.moveJ([q + 0.05 for q in HOME], 3.0, 20.0)
    assert board.programState() == "PLAYING rtde_control"


def test_dashboard_opened_in_local_control_refuses_until_reconnect() -> None:
    import dashboard_client

    with start() as process, process.control() as control:
        control.fault("local_mode")
        board = dashboard_client.DashboardClient(process.address)
        board.connect()
        control.fault("remote_mode")
        assert board.isInRemoteControl()
        with pytest.raises(RuntimeError, match="reconnect to port 29999"):
            board.stop()
        board.disconnect()
        board.connect()
        board.stop()
        board.disconnect()


def test_shutdown_controller_is_gone_until_restart() -> None:
    import dashboard_client
    import rtde_receive

    with start() as process, process.control() as control:
        board = dashboard_client.DashboardClient(process.address)
        board.connect()
        board.shutdown()
        board.disconnect()
        wait_until(lambda: not _answers(process.address))
        with pytest.raises(RuntimeError, match="Could not connect to"):
            rtde_receive.RTDEReceiveInterface(process.address)
        control.fault("restart")
        wait_until(lambda: _answers(process.address))
        wait_until(lambda: control.state()["robot_mode"] == RobotMode.POWER_OFF)
        receive = rtde_receive.RTDEReceiveInterface(process.address)
        assert receive.getRobotMode() == RobotMode.POWER_OFF
        receive.disconnect()


def _answers(address: str) -> bool:
    import socket

    with socket.socket() as link:
        return link.connect_ex((address, 30004)) == 0
