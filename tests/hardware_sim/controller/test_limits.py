"""Limits of the arm, and how the controller answers: each answer names joint and reason."""

import math

import numpy as np
import pytest

from hardware_sim.controller import kinematics, limits, poses
from hardware_sim.controller.kinematics import MODELS
from tests.hardware_sim.controller.programs import HOME, TICK, Record, run

TURNED = [*HOME[:5], 6.0]


def protective_stop(record: Record) -> str:
    assert record.controller.safety.safety_mode.name == "PROTECTIVE_STOP"
    assert not record.controller.arm.moving
    return record.message("PROTECTIVE_STOP")


def test_movel_turning_wrist_past_limit_stops() -> None:
    record = run(" movel(pose_trans(get_forward_kin(), p[0, 0, 0, 0, 0, 0.6]), v=0.5)", 3.0, home=TURNED)
    message = protective_stop(record)
    assert "joint 5 (wrist 3) at 36" in message
    assert "is outside the joint limits of ±360°" in message
    assert 6.2 < record.joints[-1][5] < limits.JOINT_LIMIT + 0.02


def test_speedj_into_joint_limit_stops() -> None:
    record = run(" while True:\n  speedj([0, 0, 0, 0, 0, 0.5], 2, 0.1)\n end", 3.0, home=TURNED)
    assert "joint 5 (wrist 3)" in protective_stop(record)


def test_arm_at_joint_limit_can_turn_back() -> None:
    record = run(" movej([0,-1.9,1.9,-1.57,-1.57,0])", home=[*HOME[:5], limits.JOINT_LIMIT])
    assert record.joints[-1].tolist() == HOME


@pytest.mark.parametrize("function", ["movej([0, 0, 0, -6.4, 0, 0])", "servoj([0, 0, 0, -6.4, 0, 0])"])
def test_movej_target_outside_limits_raises_before_moving(function: str) -> None:
    record = run(f" {function}", 1.0)
    assert "joint 3 (wrist 1) at -366.7° is outside the joint limits" in record.message("runtime exception")
    assert (record.joints == HOME).all()


def test_movel_over_base_reports_shoulder_singularity() -> None:
    lines = " movel(p[0.3, 0.05, 0.6, 3.14, 0, 0], a=1, v=0.5)\n movel(p[-0.3, 0.05, 0.6, 3.14, 0, 0], a=1, v=0.5)"
    message = protective_stop(run(lines, 4.0))
    assert "joint 0 (base) would have to turn at" in message
    assert "its limit is 3.14: close to the shoulder singularity" in message


def test_movel_through_wrist_singularity_stops() -> None:
    home = [0.0, -1.9, 1.9, -1.57, 0.12, 0.0]
    beyond = kinematics.forward(MODELS["ur5e"], [0.0, -1.9, 1.9, -1.57, -0.12, 0.0])
    offset = poses.compose(poses.invert(kinematics.forward(MODELS["ur5e"], home)), beyond)
    # Beside it, so that the wrist has to swing round.
    aside = poses.to_ur(poses.compose(offset, poses.from_ur([0, 0.02, 0, 0, 0, 0])))
    record = run(f" movel(pose_trans(get_forward_kin(), p{aside}), v=1, a=5)", 4.0, home=home)
    message = protective_stop(record)
    assert "wrist" in message
    assert "close to the wrist singularity" in message
    assert np.abs(record.speeds).max() < math.pi * 1.03


def test_movel_leaving_reach_midway_stops() -> None:
    """Both ends can be reached, what is between them lies inside the arm's own base column."""
    record = run(" movel(p[0.13, -0.4, 0.4, 3.14, 0, 0], v=0.5)\n movel(p[0.0, 0.4, 0.4, 3.14, 0, 0], v=0.5, a=3)", 6.0)
    message = protective_stop(record)
    assert "would have to" in message or "out of reach" in message


@pytest.mark.parametrize("move", ["movel", "movep"])
def test_movel_target_out_of_reach_stops(move: str) -> None:
    record = run(f" {move}(p[2, 0, 0.5, 0, 3.14, 0])", 1.0)
    assert "the target pose is out of reach" in protective_stop(record)
    assert (record.joints == HOME).all()


@pytest.mark.parametrize("line", ["x = get_inverse_kin(p[2, 0, 0.5, 0, 3, 0])", "movej(p[2, 0, 0.5, 0, 3, 0])"])
def test_get_inverse_kin_without_solution_ends_program(line: str) -> None:
    record = run(f" {line}", 1.0)
    assert "no solution" in record.message("runtime exception")
    assert "line 2" in record.message("runtime exception")
    assert record.controller.safety.safety_mode.name == "NORMAL"


def test_is_within_safety_limits_agrees_with_moves() -> None:
    random = np.random.default_rng(3)
    answers = {True: 0, False: 0}
    for _ in range(60):
        joints = random.uniform(-1, 1, 6) * [7, 2, 2, 7, 7, 7]
        pose = [*random.uniform(-0.9, 0.9, 3).tolist(), *random.uniform(-2, 2, 3).tolist()]
        for target in (f"{joints.tolist()}", f"p{pose}"):
            lines = f""" write_output_integer_register(0, 1)
 if is_within_safety_limits({target}):
  write_output_integer_register(0, 2)
 end
 movej({target}, a=40, v=3)"""
            record = run(lines, 0.05)
            said = record.controller.registers.get("output_int_register_0")[0] == 2
            assert said == (not record.message("runtime exception"))
            answers[said] += 1
    assert min(answers.values()) > 20


def test_get_inverse_kin_has_solution_agrees_with_inverse() -> None:
    lines = """ ok = 0
 if get_inverse_kin_has_solution(p[0.4, 0.1, 0.3, 3.1, 0, 0]):
  q = get_inverse_kin(p[0.4, 0.1, 0.3, 3.1, 0, 0])
  ok = pose_dist(get_forward_kin(q), p[0.4, 0.1, 0.3, 3.1, 0, 0])
 end
 write_output_float_register(0, ok)"""
    record = run(lines, 1.0)
    assert 0 < record.controller.registers.get("output_double_register_0")[0] < 1e-9


def test_tool_speed_limit_slows_joint_moves(monkeypatch: pytest.MonkeyPatch) -> None:
    lines = " movej([1.5, -1.5, 1.5, -1.57, -1.57, 0], a=10, v=3)"
    free = run(lines)
    monkeypatch.setattr(limits, "TOOL_SPEED", 0.4)
    slow = run(lines)
    fastest = [np.linalg.norm(np.diff(record.tools, axis=0), axis=1).max() / TICK for record in (free, slow)]
    assert fastest[0] > 0.8
    assert 0.39 < fastest[1] < 0.41
    assert slow.joints[-1].tolist() == free.joints[-1].tolist()


def test_tool_speed_limit_cuts_tool_moves_and_speeds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "TOOL_SPEED", 0.2)
    for lines in (
        " movel(pose_trans(get_forward_kin(), p[0.15, 0, 0, 0, 0, 0]), a=5, v=1)",
        " speedl([0, 0.2, -0.2, 0, 0, 0], 3, 0.4)",
    ):
        record = run(lines, 3.0)
        fastest = np.linalg.norm(np.diff(record.tools, axis=0), axis=1).max() / TICK
        assert 0.19 < fastest < 0.201


def test_servoj_above_tool_speed_limit_stops(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "TOOL_SPEED", 0.2)
    record = run(" while True:\n  servoj([1, -1.9, 1.9, -1.57, -1.57, 0])\n end", 1.0)
    assert "the tool would have to move at" in protective_stop(record)


@pytest.mark.parametrize(
    "move", ["movej([1.5, -1.9, 1.9, -1.57, -1.57, 0], t=0.05)", "movej(p[-0.5, 0, 0.4, 3.14, 0, 0], t=0.05)"]
)
def test_move_time_too_short_is_extended(move: str) -> None:
    record = run(f" {move}")
    assert record.controller.safety.safety_mode.name == "NORMAL"
    assert np.abs(record.speeds).max() < math.pi * (1 + 1e-6)
    assert np.abs(record.accelerations).max() < limits.JOINT_ACCELERATION * (1 + 1e-6)


@pytest.mark.parametrize(
    "lines",
    [
        " movej([1, -1.9, 1.9, -1.57, -1.57, 0], a=10000, v=1)",
        " speedj([1, 0, 0, 0, 0, 0], 10000, 0.2)\n stopj(10000)",
        " speedj([0.3, 0, 0, 0, 0, 0], 100, 0.2)\n stopl(10000)",
        " servoj([0.5, -1.9, 1.9, -1.57, -1.57, 0], t=0.5, lookahead_time=0.03, gain=2000)",
    ],
)
def test_joint_accelerations_stay_within_drive_limit(lines: str) -> None:
    record = run(lines, 3.0)
    assert np.abs(record.accelerations).max() <= limits.JOINT_ACCELERATION * 1.01
    assert record.joints[-1][0] > 0.05


def test_pure_rotation_keeps_turn_limit() -> None:
    record = run(" movel(pose_trans(get_forward_kin(), p[0.000001, 0, 0, 0, 0, 1.5]), a=10, v=3)")
    assert record.controller.safety.safety_mode.name == "NORMAL"
    assert np.abs(record.speeds).max() <= math.pi * 1.001


def test_wrist_3_of_ur3e_turns_without_end() -> None:
    turn = " movej([0,-1.9,1.9,-1.57,-1.57,15.0], a=20, v=6)\n speedj([0, 0, 0, 0, 0, 2.0], 20, 0.5)\n stopj(20)"
    record = run(turn, model="ur3e", home=TURNED)
    assert record.controller.safety.safety_mode.name == "NORMAL"
    assert record.joints[-1][5] > 15.5
    assert "outside the joint limits" in run(turn, home=TURNED).message("joint 5 (wrist 3)")
