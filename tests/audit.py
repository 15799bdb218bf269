"""Independent collision audit of the arm's motion: joint samples against meshes, with FCL.

No code of the planner is used: the forward kinematics is implemented here (and its flange compared with
`ur_analytic_ik` at every call), links are the manufacturer's collision meshes instead of capsules, and obstacles are
triangle meshes. Meshes are surfaces, so sample finely enough that no body passes inside another between two samples.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from itertools import pairwise
from pathlib import Path

import fcl
import numpy as np
import numpy.typing as npt
import trimesh
import ur_analytic_ik

from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import Box, Capsule, CapsuleShape, CellConfig, Cone, ConvexMesh, HalfSpace, Obstacle

MESHES = Path(__file__).parents[1] / "acquisition" / "waypoints" / "meshes"

FloatArray = npt.NDArray[np.float64]

# Universal Robots, "DH parameters for calculations": rows a, d, alpha.
DH = {
    "ur3e": ((0, 0.15185, 90), (-0.24355, 0, 0), (-0.2132, 0, 0), (0, 0.13105, 90), (0, 0.08535, -90), (0, 0.0921, 0)),
    "ur5e": ((0, 0.1625, 90), (-0.425, 0, 0), (-0.3922, 0, 0), (0, 0.1333, 90), (0, 0.0997, -90), (0, 0.0996, 0)),
    "ur10e": (
        (0, 0.1807, 90), (-0.6127, 0, 0), (-0.57155, 0, 0), (0, 0.17415, 90), (0, 0.11985, -90), (0, 0.11655, 0),
    ),
    "ur16e": ((0, 0.1807, 90), (-0.4784, 0, 0), (-0.36, 0, 0), (0, 0.17415, 90), (0, 0.11985, -90), (0, 0.11655, 0)),
    "ur15": ((0, 0.2186, 90), (-0.6475, 0, 0), (-0.5164, 0, 0), (0, 0.1824, 90), (0, 0.1361, -90), (0, 0.1434, 0)),
    "ur20": ((0, 0.2363, 90), (-0.862, 0, 0), (-0.7287, 0, 0), (0, 0.201, 90), (0, 0.1593, -90), (0, 0.1543, 0)),
    "ur30": ((0, 0.2363, 90), (-0.637, 0, 0), (-0.5037, 0, 0), (0, 0.201, 90), (0, 0.1593, -90), (0, 0.1543, 0)),
}  # fmt: skip
DH |= {"ur7e": DH["ur5e"], "ur12e": DH["ur10e"]}
_DRAWN_AS = {"ur7e": "ur5e", "ur12e": "ur10e"}


_LINKS = ("base", "shoulder", "upper arm", "forearm", "wrist 1", "wrist 2", "wrist 3")


@dataclass(frozen=True)
class Hit:
    """Two bodies that touch at one sample."""

    sample: int
    first: str
    second: str


@dataclass(frozen=True)
class _Body:
    """A triangle mesh that moves with a link (None: static), with its box and bounding sphere in the link's frame."""

    name: str
    link: int | None
    mesh: trimesh.Trimesh
    shape: fcl.BVHModel
    center: FloatArray
    half: FloatArray
    radius: float
    plane: tuple[FloatArray, float] | None = None  # of a half-space: outward normal, offset


def audit(
    joints: FloatArray, cell: CellConfig, object_mesh: tuple[FloatArray, npt.NDArray[np.int64]] | None = None
) -> list[Hit]:
    """All touching pairs of bodies over joint samples (N, 6): links, tool, table, object, camera, obstacles.

    `object_mesh` (vertices (V, 3) in m, base frame; faces (F, 3)) replaces the keep-out cylinder. Neighbouring links
    share a joint and are not compared; nor is the base with the table. Broad phase: FCL checks only samples at which
    neither body's bounding sphere is clear of the other's box.
    """
    frames = link_frames(cell.arm.model, joints)
    moving, still = _arm(cell), _surroundings(cell, object_mesh)
    base = next(body for body in moving if body.link == 0)
    tool_neighbours = (5, 6)
    pairs = [(body, other) for body in moving for other in still if body is not base]
    pairs += [
        (body, other)
        for body in moving
        for other in moving
        if body.link is not None
        and other.link is not None
        and other.link - body.link >= 2
        and not (other.name.startswith("tool") and body.link in tool_neighbours)
    ]
    hits: list[Hit] = []
    for first, second in pairs:
        for sample in np.flatnonzero(_near(first, second, frames)):
            one, two = (
                fcl.CollisionObject(body.shape, _transform(frames[sample], body.link)) for body in (first, second)
            )
            if fcl.collide(one, two, fcl.CollisionRequest(), fcl.CollisionResult()):
                hits.append(Hit(int(sample), first.name, second.name))
    return hits


def samples_along(corners: Sequence[Sequence[float]], step_rad: float = 0.01) -> FloatArray:
    """Joint samples (N, 6) along straight joint segments, no joint turning further than `step_rad` between two."""
    points = np.array(corners, dtype=float)
    pieces = [points[:1]]
    for start, end in pairwise(points):
        count = max(int(np.ceil(np.abs(end - start).max() / step_rad)), 1)
        pieces.append(start + (np.arange(1, count + 1) / count)[:, None] * (end - start))
    return np.concatenate(pieces)


def thinned(joints: FloatArray, step_rad: float = 0.005) -> FloatArray:
    """Subsamples a trace (N, 6): omits samples in which no joint has turned by `step_rad` since the last one kept."""
    kept = [0]
    for number in range(1, len(joints)):
        if np.abs(joints[number] - joints[kept[-1]]).max() >= step_rad:
            kept.append(number)
    return joints[kept]


def occlusions(joints: FloatArray, cell: CellConfig, origins: FloatArray, with_tool: bool) -> list[int]:
    """Ray casting: the samples of (N, 6) at which the arm occludes the keep-out cylinder from a point.

    `origins` is one point (3,) or one for each sample (N, 3). `with_tool` False omits the tool, for rays from the lamp
    itself.
    """
    frames = link_frames(cell.arm.model, joints)
    origins = np.broadcast_to(origins, (len(joints), 3))
    targets = _cylinder_points(cell)
    parts = [body for body in _arm(cell) if with_tool or not body.name.startswith("tool")]
    return [
        sample
        for sample, origin in enumerate(origins)
        if any(_between(body, frames[sample, body.link], origin, targets) for body in parts)
    ]


def hidden_by(cell: CellConfig, origin: FloatArray) -> list[str]:
    """Ray casting: the camera's bodies and obstacles that occlude the keep-out cylinder from a point (3,)."""
    targets = _cylinder_points(cell)
    bodies = [_standing(item) for item in (*cell.camera_body, *cell.obstacles)]
    return [body.name for body in bodies if _between(body, np.eye(4), origin, targets)]


def _between(body: _Body, frame: FloatArray, origin: FloatArray, targets: FloatArray) -> bool:
    """Whether a body, its frame (4, 4) in base, intersects a line segment from a point (3,) to others (N, 3)."""
    start, *ends = (np.vstack([origin, targets]) - frame[:3, 3]) @ frame[:3, :3]
    reach = np.array(ends) - start
    # All segments are within this distance of the one to the targets' centre; most bodies are further away.
    middle = reach.mean(axis=0)
    wide = np.linalg.norm(reach - middle, axis=1).max()
    share = np.clip((body.center - start) @ middle / (middle @ middle), 0.0, 1.0)
    if np.linalg.norm(start + share * middle - body.center) > wide + body.radius:
        return False
    places, rays, _ = body.mesh.ray.intersects_location(np.tile(start, (len(reach), 1)), reach, multiple_hits=False)
    return bool((np.linalg.norm(places - start, axis=1) < np.linalg.norm(reach[rays], axis=1)).any())


def lens(calibration: Calibration) -> FloatArray:
    """The camera's centre (3,) in base, m."""
    return np.array(calibration.base_from_camera)[:3, 3]


def link_frames(model: str, joints: FloatArray) -> FloatArray:
    """Link frames (N, 7, 4, 4) in base, 0 the base and 6 the flange."""
    frames = np.tile(np.eye(4), (len(joints), 7, 1, 1))
    for joint, (a, d, twist_deg) in enumerate(DH[model]):
        twist = np.eye(4)
        twist[:3, :3] = trimesh.transformations.rotation_matrix(np.radians(twist_deg), (1, 0, 0))[:3, :3]
        shift = np.eye(4)
        shift[:3, 3] = a, 0, d
        turn = np.tile(np.eye(4), (len(joints), 1, 1))
        angle = joints[:, joint]
        turn[:, 0, 0], turn[:, 0, 1], turn[:, 1, 0], turn[:, 1, 1] = (
            np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle),
        )  # fmt: skip
        frames[:, joint + 1] = frames[:, joint] @ turn @ shift @ twist
    known = hasattr(ur_analytic_ik, model)
    for number in {0, len(joints) // 2, len(joints) - 1} if len(joints) and known else set():
        other = getattr(ur_analytic_ik, model).forward_kinematics(*joints[number])
        assert np.allclose(other, frames[number, 6], atol=1e-9), "two independent kinematics disagree"
    return frames


def _arm(cell: CellConfig) -> list[_Body]:
    tool = [_tool_body(item.model_dump_json(), number) for number, item in enumerate(cell.arm.tool_capsules)]
    return [*_link_bodies(cell.arm.model), *tool]


@cache
def link_meshes(model: str) -> tuple[trimesh.Trimesh, ...]:
    """The manufacturer's collision meshes of the seven links, base first, each in its link's DH frame, m.

    Those of the UR15, UR20 and UR30 are estimates (`acquisition.waypoints.estimated_links`).
    """
    with np.load(MESHES / f"{_DRAWN_AS.get(model, model)}.npz") as stored:
        names = sorted(name.removesuffix("_faces") for name in stored.files if name.endswith("_faces"))
        return tuple(
            trimesh.Trimesh(stored[f"{name}_vertices"], stored[f"{name}_faces"], process=False) for name in names
        )


@cache
def _link_bodies(model: str) -> tuple[_Body, ...]:
    links = enumerate(zip(_LINKS, link_meshes(model), strict=True))
    return tuple(_body(name, link, mesh) for link, (name, mesh) in links)


@lru_cache(maxsize=16)
def _tool_body(capsule_json: str, number: int) -> _Body:
    return _body(f"tool {number}", 6, _capsule(CapsuleShape.model_validate_json(capsule_json)))


def _surroundings(cell: CellConfig, object_mesh: tuple[FloatArray, npt.NDArray[np.int64]] | None) -> list[_Body]:
    thing = _keep_out(cell) if object_mesh is None else trimesh.Trimesh(*object_mesh, process=False)
    return [_body("object", None, thing), *map(_standing, (cell.table, *cell.camera_body, *cell.obstacles))]


def _standing(item: Obstacle) -> _Body:
    return _standing_body(type(item), item.model_dump_json())


@lru_cache(maxsize=32)
def _standing_body(kind: type[Obstacle], item_json: str) -> _Body:
    item = kind.model_validate_json(item_json)
    body = _body(item.name, None, _mesh(item))
    if isinstance(item, HalfSpace):
        normal = np.array(item.normal) / np.linalg.norm(item.normal)
        body = replace(body, plane=(normal, float(normal @ np.array(item.point_m))))
    return body


def _mesh(item: Obstacle) -> trimesh.Trimesh:
    if isinstance(item, ConvexMesh):
        hull = trimesh.convex.convex_hull(np.array(item.vertices_m))
        return hull.apply_transform(item.base_from_mesh.matrix)
    if isinstance(item, Cone):
        angles = np.linspace(0, 2 * np.pi, 64, endpoint=False)
        round_ = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
        rims = [item.foot_radius_m * round_, item.top_radius_m * round_ + (0, 0, item.height_m)]
        return trimesh.convex.convex_hull(np.concatenate(rims)).apply_transform(item.base_from_cone.matrix)
    if isinstance(item, Capsule):
        return _capsule(item)
    if isinstance(item, Box):
        return trimesh.creation.box(2 * np.array(item.half_extents_m), item.base_from_box.matrix)
    slab = trimesh.creation.box((6.0, 6.0, 0.2), trimesh.transformations.translation_matrix((0, 0, -0.1)))
    pose = trimesh.geometry.align_vectors((0, 0, 1), item.normal)
    pose[:3, 3] = item.point_m
    return slab.apply_transform(pose)


def _keep_out(cell: CellConfig) -> trimesh.Trimesh:
    keep = cell.object.keep_out
    cylinder = trimesh.creation.cylinder(keep.radius_m, keep.height_m, sections=48)
    cylinder.apply_translation((0, 0, keep.height_m / 2))
    return cylinder.apply_transform(keep.base_from_object.matrix)


def _cylinder_points(cell: CellConfig) -> FloatArray:
    """Points on the keep-out cylinder's rims, side and top, shrunk slightly so that rays end inside."""
    keep = cell.object.keep_out
    angle = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    rings = [
        np.stack([share * keep.radius_m * np.cos(angle), share * keep.radius_m * np.sin(angle), height + 0 * angle], 1)
        for share, height in ((0.99, 0.001), (0.99, keep.height_m / 2), (0.99, keep.height_m), (0.5, keep.height_m))
    ]
    pose = keep.base_from_object.matrix
    return np.concatenate(rings) @ pose[:3, :3].T + pose[:3, 3]


def _capsule(item: Capsule | CapsuleShape) -> trimesh.Trimesh:
    """A mesh that encloses the capsule and exceeds its radius by less than 2 %."""
    vertices, faces = _capsule_of_one()
    start, end = np.array(item.start_m), np.array(item.end_m)
    length = float(np.linalg.norm(end - start))
    pose = trimesh.geometry.align_vectors((0, 0, 1), (end - start) / length) if length > 0.0 else np.eye(4)
    top = vertices[:, 2:] > 0
    placed = item.radius_m * (vertices - np.where(top, 1.0, -1.0) * (0, 0, 1)) @ pose[:3, :3].T + np.where(
        top, end, start
    )
    return trimesh.Trimesh(placed, faces, process=False)


@cache
def _capsule_of_one() -> tuple[FloatArray, npt.NDArray[np.int64]]:
    """Vertices and faces of a mesh that encloses the capsule of radius 1 from z = −1 to z = 1."""
    mesh = trimesh.creation.capsule(2.0, 1.0, count=(12, 24))
    vertices = mesh.vertices - mesh.bounds.mean(axis=0)
    feet = np.sign(vertices[:, 2:]) * (0, 0, 1)
    # The corners lie on the unit capsule and the faces inside it, the deepest at this distance from its line:
    sphere = trimesh.Trimesh(vertices - feet, mesh.faces, process=False)
    sphere.update_faces(sphere.area_faces > 1e-9)
    inside = np.abs(np.einsum("fi,fi->f", sphere.face_normals, sphere.triangles[:, 0])).min()
    return (vertices - feet) / inside + feet, np.array(mesh.faces, dtype=np.int64)


def _body(name: str, link: int | None, mesh: trimesh.Trimesh) -> _Body:
    shape = fcl.BVHModel()
    shape.beginModel(len(mesh.vertices), len(mesh.faces))
    shape.addSubModel(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    shape.endModel()
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    center = (low + high) / 2
    return _Body(
        name, link, mesh, shape, center, (high - low) / 2, float(np.linalg.norm(mesh.vertices - center, axis=1).max())
    )


def _near(first: _Body, second: _Body, frames: FloatArray) -> npt.NDArray[np.bool_]:
    """The samples (N,) at which neither body's bounding sphere is clear of the other's box, or of its plane."""
    if second.plane is not None:
        normal, offset = second.plane
        # Support of the box along the plane's normal: the minimum over its corners.
        across = np.abs(normal @ frames[:, first.link, :3, :3]) @ first.half
        return _centers(first, frames) @ normal - offset - across < 0
    return _sphere_meets_box(first, second, frames) & _sphere_meets_box(second, first, frames)


def _sphere_meets_box(round_: _Body, square: _Body, frames: FloatArray) -> npt.NDArray[np.bool_]:
    centers = _centers(round_, frames)
    if square.link is not None:
        frame = frames[:, square.link]
        centers = np.einsum("nji,nj->ni", frame[:, :3, :3], centers - frame[:, :3, 3])
    over = np.maximum(np.abs(centers - square.center) - square.half, 0.0)
    return np.einsum("ni,ni->n", over, over) < round_.radius**2


def _centers(body: _Body, frames: FloatArray) -> FloatArray:
    if body.link is None:
        return np.broadcast_to(body.center, (len(frames), 3))
    return frames[:, body.link, :3, :3] @ body.center + frames[:, body.link, :3, 3]


def _transform(frames: FloatArray, link: int | None) -> fcl.Transform:
    if link is None:
        return fcl.Transform()
    return fcl.Transform(np.ascontiguousarray(frames[link, :3, :3]), np.ascontiguousarray(frames[link, :3, 3]))
