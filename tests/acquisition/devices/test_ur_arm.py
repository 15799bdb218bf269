"""The arm through the real ur-rtde against the simulated controller: moves, lamp, preflight, refusals."""

import math
import os
import signal
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import rtde_control

from acquisition.devices import MotionLimits, StopToken
from acquisition.devices.ur import arm as arm_module
from acquisition.devices.ur.arm import UrArm
from acquisition.devices.ur.lamp import UrLamp
from acquisition.models.errors import ErrorCode, Halted, RigError
from hardware_sim import real_time_controller
from hardware_sim.controller.control import ControlClient
from hardware_sim.controller.options import ControllerOptions
from tests.acquisition.devices.arm_scenes import (
    CELL,
    FAR,
    HOME,
    LIMITS,
    NEAR,
    arm_config,
    connected,
    controller,
    moved,
    stays_at_rest,
    until_undisturbed,
    wait_for,
)

ADDRESS, STRANGERS, ABSENT = "127.0.3.20", "127.0.3.21", "127.0.3.22"


@pytest.fixture(scope="module")
def control() -> Iterator[ControlClient]:
    """The controller of most tests; those with one of their own come first, so that it does not run beside them."""
    with controller(ADDRESS) as client:
        yield client


@pytest.fixture(scope="module")
def shared_arm(control: ControlClient) -> Iterator[UrArm]:
    with connected(UrArm(arm_config(ADDRESS), CELL.lamp.output)) as arm:
        yield arm


@pytest.fixture
def arm(shared_arm: UrArm, control: ControlClient) -> UrArm:
    """The shared arm, under control; each test finds it again by an explicit connect."""
    control.fault("remote_mode")
    control.fault("speed_slider", fraction=1.0)
    shared_arm.connect()
    return shared_arm


def test_preflight_other_arm_model_is_reported() -> None:
    with (
        real_time_controller.start(STRANGERS, ControllerOptions(home=HOME, model="ur10e")),
        connected(UrArm(arm_config(STRANGERS), CELL.lamp.output)) as arm,
    ):
        differences = arm.preflight()
    assert differences[0].what == "The arm is a UR10, the cell file says ur5e."


def test_connect_foreign_program_is_not_stopped(tmp_path: Path) -> None:
    with controller(STRANGERS) as control:
        stranger = rtde_control.RTDEControlInterface(STRANGERS)
        stranger.moveJ(list(FAR), 0.2, 0.5, True)
        arm = UrArm(arm_config(STRANGERS), CELL.lamp.output)
        try:
            with pytest.raises(RigError) as caught:
                arm.connect()
            assert caught.value.code == ErrorCode.ARM_IN_USE
            assert control.state()["program_running"]
        finally:
            arm.close()
            stranger.stopScript()
            stranger.disconnect()


def test_connect_without_controller_raises_arm_unreachable() -> None:
    arm = UrArm(arm_config(ABSENT), CELL.lamp.output)
    with pytest.raises(RigError) as caught:
        arm.connect()
    assert caught.value.code == ErrorCode.ARM_UNREACHABLE
    assert not arm.reading.connected
    arm.halt()
    with pytest.raises(RigError) as caught:
        arm.move([NEAR], [LIMITS], StopToken())
    assert caught.value.code == ErrorCode.DRIVER_LOST
    arm.close()


def test_connect_arm_without_power_refuses_moves() -> None:
    with controller(STRANGERS) as control:
        control.fault("power_off")
        with connected(UrArm(arm_config(STRANGERS), CELL.lamp.output)) as arm:
            assert arm.reading.connected
            assert "powered off" in arm.preflight()[0].what
            with pytest.raises(RigError) as caught:
                arm.move([NEAR], [LIMITS], StopToken())
            assert caught.value.code == ErrorCode.ARM_NOT_READY
            assert stays_at_rest(control)
            assert control.state()["robot_mode"] == 3, "power is a person's to give"


def test_arm_stop_longer_than_watchdog_raises_config_invalid() -> None:
    with pytest.raises(RigError) as caught:
        UrArm(arm_config(ADDRESS).model_copy(update={"stop_deceleration_rad_s2": 2.0}), CELL.lamp.output)
    assert caught.value.code == ErrorCode.CONFIG_INVALID


def test_move_successive_paths_end_at_their_goals(arm: UrArm, control: ControlClient) -> None:
    goal = (HOME[0] + 0.1, HOME[1] - 0.1, *HOME[2:])
    begun: list[int] = []

    def move() -> None:
        arm.connect()
        begun.append(control.state()["moves_started"])
        arm.move([NEAR, goal], [LIMITS, MotionLimits(0.5, 1.0)], StopToken())

    until_undisturbed(move)
    state = control.state()
    np.testing.assert_allclose(state["joints"], goal, atol=1e-4)
    assert max(map(abs, state["joint_speeds"])) == 0.0
    assert state["moves_started"] == begun[-1] + 2
    reading = arm.reading
    assert reading.connected
    assert reading.program_running
    np.testing.assert_allclose(reading.joints, goal, atol=1e-4)
    np.testing.assert_allclose(reading.base_from_tool, state["base_from_tool"], atol=1e-6)


def test_move_to_present_joints_returns(arm: UrArm, control: ControlClient) -> None:
    joints = arm.reading.joints
    arm.move([joints], [LIMITS], StopToken())
    np.testing.assert_allclose(control.state()["joints"], joints, atol=1e-6)


def test_move_empty_path_moves_nothing(arm: UrArm, control: ControlClient) -> None:
    before = control.state()["moves_started"]
    arm.move([], [], StopToken())
    assert control.state()["moves_started"] == before


def test_move_set_token_raises_halted_without_motion(arm: UrArm, control: ControlClient) -> None:
    before = control.state()["moves_started"]
    stop = StopToken()
    stop.set()
    with pytest.raises(Halted):
        arm.move([NEAR], [LIMITS], stop)
    assert control.state()["moves_started"] == before


@pytest.mark.parametrize(
    ("path", "limits"),
    [
        ([NEAR], []),
        ([NEAR[:5]], [LIMITS]),
        ([(*NEAR[:5], math.nan)], [LIMITS]),
        ([NEAR], [MotionLimits(1.06, 1.4)]),
        ([NEAR], [MotionLimits(0.0, 1.4)]),
        ([NEAR], [MotionLimits(1.0, math.inf)]),
    ],
)
def test_move_invalid_path_is_refused_without_motion(
    arm: UrArm, control: ControlClient, path: list[tuple[float, ...]], limits: list[MotionLimits]
) -> None:
    before = control.state()["moves_started"]
    with pytest.raises(RigError) as caught:
        arm.move(path, limits, StopToken())
    assert caught.value.code == ErrorCode.ARM_MOVE_FAILED
    assert control.state()["moves_started"] == before


def test_move_goal_beyond_safety_limits_is_refused_without_motion(arm: UrArm, control: ControlClient) -> None:
    before = control.state()["moves_started"]
    with pytest.raises(RigError) as caught:
        arm.move([NEAR, (7.0, *HOME[1:])], [LIMITS, LIMITS], StopToken())
    assert caught.value.code == ErrorCode.ARM_MOVE_FAILED
    assert "safety limits" in caught.value.detail
    assert control.state()["moves_started"] == before
    wait_for(lambda: not arm.reading.program_running)  # a move that failed ends it; only a person goes on


def test_lamp_set_switches_and_reads_back(arm: UrArm, control: ControlClient) -> None:
    lamp = UrLamp(arm, CELL.lamp)
    lamp.connect()
    for on in (True, True, False):
        lamp.set(on)
        assert control.state()["digital_outputs"] == int(on) << CELL.lamp.output
        assert arm.reading.digital_outputs == int(on) << CELL.lamp.output
    lamp.set(True)
    lamp.close()
    assert control.state()["digital_outputs"] == 0


@pytest.mark.parametrize("level", [False, True])
def test_lamp_set_stuck_output_raises_not_confirmed(arm: UrArm, control: ControlClient, level: bool) -> None:
    lamp = UrLamp(arm, CELL.lamp)
    control.fault("output_stuck", output=CELL.lamp.output, level=level)
    try:
        with pytest.raises(RigError) as caught:
            lamp.set(not level)
        assert caught.value.code == ErrorCode.LAMP_NOT_CONFIRMED
    finally:
        control.fault("output_stuck", output=CELL.lamp.output, level=None)
    assert control.state()["digital_outputs"] == 0, "the lamp must not come on when the output is mended"
    lamp.set(True)
    lamp.set(False)


def test_lamp_set_other_output_raises_config_invalid(arm: UrArm) -> None:
    with pytest.raises(RigError) as caught:
        UrLamp(arm, CELL.lamp.model_copy(update={"output": 5})).set(True)
    assert caught.value.code == ErrorCode.CONFIG_INVALID


def test_pulse_output_rises_falls_and_names_a_stuck_line(arm: UrArm, control: ControlClient) -> None:
    arm.pulse_output(3)
    assert control.state()["digital_outputs"] == 0
    assert control.state()["output_age_s"][3] < 60.0, "it has changed just now"
    control.fault("output_stuck", output=3, level=False)
    try:
        with pytest.raises(RigError) as caught:
            arm.pulse_output(3)
        assert caught.value.code == ErrorCode.CAMERA_TIMEOUT
    finally:
        control.fault("output_stuck", output=3, level=None)
    assert control.state()["digital_outputs"] == 0


def test_halt_at_rest_changes_nothing(arm: UrArm, control: ControlClient) -> None:
    lamp = UrLamp(arm, CELL.lamp)
    lamp.set(True)
    arm.halt()
    wait_for(lambda: control.state()["digital_outputs"] == 0)
    assert stays_at_rest(control)
    assert arm.reading.program_running, "a halt that the driver took does not end the program"
    moved(arm, [NEAR])
    moved(arm)


def test_halt_in_signal_handler_during_halt_succeeds(arm: UrArm) -> None:
    handled: list[int] = []

    def handle(number: int, frame: object) -> None:
        arm.halt()
        handled.append(number)

    before = signal.signal(signal.SIGUSR1, handle)
    try:
        for _ in range(200):
            os.kill(os.getpid(), signal.SIGUSR1)
            arm.halt()
    finally:
        signal.signal(signal.SIGUSR1, before)
    assert handled
    arm.move([NEAR], [LIMITS], StopToken())


def test_reading_is_updated_continuously(arm: UrArm) -> None:
    def readings() -> int:
        """How many different ones are seen in a second of the controller's time."""
        start = arm.reading.timestamp
        timestamps: set[float] = set()
        while max(timestamps, default=start) < start + 1.0:
            timestamps.add(arm.reading.timestamp)
            time.sleep(0.002)
        return len(timestamps)

    wait_for(lambda: readings() >= 50)  # in a second in which the machine lets this process look


def test_preflight_wrong_kinematics_is_reported(arm: UrArm) -> None:
    measured = arm.reading.base_from_tool
    shifted = measured.copy()
    shifted[2, 3] += 0.01
    arm.expected_pose = lambda joints: measured
    assert arm.preflight() == []
    arm.expected_pose = lambda joints: shifted
    try:
        assert "10.0 mm" in arm.preflight()[0].what
    finally:
        arm.expected_pose = None


def test_preflight_matching_cell_has_no_findings(arm: UrArm) -> None:
    assert arm.preflight() == []


def test_preflight_faulty_cell_names_each_fault(arm: UrArm, control: ControlClient) -> None:
    control.fault("local_mode")
    control.fault("speed_slider", fraction=0.0)
    wait_for(lambda: arm.reading.speed_fraction == 0.0)
    sentences = " ".join(finding.what for finding in arm.preflight())
    assert "local control" in sentences
    assert "slider" in sentences
    assert "program" not in sentences


@pytest.mark.parametrize(
    ("line", "word"),
    [("set_tcp(p[0, 0, 0.1, 0, 0, 0])", "TCP"), ("set_payload(2.0, [0, 0, 0.05])", "payload")],
)
def test_preflight_changed_tool_is_reported(arm: UrArm, line: str, word: str) -> None:
    program = f"sec changed():\n  {line}\nend\n"
    with socket.create_connection((ADDRESS, 30002), 5.0) as connection:
        connection.sendall(program.encode())
        wait_for(lambda: word in " ".join(finding.what for finding in arm.preflight()))
    arm.connect()  # states both again
    assert arm.preflight() == []


def test_pendant_stop_program_stays_stopped_until_connect(arm: UrArm, control: ControlClient) -> None:
    control.fault("program_stop")
    wait_for(lambda: not arm.reading.program_running)
    assert stays_at_rest(control)
    assert not control.state()["program_running"], "nobody may upload the program unasked"
    with pytest.raises(RigError) as caught:
        arm.move([NEAR], [LIMITS], StopToken())
    assert caught.value.code == ErrorCode.ARM_NOT_READY
    assert "program" in arm.preflight()[0].what
    arm.connect()
    assert arm.preflight() == []
    moved(arm, [NEAR])


def test_move_half_speed_slider_reaches_the_goal(arm: UrArm, control: ControlClient) -> None:
    control.fault("speed_slider", fraction=0.5)
    goal = (HOME[0] + 0.2, *HOME[1:])
    moved(arm, [goal])
    np.testing.assert_allclose(control.state()["joints"], goal, atol=1e-4)
    assert arm.reading.speed_fraction == 0.5


def test_move_slider_turned_down_in_mid_move_goes_on(
    arm: UrArm, control: ControlClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A person who wants to see a move slowly turns the slider down; the move then takes longer than was expected."""
    limits, goal = MotionLimits(0.2, 1.4), (HOME[0] - 0.3, *HOME[1:])

    def move() -> None:
        control.fault("speed_slider", fraction=1.0)
        moved(arm)
        control.fault("speed_slider", fraction=0.2, at_move=1)
        begun = control.state()["timestamp"]
        with monkeypatch.context() as patched:
            patched.setattr(arm_module, "REQUEST_DEADLINE_S", 0.5)
            try:
                arm.move([goal], [limits], StopToken())
            except RigError as error:
                if "did not answer within" in error.detail:
                    pytest.fail(error.detail)
                raise
        assert control.state()["timestamp"] - begun > 5.0, "it was no slower than at full speed"

    until_undisturbed(move)
    np.testing.assert_allclose(control.state()["joints"], goal, atol=1e-4)


def test_connect_second_client_raises_arm_in_use(arm: UrArm) -> None:
    other = UrArm(arm_config(ADDRESS), CELL.lamp.output)
    try:
        with pytest.raises(RigError) as caught:
            other.connect()
        assert caught.value.code == ErrorCode.ARM_IN_USE
    finally:
        other.close()
    arm.move([NEAR], [LIMITS], StopToken())  # ours is not disturbed
    assert arm.preflight() == []
