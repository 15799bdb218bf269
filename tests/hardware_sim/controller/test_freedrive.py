"""Freedrive and teach mode: the arm holds its pose, a hand moves it, no command does."""

import numpy as np
import pytest

from hardware_sim.controller.controller import Controller
from hardware_sim.controller.kinematics import MODELS
from hardware_sim.controller.modes import RuntimeState, SafetyMode
from tests.hardware_sim.controller.programs import HOME, run

TARGET = [0.2, -1.8, 1.8, -1.5, -1.5, 0.1]


def guided(lines: str, ticks: int = 50) -> Controller:
    controller = Controller(MODELS["ur5e"], HOME, now=0.0)
    controller.load(f"def f():\n{lines}\n while True:\n  sync()\n end\nend\n")
    advance(controller, ticks)
    return controller


def advance(controller: Controller, ticks: int) -> np.ndarray:
    samples = []
    for _ in range(ticks):
        controller.tick(controller.timestamp)
        samples.append(controller.arm.joints)
    return np.array(samples)


@pytest.mark.parametrize("mode", ["freedrive_mode()", "teach_mode()"])
def test_freedrive_hand_move_moves_arm_and_program_continues(mode: str) -> None:
    controller = guided(f" {mode}")
    assert controller.arm.joints == HOME
    controller.move_by_hand(TARGET, 0.5)
    assert np.abs(np.diff(advance(controller, 300), axis=0)).max() < 0.01
    assert controller.arm.joints == TARGET
    assert controller.safety.safety_mode is SafetyMode.NORMAL
    assert controller.runtime_state is RuntimeState.PLAYING


def test_hand_move_without_freedrive_causes_protective_stop() -> None:
    controller = guided(" freedrive_mode()\n end_freedrive_mode()")
    controller.move_by_hand(TARGET, 0.5)
    assert controller.safety.safety_mode is SafetyMode.PROTECTIVE_STOP


def test_freedrive_blocked_axis_resists() -> None:
    controller = guided(" freedrive_mode(freeAxes=[1, 1, 0, 1, 1, 1], feature=p[0, 0, 0, 0, 0, 0])")
    controller.move_by_hand(TARGET, 0.5)
    advance(controller, 300)
    assert controller.arm.joints == HOME
    assert any("does not free the axis z" in m for m in controller.messages)
    controller.move_by_hand([0.3, *HOME[1:]], 0.5)  # on a horizontal circle
    advance(controller, 300)
    assert controller.arm.joints == [0.3, *HOME[1:]]


@pytest.mark.parametrize(
    "move",
    [
        "movej([0,0,0,0,0,0])",
        "movel(get_forward_kin())",
        "movep(get_forward_kin())",
        "movec(get_forward_kin(), get_forward_kin())",
        "speedj([0.1,0,0,0,0,0])",
        "speedl([0.1,0,0,0,0,0])",
        "servoj([0,0,0,0,0,0])",
        "teach_mode()",
    ],
)
def test_freedrive_motion_commands_raise(move: str) -> None:
    record = run(f" freedrive_mode()\n {move}", 1.0)
    message = record.message("runtime exception")
    assert "the arm is in freedrive_mode: end that first" in message
    assert "line 3" in message
    assert (record.joints == HOME).all()


def test_end_freedrive_and_next_program_allow_moves() -> None:
    record = run(" teach_mode()\n sleep(0.1)\n end_teach_mode()\n movej([0.1, -1.9, 1.9, -1.57, -1.57, 0])")
    assert record.joints[-1][0] == 0.1
    controller = guided(" freedrive_mode()")
    controller.load("def g():\n movej([0.1, -1.9, 1.9, -1.57, -1.57, 0], a=5)\nend\n")
    advance(controller, 300)
    assert controller.arm.joints[0] == 0.1


def test_freedrive_moving_arm_brakes_first() -> None:
    record = run(" speedj([0.5, 0, 0, 0, 0, 0], 2, 0.5)\n freedrive_mode()\n sleep(0.1)", 3.0)
    assert np.abs(record.accelerations).max() < 6.1
    assert not record.controller.arm.moving


def test_freedrive_status_reports_singularity() -> None:
    for joints, status in ((HOME, 0), ([*HOME[:4], 0.01, 0.0], 1)):
        record = run(" freedrive_mode()\n write_output_integer_register(0, get_freedrive_status())", 1.0, home=joints)
        assert record.controller.registers.get("output_int_register_0")[0] == status
