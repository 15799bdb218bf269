"""Blends: how far from the corner the tool leaves its path, and that speeds stay continuous."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from hardware_sim.controller import kinematics
from hardware_sim.controller.kinematics import MODELS
from tests.hardware_sim.controller.programs import HOME, TICK, Record, run

ARM = MODELS["ur5e"]
START = kinematics.forward(ARM, HOME)
PLACE = np.array([START[3], START[7], START[11]])
AXIS = np.zeros((1, 2))  # of the base, seen from above
STRAIGHT = 1e-4  # m: what straight means
offsets = st.tuples(*[st.floats(-0.12, 0.12)] * 3).map(np.array)
turns = st.tuples(*[st.floats(-0.5, 0.5)] * 6).map(np.array)


def pose(place: np.ndarray) -> str:
    return "p[" + ",".join(f"{v:.9f}" for v in place) + ", 2.2214, 2.2214, 0]"


def at(x: float, y: float, z: float) -> np.ndarray:
    return PLACE + np.array([x, y, z])


def place_of(joints: np.ndarray) -> np.ndarray:
    frame = kinematics.forward(ARM, joints.tolist())
    return np.array([frame[3], frame[7], frame[11]])


def distance_to_segment(points: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    displacement = b - a
    share = np.clip((points - a) @ displacement / max(displacement @ displacement, 1e-12), 0.0, 1.0)
    return np.linalg.norm(points - a - share[:, None] * displacement, axis=1)


def assert_rounded(record: Record, corners: list[np.ndarray], radii: list[float]) -> None:
    """Off the straight courses by more than 0.1 mm only within a corner's radius, and strictly inside it."""
    tools = record.tools
    begin = int(np.argmin(np.linalg.norm(tools - corners[0], axis=1)))
    tools = tools[begin:]
    off = np.min([distance_to_segment(tools, a, b) for a, b in itertools.pairwise(corners)], axis=0)
    inside = np.zeros(len(tools), bool)
    for corner, radius in zip(corners[1:-1], radii, strict=True):
        inside |= np.linalg.norm(tools - corner, axis=1) < radius
    assert off[~inside].max(initial=0.0) < STRAIGHT


def check_that_straight_moves_leave_the_corner_inside_the_radius(
    first: np.ndarray, second: np.ndarray, radius: float, speed: float, acceleration: float
) -> None:
    corners = [PLACE, PLACE + first, PLACE + second]
    lines = f" movel({pose(PLACE)})\n"
    moves = [f" movel({pose(c)}, a={acceleration}, v={speed}" for c in corners[1:]]
    blended = run(lines + f"{moves[0]}, r={radius})\n{moves[1]})\n")
    stopping = run(lines + f"{moves[0]})\n{moves[1]})\n")
    assert np.allclose(blended.tools[-1], corners[-1], atol=1e-8)
    assert_rounded(blended, corners, [radius])
    assert blended.seconds <= stopping.seconds + 2 * TICK
    # Nothing is faster, and nothing accelerates harder than twice what one move does.
    assert np.abs(blended.speeds).max() <= np.abs(stopping.speeds).max() * 1.1 + 1e-3
    assert np.abs(blended.accelerations).max() <= 2.2 * np.abs(stopping.accelerations).max() + 0.1


test_straight_moves_leave_the_corner_inside_the_radius = settings(max_examples=3, deadline=None)(
    given(offsets, offsets, st.floats(0.005, 0.08), st.floats(0.05, 0.5), st.floats(0.5, 3.0))(
        check_that_straight_moves_leave_the_corner_inside_the_radius
    )
)
test_straight_moves_leave_the_corner_inside_the_radius_many = pytest.mark.long(
    settings(max_examples=40, deadline=None)(
        given(offsets, offsets, st.floats(0.005, 0.08), st.floats(0.05, 0.5), st.floats(0.5, 3.0))(
            check_that_straight_moves_leave_the_corner_inside_the_radius
        )
    )
)


def check_that_joint_moves_leave_the_corner_inside_the_radius(
    first: np.ndarray, second: np.ndarray, radius: float, speed: float, acceleration: float
) -> None:
    corner, end = np.array(HOME) + first, np.array(HOME) + second
    moves = [f" movej({q.tolist()}, a={acceleration}, v={speed}" for q in (corner, end)]
    blended = run(f"{moves[0]}, r={radius})\n{moves[1]})\n")
    stopping = run(f"{moves[0]})\n{moves[1]})\n")
    assert blended.joints[-1] == pytest.approx(end, abs=1e-12)
    off = np.minimum(
        distance_to_segment(blended.joints, np.array(HOME), corner), distance_to_segment(blended.joints, corner, end)
    )
    away = np.linalg.norm(blended.tools - place_of(corner), axis=1)
    assert off[away >= radius].max(initial=0.0) < 1e-9
    assert blended.seconds <= stopping.seconds + 2 * TICK
    assert np.abs(blended.speeds).max(initial=0.0) <= speed * (1 + 1e-6)
    assert np.abs(blended.accelerations).max(initial=0.0) <= 2 * acceleration * (1 + 1e-6)


test_joint_moves_leave_the_corner_inside_the_radius = settings(max_examples=3, deadline=None)(
    given(turns, turns, st.floats(0.01, 0.15), st.floats(0.2, 2.0), st.floats(1.0, 6.0))(
        check_that_joint_moves_leave_the_corner_inside_the_radius
    )
)
test_joint_moves_leave_the_corner_inside_the_radius_many = pytest.mark.long(
    settings(max_examples=40, deadline=None)(
        given(turns, turns, st.floats(0.01, 0.15), st.floats(0.2, 2.0), st.floats(1.0, 6.0))(
            check_that_joint_moves_leave_the_corner_inside_the_radius
        )
    )
)


def test_blend_corner_is_faster_than_stopping_and_keeps_moving() -> None:
    corners = [PLACE, at(0.0, 0.1, 0.0), at(0.0, 0.1, 0.1)]
    moves = f" movel({pose(PLACE)})\n movel({pose(corners[1])}, r=0.03)\n movel({pose(corners[2])})\n"
    blended, stopping = run(moves), run(moves.replace(", r=0.03", ""))
    assert blended.seconds < stopping.seconds - 0.15
    speeds = np.linalg.norm(np.diff(blended.tools, axis=0), axis=1) / TICK
    near = np.linalg.norm(blended.tools[1:] - corners[1], axis=1) < 0.02
    assert speeds[near].min() > 0.1


def test_blend_joint_and_straight_moves_keeps_moving() -> None:
    corner = [0.3, *HOME[1:]]
    end = place_of(np.array(corner)) + np.array([0.0, 0.0, 0.1])
    moves = (
        f" movej({corner}, a=3, v=0.8, r=0.05)\n movel({pose(end)}, a=2, v=0.4, r=0.05)\n movej({HOME}, a=3, v=0.8)\n"
    )
    record = run(moves)
    assert record.joints[-1].tolist() == HOME
    first, second = place_of(np.array(corner)), end
    away = np.minimum(*(np.linalg.norm(record.tools - c, axis=1) for c in (first, second)))
    assert 0.002 < np.linalg.norm(record.tools - first, axis=1).min() < 0.05
    assert 0.002 < np.linalg.norm(record.tools - second, axis=1).min() < 0.05
    moving = np.linalg.norm(record.speeds, axis=1)
    assert moving[away[1:] < 0.05].min() > 0.1
    assert np.abs(record.accelerations).max() < 15


def test_blend_overlapping_radii_drops_the_second_with_warning() -> None:
    corners = [PLACE, at(0.0, 0.1, 0.0), at(0.0, 0.1, 0.05), at(0.1, 0.1, 0.05)]
    moves = [f" movel({pose(c)}, r={r})\n" for c, r in zip(corners, (0, 0.03, 0.03, 0), strict=True)]
    record = run("".join(moves))
    assert "overlapping blends: radius 0.03 m after 0.03 m on 0.0500 m" in record.message("overlapping")
    assert_rounded(record, corners, [0.03, 1e-9])
    assert np.linalg.norm(record.tools - corners[2], axis=1).min() < 1e-6


def test_blend_move_shorter_than_radius_stops_at_corner() -> None:
    corners = [PLACE, at(0.0, 0.1, 0.0), at(0.0, 0.1, 0.02)]
    record = run("".join(f" movel({pose(c)}, r={r})\n" for c, r in zip(corners, (0, 0.05, 0), strict=True)))
    assert "shorter than the blend" in record.message("shorter")
    assert np.linalg.norm(record.tools - corners[1], axis=1).min() < 1e-5
    assert np.allclose(record.tools[-1], corners[-1], atol=1e-8)


def test_blend_many_corners_rounds_each() -> None:
    corners = [at(0.0, 0.08 * (n // 2 % 2), 0.04 * (n - n // 2)) for n in range(9)]
    radii = [0.01] * 7
    lines = "".join(f" movel({pose(c)}, v=0.3, a=2, r={r})\n" for c, r in zip(corners, [0, *radii, 0], strict=True))
    record = run(lines)
    assert_rounded(record, corners, radii)
    for corner in corners[1:-1]:
        assert np.linalg.norm(record.tools - corner, axis=1).min() < 0.01
    assert not record.message("overlapping")


@pytest.mark.parametrize("stop", ["stopj(4)", "stopl(2)", "sleep(0.2)"])
def test_blend_stopped_midway_brakes(stop: str) -> None:
    corner, end = [0.4, *HOME[1:]], [0.4, -1.5, *HOME[2:]]
    seconds = math.sqrt(0.4 / 3) * 2 - 0.1
    lines = f""" thread mover():
  movej({corner}, a=3, v=2, r=0.1)
  movej({end}, a=3, v=2)
 end
 handle = run mover()
 sleep({seconds})
 kill handle
 {stop}
"""
    record = run(lines)
    assert not record.controller.arm.moving
    assert record.joints[-1] != pytest.approx(corner, abs=1e-3)
    assert np.abs(record.accelerations).max() < 13


def check_that_process_moves_keep_their_tool_speed_round_the_corner(
    first: np.ndarray, second: np.ndarray, radius: float, speed: float
) -> None:
    acceleration = 1.5
    corners = [PLACE, PLACE + first, PLACE + first + second]
    # Nearer to the base's axis than the wrist's offset no pose has a solution, and just outside it the base must race.
    assume(min(distance_to_segment(AXIS, a[:2], b[:2])[0] for a, b in itertools.pairwise(corners)) > 0.25)
    moves = [f" movep({pose(c)}, a={acceleration}, v={speed}" for c in corners[1:]]
    record = run(f" movel({pose(PLACE)})\n{moves[0]}, r={radius})\n{moves[1]})\n")
    assert np.allclose(record.tools[-1], corners[-1], atol=1e-8)
    assert_rounded(record, corners, [radius])
    begin = int(np.argmin(np.linalg.norm(record.tools - PLACE, axis=1)))
    tool_speeds = np.linalg.norm(np.diff(record.tools[begin:], axis=0), axis=1) / TICK
    assert tool_speeds.max() <= speed * 1.001 + 1e-6
    changes = np.diff(tool_speeds) / TICK
    assert np.abs(changes).max() <= 2.1 * acceleration
    lengths = [np.linalg.norm(b - a) for a, b in itertools.pairwise(corners)]
    bend = math.acos(np.clip((first @ second) / max(lengths[0] * lengths[1], 1e-12), -1, 1))
    if min(lengths) > radius and bend < 2.5:
        admitted = min(speed, math.sqrt(acceleration * radius / math.tan(max(bend, 1e-6) / 2)))
        ramp = speed**2 / (2 * acceleration)
        if min(lengths) > radius + ramp + 0.01:
            near = np.linalg.norm(record.tools[begin + 1 :] - corners[1], axis=1) < radius
            assert tool_speeds[near].min() >= 0.98 * admitted


test_process_moves_keep_their_tool_speed_round_the_corner = settings(max_examples=3, deadline=None)(
    given(offsets, offsets, st.floats(0.01, 0.06), st.floats(0.05, 0.4))(
        check_that_process_moves_keep_their_tool_speed_round_the_corner
    )
)
test_process_moves_keep_their_tool_speed_round_the_corner_many = pytest.mark.long(
    settings(max_examples=40, deadline=None)(
        given(offsets, offsets, st.floats(0.01, 0.06), st.floats(0.05, 0.4))(
            check_that_process_moves_keep_their_tool_speed_round_the_corner
        )
    )
)


def test_movep_many_corners_keeps_speed() -> None:
    corners = [at(0.0, 0.1 * (n // 2 % 2), 0.05 * (n - n // 2)) for n in range(9)]
    lines = "".join(
        f" movep({pose(c)}, v=0.1, a=2, r={r})\n" for c, r in zip(corners[1:], [*[0.015] * 7, 0], strict=True)
    )
    record = run(f" movel({pose(PLACE)})\n{lines}")
    assert_rounded(record, corners, [0.015] * 7)
    speeds = np.linalg.norm(np.diff(record.tools, axis=0), axis=1) / TICK
    speeds = speeds[int(np.argmin(np.linalg.norm(record.tools - PLACE, axis=1))) :]
    full = np.flatnonzero(speeds > 0.0999)
    assert speeds[full[0] : full[-1]].min() > 0.0995
    assert len(full) * TICK > 3.5


def test_movep_next_to_other_moves_blends() -> None:
    corners = [at(0.0, 0.0, 0.0), at(0.0, 0.1, 0.0), at(0.0, 0.1, 0.1), at(0.1, 0.1, 0.1)]
    lines = "".join(
        f" {move}({pose(c)}, v=0.2, a=1.5, r={r})\n"
        for move, c, r in zip(("movel", "movep", "movel", "movep"), corners, (0, 0.03, 0.03, 0), strict=True)
    )
    record = run(lines)
    assert np.allclose(record.tools[-1], corners[-1], atol=1e-8)
    assert_rounded(record, corners, [0.03, 0.03])
    for corner in corners[1:-1]:
        assert 1e-3 < np.linalg.norm(record.tools - corner, axis=1).min() < 0.03
    assert np.abs(record.accelerations).max() < 15


def test_movep_rotation_through_arc_is_even() -> None:
    places = [PLACE, at(0.0, 0.12, 0.0), at(0.0, 0.12, 0.12)]
    ends = ["2.2214, 2.2214, 0", "2.0, 2.3, 0.3", "2.3, 2.0, -0.3"]
    poses = ["p[" + ",".join(map(str, p)) + f", {e}]" for p, e in zip(places, ends, strict=True)]
    record = run(f" movel({poses[0]})\n movep({poses[1]}, v=0.2, r=0.03)\n movep({poses[2]}, v=0.2)\n")
    assert np.abs(record.accelerations).max() < 8
    assert np.allclose(record.tools[-1], places[-1], atol=1e-8)


def test_movep_reversal_stops_at_corner() -> None:
    turning_point = at(0.0, 0.1, 0.0)
    record = run(f" movel({pose(PLACE)})\n movep({pose(turning_point)}, r=0.02)\n movep({pose(PLACE)})\n")
    assert "too sharp" in record.message("too sharp")
    assert np.linalg.norm(record.tools - turning_point, axis=1).min() < 0.02
    assert np.allclose(record.tools[-1], PLACE, atol=1e-8)
    assert np.abs(record.accelerations).max() < 20
