"""Circular moves against geometry: the circle, the speed on it, and both rotation modes."""

import math

import numpy as np
import pytest

from hardware_sim.controller import kinematics, poses
from hardware_sim.controller.kinematics import MODELS
from tests.hardware_sim.controller.programs import HOME, TICK, Record, run

ARM = MODELS["ur5e"]
START = kinematics.forward(ARM, HOME)
PLACE = np.array(poses.position(START))
RADIUS = 0.06


TILTED, LEVEL = np.array([0.6, 0.0, 0.8]), np.array([1.0, 0.0, 0.0])


def on_circle(angle: float, along: np.ndarray = TILTED) -> np.ndarray:
    """A circle through the start in the plane of y and `along`, `angle` (rad) from the start."""
    across = np.array([0.0, 1.0, 0.0])
    return PLACE + RADIUS * ((math.cos(angle) - 1.0) * across + math.sin(angle) * along)


def pose(place: np.ndarray, turn: float = 0.0) -> str:
    turned = poses.rotated(poses.with_position(START, place), (0.0, 0.0, turn))
    return f"p{[float(v) for v in poses.to_ur(turned)]}"


def turns(record: Record) -> np.ndarray:
    """Rotation vectors (N, 3) in the base frame from the start's rotation."""
    frames = [kinematics.forward(ARM, joints) for joints in record.joints.tolist()]
    return np.array([poses.difference(START, frame)[1] for frame in frames])


@pytest.mark.parametrize(
    ("swept", "mode", "along"),
    [(0.5, 0, TILTED), (2.0, 0, TILTED), (5.8, 0, TILTED), (0.5, 1, TILTED), (2.0, 1, LEVEL), (4.0, 1, LEVEL)],
)
def test_movec_keeps_tool_on_circle_through_three_points(swept: float, mode: int, along: np.ndarray) -> None:
    via, end = on_circle(0.4 * swept, along), on_circle(swept, along)
    record = run(f" movec({pose(via)}, {pose(end, 0.4)}, a=1.5, v=0.15, mode={mode})")
    assert record.tools[-1] == pytest.approx(end, abs=1e-8)
    centre = PLACE - np.array([0.0, RADIUS, 0.0])
    assert np.linalg.norm(record.tools - centre, axis=1) == pytest.approx(np.full(len(record.tools), RADIUS), abs=1e-6)
    normal = np.cross(along, [0.0, 1.0, 0.0])
    assert np.abs((record.tools - PLACE) @ normal).max() < 1e-6
    assert np.linalg.norm(record.tools - via, axis=1).min() < 2e-3
    displacement = np.linalg.norm(np.diff(record.tools, axis=0), axis=1)
    assert displacement.sum() == pytest.approx(RADIUS * swept, rel=1e-4)
    length, speed, acceleration = RADIUS * swept, 0.15, 1.5
    expected = (
        length / speed + speed / acceleration
        if length > speed**2 / acceleration
        else 2 * math.sqrt(length / acceleration)
    )
    assert record.seconds == pytest.approx(expected, abs=2 * TICK)
    assert displacement.max() / TICK <= speed * 1.001


def test_movec_free_rotation_ends_at_target_rotation() -> None:
    record = run(f" movec({pose(on_circle(1.0), 2.0)}, {pose(on_circle(2.0), 0.5)})")
    frame = kinematics.forward(ARM, record.joints[-1].tolist())
    turn = poses.rotation_vector(poses.compose(poses.invert(START), frame))
    assert turn == pytest.approx([0.0, 0.0, 0.5], abs=1e-7)
    # The point on the way gives its place only.
    angles = np.linalg.norm(turns(record), axis=1)
    assert (np.diff(angles) > -1e-9).all()
    assert angles.max() == pytest.approx(0.5, abs=1e-7)


def test_movec_fixed_rotation_keeps_angle_to_tangent() -> None:
    via, end = on_circle(1.0, LEVEL), on_circle(2.0, LEVEL)
    record = run(f" movec({pose(via)}, {pose(end, 0.5)}, mode=1)")
    normal = np.cross(via - PLACE, end - PLACE)
    normal /= np.linalg.norm(normal)
    assert turns(record)[-1] == pytest.approx(2.0 * normal, abs=1e-6)
    tangents = np.diff(record.tools, axis=0)
    moving = np.linalg.norm(tangents, axis=1) > 1e-5
    frames = np.array([kinematics.forward(ARM, q) for q in record.joints[1:].tolist()]).reshape(-1, 3, 4)[:, :, :3]
    in_tool = np.einsum("nij,ni->nj", frames, tangents)[moving]
    in_tool /= np.linalg.norm(in_tool, axis=1)[:, None]
    assert np.ptp(in_tool, axis=0).max() < 5e-3


def test_movec_with_radius_blends_into_next_move() -> None:
    via, corner = on_circle(0.8), on_circle(1.6)
    end = corner + np.array([0.0, 0.0, 0.1])
    lines = f" movec({pose(via)}, {pose(corner)}, v=0.2, r=0.02)\n movel({pose(end)}, v=0.2)"
    record, stopping = run(lines), run(lines.replace(", r=0.02", ""))
    assert record.tools[-1] == pytest.approx(end, abs=1e-8)
    away = np.linalg.norm(record.tools - corner, axis=1)
    assert 5e-4 < away.min() < 0.02
    assert record.seconds < stopping.seconds
    speeds = np.linalg.norm(np.diff(record.tools, axis=0), axis=1) / TICK
    assert speeds[away[1:] < 0.01].min() > 0.05
    assert np.abs(record.accelerations).max() < 12


def test_movec_collinear_points_raises_script_error() -> None:
    ahead = [PLACE + np.array([0.0, 0.0, z]) for z in (0.05, 0.1)]
    record = run(f" movec({pose(ahead[0])}, {pose(ahead[1])})", 1.0)
    assert "movec: start, via and end must be three points of a circle" in record.message("runtime exception")
    assert (record.joints == HOME).all()


def test_movec_joint_targets_equal_poses() -> None:
    joints = [[q + d for q, d in zip(HOME, (0.1 * n, 0.05 * n * n, 0, 0, 0, 0), strict=True)] for n in (1, 2)]
    record = run(f" movec({joints[0]}, {joints[1]})")
    expected = poses.position(kinematics.forward(ARM, joints[1]))
    assert record.tools[-1] == pytest.approx(expected, abs=1e-8)
