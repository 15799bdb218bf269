"""The controller as a process: start, control port, record, end."""

import json
import socket
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hardware_sim.controller.control import ControlClient
from hardware_sim.controller.faults import FAULTS
from hardware_sim.controller.options import ControllerOptions
from hardware_sim.controller.process import ControllerProcess
from hardware_sim.controller.trace import read_trace
from tests.hardware_sim.controller.cells import HOME, start, wait_until

MOVE = b"def f():\n movej([0.5,-1.9,1.9,-1.57,-1.57,0], a=4, v=1)\n set_digital_out(3, True)\nend\n"


def send_script(address: str, text: bytes) -> None:
    with socket.create_connection((address, 30002), 3.0) as script:
        script.sendall(text)


def test_state_reports_joints_outputs_and_modes(controller: ControllerProcess) -> None:
    with controller.control() as control:
        state = control.state()
        assert state["joints"] == pytest.approx(HOME)
        assert state["base_from_tool"][3] == [0.0, 0.0, 0.0, 1.0]
        assert len(state["output_age_s"]) == 18
        assert not state["program_running"]
        before = state["timestamp"]
        send_script(controller.address, MOVE)
        wait_until(lambda: control.state()["digital_outputs"] == 1 << 3)
        state = control.state()
        assert state["joints"][0] == 0.5
        assert state["output_age_s"][3] < state["timestamp"] - before
        assert state["output_age_s"][4] > state["output_age_s"][3]


def test_control_port_invalid_requests_are_refused_with_reason(controller: ControllerProcess) -> None:
    with controller.control() as control:
        for request in (
            {"command": "nothing"},
            {"command": "fault", "kind": "nothing"},
            {"command": "fault", "kind": ["cut"]},
            {"command": "fault", "kind": "cut", "port": 30200},
            {"command": "fault", "kind": "stall", "port": 30004, "seconds": -1},
            {"command": "fault", "kind": "speed_slider", "fraction": 1.5},
            {"command": "fault", "kind": "joint_offset", "offsets_rad": [0.0]},
            {"command": "fault", "kind": "output_stuck", "output": 18, "level": True},
            {"command": "fault", "kind": "protective_stop", "at_s": "soon"},
        ):
            with pytest.raises(ValueError):  # noqa: PT011 - each has a sentence of its own
                control.request(**request)
        assert control.state()["ok"]
    with socket.create_connection((controller.address, 30200), 3.0) as raw:
        lines = raw.makefile("rb")
        for bad in (b"not json\n", b"[1, 2]\n", b"\xff\xfe\n", b"[" * 3000 + b"\n", b'{"command": NaN}\n'):
            raw.sendall(bad)
            assert json.loads(lines.readline())["ok"] is False


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"command": "state", "at": 1}, "state takes no fields, not at"),
        ({"command": "collisions", "since": 1}, "collisions takes no fields, not since"),
        ({"command": "log", "count": 3}, "log takes no fields, not count"),
        ({"command": "input", "digital": 3, "level": True, "value": 1.0},
         "digital input takes digital, level, not value"),
        ({"command": "input", "analog": 1, "value": 1.0, "unit": "A"}, "analog input takes analog, value, not unit"),
        ({"command": "input", "digitl": 3, "level": True}, "input takes digital and level, or analog and value"),
        ({"command": "surface", "stiffness": 0.0, "stifness": 9.0},
         "surface takes point, normal, stiffness, not stifness"),
        ({"command": "surroundings", "file": "x", "clear": True}, "surroundings takes file, not clear"),
    ],
)  # fmt: skip
def test_control_port_unknown_field_is_refused_by_name(
    controller: ControllerProcess, fields: dict[str, Any], said: str
) -> None:
    with controller.control() as control:
        inputs = control.state()["digital_inputs"]
        with pytest.raises(ValueError, match=f"^{said}$"):
            control.request(**fields)
        assert control.state()["digital_inputs"] == inputs


def test_faults_without_parameters_take_effect(controller: ControllerProcess) -> None:
    modes = {
        "protective_stop": 3,
        "safeguard_stop": 5,
        "emergency_stop": 7,
        "system_emergency_stop": 6,
        "violation": 8,
        "fault": 9,
    }
    assert set(modes) < set(FAULTS)
    with controller.control() as control:
        for kind, mode in modes.items():
            control.fault(kind)
            assert control.state()["safety_mode"] == mode
            control.fault("clear")
            assert control.state()["safety_mode"] == 1
        control.fault("safeguard_stop", at_s=0.1)
        wait_until(lambda: control.state()["safety_mode"] != 1)
        assert control.state()["safety_mode"] == 5
        control.fault("release_safeguard_stop")
        assert control.state()["safety_mode"] == 1


def test_fault_at_move_takes_effect_at_its_start(controller: ControllerProcess) -> None:
    with controller.control() as control:
        control.fault("protective_stop", at_move=2)
        text = b"def f():\n movej([0.1,-1.9,1.9,-1.57,-1.57,0], a=20, v=3)\n movej([0,-1.9,1.9,-1.57,-1.57,0])\nend\n"
        send_script(controller.address, text)
        wait_until(lambda: control.state()["safety_mode"] == 3)
        assert control.state()["moves_started"] == 2
        assert control.state()["joints"][0] > 0.05


def test_record_holds_every_tick_of_motion(tmp_path: Path) -> None:
    path = tmp_path / "ticks.record"
    with start(record=path, speed=4.0) as process, process.control() as control:
        send_script(process.address, MOVE)
        wait_until(lambda: control.state()["digital_outputs"] == 1 << 3)
        wait_until(lambda: not control.state()["program_running"])
    trace = read_trace(path)
    times, joints = trace.times, trace.joints
    assert np.all(np.diff(times) >= 0.0)
    assert joints[0] == pytest.approx(HOME, abs=0.01)
    assert joints[-1] == pytest.approx([0.5, *HOME[1:]])
    steps = np.abs(np.diff(joints[:, 0]))
    assert steps.max() <= 1.0 * 0.008 * 1.001  # at most 8 ms of motion at 1 rad/s between two rows
    assert trace.outputs[-1] == 0b1000
    assert np.all(np.diff(trace.outputs) >= 0)
    assert set(trace.safety_mode) == {1}
    assert set(trace.robot_mode) == {7}
    assert list(dict.fromkeys(trace.runtime_state[::-1])) == [1, 2]
    assert not trace.touching.any()
    # The pose is that of the joints: the flange's, as no tool is set.
    from ur_analytic_ik import ur5e

    for row in (0, len(times) // 2, -1):
        assert trace.tcp[row, :3] == pytest.approx(ur5e.forward_kinematics(*joints[row])[:3, 3], abs=1e-6)


def test_process_address_in_use_raises(controller: ControllerProcess) -> None:
    with pytest.raises(ConnectionError, match="did not start"):
        ControllerProcess(controller.address, ControllerOptions(home=HOME))


def test_control_client_without_listener_raises() -> None:
    with pytest.raises(ConnectionError, match="30200"):
        ControlClient("127.0.1.251", timeout_s=1.0)


def test_process_starts_quickly_and_ends_cleanly(controller: ControllerProcess) -> None:
    control = controller.control()
    controller.close()
    assert controller.process.returncode == 0
    with pytest.raises(ConnectionError):
        control.state()
    control.close()
