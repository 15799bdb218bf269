"""Routes: complete, certified, within the speed limits, deterministic, or refused with reasons."""

import itertools
import os
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acquisition import lamp_pose
from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import Capsule, CellConfig
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import Light
from acquisition.models.route import JointPath, Refusal, Route
from acquisition.waypoints import order_kernels
from acquisition.waypoints import roadmap as roadmap_module
from acquisition.waypoints.collision import scene
from acquisition.waypoints.motion import trapezoid_seconds
from acquisition.waypoints.reach import reach, refusals
from acquisition.waypoints.roadmap import dome_lights, roadmap
from acquisition.waypoints.routing import path_between, retreat, route
from tests import audit
from tests.acquisition.waypoints.cells import random_cell, simulated_cell


def some_lights(cell: CellConfig, calibration: Calibration, count: int, seed: int) -> list[Light]:
    """Up to `count` reachable lights drawn from the dome."""
    lights = dome_lights(cell, calibration, cell.dome.candidates)
    drawn = [lights[number] for number in np.random.default_rng(seed).permutation(len(lights))[: 2 * count]]
    reasons = refusals(drawn, cell, calibration)
    return [light for light, refusal in zip(drawn, reasons, strict=True) if refusal is None][:count]


def corners(planned: Route) -> list[tuple[float, ...]]:
    """All joint configurations of a route in the order of travel."""
    return [planned.start, *(item for waypoint in planned.waypoints for item in waypoint.path), *planned.home_path]


def tool_points(joints: np.ndarray, cell: CellConfig) -> np.ndarray:
    """The emitter (N, 3) in base, by the audit's kinematics."""
    return (audit.link_frames(cell.arm.model, joints)[:, 6] @ cell.arm.flange_from_tool.matrix)[:, :3, 3]


@pytest.fixture(scope="module")
def eight() -> tuple[CellConfig, Calibration, list[Light], Route]:
    cell, calibration = simulated_cell()
    lights = some_lights(cell, calibration, 8, seed=0)
    return cell, calibration, lights, route(lights, cell.arm.home, cell, calibration)


def test_route_starts_at_arm_serves_all_and_ends_at_home(
    eight: tuple[CellConfig, Calibration, list[Light], Route],
) -> None:
    cell, _, lights, planned = eight
    assert planned.start == cell.arm.home
    assert sorted(planned.light_numbers) == list(range(8))
    assert [waypoint.light for waypoint in planned.waypoints] == [lights[n] for n in planned.light_numbers]
    assert planned.home_path[-1] == cell.arm.home
    for waypoint in planned.waypoints:
        assert len(waypoint.speeds) == len(waypoint.path)
    assert len(planned.home_speeds) == len(planned.home_path)
    assert planned.lower_bound_s <= planned.seconds * 1.001


def test_route_waypoints_put_lamp_at_planned_poses(
    eight: tuple[CellConfig, Calibration, list[Light], Route],
) -> None:
    cell, calibration, _, planned = eight
    joints = np.array([waypoint.joints for waypoint in planned.waypoints])
    base_from_tool = audit.link_frames(cell.arm.model, joints)[:, 6] @ cell.arm.flange_from_tool.matrix
    for waypoint, pose in zip(planned.waypoints, base_from_tool, strict=True):
        light = lamp_pose.light_from_tool(pose, calibration)
        assert np.allclose(light.position, waypoint.light.position, atol=1e-6)
        assert np.allclose(light.axis, waypoint.light.axis, atol=1e-6)


def test_route_tool_and_elbow_keep_speed_limits(eight: tuple[CellConfig, Calibration, list[Light], Route]) -> None:
    cell, _, _, planned = eight
    speeds = [*itertools.chain.from_iterable(waypoint.speeds for waypoint in planned.waypoints), *planned.home_speeds]
    fastest_tool = 0.0
    for (start, end), speed in zip(itertools.pairwise(np.array(corners(planned))), speeds, strict=True):
        leading = np.abs(end - start).max()
        samples = start + np.linspace(0, 1, 2000)[:, None] * (end - start)
        step_s = leading / speed / 1999  # at full speed, however short the segment
        tool = np.linalg.norm(np.diff(tool_points(samples, cell), axis=0), axis=1).max() / step_s
        elbow_points = audit.link_frames(cell.arm.model, samples)[:, 2, :3, 3]
        elbow = np.linalg.norm(np.diff(elbow_points, axis=0), axis=1).max() / step_s
        assert tool <= cell.arm.max_tool_speed_m_s
        assert elbow <= cell.arm.max_elbow_speed_m_s
        assert speed <= cell.arm.max_joint_speed_rad_s
        fastest_tool = max(fastest_tool, tool)
    assert fastest_tool > 0.9 * cell.arm.max_tool_speed_m_s  # nor slower than necessary


def test_route_seconds_equal_its_trapezoids(
    eight: tuple[CellConfig, Calibration, list[Light], Route],
) -> None:
    cell, _, _, planned = eight
    speeds = [*itertools.chain.from_iterable(waypoint.speeds for waypoint in planned.waypoints), *planned.home_speeds]
    angles = np.array([np.abs(end - start).max() for start, end in itertools.pairwise(np.array(corners(planned)))])
    seconds = trapezoid_seconds(angles, np.array(speeds), cell.arm.max_joint_acceleration_rad_s2)
    assert seconds.sum() == pytest.approx(planned.seconds)
    # 0.3 rad at 1.05 rad/s and 1.4 rad/s² took a controller 0.926 s
    assert trapezoid_seconds(np.array([0.3]), np.array([1.05]), 1.4)[0] == pytest.approx(0.926, abs=1e-3)


def test_route_same_lights_gives_same_route(eight: tuple[CellConfig, Calibration, list[Light], Route]) -> None:
    cell, calibration, lights, planned = eight
    assert route(lights, cell.arm.home, cell, calibration) == planned


def test_route_starts_from_any_free_configuration(eight: tuple[CellConfig, Calibration, list[Light], Route]) -> None:
    cell, calibration, lights, planned = eight
    start = planned.waypoints[3].joints
    onward = route(lights[:2], start, cell, calibration)
    assert onward.start == start
    assert onward.home_path[-1] == cell.arm.home
    back = retreat(start, cell, calibration)
    assert isinstance(back, JointPath)
    assert back.path[-1] == cell.arm.home
    assert len(back.speeds) == len(back.path)


def test_route_no_lights_leads_home() -> None:
    cell, calibration = simulated_cell()
    start = (cell.arm.home[0] + 0.2, *cell.arm.home[1:])
    planned = route([], start, cell, calibration)
    assert planned.waypoints == []
    assert planned.home_path == [cell.arm.home]


def test_route_unreachable_lights_are_named_with_reasons(
    eight: tuple[CellConfig, Calibration, list[Light], Route],
) -> None:
    cell, calibration, lights, _ = eight
    far = Light(position=(3.0, 0.0, 0.0), axis=(-1.0, 0.0, 0.0))
    under = Light(position=(lights[0].position[0], lights[0].position[1], -0.95), axis=(0.0, 0.0, 1.0))
    with pytest.raises(RigError) as caught:
        route([lights[0], far, lights[1], under], cell.arm.home, cell, calibration)
    assert caught.value.code == ErrorCode.WAYPOINTS_UNREACHABLE
    named = caught.value.context["lights"]
    assert [item["number"] for item in named] == [1, 3]
    assert named[0]["reason"] == "too-far"
    assert all(item["detail"] for item in named)


def test_route_of_many_unreachable_lights_names_the_first_few(
    eight: tuple[CellConfig, Calibration, list[Light], Route],
) -> None:
    """The sentence was of 5 kB at the size of a dome; the problem's field still lists all lights."""
    cell, calibration, lights, _ = eight
    far = [Light(position=(3.0 + 0.01 * number, 0.0, 0.0), axis=(-1.0, 0.0, 0.0)) for number in range(40)]
    with pytest.raises(RigError, match=r"^\S+: 40 lights are refused: light 1: too-far: ") as caught:
        route([lights[0], *far], cell.arm.home, cell, calibration)
    assert caught.value.detail.endswith("; and 35 more (all in `lights`)")
    assert len(caught.value.detail) < 600
    assert [item["number"] for item in caught.value.context["lights"]] == list(range(1, 41))


def test_route_unconnected_light_is_named() -> None:
    cell, calibration = random_cell(4)
    lights = dome_lights(cell, calibration, cell.dome.candidates)
    reasons = reach(cell, calibration).refusals
    cut_off = next(light for light, refusal in zip(lights, reasons, strict=True) if _reason(refusal) == "not-connected")
    good = next(light for light, refusal in zip(lights, reasons, strict=True) if refusal is None)
    with pytest.raises(RigError) as caught:
        route([good, cut_off], cell.arm.home, cell, calibration)
    assert caught.value.code == ErrorCode.WAYPOINTS_COLLISION
    assert [(item["number"], item["reason"]) for item in caught.value.context["lights"]] == [(1, "not-connected")]


def test_arm_at_the_end_of_a_branch_goes_home_and_returns() -> None:
    """A session that ends at a light which only a branch of its own connects must leave an arm that can be parked."""
    cell, calibration = random_cell(118)
    light = dome_lights(cell, calibration, 400)[193]
    joints = route([light], cell.arm.home, cell, calibration).waypoints[0].joints
    assert not len(roadmap(cell, calibration).attachments(np.array(joints), scene(cell, calibration)))
    measured = np.array(joints) + np.random.default_rng(0).uniform(-1e-3, 1e-3, 6)

    home = retreat(measured, cell, calibration)
    assert home.path[-1] == cell.arm.home
    there = path_between(cell.arm.home, measured, cell, calibration)
    corners = np.array([cell.arm.home, *there.path, *home.path])
    assert np.allclose(there.path[-1], measured)
    assert scene(cell, calibration).edges_free(corners[:-1], corners[1:]).all()
    assert route([light], measured, cell, calibration).waypoints


def test_route_colliding_start_is_refused() -> None:
    cell, calibration = simulated_cell()
    low = (cell.arm.home[0], 0.3, 0.0, 0.0, 0.0, 0.0)  # extended, through the table
    for plan in (lambda: route([], low, cell, calibration), lambda: retreat(low, cell, calibration)):
        with pytest.raises(RigError) as caught:
            plan()
        assert caught.value.code == ErrorCode.WAYPOINTS_COLLISION
        assert "by hand" in caught.value.detail


def test_route_unknown_joints_are_refused() -> None:
    cell, calibration = simulated_cell()
    with pytest.raises(RigError) as caught:
        retreat((float("nan"),) * 6, cell, calibration)
    assert caught.value.code == ErrorCode.WAYPOINTS_COLLISION


def test_route_post_between_lights_is_avoided() -> None:
    """A post beside the dome blocks straight segments; the route takes via points and touches nothing."""
    cell, calibration = simulated_cell()
    post = Capsule(name="post", start_m=(0.35, 0.25, 0.0), end_m=(0.35, 0.25, 0.6), radius_m=0.02)
    blocked = cell.model_copy(update={"obstacles": [post]})
    lights = some_lights(blocked, calibration, 12, seed=4)
    planned = route(lights, cell.arm.home, blocked, calibration)
    assert len(corners(planned)) > 1 + len(lights) + 1
    assert audit.audit(audit.samples_along(corners(planned), 0.01), blocked) == []


def check_cell(seed: int, count: int) -> Route:
    """Plans a route in a random cell and replays it on the meshes: no contact, no limit passed, no cone crossed."""
    cell, calibration = random_cell(seed)
    lights = some_lights(cell, calibration, count, seed)
    planned = route(lights, cell.arm.home, cell, calibration)
    assert sorted(planned.light_numbers) == list(range(len(lights)))
    joints = audit.samples_along(corners(planned), 0.02)
    assert np.abs(joints).max() < 2 * np.pi
    assert np.abs(np.delete(joints - np.array(cell.arm.home), 2, axis=1)).max() <= np.pi + 1e-9
    _check_speeds(planned, cell)
    assert audit.audit(joints, cell) == [], f"seed {seed}"
    stands = np.array([waypoint.joints for waypoint in planned.waypoints]).reshape(-1, 6)
    assert audit.occlusions(stands, cell, audit.lens(calibration), with_tool=True) == [], f"seed {seed}"
    emitters = tool_points(stands, cell)
    assert audit.occlusions(stands, cell, emitters, with_tool=False) == [], f"seed {seed}"
    assert [audit.hidden_by(cell, emitter) for emitter in emitters] == [[]] * len(emitters), f"seed {seed}"
    return planned


def _check_speeds(planned: Route, cell: CellConfig) -> None:
    speeds = np.array(
        [*itertools.chain.from_iterable(waypoint.speeds for waypoint in planned.waypoints), *planned.home_speeds]
    )
    stops = np.array(corners(planned))
    starts, directions = stops[:-1], np.diff(stops, axis=0)
    samples = starts[:, None] + np.linspace(0, 1, 40)[:, None] * directions[:, None]  # (legs, 40, 6)
    step_s = np.abs(directions).max(axis=1) / speeds / 39
    tool = tool_points(samples.reshape(-1, 6), cell).reshape(-1, 40, 3)
    elbow = audit.link_frames(cell.arm.model, samples.reshape(-1, 6))[:, 2, :3, 3].reshape(-1, 40, 3)
    for points, limit in ((tool, cell.arm.max_tool_speed_m_s), (elbow, cell.arm.max_elbow_speed_m_s)):
        assert (np.linalg.norm(np.diff(points, axis=1), axis=2).max(axis=1) <= limit * step_s + 1e-12).all()
    assert (speeds <= cell.arm.max_joint_speed_rad_s * (1 + 1e-9)).all()


@pytest.mark.parametrize("half", range(2))
@settings(max_examples=12, deadline=None, derandomize=True)
@given(seed=st.integers(0, 10**6))
def test_route_random_cells_neither_touch_nor_occlude(half: int, seed: int) -> None:
    """With a sparse roadmap, at a third of the cost; detours and RRT-Connect compensate."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(roadmap_module, "_DOME_LIGHTS", 16)
        check_cell(2 * seed + half, count=3)
    roadmap_module._roadmap.cache_clear()


CELLS = range(*map(int, os.environ.get("LIGHTPOSE_CELLS", "0:10000").split(":")))
CELLS_AT_A_TIME = 100


@pytest.mark.long
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("first", CELLS[::CELLS_AT_A_TIME])
def test_route_many_random_cells_neither_touch_nor_occlude(first: int) -> None:
    """LIGHTPOSE_CELLS=start:stop chooses the seeds; each hundred is one item and prints its figures."""
    some = range(first, min(first + CELLS_AT_A_TIME, CELLS.stop))
    planned = [check_cell(seed, count=6) for seed in some]
    lights, legs = sum(len(one.waypoints) for one in planned), sum(len(corners(one)) - 1 for one in planned)
    samples = sum(len(audit.samples_along(corners(one), 0.02)) for one in planned)
    print(
        f"\ncells {some.start}–{some.stop - 1}: {lights} lights, {legs} legs, {samples} samples, "
        "nothing touched, passed or crossed",
        end="",
    )
    assert lights > len(some)


def test_searched_tour_is_near_exact_tour() -> None:
    random = np.random.default_rng(11)
    for _ in range(5):
        first = np.arange(0, 8 * 4 + 1, 4)
        places = random.uniform(0, 1, (34, 3))
        seconds = np.linalg.norm(places[:, None] - places[None], axis=2)
        exact = order_kernels.exact_tour(seconds, first, 32, 33)
        searched = order_kernels.searched_tour(seconds, first, 32, 33, np.empty(0, dtype=np.int64), 40)
        assert sorted(node // 4 for node in searched) == list(range(8))
        best, heuristic = (_length(tour, seconds) for tour in (exact, searched))
        assert best == pytest.approx(min(best, heuristic))
        assert heuristic <= 1.1 * best


def test_exact_tour_is_best_of_all_permutations() -> None:
    random = np.random.default_rng(12)
    seconds = random.uniform(1, 2, (8, 8))
    seconds += seconds.T
    first = np.array([0, 2, 4, 6])
    tours = (
        [2 * stop + choice for stop, choice in zip(order, choices, strict=True)]
        for order in itertools.permutations(range(3))
        for choices in itertools.product((0, 1), repeat=3)
    )
    best = min(_length(tour, seconds, start=6, home=7) for tour in tours)
    assert _length(order_kernels.exact_tour(seconds, first, 6, 7), seconds, start=6, home=7) == pytest.approx(best)


def test_path_bound_is_below_and_near_best_tour() -> None:
    random = np.random.default_rng(13)
    shares: list[float] = []
    for _ in range(10):
        places = random.uniform(0, 1, (11, 3))
        seconds = np.linalg.norm(places[:, None] - places[None], axis=2)
        best = _length(order_kernels.exact_tour(seconds, np.arange(10), 9, 10), seconds, start=9, home=10)
        shares.append(order_kernels.path_bound(seconds, 100) / best)
    assert max(shares) <= 1 + 1e-9
    assert np.median(shares) > 0.95


def _reason(refusal: Refusal | None) -> str:
    return refusal.reason if refusal else ""


def _length(tour: Sequence[int], seconds: np.ndarray, start: int = 32, home: int = 33) -> float:
    return float(sum(seconds[a, b] for a, b in itertools.pairwise([start, *tour, home])))
