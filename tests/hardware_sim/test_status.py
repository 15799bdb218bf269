"""The status lines of a simulated cell."""

import json

from hardware_sim.controller.control_port import state
from hardware_sim.controller.controller import Controller
from hardware_sim.controller.kinematics import MODELS
from hardware_sim.status import INTERVAL_S, StatusLines

HOME = [0.0, -1.9, 1.9, -1.57, -1.57, 0.0]


def test_status_lines_report_changes_at_once_and_rest_by_interval() -> None:
    machine, lines = Controller(MODELS["ur5e"], HOME, now=0.0), StatusLines()
    reported = json.loads(lines.line(state(machine), 0.0) or "")
    assert reported["arm"] == "stands"
    assert reported["program"] == "STOPPED"
    assert (reported["robot_mode"], reported["safety_mode"], reported["lamp"]) == ("RUNNING", "NORMAL", "ok")
    assert lines.line(state(machine), 1.0) is None
    machine.load("def f():\n movej([1,-1.9,1.9,-1.57,-1.57,0])\nend\n")
    for _ in range(10):
        machine.tick(machine.now + 0.002)
    reported = json.loads(lines.line(state(machine), 1.1) or "")
    assert (reported["arm"], reported["program"]) == ("moves", "PLAYING f")
    assert lines.line(state(machine), 1.2) is None
    machine.protective_stop("test")
    assert json.loads(lines.line(state(machine), 1.3) or "")["safety_mode"] == "PROTECTIVE_STOP"
    again = json.loads(lines.line(state(machine), 1.3 + INTERVAL_S) or "")
    assert len(again["joints"]) == 6
