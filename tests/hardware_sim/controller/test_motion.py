"""Profiles and motions against formulas and against derivatives of the samples themselves."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hardware_sim.controller import kinematics, poses
from hardware_sim.controller.controller import PROGRAM_STOP_DECELERATION, Controller
from hardware_sim.controller.kinematics import MODELS
from hardware_sim.controller.limits import JOINT_ACCELERATION
from hardware_sim.controller.moves import JointMove
from hardware_sim.controller.profile import Trapezoid
from hardware_sim.controller.steering import JointBrake, JointServo

HOME = [0.0, -1.9, 1.9, -1.57, -1.57, 0.0]
TICK = 0.002


def run(program: str, seconds: float, *, speed_factor: float = 1.0) -> tuple[np.ndarray, Controller]:
    """The joints after each tick of a program."""
    controller = Controller(MODELS["ur5e"], HOME, now=0.0, speed_factor=speed_factor)
    controller.load(program)
    samples = []
    for tick in range(round(seconds / TICK)):
        controller.tick(tick * TICK)
        samples.append(controller.arm.joints)
    return np.array(samples), controller


@pytest.mark.parametrize(("length", "speed", "acceleration"), [(1.0, 1.05, 1.4), (0.3, 1.05, 1.4), (1e-6, 3.0, 40.0)])
def test_trapezoid_position_is_integral_of_speed_within_limits(
    length: float, speed: float, acceleration: float
) -> None:
    profile = Trapezoid.planned(length, speed, acceleration, 0.0, math.inf, math.inf)
    expected = (
        2 * math.sqrt(length / acceleration)
        if length < speed**2 / acceleration
        else length / speed + speed / acceleration
    )
    assert profile.duration == pytest.approx(expected)
    times = np.linspace(0.0, profile.duration, 4001)
    positions = np.array([profile.position(t) for t in times])
    speeds = np.array([profile.speed_at(t) for t in times])
    assert positions[0] == 0.0
    assert positions[-1] == length
    assert np.allclose(np.gradient(positions, times)[5:-5], speeds[5:-5], atol=speeds.max() * 2e-3)
    assert speeds.max() <= speed * (1 + 1e-12)
    assert np.abs(np.diff(speeds)).max() <= acceleration * (times[1] - times[0]) * 1.001


def test_trapezoid_lasting_takes_given_time() -> None:
    assert Trapezoid.planned(2.0, 1.0, 1.0, 5.0, math.inf, math.inf).duration == pytest.approx(5.0)


positive = st.floats(1e-3, 50.0)


@given(positive, positive, positive, st.one_of(st.just(0.0), positive), positive, positive)
def test_trapezoid_planned_covers_length_within_limits(
    length: float, speed: float, acceleration: float, seconds: float, fastest: float, hardest: float
) -> None:
    profile = Trapezoid.planned(length, speed, acceleration, seconds, fastest, hardest)
    assert profile.position(profile.duration) == length
    assert profile.speed <= fastest * (1 + 1e-9)
    assert profile.acceleration <= hardest * (1 + 1e-9)
    assert 2 * profile.ramp <= profile.duration * (1 + 1e-9)
    middle = profile.position(profile.duration / 2)
    assert middle == pytest.approx(length / 2)
    if seconds > 0:
        assert profile.duration >= seconds * (1 - 1e-9)
    else:
        assert profile.speed <= speed * (1 + 1e-9)
        assert profile.acceleration <= acceleration * (1 + 1e-9)


@given(st.lists(st.floats(-3.0, 3.0), min_size=6, max_size=6), st.floats(0.1, 100.0), st.integers(1, 300))
def test_joint_brake_covers_square_of_speed(speeds: list[float], deceleration: float, ticks: int) -> None:
    brake = JointBrake([0.0] * 6, speeds, deceleration)
    joints, now = [0.0] * 6, speeds
    for _ in range(ticks):
        if not brake.finished:
            joints, after = brake.step(TICK, 0.0)
            assert all(abs(b) <= abs(a) and a * b >= 0 for a, b in zip(now, after, strict=True))
            now = after
    fastest, used = max(map(abs, speeds)), min(deceleration, JOINT_ACCELERATION)
    if ticks * TICK > fastest / used:
        assert now == [0.0] * 6
        assert joints == pytest.approx([0.5 * v * fastest / used for v in speeds], abs=1e-9)


@given(st.lists(st.floats(-2.0, 2.0), min_size=6, max_size=6), st.floats(0.03, 0.2), st.floats(100.0, 2000.0))
@settings(max_examples=30, deadline=None)
def test_joint_servo_reaches_target_within_limits(target: list[float], lookahead: float, gain: float) -> None:
    servo = JointServo(MODELS["ur3e"], [0.0] * 6, [0.0] * 6)
    servo.target, servo.lookahead, servo.gain = target, lookahead, gain
    record = np.array([servo.step(TICK, 1.0)[0] for _ in range(1500)])
    assert record[-1] == pytest.approx(target, abs=1e-3)
    speeds = np.diff(record, axis=0) / TICK
    assert (np.abs(speeds).max(axis=0) <= np.array(MODELS["ur3e"].joint_speeds) * (1 + 1e-9)).all()
    assert np.abs(np.diff(speeds, axis=0)).max() / TICK <= 2 * JOINT_ACCELERATION
    beyond = np.abs(record).max(axis=0) - np.abs(target)
    assert beyond.max() < 0.02


CORNERS = """ movej([0.3, -1.9, 1.9, -1.57, -1.57, 0], a=6, v=1.5, r=0.05)
 movel(pose_trans(p[0, 0, 0.1, 0, 0, 0], get_forward_kin([0.3, -1.9, 1.9, -1.57, -1.57, 0])), a=4, v=0.5, r=0.03)
 movep(pose_trans(p[0, 0.1, 0.1, 0, 0, 0], get_forward_kin([0.3, -1.9, 1.9, -1.57, -1.57, 0])), a=4, v=0.5, r=0.03)
 movep(pose_trans(p[0, 0.1, 0, 0, 0, 0], get_forward_kin([0.3, -1.9, 1.9, -1.57, -1.57, 0])), a=4, v=0.5)
"""


def test_motion_repeats_in_every_run() -> None:
    first, second = (run(f"def f():\n{CORNERS}end\n", 2.0)[0] for _ in range(2))
    assert (first == second).all()
    assert np.abs(first[-1] - HOME).max() > 0.05


def test_corners_are_equal_at_any_speed_factor() -> None:
    slow, _ = run(f"def f():\n{CORNERS}end\n", 2.0)
    fast, _ = run(f"def f():\n{CORNERS}end\n", 0.25, speed_factor=8.0)
    assert fast[-1] == pytest.approx(slow[-1], abs=1e-9)
    # Programs still take their turns at 500 Hz, so that corners begin up to a tick later.
    assert max(np.abs(slow - q).max(axis=1).min() for q in fast) < 5e-3


@pytest.mark.parametrize("fraction", [0.1, 0.5])
def test_slider_stretches_time_and_keeps_path(fraction: float) -> None:
    full = run(f"def f():\n{CORNERS}end\n", 2.0)[0]
    controller = Controller(MODELS["ur5e"], HOME, now=0.0)
    controller.slider = fraction
    controller.tick(0.0)
    controller.load(f"def f():\n{CORNERS}end\n")
    slow = []
    for tick in range(round(1.6 / fraction / TICK)):
        controller.tick(tick * TICK)
        slow.append(controller.arm.joints)
    assert np.abs(slow[-1] - full[-1]).max() < 1e-9
    lasted = [np.count_nonzero(np.abs(np.diff(q, axis=0)).max(axis=1)) for q in (full, np.array(slow))]
    assert lasted[1] * fraction == pytest.approx(lasted[0], rel=0.03)
    assert max(np.abs(full - q).max(axis=1).min() for q in slow[::20]) < 3e-3


def test_slider_at_zero_holds_arm() -> None:
    controller = Controller(MODELS["ur5e"], HOME, now=0.0)
    controller.slider = 0.0
    controller.tick(0.0)
    controller.load(f"def f():\n{CORNERS}end\n")
    for tick in range(200):
        controller.tick(tick * TICK)
    assert controller.arm.joints == HOME
    assert controller.playing


def test_movej_joints_stay_on_segment_within_limits() -> None:
    target = [0.5, -1.5, 1.2, -1.0, -1.9, 0.3]
    joints, controller = run(f"def f():\n movej({target}, a=1.4, v=1.05)\nend\n", 2.0)
    assert controller.arm.joints == target
    displacement = np.array(target) - HOME
    shares = (joints - HOME) / displacement
    assert np.abs(shares - shares[:, :1]).max() < 1e-9
    speeds = np.diff(joints, axis=0) / TICK
    assert np.abs(speeds).max() == pytest.approx(1.05, abs=1e-6) or np.abs(displacement).max() < 1.05**2 / 1.4
    assert np.abs(np.diff(speeds, axis=0) / TICK).max() <= 1.4 * 1.001


def test_movej_leading_axis_slows_for_slower_joint() -> None:
    move = run("def f():\n movej([1.9, -1.9, 1.9, -1.57, -1.57, 0.0], a=40, v=10)\nend\n", 1.0)[0]
    assert np.abs(np.diff(move, axis=0) / TICK).max() == pytest.approx(math.pi, abs=1e-6)


def test_speed_factor_changes_time_only() -> None:
    program = "def f():\n movej([0.8, -1.9, 1.9, -1.57, -1.57, 0.0], a=1.4, v=1.05)\nend\n"
    slow, _ = run(program, 1.8)
    fast, _ = run(program, 0.18, speed_factor=10.0)
    assert np.allclose(slow[9::10][: len(fast)], fast, atol=1e-9)


def test_killed_move_brakes_within_deceleration() -> None:
    program = """def f():
    thread mover():
        movej([3.0, -1.9, 1.9, -1.57, -1.57, 0.0], a=5, v=1)
    end
    handle = run mover()
    sleep(0.5)
    kill handle
    sleep(1)
end
"""
    joints, controller = run(program, 1.5)
    speeds = np.diff(joints[:, 0]) / TICK
    assert speeds.max() == pytest.approx(1.0)
    assert not controller.arm.moving
    assert np.diff(speeds).min() / TICK == pytest.approx(-PROGRAM_STOP_DECELERATION, rel=0.01)


def test_move_after_kill_has_continuous_speed() -> None:
    program = """def f():
    thread mover():
        movej([3.0, -1.9, 1.9, -1.57, -1.57, 0.0], a=3, v=1)
    end
    handle = run mover()
    sleep(0.6)
    kill handle
    movej([0.0, -1.5, 1.9, -1.57, -1.57, 0.0], a=3, v=1)
end
"""
    joints, controller = run(program, 4.0)
    assert controller.arm.joints == [0.0, -1.5, 1.9, -1.57, -1.57, 0.0]
    assert np.abs(np.diff(joints, n=2, axis=0)).max() / TICK**2 <= 3.0 * 1.01


def test_blend_stays_within_radius_and_keeps_moving() -> None:
    corner = [0.6, -1.9, 1.9, -1.57, -1.57, 0.0]
    end = [0.6, -1.4, 1.9, -1.57, -1.57, 0.0]
    program = f"def f():\n movej({corner}, a=3, v=0.8, r=0.08)\n movej({end}, a=3, v=0.8)\nend\n"
    joints, controller = run(program, 3.0)
    assert controller.arm.joints == end
    model = MODELS["ur5e"]
    tools = [kinematics.forward(model, q) for q in joints.tolist()]
    target = kinematics.forward(model, corner)
    away = np.array([poses.distance(tool, target)[0] for tool in tools])
    assert 0.002 < away.min() < 0.08
    speeds = np.linalg.norm(np.diff(joints, axis=0), axis=1) / TICK
    moving = np.flatnonzero(speeds > 0.4)
    assert speeds[moving[0] : moving[-1]].min() > 0.2
    # Outside the blend the arm is on the straight segments.
    off = np.minimum(np.abs(joints - HOME)[:, 1], np.abs(joints - corner)[:, 0])
    assert off[away > 0.12].max() < 1e-9


def test_blend_without_next_move_ends_at_corner() -> None:
    corner = [0.3, -1.9, 1.9, -1.57, -1.57, 0.0]
    _, controller = run(f"def f():\n movej({corner}, a=3, v=0.8, r=0.05)\n sleep(1.5)\nend\n", 1.5)
    assert controller.arm.joints == corner


def test_program_ending_in_blend_brakes() -> None:
    corner = [0.3, -1.9, 1.9, -1.57, -1.57, 0.0]
    joints, controller = run(f"def f():\n movej({corner}, a=3, v=0.8, r=0.05)\nend\n", 1.5)
    assert not controller.arm.moving
    assert np.abs(np.diff(joints, n=2, axis=0)).max() / TICK**2 <= PROGRAM_STOP_DECELERATION * 1.01


def test_stopl_stays_on_line() -> None:
    program = """def f():
    thread up():
        movel(pose_trans(p[0, 0, 0.2, 0, 0, 0], get_actual_tcp_pose()), a=0.5, v=0.2)
    end
    handle = run up()
    sleep(0.6)
    kill handle
    stopl(0.4)
end
"""
    joints, controller = run(program, 2.0)
    tools = np.array([kinematics.forward(MODELS["ur5e"], q) for q in joints.tolist()])
    assert np.ptp(tools[:, 3]) < 1e-9
    assert np.ptp(tools[:, 7]) < 1e-9
    heights = tools[:, 11]
    assert heights[-1] - heights[0] == pytest.approx(
        0.5 * 0.2**2 / 0.5 + 0.2 * (0.6 - 0.4) + 0.5 * 0.2**2 / 0.4, abs=2e-3
    )
    assert not controller.arm.moving


def test_brake_takes_time_of_fastest_joint() -> None:
    brake = JointBrake([0.0] * 6, [1.0, -0.5, 0, 0, 0, 0], 2.0)
    joints, speeds = brake.step(0.25, 0.0)
    assert speeds[:2] == pytest.approx([0.5, -0.25])
    joints, speeds = brake.step(10.0, 0.0)
    assert brake.finished
    assert joints[:2] == pytest.approx([0.25, -0.125])
    assert speeds == [0.0] * 6


def test_move_of_zero_length_finishes_at_once() -> None:
    assert JointMove(HOME, HOME, Trapezoid(0.0, 1.0, 1.0)).finished


def test_movel_through_singularity_causes_protective_stop() -> None:
    # Through the shoulder's axis: the base joint would have to turn on the spot.
    program = """def f():
    movel(p[0.3, 0.05, 0.6, 3.14, 0, 0], a=1, v=0.5)
    movel(p[-0.3, 0.05, 0.6, 3.14, 0, 0], a=1, v=0.5)
end
"""
    joints, controller = run(program, 4.0)
    assert controller.safety.safety_mode.name == "PROTECTIVE_STOP"
    assert not controller.arm.moving
    assert np.abs(np.diff(joints, axis=0)).max() / TICK <= math.pi * 1.03
