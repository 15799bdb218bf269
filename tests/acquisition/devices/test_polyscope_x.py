"""An arm with PolyScope X, which has no dashboard: who it is, recovery by a person, and each halt path alone."""

import json
import os
import signal
import socket
import threading
from collections.abc import Generator
from contextlib import closing, contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from acquisition.devices import UNKNOWN
from acquisition.devices.ur import probe
from acquisition.devices.ur.arm import UrArm
from acquisition.devices.ur.lamp import UrLamp
from acquisition.devices.ur.polyscope_x import BASE, PolyScopeX
from acquisition.devices.ur.software import Version
from acquisition.models.errors import ErrorCode, Halted, RigError
from hardware_sim.controller.control import ControlClient
from hardware_sim.nominal import ROBOT_API_PORT
from tests.acquisition.devices.arm_scenes import (
    CELL,
    HOME,
    NEAR,
    arm_config,
    connected,
    controller,
    moved,
    stays_at_rest,
    under_way,
    until_undisturbed,
    wait_for,
    wait_until_at_rest,
)

ADDRESS, OLDER = "127.0.3.50", "127.0.3.51"
CONFIG = arm_config(ADDRESS, "x")
STOPPED, PLAYING, PAUSED = 1, 2, 4
IDLE, RUNNING = 5, 7


@pytest.fixture(scope="module")
def control() -> Generator[ControlClient]:
    with controller(ADDRESS, polyscope="x") as client:
        yield client


@pytest.fixture
def software(control: ControlClient) -> PolyScopeX:
    control.fault("clear")
    return PolyScopeX(ADDRESS, ROBOT_API_PORT, CONFIG.stop_deceleration_rad_s2)


def home(arm: UrArm, control: ControlClient) -> UrArm:
    """The arm under control, at home, with its lamp on."""
    control.fault("program_stop")
    control.fault("hand_move", joints=list(HOME), seconds=0.0)
    control.fault("clear")

    until_undisturbed(arm.connect)
    moved(arm)
    UrLamp(arm, CELL.lamp).set(True)
    return arm


def answers() -> bool:
    """Whether all ports answer again."""
    try:
        probe.probe(CONFIG, probe.software_of(CONFIG))
    except RigError:
        return False
    return True


def assert_stopped(control: ControlClient) -> None:
    """The arm stands with its lamp out, and nothing moves again by itself."""
    wait_until_at_rest(control)
    wait_for(lambda: control.state()["digital_outputs"] == 0)
    assert stays_at_rest(control)


def test_state_names_arm_and_remote_control(software: PolyScopeX, control: ControlClient) -> None:
    software.probe(Version(10, 14, 0, 0))
    state = software.state()
    assert (state.identity.model, state.identity.serial) == ("UR5", "20215500042")
    assert state.identity.software == "PolyScope X 10.14.0"
    assert state.remote_control
    control.fault("local_mode")
    assert not software.state().remote_control
    assert any("remote control" in limit for limit in software.limits())


@pytest.mark.long
def test_recover_powers_on_and_releases_brakes(software: PolyScopeX, control: ControlClient) -> None:
    control.fault("power_off")
    software.recover("power")
    wait_for(lambda: control.state()["robot_mode"] == IDLE)
    software.recover("brakes")
    wait_for(lambda: control.state()["robot_mode"] == RUNNING)


def test_recover_refused_says_what_the_controller_answers(software: PolyScopeX, control: ControlClient) -> None:
    with pytest.raises(RigError, match=r"409.*there is none") as caught:
        software.recover("unlock")
    assert caught.value.code == ErrorCode.SAFETY_RECOVERY_REFUSED
    control.fault("local_mode")
    with pytest.raises(RigError, match=r"403.*Not authorized.*Remote, in the pendant's safety overview") as caught:
        software.recover("power")
    assert caught.value.code == ErrorCode.SAFETY_RECOVERY_REFUSED


def play(control: ControlClient) -> None:
    """Starts a program that does not end by itself."""
    with socket.create_connection((ADDRESS, 30002), 30.0) as script:
        script.sendall(b"def endless():\n  while True:\n    sync()\n  end\nend\n")
        wait_for(lambda: control.state()["runtime_state"] == PLAYING)


def test_open_stop_ends_what_runs_or_is_paused(software: PolyScopeX, control: ControlClient) -> None:
    stop = software.open_stop(30.0)
    with closing(stop):
        for state in (PLAYING, PAUSED):
            play(control)
            if state == PAUSED:
                control.fault("protective_stop")
            wait_for(lambda state=state: control.state()["runtime_state"] == state)
            assert stop.stop() == "no program runs"
            wait_for(lambda: control.state()["runtime_state"] == STOPPED)
        assert stop.stop() == "no program runs", "harmless where nothing runs"


def test_open_stop_in_local_control_is_not_confirmed_for_life(software: PolyScopeX, control: ControlClient) -> None:
    control.fault("local_mode")
    stop = software.open_stop(30.0)
    with closing(stop):
        control.fault("remote_mode")
        play(control)
        with pytest.raises(TimeoutError):
            stop.stop()
        assert control.state()["runtime_state"] == PLAYING
    with closing(software.open_stop(30.0)) as another:
        another.stop()
    wait_for(lambda: control.state()["runtime_state"] == STOPPED)


@contextmanager
def older_api() -> Generator[None]:
    """A Robot API before 10.14, which names neither model nor serial number; a path that has moved is redirected."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            moved = self.path == f"{BASE}/system/v1/controlmode"
            known = self.path == f"{BASE}/system/v1/controlmode/"
            body = json.dumps({"mode": "REMOTE"} if known else {"message": "Not Found"}).encode()
            self.send_response(307 if moved else 200 if known else 404)
            if moved:
                self.send_header("Location", self.path + "/")
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def do_PUT(self) -> None:
            self.send_response(307)
            self.send_header("Location", f"https://{OLDER}{self.path}")
            self.send_header("Content-Length", "0")
            self.end_headers()

        def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the name that http.server has
            pass

    server = ThreadingHTTPServer((OLDER, ROBOT_API_PORT), Handler)
    thread = threading.Thread(target=server.serve_forever, args=(0.01,))
    thread.start()
    try:
        yield
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def test_state_older_api_leaves_identity_unknown_and_says_so() -> None:
    software = PolyScopeX(OLDER, ROBOT_API_PORT, 6.0)
    with older_api():
        state = software.state()
        with pytest.raises(RigError, match="https") as caught:
            software.recover("power")
    assert (state.identity.model, state.identity.serial) == (UNKNOWN, UNKNOWN)
    assert state.remote_control
    assert caught.value.code == ErrorCode.ARM_UNREACHABLE
    with pytest.raises(RigError, match="Robot API") as caught:
        software.state()
    assert caught.value.code == ErrorCode.ARM_UNREACHABLE


@pytest.mark.long
def test_preflight_matching_arm_is_empty_and_local_control_is_found(control: ControlClient) -> None:
    with connected(UrArm(CONFIG, CELL.lamp.output)) as arm:
        home(arm, control)
        assert arm.preflight() == []
        control.fault("local_mode")
        assert [finding.what for finding in arm.preflight()] == ["The controller is in local control."]
        assert "safety overview" in arm.preflight()[0].remedy
        control.fault("remote_mode")


@pytest.mark.long
def test_halt_by_driver_alone_stops_the_arm(control: ControlClient) -> None:
    with connected(UrArm(CONFIG, CELL.lamp.output, halt_by_program_stop=False)) as arm:
        journey, _ = under_way(home(arm, control), control)
        journey.stop.set()
        arm.halt()
        assert_stopped(control)
        assert isinstance(journey.end(), Halted)
        assert control.state()["runtime_state"] == PLAYING
        moved(arm, [NEAR])


@pytest.mark.long
def test_halt_by_primary_interface_alone_stops_the_arm(control: ControlClient) -> None:
    with connected(UrArm(CONFIG, CELL.lamp.output, halt_by_driver=False)) as arm:
        journey, _ = under_way(home(arm, control), control)
        arm.halt()
        assert_stopped(control)
        error = journey.end()
        assert isinstance(error, RigError)
        assert error.code == ErrorCode.ARM_MOVE_FAILED
        wait_for(lambda: control.state()["runtime_state"] == STOPPED)
        assert any("stop program" in line for line in control.log())


@pytest.mark.long
def test_halt_with_silent_rtde_and_hanging_driver_stops(control: ControlClient) -> None:
    with connected(UrArm(CONFIG, CELL.lamp.output)) as arm:
        journey, _ = under_way(home(arm, control), control)
        assert arm.driver_pid is not None
        os.kill(arm.driver_pid, signal.SIGSTOP)
        control.fault("stall", port=30004, seconds=2.0)
        journey.stop.set()
        arm.halt()
        assert_stopped(control)
        assert isinstance(journey.end(), Halted)
    wait_for(answers)


@pytest.mark.long
def test_killed_driver_stops_by_controller_watchdog(control: ControlClient) -> None:
    with connected(UrArm(CONFIG, CELL.lamp.output, halt_by_program_stop=False)) as arm:
        journey, _ = under_way(home(arm, control), control)
        assert arm.driver_pid is not None
        before = len(control.log())
        os.kill(arm.driver_pid, signal.SIGKILL)
        assert_stopped(control)
        assert isinstance(journey.end(), RigError)
        assert any("watchdog" in line for line in control.log()[before:])


@pytest.mark.long
@pytest.mark.parametrize("polyscope", ["5", "x"])
def test_stop_connection_of_local_control_is_opened_anew(polyscope: str) -> None:
    """A connection opened in local control obeys nobody, also when remote control has been granted since."""
    with controller(OLDER, polyscope=polyscope) as control:
        control.fault("local_mode")
        arm = UrArm(arm_config(OLDER, polyscope), CELL.lamp.output, halt_by_driver=False)
        with connected(arm):
            assert not arm.reading.program_running
            control.fault("remote_mode")
            journey, _ = under_way(arm, control)
            arm.halt()
            assert_stopped(control)
            assert isinstance(journey.end(), RigError)


@pytest.mark.long
def test_protective_stop_in_a_move_ends_the_program(control: ControlClient) -> None:
    with connected(UrArm(CONFIG, CELL.lamp.output)) as arm:
        journey, _ = under_way(home(arm, control), control)
        control.fault("protective_stop")
        assert_stopped(control)
        error = journey.end()
        assert isinstance(error, RigError)
        assert error.code == ErrorCode.ARM_PROTECTIVE_STOP
        # A paused program would go on where it was when somebody presses play: it is ended.
        wait_for(lambda: control.state()["runtime_state"] == STOPPED)
