"""Collision check: the controller's spheres against FCL on the maker's meshes and on the rendered object."""

from dataclasses import replace
from pathlib import Path

import fcl
import numpy as np
import pytest
import trimesh

from acquisition.models import cell_config
from acquisition.models.base import FloatArray
from acquisition.models.cell_config import Cone, ConvexMesh, Pose
from hardware_sim import link_spheres, nominal, objects, solids
from hardware_sim.controller.contact import PARTS, ContactCheck
from hardware_sim.controller.kinematics import MODELS
from hardware_sim.controller.surroundings import Surroundings, load
from tests import audit

CELL = cell_config.load(nominal.default_cell_file())
HOME = np.array(CELL.arm.home)
EARLY_M = link_spheres.OUT_M + 0.0002
LATE_M = link_spheres.GAP_M + 0.0005
"""By how much one body may be seen too early or too late; two moving ones by twice as much."""
OBJECT_M = 0.002
"""The same of the object's balls."""


@pytest.fixture(scope="module")
def surroundings() -> Surroundings:
    return solids.surroundings(CELL, objects.build("part", 1).mesh)


@pytest.fixture(scope="module")
def check(surroundings: Surroundings) -> ContactCheck:
    return ContactCheck(MODELS["ur5e"], surroundings)


def poses(count: int, seed: int) -> FloatArray:
    """Joints (N, 6) all over the workspace, many of them near table, object or the arm itself."""
    random = np.random.default_rng(seed)
    joints = random.uniform(-np.pi, np.pi, (count, 6))
    joints[:, 1] = random.uniform(-2.4, -0.3, count)
    joints[:, 2] = random.uniform(-2.7, 2.7, count)
    return joints


def body(mesh: trimesh.Trimesh) -> fcl.BVHModel:
    model = fcl.BVHModel()
    model.beginModel(len(mesh.vertices), len(mesh.faces))
    model.addSubModel(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    model.endModel()
    return model


def apart(first: fcl.CollisionObject, second: fcl.CollisionObject) -> float:
    """The distance of two surfaces by FCL, 0 where they cross."""
    if fcl.collide(first, second, fcl.CollisionRequest(), fcl.CollisionResult()):
        return 0.0
    return max(0.0, fcl.distance(first, second, fcl.DistanceRequest(), fcl.DistanceResult()))


@pytest.mark.parametrize(
    "model", ["ur5e", *(pytest.param(m, marks=pytest.mark.long) for m in sorted(MODELS) if m != "ur5e")]
)
def test_contact_links_agree_with_meshes(model: str) -> None:
    check = ContactCheck(MODELS[model], Surroundings())
    links = [body(mesh) for mesh in audit.link_meshes(model)]
    coarse = link_spheres.ESTIMATED if model in ("ur15", "ur20", "ur30") else 1.0
    joints = poses(30, 1)
    frames = audit.link_frames(model, joints)
    met = 0
    for number, row in enumerate(joints):
        placed = [fcl.CollisionObject(link, pose(frames[number, n])) for n, link in enumerate(links)]
        for (first, second), ours in check.distances(row).items():
            theirs = apart(placed[PARTS.index(first)], placed[PARTS.index(second)])
            met += theirs == 0.0
            assert ours <= theirs + 2 * coarse * LATE_M, (row, first, second)
            if theirs > 0.0 and ours < 0.03:
                assert ours >= theirs - 2 * coarse * EARLY_M, (row, first, second)
    assert met > 0


def pose(frame: FloatArray) -> fcl.Transform:
    return fcl.Transform(np.ascontiguousarray(frame[:3, :3]), np.ascontiguousarray(frame[:3, 3]))


def test_contact_arm_and_tool_with_bodies_agree_with_meshes(check: ContactCheck) -> None:
    mesh = objects.build("part", 1).mesh
    body_mesh = trimesh.Trimesh(mesh.triangles.reshape(-1, 3), np.arange(3 * len(mesh.triangles)).reshape(-1, 3))
    body_mesh.apply_transform(CELL.object.keep_out.base_from_object.matrix)
    around = {
        "table": body(audit._mesh(CELL.table)),  # pyright: ignore[reportPrivateUsage]
        "camera": body(audit._mesh(CELL.camera_body[0])),  # pyright: ignore[reportPrivateUsage]
        "object": body(body_mesh),
    }
    tool = trimesh.util.concatenate(
        [audit._capsule(item) for item in CELL.arm.tool_capsules]  # pyright: ignore[reportPrivateUsage]
    )
    parts = dict(zip(PARTS, map(body, [*audit.link_meshes("ur5e"), tool]), strict=False))
    # Round the object, where it is narrow.
    random = np.random.default_rng(2)
    joints = np.vstack([poses(20, 3), np.array([np.pi, -0.9, 1.6, -0.8, -1.57, 0.0]) + random.normal(0, 0.25, (40, 6))])
    frames = audit.link_frames("ur5e", joints)
    met = dict.fromkeys(around, 0)
    for number, row in enumerate(joints):
        for (part, other), ours in check.distances(row).items():
            if other not in around:
                continue
            frame = frames[number, min(PARTS.index(part), 6)]
            theirs = apart(fcl.CollisionObject(parts[part], pose(frame)), fcl.CollisionObject(around[other]))
            met[other] += theirs == 0.0
            slack = OBJECT_M if other == "object" else 0.001  # FCL's capsules have facets
            # A body is its surface to FCL: what is wholly inside is no contact there.
            if theirs > 0.0 and 0.0 < ours < 0.03:
                assert ours >= theirs - EARLY_M - slack, (row, part, other)
            assert ours <= theirs + LATE_M + slack, (row, part, other)
    assert met["table"] > 10
    assert met["object"] > 1


def random_pose(random: np.random.Generator) -> Pose:
    """Somewhere, turned somehow."""
    place, turn = random.normal(0, 0.3, 3).tolist(), random.normal(0, 1, 3).tolist()
    return Pose(position_m=tuple(place), rotation_vector_rad=tuple(turn))


@pytest.mark.parametrize("size_m", [0.0, 0.06, 0.3])
@pytest.mark.parametrize("kind", ["cone", "hull"])
def test_distances_of_cones_and_hulls_agree_with_meshes(kind: str, size_m: float, tmp_path: Path) -> None:
    random = np.random.default_rng(11)
    if kind == "cone":
        body: Cone | ConvexMesh = Cone(
            name="it", base_from_cone=random_pose(random), foot_radius_m=0.1, top_radius_m=size_m, height_m=0.3
        )
        angles = np.linspace(0, 2 * np.pi, 512, endpoint=False)
        ring = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
        corners = np.vstack([0.1 * ring, size_m * ring + (0, 0, 0.3)])
        frame = body.base_from_cone.matrix
    else:
        corners = random.normal(0, 0.05 + size_m, (40, 3))
        corners = np.vstack([corners, np.array(np.meshgrid(*[[-0.1, 0.1]] * 3)).reshape(3, 8).T])
        body = ConvexMesh(name="it", base_from_mesh=random_pose(random), vertices_m=list(map(tuple, corners.tolist())))
        frame = body.base_from_mesh.matrix
    mesh = trimesh.convex.convex_hull(corners).apply_transform(frame)
    around = solids.surroundings(CELL.model_copy(update={"obstacles": [body]}), objects.build("sphere", 1).mesh)
    low, high = mesh.bounds
    points = random.uniform(low - 0.05, high + 0.05, (120, 3))
    _, away, _ = trimesh.proximity.closest_point_naive(mesh, points)
    inside = mesh.contains(points)
    assert 4 < inside.sum() < 116
    around.save(tmp_path / "surroundings.npz")
    around = load(tmp_path / "surroundings.npz")
    result = around.distances(points, around.names.index("it"))
    assert result == pytest.approx(np.where(inside, -away, away), abs=2e-5)


def test_contact_arm_above_cone_or_hull_touches_at_top() -> None:
    check = ContactCheck(MODELS["ur5e"], Surroundings())
    over = np.array(check.frames(HOME.tolist())[6]).reshape(3, 4)[:, 3]
    x, y, z = over.tolist()
    foot = Pose(position_m=(x, y, 0.0))
    top = z - 0.3
    cone = Cone(name="it", base_from_cone=foot, foot_radius_m=0.08, top_radius_m=0.05, height_m=top)
    corners = [(a, b, c) for a in (-0.06, 0.06) for b in (-0.06, 0.06) for c in (0.0, top)]
    hull = ConvexMesh(name="it", base_from_mesh=foot, vertices_m=corners)
    lowered = np.array([0.0, 0.5, 0.0, 0.0, 0.0, 0.0])
    places: list[FloatArray] = []
    for body in (cone, hull):
        bare = CELL.model_copy(update={"obstacles": [body], "camera_body": []})
        around = replace(solids.surroundings(bare, objects.build("sphere", 1).mesh), object_points=np.zeros((0, 3)))
        check = ContactCheck(MODELS["ur5e"], around)
        assert check.advance(HOME.tolist()) is None
        contact = check.advance((HOME + lowered).tolist())
        assert contact is not None
        assert (contact.first, contact.second) == ("tool", "it")
        places.append(np.array(contact.joints))
        at_contact = check.distances(contact.joints)[("tool", "it")]
        assert -0.002 < at_contact <= 0.0
    assert places[0] == pytest.approx(places[1], abs=0.03)


def test_packed_spheres_cover_body_and_stay_inside_tolerance() -> None:
    mesh = trimesh.creation.box((0.1, 0.06, 0.05))
    spheres = link_spheres.packed(mesh)
    points = mesh.sample(2000, seed=5)
    gaps = np.linalg.norm(points[:, None] - spheres[None, :, :3], axis=2) - spheres[:, 3]
    assert gaps.min(axis=1).max() <= link_spheres.GAP_M + 0.0015  # the gap is kept at points 2.5 mm apart
    reach = np.abs(spheres[:, :3]) + spheres[:, 3:]
    assert np.all(reach <= np.array([0.05, 0.03, 0.025]) + link_spheres.OUT_M + 1e-9)


def first_contact(check: ContactCheck, goal: FloatArray, steps: int) -> FloatArray | None:
    """The joints at the first contact on the straight way from home, looked for in so many calls."""
    check.reset()
    for share in np.linspace(0, 1, steps + 1):
        contact = check.advance(HOME + share * (goal - HOME))
        if contact is not None:
            return np.array(contact.joints)
    return None


def test_advance_large_steps_finds_every_contact(check: ContactCheck) -> None:
    """Adaptive sampling of a path finds the same contacts as dense sampling."""
    random = np.random.default_rng(7)
    result = 0
    for _ in range(3):
        goal = HOME + random.uniform(-1.5, 1.5, 6)
        one, many = (first_contact(check, goal, steps) for steps in (1, 30))
        shares = np.linspace(0, 1, 60)
        touching = [min(check.distances(HOME + share * (goal - HOME)).values()) <= 0 for share in shares]
        if one is None or many is None:
            assert one is many
            assert not any(touching)
            continue
        result += 1
        assert one == pytest.approx(many, abs=0.003)
        at = np.argmax(np.abs(goal - HOME))
        share = (one - HOME)[at] / (goal - HOME)[at]
        assert not any(touching[: int(share * 59)])
        if any(touching):  # a graze may fall between two of these looks
            assert share <= shares[touching.index(True)] + 1e-9
    assert result > 1


def test_surroundings_saved_file_reads_back(surroundings: Surroundings, tmp_path: Path) -> None:
    path = tmp_path / "surroundings.npz"
    surroundings.save(path)
    again = load(path)
    assert again.names == surroundings.names == ("table", "camera")
    points = np.random.default_rng(0).uniform((0.3, -0.3, 0.0), (0.8, 0.3, 1.2), (500, 3))
    for number in range(len(again.names)):
        assert np.array_equal(again.distances(points, number), surroundings.distances(points, number))
    assert np.array_equal(again.object_in_base, surroundings.object_in_base)
    assert np.array_equal(again.tool, surroundings.tool)
    np.savez(tmp_path / "other.npz", a=1)
    with pytest.raises(ValueError, match="surroundings"):
        load(tmp_path / "other.npz")


def test_surroundings_nudged_object_is_touched_at_new_pose(surroundings: Surroundings) -> None:
    moved = surroundings.nudged((0.2, 0.0, 0.01), np.pi)
    axis = CELL.object.keep_out.base_from_object.position_m
    before, after = surroundings.object_in_base - axis, moved.object_in_base - axis
    assert after == pytest.approx(before * (-1, -1, 1) + (0.2, 0.0, 0.01), abs=1e-12)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(12))
def test_contact_certified_routes_touch_nothing(seed: int) -> None:
    """The planner keeps its clearances by its own shapes; by these, nothing is even near on any of its routes."""
    from acquisition.waypoints.routing import route
    from tests.acquisition.waypoints.cells import random_cell, simulated_cell
    from tests.acquisition.waypoints.test_routing import corners, some_lights

    cell, calibration = simulated_cell() if seed == 0 else random_cell(seed)
    planned = route(some_lights(cell, calibration, 8, seed), cell.arm.home, cell, calibration)
    name = sorted(objects.SHAPES)[seed % len(objects.SHAPES)]
    check = ContactCheck(MODELS[cell.arm.model], solids.surroundings(cell, objects.build(name, seed).mesh))
    for joints in audit.samples_along(corners(planned), 0.005):
        assert check.advance(joints) is None
    for joints in audit.samples_along(corners(planned), 0.1):
        assert min(d for pair, d in check.distances(joints).items() if "base" not in pair) > 0.005
