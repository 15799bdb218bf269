"""Every stop path stops a moving arm, by the simulator's record, and no motion resumes without a command.

The simulator's time stamps are compared, not this machine's clock: `STOPPED_WITHIN_S` is several times what is measured
on an idle machine and less than what is left of the move. It includes how late this process, on a busy machine, sees
that the arm rests; `test_ur_rest` measures the time itself, tick by tick.
"""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from acquisition.devices import StopToken
from acquisition.devices.ur.arm import UrArm
from acquisition.devices.ur.dashboard import Dashboard
from acquisition.devices.ur.lamp import UrLamp
from acquisition.models.errors import ErrorCode, Halted, RigError
from acquisition.runner.safety_monitor import SafetyMonitor
from acquisition.session import same_joints
from hardware_sim import real_time_controller
from hardware_sim.controller.control import ControlClient
from hardware_sim.controller.options import ControllerOptions
from tests.acquisition.devices.arm_scenes import (
    CELL,
    FAR,
    HOME,
    LIMITS,
    LOAD,
    NEAR,
    SERVICE_CODE,
    arm_config,
    connected,
    controller,
    moved,
    stays_at_rest,
    under_way,
    until_undisturbed,
    wait_for,
    wait_until_at_rest,
    wait_until_moving,
)

ADDRESS, LOST, SERVICE = "127.0.3.30", "127.0.3.32", "127.0.3.33"
STOPPED_WITHIN_S = 2.0
STOPPED, PLAYING = 1, 2


@pytest.fixture(scope="module")
def control() -> Generator[ControlClient]:
    """The controller of most tests; those with one of their own come first, so that it does not run beside them."""
    with controller(ADDRESS) as client:
        yield client


@pytest.fixture(scope="module")
def shared_arm(control: ControlClient) -> Generator[UrArm]:
    with connected(UrArm(arm_config(ADDRESS), CELL.lamp.output)) as arm:
        yield arm


@pytest.fixture
def arm(shared_arm: UrArm, control: ControlClient) -> UrArm:
    """The shared arm under control and at home, found again by an explicit connect, with its lamp on."""
    return made_ready(shared_arm, control)


def made_ready(arm: UrArm, control: ControlClient) -> UrArm:
    """Moves the arm home by hand, which ends its program; then connects it again."""
    if not same_joints(tuple(control.state()["joints"]), HOME):
        control.fault("program_stop")
        control.fault("hand_move", joints=list(HOME), seconds=0.0)
        control.fault("clear")
        wait_for(lambda: control.state()["runtime_state"] == STOPPED)
    until_undisturbed(arm.connect)
    wait_for(lambda: arm.reading.safety_bits == 1)  # the controller reports a cleared fault with its next packet
    moved(arm)
    UrLamp(arm, CELL.lamp).set(True)
    return arm


def assert_stopped(control: ControlClient, before: dict[str, Any]) -> dict[str, Any]:
    """The arm came to rest soon after `before`, short of its goal, with the lamp out; nothing moves again by itself."""
    rest = wait_until_at_rest(control)
    assert rest["timestamp"] - before["timestamp"] < STOPPED_WITHIN_S
    assert abs(rest["joints"][0] - FAR[0]) > 0.1, "the move ran to its end"
    wait_for(lambda: control.state()["digital_outputs"] == 0)
    assert stays_at_rest(control)
    return control.state()


@pytest.mark.parametrize(
    ("fault", "sentence"),
    [({"kind": "cut"}, "is closed|driver ended"), ({"kind": "stall", "seconds": 2.0}, "sends nothing|driver ended")],
)
def test_lost_link_during_move_stops_the_arm(fault: dict[str, Any], sentence: str) -> None:
    with controller(LOST) as control, connected(UrArm(arm_config(LOST), CELL.lamp.output)) as arm:
        made_ready(arm, control)
        journey, moving = under_way(arm, control)
        control.fault(port=30004, **fault)
        assert_stopped(control, moving)
        error = journey.end()
        assert isinstance(error, RigError)
        assert error.code in (ErrorCode.DEVICE_DISCONNECTED, ErrorCode.DRIVER_LOST, ErrorCode.ARM_MOVE_FAILED)
        wait_for(lambda: not arm.reading.connected)
        assert re.search(sentence, arm.reading.lost)
        wait_for(lambda: control.state()["runtime_state"] == STOPPED)
        assert stays_at_rest(control, 1.0)


def test_power_loss_of_controller_is_reported() -> None:
    with (
        real_time_controller.start(LOST, ControllerOptions(home=HOME)) as process,
        process.control() as control,
        connected(UrArm(arm_config(LOST), CELL.lamp.output)) as arm,
    ):
        made_ready(arm, control)
        journey, _ = under_way(arm, control)
        process.kill()
        error = journey.end()
        assert isinstance(error, RigError)
        assert error.code in (ErrorCode.DEVICE_DISCONNECTED, ErrorCode.DRIVER_LOST)
        wait_for(lambda: not arm.reading.connected)
        arm.halt()
        with pytest.raises(RigError) as caught:
            arm.connect()
        assert caught.value.code == ErrorCode.ARM_UNREACHABLE


@contextmanager
def service() -> Generator[tuple[subprocess.Popen[bytes], ControlClient]]:
    """A process of its own that moves the arm."""
    with controller(SERVICE) as control:
        code = SERVICE_CODE.format(address=SERVICE)
        root = Path(__file__).parents[3]
        process = subprocess.Popen([sys.executable, "-c", code], cwd=root, stderr=subprocess.PIPE)
        try:
            yield process, control
        finally:
            process.kill()
            process.communicate()


def test_killed_service_stops_the_arm() -> None:
    with service() as (process, control):
        moving = wait_until_moving(control)
        process.kill()
        assert_stopped(control, moving)
        wait_for(lambda: control.state()["runtime_state"] == STOPPED)  # the driver has gone, its kicks with it


def test_hanging_service_expired_lease_stops_the_arm() -> None:
    with service() as (process, control):
        moving = wait_until_moving(control)
        process.send_signal(signal.SIGSTOP)
        after = assert_stopped(control, moving)
        assert after["runtime_state"] == PLAYING, "the lease stopped the arm, not the watchdog"
        process.send_signal(signal.SIGCONT)
        _, stderr = process.communicate(timeout=90)
        assert b"stopped responding" in stderr
        assert stays_at_rest(control)


def test_halt_by_driver_alone_stops_the_arm(shared_arm: UrArm, control: ControlClient) -> None:
    shared_arm.close()
    with connected(UrArm(arm_config(ADDRESS), CELL.lamp.output, halt_by_program_stop=False)) as arm:
        made_ready(arm, control)
        journey, moving = under_way(arm, control)
        journey.stop.set()
        arm.halt()
        after = assert_stopped(control, moving)
        assert isinstance(journey.end(), Halted)
        assert after["runtime_state"] == PLAYING, "the driver's stop leaves the control program running"
        moved(arm, [NEAR])


def test_halt_by_dashboard_alone_stops_the_arm(shared_arm: UrArm, control: ControlClient) -> None:
    shared_arm.close()
    with connected(UrArm(arm_config(ADDRESS), CELL.lamp.output, halt_by_driver=False)) as arm:
        made_ready(arm, control)

        def stopped_by_the_dashboard() -> bool:
            lines = len(control.log())
            journey, moving = under_way(arm, control)
            arm.halt()
            after = assert_stopped(control, moving)
            error = journey.end()
            assert isinstance(error, RigError)
            assert error.code in LOAD
            assert after["runtime_state"] == STOPPED
            return error.code == ErrorCode.ARM_MOVE_FAILED and any(
                "by the dashboard" in line for line in control.log()[lines:]
            )

        # Where the machine keeps service or driver waiting, lease or watchdog may have stopped the arm just before.
        assert any(stopped_by_the_dashboard() for _ in range(5))


def test_halt_hanging_driver_stops_by_dashboard(arm: UrArm, control: ControlClient) -> None:
    journey, moving = under_way(arm, control)
    assert arm.driver_pid is not None
    os.kill(arm.driver_pid, signal.SIGSTOP)
    journey.stop.set()
    arm.halt()
    assert_stopped(control, moving)
    assert isinstance(journey.end(), Halted)
    assert not arm.is_open, "a driver that hangs is killed"


def test_move_token_set_meanwhile_halts(arm: UrArm, control: ControlClient) -> None:
    journey, moving = under_way(arm, control)
    journey.stop.set()
    assert_stopped(control, moving)
    assert isinstance(journey.end(), Halted)


@pytest.mark.parametrize("fault", ["protective_stop", "safeguard_stop", "program_pause"])
def test_halt_at_a_stop_of_the_cell_leaves_no_paused_move(arm: UrArm, control: ControlClient, fault: str) -> None:
    """The safety monitor halts before the driver has reported the stop; the paused program still holds the move."""
    journey, _ = under_way(arm, control)

    def halt_move(latch: object) -> None:
        if latch is not None:
            journey.stop.set()
            arm.halt()

    monitor = SafetyMonitor(arm, halt_move)
    monitor.start()
    try:
        control.fault(fault)
        if fault == "program_pause":
            halt_move(fault)
        assert isinstance(journey.end(), Halted)
    finally:
        monitor.close()
    wait_for(lambda: control.state()["runtime_state"] == STOPPED)
    wait_until_at_rest(control)
    control.fault("clear")
    with Dashboard(ADDRESS) as pendant:
        assert pendant.ask("play") == "Failed to execute: play"
    assert stays_at_rest(control)


def test_halt_mid_path_ends_all_segments(arm: UrArm, control: ControlClient) -> None:
    journey, moving = under_way(arm, control, (FAR, HOME, FAR))
    journey.stop.set()
    arm.halt()
    after = assert_stopped(control, moving)
    assert isinstance(journey.end(), Halted)
    assert after["moves_started"] == moving["moves_started"]


def test_killed_driver_stops_the_arm(arm: UrArm, control: ControlClient) -> None:
    journey, moving = under_way(arm, control)
    assert arm.driver_pid is not None
    os.kill(arm.driver_pid, signal.SIGKILL)
    assert_stopped(control, moving)
    error = journey.end()
    assert isinstance(error, RigError)
    assert error.code == ErrorCode.DRIVER_LOST
    assert not arm.reading.connected
    assert arm.reading.lost == "The arm's driver ended"
    with pytest.raises(RigError) as caught:
        arm.move([FAR], [LIMITS], StopToken())
    assert caught.value.code == ErrorCode.DRIVER_LOST
    made_ready(arm, control)


def test_killed_driver_stops_by_controller_watchdog(shared_arm: UrArm, control: ControlClient) -> None:
    shared_arm.close()
    with connected(UrArm(arm_config(ADDRESS), CELL.lamp.output, halt_by_program_stop=False)) as arm:
        made_ready(arm, control)
        journey, moving = under_way(arm, control)
        assert arm.driver_pid is not None
        os.kill(arm.driver_pid, signal.SIGKILL)
        assert_stopped(control, moving)
        assert isinstance(journey.end(), RigError)
        assert "watchdog" in control.log()[-1]


def test_hanging_driver_stops_the_arm(arm: UrArm, control: ControlClient) -> None:
    journey, moving = under_way(arm, control)
    assert arm.driver_pid is not None
    os.kill(arm.driver_pid, signal.SIGSTOP)
    assert_stopped(control, moving)
    error = journey.end()
    assert isinstance(error, RigError)
    assert error.code == ErrorCode.DRIVER_LOST
    assert not arm.is_open


def test_sleeping_driver_does_not_report_a_lost_link(arm: UrArm, control: ControlClient) -> None:
    pid = arm.driver_pid
    assert pid is not None
    os.kill(pid, signal.SIGSTOP)
    time.sleep(1.2)  # longer than data may be old
    os.kill(pid, signal.SIGCONT)
    wait_for(lambda: arm.reading.connected)
    time.sleep(0.3)
    assert arm.reading.connected
    assert arm.driver_pid == pid
    assert control.state()["runtime_state"] == STOPPED, "the controller's watchdog has ended the program meanwhile"


def test_driver_ended_by_signal_stops_the_arm(arm: UrArm, control: ControlClient) -> None:
    journey, moving = under_way(arm, control)
    assert arm.driver_pid is not None
    os.kill(arm.driver_pid, signal.SIGINT)  # Ctrl-C reaches the whole group; the service decides, not the driver
    os.kill(arm.driver_pid, signal.SIGTERM)
    assert_stopped(control, moving)
    error = journey.end()
    assert isinstance(error, RigError)
    assert error.code == ErrorCode.DRIVER_LOST


def test_pendant_stop_during_move_raises_move_failed(arm: UrArm, control: ControlClient) -> None:
    journey, moving = under_way(arm, control)
    control.fault("program_stop")
    assert_stopped(control, moving)
    error = journey.end()
    assert isinstance(error, RigError)
    assert error.code == ErrorCode.ARM_MOVE_FAILED
    wait_for(lambda: not arm.reading.program_running)
    assert arm.reading.connected


@pytest.mark.parametrize(
    ("fault", "code"),
    [
        ("safeguard_stop", ErrorCode.ARM_PROTECTIVE_STOP),
        ("protective_stop", ErrorCode.ARM_PROTECTIVE_STOP),
        ("emergency_stop", ErrorCode.ARM_EMERGENCY_STOP),
    ],
)
def test_safety_stop_during_move_raises_its_code(
    arm: UrArm, control: ControlClient, fault: str, code: ErrorCode
) -> None:
    journey, moving = under_way(arm, control)
    monitor = SafetyMonitor(arm, lambda latch: None)
    monitor.start()
    control.fault(fault)
    assert_stopped(control, moving)
    error = journey.end()
    assert isinstance(error, RigError)
    assert error.code == code
    monitor.close()
    assert monitor.latch is not None
    assert monitor.latch.code == code
    # A paused program would go on where it was when somebody presses play: it is ended.
    wait_for(lambda: control.state()["runtime_state"] == STOPPED)
    with pytest.raises(RigError) as caught:
        arm.move([FAR], [LIMITS], StopToken())
    assert caught.value.code == code
    with pytest.raises(RigError) as caught:
        arm.prepare()
    assert caught.value.code == code
    if fault == "safeguard_stop":
        control.fault("release_safeguard_stop")
        wait_for(lambda: arm.reading.safety_bits == 1)
        assert stays_at_rest(control)
        assert control.state()["runtime_state"] == STOPPED, "only connect or prepare may start it again"
        until_undisturbed(arm.prepare)
        moved(arm)


@pytest.mark.long
def test_move_speed_slider_at_zero_fails_in_time(arm: UrArm, control: ControlClient) -> None:
    journey, _ = under_way(arm, control)
    control.fault("speed_slider", fraction=0.0)
    try:
        error = journey.end()
    finally:
        control.fault("speed_slider", fraction=1.0)
    assert isinstance(error, RigError)
    assert error.code == ErrorCode.ARM_MOVE_FAILED
    assert "slider" in error.detail
    assert stays_at_rest(control)
