"""Capsules, certified edges and cones against meshes and ray casting."""

import fcl
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from acquisition import geometry, lamp_pose
from acquisition.models.cell_config import Box, Capsule, CapsuleShape, HalfSpace, Pose
from acquisition.waypoints import collision_kernels as kernels
from acquisition.waypoints import shape_kernels as shapes
from acquisition.waypoints.collision import NODE_SLACK_M, scene
from acquisition.waypoints.kinematics import forward
from acquisition.waypoints.reach import refusals
from acquisition.waypoints.roadmap import dome_lights
from tests import audit
from tests.acquisition.waypoints.cells import random_cell, simulated_cell


@settings(max_examples=12, deadline=None, derandomize=True)
@given(seed=st.integers(0, 10**6))
def test_free_configuration_touching_in_meshes_is_refused(seed: int) -> None:
    cell, calibration = random_cell(seed)
    joints = np.random.default_rng(seed).uniform(-np.pi, np.pi, (150, 6))
    free = scene(cell, calibration).free(joints)
    touching = {hit.sample: hit for hit in audit.audit(joints, cell)}
    assert [hit for sample, hit in touching.items() if free[sample]] == []


@settings(max_examples=12, deadline=None, derandomize=True)
@given(seed=st.integers(0, 10**6))
def test_edges_free_certified_touch_nothing_in_meshes(seed: int) -> None:
    cell, calibration = random_cell(seed)
    arm = scene(cell, calibration)
    random = np.random.default_rng(seed)
    joints = random.uniform(-np.pi, np.pi, (3000, 6))
    joints = joints[arm.free(joints)][:60]
    starts, ends = joints[:-1], joints[1:]
    ends = starts + (ends - starts) * random.uniform(0.05, 0.6, (len(starts), 1))
    certified = np.flatnonzero(arm.edges_free(starts, ends))[:10]
    samples = [audit.samples_along([starts[index], ends[index]], 0.02) for index in certified]
    assert audit.audit(np.concatenate([np.empty((0, 6)), *samples]), cell) == []


def test_edges_free_certified_keep_minimum_distances() -> None:
    cell, calibration = simulated_cell()
    arm = scene(cell, calibration)
    random = np.random.default_rng(1)
    joints = random.uniform(-np.pi, np.pi, (2000, 6))
    joints = joints[arm.free(joints)]
    starts = joints[:-1]
    ends = starts + 0.3 * (joints[1:] - starts)
    free = arm.edges_free(starts, ends)
    least = np.array([*arm.obstacles[:, 1], arm.self_margin])
    assert 0.2 < free.mean() < 0.98
    for index, certified in enumerate(free[:300]):
        margin = (arm.clearance(audit.samples_along([starts[index], ends[index]], 0.005)) - least).min()
        assert margin >= -1e-4 if certified else margin < 0.001


def test_edges_free_edge_through_thin_pole_is_refused() -> None:
    cell, calibration = simulated_cell()
    home, aside = np.array([cell.arm.home]), np.array([0.6, 0, 0, 0, 0, 0])
    x, y, _ = forward(scene(cell, calibration).model, home)[0, 6, :3, 3].tolist()
    pole = Capsule(name="pole", start_m=(x, y, 0.0), end_m=(x, y, 1.0), radius_m=0.002)
    with_pole = scene(cell.model_copy(update={"obstacles": [pole]}), calibration)
    assert with_pole.free(np.vstack([home - aside, home + aside])).all()
    assert scene(cell, calibration).edges_free(home - aside, home + aside)[0]
    assert not with_pole.edges_free(home - aside, home + aside)[0]
    assert with_pole.describe_violation(int(with_pole.violations(home)[0])) == ("hits-obstacle", "pole")


def test_free_each_obstacle_has_its_own_clearance() -> None:
    cell, calibration = simulated_cell()
    home = np.array([cell.arm.home])
    x, y, z = forward(scene(cell, calibration).model, home)[0, 6, :3, 3].tolist()
    wall = HalfSpace(name="wall", point_m=(x, y + 0.2, z), normal=(0.0, -1.0, 0.0))
    usual = scene(cell.model_copy(update={"obstacles": [wall]}), calibration)
    away = float(usual.clearance(home)[0, -2])
    assert away > cell.clearances.obstacle_m + NODE_SLACK_M
    assert usual.free(home)[0]
    careful = wall.model_copy(update={"clearance_m": away + 0.01})
    assert not scene(cell.model_copy(update={"obstacles": [careful]}), calibration).free(home)[0]


def test_scene_cable_allowance_widens_wrist_and_tool_only() -> None:
    cell, calibration = simulated_cell()
    joints = np.random.default_rng(6).uniform(-np.pi, np.pi, (300, 6))
    bare = scene(cell, calibration)
    laid = scene(cell.model_copy(update={"arm": cell.arm.model_copy(update={"cable_allowance_m": 0.02})}), calibration)
    lost = (bare.clearance(joints) - laid.clearance(joints))[:, :-1]
    assert (lost > -1e-9).all()
    assert (lost < 0.02 + 1e-9).all()
    table = lost[:, 0]
    assert (table > 0.019).any()
    assert (table == 0).any()


def test_light_occluder_post_before_lamp_is_named() -> None:
    cell, calibration = simulated_cell()
    lights = dome_lights(cell, calibration, 60)
    reasons = refusals(lights, cell, calibration)
    number = next(n for n in range(30, 60) if reasons[n] is None)
    emitter = geometry.transform(lamp_pose.base_from_view(calibration), lights[number].position)
    middle = np.array(cell.object.keep_out.base_from_object.position_m) * 0.4 + 0.6 * emitter
    x, y, z = middle.tolist()
    post = Capsule(name="post", start_m=(x, y, z), end_m=(x, y, z + 0.001), radius_m=0.003)
    shadowed = refusals([lights[number]], cell.model_copy(update={"obstacles": [post]}), calibration)[0]
    assert shadowed is not None
    assert shadowed.reason == "shadows-object"
    assert "post" in shadowed.detail


def test_violations_name_the_colliding_body() -> None:
    cell, calibration = simulated_cell()
    arm = scene(cell, calibration)
    joints = np.random.default_rng(2).uniform(-np.pi, np.pi, (4000, 6))
    violations = arm.violations(joints)
    clearance = arm.clearance(joints)
    least = np.array([*arm.obstacles[:, 1], arm.self_margin]) + NODE_SLACK_M
    assert ((violations < 0) == (clearance >= least).all(axis=1)).all()
    bodies = {arm.describe_violation(int(violation)) for violation in violations if violation >= 0}
    assert {word for word, _ in bodies} == {"hits-table", "hits-object", "hits-camera", "self-collision"}
    for violation in set(violations[violations >= 0].tolist()):
        assert (clearance[violations == violation, violation] < least[violation]).all()


@pytest.mark.parametrize("shape", ["box", "cylinder", "cone", "hull", "half-space", "capsule"])
def test_clearance_agrees_with_independent_library(shape: str) -> None:
    random = np.random.default_rng(5)
    row, vertices = np.zeros(shapes.ROW), np.zeros((0, 3))
    pose = trimesh.transformations.random_rotation_matrix(random.uniform(size=3))
    pose[:3, 3] = random.normal(size=3)
    axis, middle = pose[:3, 2], pose[:3, 3] + 0.25 * pose[:3, 2]
    if shape == "box":
        row[:17] = [shapes.BOX, 0, *pose[:3, 3], *pose[:3, :3].ravel(), 0.1, 0.3, 0.2]
        other = fcl.CollisionObject(fcl.Box(0.2, 0.6, 0.4), fcl.Transform(pose[:3, :3], pose[:3, 3]))
    elif shape == "cylinder":
        row[:10] = [shapes.CYLINDER, 0, *pose[:3, 3], *axis, 0.2, 0.5]
        other = fcl.CollisionObject(fcl.Cylinder(0.2, 0.5), fcl.Transform(pose[:3, :3], middle))
    elif shape == "cone":
        row[:11] = [shapes.CONE, 0, *pose[:3, 3], *axis, 0.3, 0.5, 0.0]
        other = fcl.CollisionObject(fcl.Cone(0.3, 0.5), fcl.Transform(pose[:3, :3], middle))
    elif shape == "hull":
        vertices = random.normal(0, 0.2, (30, 3)) + pose[:3, 3]
        solid = trimesh.convex.convex_hull(vertices)
        radius = np.linalg.norm(vertices - pose[:3, 3], axis=1).max()
        row[:11] = [shapes.HULL, 0, *pose[:3, 3], *pose[:3, 3], radius, 0, 30]
        faces = np.hstack([np.full((len(solid.faces), 1), 3), solid.faces]).ravel()
        other = fcl.CollisionObject(fcl.Convex(solid.vertices, len(solid.faces), faces), fcl.Transform())
    elif shape == "capsule":
        row[:9] = [shapes.CAPSULE, 0, *pose[:3, 3], *(pose[:3, 3] + 0.5 * axis), 0.2]
        other = fcl.CollisionObject(fcl.Capsule(0.2, 0.5), fcl.Transform(pose[:3, :3], middle))
    else:
        row[:6] = [shapes.HALF_SPACE, 0, *axis, axis @ pose[:3, 3]]
        slab = fcl.Transform(pose[:3, :3], pose[:3, 3] - 5.0 * axis)
        other = fcl.CollisionObject(fcl.Box(100.0, 100.0, 10.0), slab)
    apart = 0
    for _ in range(300):
        line = np.concatenate([pose[:3, 3], pose[:3, 3]]) + random.normal(0, 0.7, 6)
        along = line[3:] - line[:3]
        length = float(np.linalg.norm(along))
        turn = trimesh.geometry.align_vectors((0, 0, 1), along / length)[:3, :3]
        thin = fcl.CollisionObject(fcl.Capsule(1e-6, length), fcl.Transform(turn, (line[:3] + line[3:]) / 2))
        truth = fcl.distance(thin, other, fcl.DistanceRequest(), fcl.DistanceResult())
        distance = shapes.line_to_obstacle(row[None], 0, vertices, line[None], 0, np.nan, np.nan)
        if truth > 1e-3:
            apart += 1
            assert distance == pytest.approx(truth, abs=1e-4)
        elif truth < 0:
            assert distance < 1e-4
    assert 30 < apart < 290


def test_blocked_cones_agree_with_cast_rays() -> None:
    """No occlusion seen by cast rays is accepted; few unoccluded configurations are refused."""
    cell, calibration = simulated_cell()
    arm = scene(cell, calibration)
    random = np.random.default_rng(4)
    # Configurations about the object, so that a good part of them occludes the view.
    joints = np.array(cell.arm.home) + random.uniform(-1.2, 1.2, (3000, 6))
    joints = joints[arm.free(joints)][:120]
    emitters = (forward(arm.model, joints)[:, 6] @ cell.arm.flange_from_tool.matrix)[:, :3, 3].copy()
    blocked = arm.blocked_cones(joints, emitters)
    in_view = audit.occlusions(joints, cell, audit.lens(calibration), with_tool=True)
    assert len(in_view) > 5
    assert all(blocked[sample] == kernels.VIEW_BLOCKED for sample in in_view)
    clear = np.flatnonzero(blocked < 0)
    assert len(clear) > 20
    for sample in clear[:30]:
        assert audit.occlusions(joints[[sample]], cell, emitters[sample], with_tool=False) == []


def test_scene_refuses_joints_that_are_no_numbers() -> None:
    """No distance of theirs is below any clearance, so that they would seem free."""
    cell, calibration = simulated_cell()
    arm, home = scene(cell, calibration), np.array([cell.arm.home])
    unknown = home.copy()
    unknown[0, 2] = np.nan
    for check in (arm.free, arm.clearance, lambda joints: arm.edges_free(home, joints)):
        with pytest.raises(ValueError, match="finite"):
            check(unknown)


def test_half_space_without_a_direction_is_refused() -> None:
    with pytest.raises(ValidationError, match="no direction"):
        HalfSpace(name="table", point_m=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 0.0))


def test_tool_keeps_its_clearance_from_the_wrist() -> None:
    """A lamp beside the flange comes within 4 mm of the second last wrist, and overlaps it nowhere."""
    cell, calibration = simulated_cell()
    lamp = CapsuleShape(start_m=(0.1, 0.0, 0.0), end_m=(0.1, 0.0, 0.05), radius_m=0.04)
    cell = cell.model_copy(update={"arm": cell.arm.model_copy(update={"tool_capsules": [lamp]})})
    arm = scene(cell, calibration)
    joints = np.random.default_rng(1).uniform(-np.pi, np.pi, (30_000, 6))
    joints = joints[arm.free(joints)]
    frames = forward(arm.model, joints)
    share = np.linspace(0, 1, 30)[:, None]
    for wrist in np.flatnonzero(arm.links == 4):
        lines = [
            np.einsum("nij,kj->nki", frames[:, link, :3, :3], (1 - share) * row[:3] + share * row[3:6])
            + frames[:, link, None, :3, 3]
            for link, row in ((6, arm.capsules[-1]), (4, arm.capsules[wrist]))
        ]
        apart = np.linalg.norm(lines[0][:, :, None] - lines[1][:, None], axis=-1).min(axis=(1, 2))
        assert apart.min() - arm.capsules[-1, 6] - arm.capsules[wrist, 6] > cell.clearances.self_m


@pytest.mark.parametrize("wrong", [(0.1, -0.1, 0.1), (0.1, 0.0, 0.1)])
def test_box_without_extent_is_refused(wrong: tuple[float, float, float]) -> None:
    """From a box of negative extents the arm would keep less than no distance."""
    with pytest.raises(ValidationError, match="greater than 0"):
        Box(name="stand", base_from_box=Pose(position_m=(0.5, 0.0, 0.0)), half_extents_m=wrong)
