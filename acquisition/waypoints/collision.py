"""Collision model of the cell: capsules against convex obstacles, for configurations, edges and occlusion cones.

It checks whether a configuration is free, whether a straight joint edge is free over its full length, and whether the
view cone (lens to object) and the light cone (lamp to object) are unobstructed during exposure. The arm is the nominal
one: a calibrated arm differs by millimetres, while clearances are centimetres; a cell in which it differs by more than
the smallest clearance is refused. Configurations where the arm stops keep slightly more than the clearances
(`NODE_SLACK_M`), so that the edges from them can be certified for the clearances themselves. The table is not checked
against the base link, which stands on it and cannot move.
"""

import itertools
from collections import Counter
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull

from acquisition import geometry
from acquisition.models.base import BoolArray, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import ArmConfig, Box, Capsule, CellConfig, Cone, HalfSpace, Obstacle
from acquisition.models.errors import ErrorCode, RigError
from acquisition.waypoints import calibrated_kinematics, mounted_tool
from acquisition.waypoints import collision_kernels as kernels
from acquisition.waypoints import shape_kernels as shapes
from acquisition.waypoints.hull_kernels import hull_distance
from acquisition.waypoints.kinematics import ArmModel, arm_model

NODE_SLACK_M = 0.002
"""Distance, m, beyond the clearances that stop configurations keep."""
CONE_MARGIN_M = 0.01
"""Margin, m, around both cones: half the entrance pupil of the lens. The lamp's emitter is extended, too."""

_PAIR_GRID, _TOOL_GRID = 48, 180
"""Joint angles, sampled over one turn, that decide whether two capsules can meet: of the arm, and with one of the
tool."""
_RIM_CORNERS = 24
"""Corners of the polygon circumscribed about a rim of a cylinder or cone."""
_OBJECT_NUMBER = 1  # the object's number among the obstacles; the table is 0
_PERMANENT_OVERLAP_M = 0.005
"""Overlap, m, allowed between capsules of two links that cannot meet: capsules are larger than the links."""

CollisionReason = Literal["self-collision", "hits-table", "hits-object", "hits-camera", "hits-obstacle"]
Indices = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Scene:
    """A cell as arrays for the kernels; base frame, m. `reasons` and `names` identify each obstacle."""

    model: ArmModel
    links: Indices  # (C,) link of each capsule; the tool's capsules are last, on link 6
    capsules: FloatArray  # (C, 7)
    first_tool_capsule: int  # number of the tool's first capsule
    lever_arms: FloatArray  # (C, 6) largest distance of each capsule's centre line from each joint axis
    obstacles: FloatArray  # (O, ROW)
    vertices: FloatArray  # (V, 3) of all obstacles given as convex hulls
    reasons: tuple[CollisionReason, ...]
    names: tuple[str, ...]
    pairs: Indices  # (P, 2) capsules of the arm that must not meet
    self_margin: float
    keep_out: FloatArray  # (ROW,) the object's cylinder
    object_rims: FloatArray  # (48, 3) points whose convex hull encloses it
    occluders: tuple["Occluder", ...]
    lens: FloatArray  # (3,)

    def violations(self, joints: FloatArray) -> Indices:
        """First violated clearance of each of (N, 6): the obstacle's number; len(reasons): the arm itself; −1: none."""
        return kernels.first_violations(
            _finite(joints), self.model.dh, self.links, self.capsules, self.obstacles, self.vertices,
            self.pairs, self.self_margin, NODE_SLACK_M,
        )  # fmt: skip

    def free(self, joints: FloatArray) -> BoolArray:
        """Tells whether each of (N, 6) keeps all clearances plus `NODE_SLACK_M`."""
        return self.violations(joints) < 0

    def clearance(self, joints: FloatArray) -> FloatArray:
        """Returns the minimum distances (N, O + 1), m, of the arm's surface to each obstacle and, last, to itself."""
        return kernels.distances(
            _finite(joints), self.model.dh, self.links, self.capsules, self.obstacles, self.vertices,
            self.pairs,
        )  # fmt: skip

    def edges_free(self, starts: FloatArray, ends: FloatArray) -> BoolArray:
        """Continuous collision check (Schwarzer, Saha and Latombe 2002) of N straight joint edges, (N, 6) to (N, 6)."""
        return kernels.edges_free(
            _finite(starts), _finite(ends), self.model.dh, self.links, self.capsules,
            self.lever_arms, self.obstacles, self.vertices, self.pairs, self.self_margin,
        )  # fmt: skip

    def blocked_cones(self, joints: FloatArray, emitters: FloatArray) -> Indices:
        """For (N, 6) with emitters (N, 3) in base: 1 the arm blocks the view, 2 it shadows the object, −1 neither."""
        return kernels.blocked_cones(
            _finite(joints), np.ascontiguousarray(emitters), self.model.dh, self.links, self.capsules,
            self.first_tool_capsule, self.lens[None], self.keep_out[None], CONE_MARGIN_M,
        )  # fmt: skip

    def light_occluder(self, emitter: FloatArray) -> int:
        """Returns the obstacle that occludes the object from an emitter (3,), or −1; half-spaces are left out."""
        middle = (self.object_rims.min(axis=0) + self.object_rims.max(axis=0)) / 2
        bounding_radius = np.linalg.norm(self.object_rims - middle, axis=1).max() + CONE_MARGIN_M
        axis = middle - emitter
        for occluder in self.occluders:
            share = np.clip((occluder.center - emitter) @ axis / (axis @ axis), 0.0, 1.0)
            if np.linalg.norm(emitter + share * axis - occluder.center) > bounding_radius + occluder.reach:
                continue
            cone, least = np.vstack([emitter, self.object_rims]), occluder.radius + CONE_MARGIN_M
            if hull_distance(cone, occluder.points, least, least) < least:
                return occluder.number
        return -1

    def describe_violation(self, violation: int) -> tuple[CollisionReason, str]:
        """Returns refusal reason and obstacle name of a number from `violations`."""
        if violation == len(self.reasons):
            return "self-collision", "the arm itself"
        return self.reasons[violation], self.names[violation]

    def most_common_violation(self, violations: Indices) -> tuple[CollisionReason, str]:
        """Returns reason and obstacle name of the most frequent of numbers from `violations`, none of them −1."""
        return self.describe_violation(Counter(violations.tolist()).most_common(1)[0][0])


@dataclass(frozen=True)
class Occluder:
    """An obstacle that can occlude the light: the convex hull of points (N, 3), dilated by a radius."""

    number: int
    points: FloatArray
    radius: float
    center: FloatArray
    reach: float  # from the centre to its furthest point


def scene(cell: CellConfig, calibration: Calibration) -> Scene:
    """Collision model of the cell: arm, tool and obstacles as arrays; cached for each cell and calibration.

    Raises RigError config.invalid if `arm.kinematics` are not those of an arm of this model.
    """
    return _scene(cell.model_dump_json(), calibration.model_dump_json())


@lru_cache(maxsize=8)
def _scene(cell_json: str, calibration_json: str) -> Scene:
    cell, calibration = CellConfig.model_validate_json(cell_json), Calibration.model_validate_json(calibration_json)
    model = arm_model(cell.arm.model)
    tool = [[*capsule.start_m, *capsule.end_m, capsule.radius_m] for capsule in mounted_tool.capsules(cell)]
    capsules = np.vstack([model.capsules, np.array(tool, dtype=float).reshape(-1, 7)])
    links = np.array([*model.capsule_links, *[6] * len(tool)], dtype=np.int64)
    capsules[links == 6, 6] += cell.arm.cable_allowance_m
    first_tool_capsule = len(model.capsules)
    keep_out_config = cell.object.keep_out
    frame = keep_out_config.base_from_object.matrix
    keep_out = _row(
        shapes.CYLINDER,
        cell.clearances.object_m,
        *frame[:3, 3],
        *frame[:3, 2],
        keep_out_config.radius_m,
        keep_out_config.height_m,
    )
    meshes: list[FloatArray] = []
    usual = cell.clearances.obstacle_m
    rows: list[tuple[CollisionReason, str, FloatArray]] = [
        ("hits-table", cell.table.name, _obstacle(cell.table, cell.clearances.table_m, meshes)),
        ("hits-object", "the object's keep-out", keep_out),
        *(("hits-camera", body.name, _obstacle(body, usual, meshes)) for body in cell.camera_body),
        *(("hits-obstacle", item.name, _obstacle(item, usual, meshes)) for item in cell.obstacles),
    ]
    obstacles, vertices = np.stack([row for _, _, row in rows]), np.concatenate([np.zeros((0, 3)), *meshes])
    _require_model(cell.arm, capsules[links == 6, :6].reshape(-1, 3), float(obstacles[:, 1].min()))
    return Scene(
        model=model,
        links=links,
        capsules=capsules,
        first_tool_capsule=first_tool_capsule,
        lever_arms=_lever_arms(model, links, capsules),
        obstacles=obstacles,
        vertices=vertices,
        reasons=tuple(blame for blame, _, _ in rows),
        names=tuple(name for _, name, _ in rows),
        pairs=_pairs(model, links, capsules, first_tool_capsule, cell.clearances.self_m),
        self_margin=cell.clearances.self_m,
        keep_out=keep_out,
        object_rims=_rims(keep_out, keep_out[8]),
        occluders=_occluders(obstacles, vertices),
        lens=np.array(calibration.base_from_camera, dtype=float)[:3, 3].copy(),
    )


def _require_model(arm: ArmConfig, points: FloatArray, least_m: float) -> None:
    """Raises RigError config.invalid if the calibrated arm has points (K, 3) of the flange frame further than the
    smallest clearance from where its nominal model, which alone is kept clear of bodies, has them."""
    departure_m = calibrated_kinematics.departure_m(arm, points)
    if departure_m >= least_m:
        raise RigError(
            ErrorCode.CONFIG_INVALID,
            f"By `arm.kinematics` the tool is up to {1e3 * departure_m:.0f} mm from where the links of a {arm.model} "
            f"have it, but the smallest clearance is {1e3 * least_m:.0f} mm: the arm could touch what its model "
            "clears. Correct `arm.model`, or copy the calibration of this arm (`lightpose check` prints it); if both "
            "are right, state larger clearances",
            departure_m=round(departure_m, 4),
        )


def _finite(joints: FloatArray) -> FloatArray:
    """Returns contiguous joint angles. Raises ValueError if not finite: NaN would pass every clearance check."""
    if not np.isfinite(joints).all():
        raise ValueError("joint angles must be finite")
    return np.ascontiguousarray(joints)


def _row(kind: int, margin: float, *shape: float) -> FloatArray:
    row = np.zeros(shapes.ROW)
    row[: 2 + len(shape)] = [kind, margin, *shape]
    return row


def _obstacle(item: Obstacle, usual_m: float, meshes: list[FloatArray]) -> FloatArray:
    """Returns an obstacle's row (`shape_kernels.ROW`); appends the vertices of a convex mesh to `meshes`."""
    margin = usual_m if item.clearance_m is None else item.clearance_m
    if isinstance(item, HalfSpace):
        normal = np.array(item.normal) / np.linalg.norm(item.normal)
        return _row(shapes.HALF_SPACE, margin, *normal, float(normal @ np.array(item.point_m)))
    if isinstance(item, Capsule):
        return _row(shapes.CAPSULE, margin, *item.start_m, *item.end_m, item.radius_m)
    if isinstance(item, Cone):
        pose = item.base_from_cone.matrix
        sizes = item.foot_radius_m, item.height_m, item.top_radius_m
        return _row(shapes.CONE, margin, *pose[:3, 3], *pose[:3, 2], *sizes)
    if isinstance(item, Box):
        pose = item.base_from_box.matrix
        return _row(shapes.BOX, margin, *pose[:3, 3], *pose[:3, :3].ravel(), *item.half_extents_m)
    points = geometry.transform(item.base_from_mesh.matrix, np.array(item.vertices_m))
    points = points[ConvexHull(points).vertices]
    center = (points.min(axis=0) + points.max(axis=0)) / 2
    radius = float(np.linalg.norm(points - center, axis=1).max())
    first = sum(map(len, meshes))
    meshes.append(points)
    return _row(shapes.HULL, margin, *center, *center, radius, first, len(points))


def _occluders(obstacles: FloatArray, vertices: FloatArray) -> tuple[Occluder, ...]:
    occluders: list[Occluder] = []
    for number, row in enumerate(obstacles):
        points, radius = _hull(row, vertices)
        if number > _OBJECT_NUMBER and len(points):
            center = points.mean(axis=0)
            reach = float(np.linalg.norm(points - center, axis=1).max()) + radius
            occluders.append(Occluder(number, points, radius, center, reach))
    return tuple(occluders)


def _hull(shape: FloatArray, vertices: FloatArray) -> tuple[FloatArray, float]:
    """Returns points and a radius whose dilated convex hull encloses an obstacle; no points for an unbounded one."""
    match int(shape[0]):
        case shapes.CAPSULE:
            return shape[2:8].reshape(2, 3), float(shape[8])
        case shapes.BOX:
            corners = np.array(list(itertools.product((-1.0, 1.0), repeat=3))) * shape[14:17]
            return np.ascontiguousarray(corners @ shape[5:14].reshape(3, 3).T + shape[2:5]), 0.0
        case shapes.CONE:
            return _rims(shape, float(shape[10])), 0.0
        case shapes.HULL:
            return vertices[int(shape[9]) : int(shape[9] + shape[10])], 0.0
        case _:
            return np.zeros((0, 3)), 0.0


def _rims(shape: FloatArray, top_radius: float) -> FloatArray:
    """Returns corners (48, 3) of polygons circumscribed about the foot and the top of a cylinder or cone."""
    angles = np.arange(_RIM_CORNERS) * 2 * np.pi / _RIM_CORNERS
    axis = shape[5:8]
    aside = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    aside /= np.linalg.norm(aside)
    outwards = np.cos(angles)[:, None] * aside + np.sin(angles)[:, None] * np.cross(axis, aside)
    outwards /= np.cos(np.pi / _RIM_CORNERS)
    return np.vstack([shape[2:5] + shape[8] * outwards, shape[2:5] + shape[9] * axis + top_radius * outwards])


def _lever_arms(model: ArmModel, links: Indices, capsules: FloatArray) -> FloatArray:
    """Bounds the distance (C, 6), m, of each capsule's centre line from each joint axis, over all poses."""
    _, a2, a3, d4, d5, d6 = np.abs(model.dh)
    # From frame i − 1 to frame i; the offset along the axis of the joint that moves frame i adds nothing.
    link_lengths = [0.0, a2, a3, d4, d5, d6]
    own_lengths = [0.0, a2, a3, 0.0, 0.0, 0.0]
    lever_arms = np.zeros((len(links), 6))
    for c, link in enumerate(links):
        reach = max(np.linalg.norm(capsules[c, :3]), np.linalg.norm(capsules[c, 3:6]))
        for joint in range(link):
            lever_arms[c, joint] = own_lengths[joint] + sum(link_lengths[joint + 1 : link]) + reach
    return lever_arms


def _pairs(model: ArmModel, links: Indices, capsules: FloatArray, first_tool_capsule: int, margin: float) -> Indices:
    """Returns the capsule pairs of the self-collision check, the lower link first.

    Adjacent links share a joint and are excluded, except for the tool, which may fold back on the last wrist. Of two
    links with one link between them, a pair is excluded if it is nearer than the margin in every pose of the joints
    between (such as the base and the shoulder end of the upper arm) or if it never meets: the manufacturer's own gap,
    narrower than any margin, is safe. Of the tool, which nobody but the user designed, only pairs that keep the margin
    in every pose are excluded on that ground.
    """
    lever_arms = _lever_arms(model, links, capsules)
    kept: list[tuple[int, int]] = []
    for a, b in itertools.combinations(range(len(links)), 2):
        low, high, of_tool = int(links[a]), int(links[b]), b >= first_tool_capsule
        if high - low < (1 if of_tool else 2) or low == high:
            continue
        if high - low > 2:
            kept.append((a, b))
            continue
        count = _TOOL_GRID if of_tool else _PAIR_GRID
        nearest, furthest = _distances(model.name, low, high, tuple(capsules[[a, b]].ravel().tolist()), count)
        if of_tool:  # between two samples it may come nearer by what half a step of the joints moves it
            nearest -= np.pi / count * float(lever_arms[b, low:high].sum())
            meets = nearest < margin and furthest >= margin + NODE_SLACK_M
        else:
            meets = nearest <= -_PERMANENT_OVERLAP_M and furthest >= margin
        if meets:
            kept.append((a, b))
    return np.array(kept, dtype=np.int64).reshape(-1, 2)


@lru_cache(maxsize=512)
def _distances(model_name: str, low: int, high: int, capsules: tuple[float, ...], count: int) -> tuple[float, float]:
    """Samples the smallest and the largest distance, m, of two capsules with at most one link between theirs, over
    `count` angles of each joint between."""
    angles = np.linspace(-np.pi, np.pi, count, endpoint=False)
    first, second = (grid.ravel() for grid in np.meshgrid(angles, angles))
    joints = np.zeros((count ** (high - low), 6))
    joints[:, high - 1], joints[:, low] = second[: len(joints)], first[: len(joints)]
    distance = kernels.distances(
        joints, arm_model(model_name).dh, np.array([low, high]), np.array(capsules).reshape(2, 7),
        np.zeros((0, shapes.ROW)), np.zeros((0, 3)), np.array([[0, 1]]),
    )[:, -1]  # fmt: skip
    return float(distance.min()), float(distance.max())
