"""Robot API of a simulated PolyScope X: its answers, its rules in local control, and HTTP that is none."""

import json
import re
import socket
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hardware_sim.controller.controller import Controller
from hardware_sim.controller.kinematics import MODELS
from hardware_sim.controller.modes import RobotMode, SafetyMode
from hardware_sim.controller.robot_api import BASE, RobotApiConnection, answer
from tests.hardware_sim.controller.cells import HOME

SLOW = "def f():\n  sleep(60)\nend\n"
STATE, PROGRAM = "/robotstate/v1/state", "/program/v1/state"


def controller(programs: Path | None = None) -> Controller:
    return Controller(MODELS["ur5e"], HOME, now=0.0, polyscope="x", programs=programs)


def get(machine: Controller, path: str) -> dict[str, Any]:
    status, content = answer(machine, "GET", BASE + path, b"")
    assert status == 200
    return content


def put(machine: Controller, path: str, **content: object) -> int:
    return answer(machine, "PUT", BASE + path, json.dumps(content).encode())[0]


def wait(machine: Controller, seconds: float) -> None:
    """Lets time pass."""
    for _ in range(round(seconds / 0.01)):
        machine.tick(machine.now + 0.01)


def test_robot_api_names_arm_software_and_modes() -> None:
    machine = controller()
    assert get(machine, "/system/v1/information") == {"robotType": "UR5", "serialNumber": machine.serial}
    assert get(machine, "/versions/v1/") == {"marketingVersion": "10.14.0"}
    assert get(machine, "/openapi.json")["info"]["version"] == "5.0.107"
    assert get(machine, "/robotstate/v1/robotmode") == {"mode": "RUNNING"}
    assert get(machine, "/system/v1/controlmode") == {"mode": "REMOTE"}
    assert get(machine, "/system/v1/operationalmode") == {"mode": "AUTOMATIC"}
    machine.emergency_stop("the button")
    assert get(machine, "/robotstate/v1/safetymode") == {"mode": "EMERGENCY_STOP"}


def test_robot_api_power_cycle_and_protective_stop() -> None:
    machine = controller()
    assert put(machine, STATE, action="POWER_OFF") == 200
    assert put(machine, STATE, action="POWER_ON") == 200
    wait(machine, 1.1)
    assert put(machine, STATE, action="BRAKE_RELEASE") == 200
    wait(machine, 1.0)
    assert machine.safety.robot_mode is RobotMode.RUNNING
    machine.protective_stop("a test")
    assert put(machine, STATE, action="UNLOCK_PROTECTIVE_STOP") == 409
    wait(machine, 5.1)
    assert put(machine, STATE, action="UNLOCK_PROTECTIVE_STOP") == 200
    assert machine.safety.safety_mode is SafetyMode.NORMAL
    assert put(machine, STATE, action="RESTART_SAFETY") == 409
    assert put(machine, STATE, action="FLY") == 422


def test_robot_api_plays_pauses_resumes_and_stops(tmp_path: Path) -> None:
    (tmp_path / "slow.urp").write_text(SLOW, encoding="utf-8")
    machine = controller(tmp_path)
    assert put(machine, PROGRAM, action="play") == 409
    assert put(machine, "/program/v1/loaded", name="nope") == 404
    assert put(machine, "/program/v1/loaded", name="slow") == 200
    assert get(machine, "/program/v1/loaded") == {"name": "slow"}
    for action, state in (("play", "PLAYING"), ("pause", "PAUSED"), ("resume", "PLAYING"), ("stop", "STOPPED")):
        assert put(machine, PROGRAM, action=action) == 200
        wait(machine, 0.5)
        assert get(machine, PROGRAM) == {"state": state}


def test_robot_api_local_control_forbids_changes_only() -> None:
    machine = controller()
    machine.safety.remote_control = False
    assert get(machine, "/system/v1/controlmode") == {"mode": "LOCAL"}
    status, content = answer(machine, "PUT", BASE + STATE, b'{"action": "POWER_OFF"}')
    assert (status, content["message"]) == (403, "Forbidden")
    assert machine.safety.robot_mode is RobotMode.RUNNING


@pytest.mark.parametrize(
    ("method", "target", "body", "status"),
    [
        ("GET", "/", b"", 404),
        ("GET", BASE + "/nope", b"", 404),
        ("POST", BASE + STATE, b"{}", 404),
        ("PUT", BASE + STATE, b"{", 422),
        ("PUT", BASE + STATE, b"[]", 422),
        ("PUT", BASE + STATE, b"[" * 5000, 422),
    ],
)
def test_robot_api_bad_request_is_refused(method: str, target: str, body: bytes, status: int) -> None:
    assert answer(controller(), method, target, body)[0] == status


@settings(max_examples=60, deadline=None)
@given(st.lists(st.integers(1, 60), min_size=1, max_size=5), st.binary(max_size=200))
def test_robot_api_requests_in_pieces_get_one_answer_each(chunks: list[int], junk: bytes) -> None:
    """Three requests that arrive in pieces are answered in order; what is no HTTP ends the connection at most."""
    ours, theirs = socket.socketpair()
    ours.setblocking(False)
    with ours, theirs:
        connection = RobotApiConnection(ours, controller(), lambda: None)
        body = b'{"action": "POWER_OFF"}'
        data = b"GET %s/system/v1/controlmode HTTP/1.1\r\nHost: a\r\n\r\n" % BASE.encode()
        data += b"PUT %s%s HTTP/1.1\r\ncontent-length: %d\r\n\r\n" % (BASE.encode(), STATE.encode(), len(body)) + body
        data += b"GET /nope HTTP/1.1\r\nConnection: close\r\n\r\n"
        at, turn = 0, 0
        while at < len(data):
            size = chunks[turn % len(chunks)]
            connection.received(data[at : at + size])
            at, turn = at + size, turn + 1
        assert connection.closed
        answers = theirs.recv(1 << 16)
        assert re.findall(rb"HTTP/1.1 (\d+) ", answers) == [b"200", b"200", b"404"]
        other = RobotApiConnection(ours, controller(), lambda: None)
        other.received(junk + b"\r\n\r\n")
