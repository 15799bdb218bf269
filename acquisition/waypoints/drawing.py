"""A cell, its lights and a route as lines and points in the base frame: what both kinds of picture are drawn from."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import ConvexHull

from acquisition import geometry, lamp_pose
from acquisition.models.base import FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import Box, Capsule, CapsuleShape, CellConfig, Cone, HalfSpace, Obstacle
from acquisition.models.route import Route
from acquisition.waypoints.kinematics import arm_model, forward
from acquisition.waypoints.reach import ReachMap

GREY, TABLE, OBSTACLE, CAMERA, OBJECT = "#888888", "#b9a98a", "#a05050", "#303030", "#c08030"
ARM, WAY, LIGHT, REFUSED = "#4060a0", "#2a8a4a", "#f0a000", "#c03030"
_ROUND = np.linspace(0.0, 2 * np.pi, 33)
_SAMPLES = 16


@dataclass(frozen=True)
class Mark:
    """One thing of a picture: points (N, 3) in m, joined by lines (rows of NaN are gaps) or single ones with words."""

    name: str
    points: FloatArray
    color: str
    joined: bool = True
    words: list[str] = field(default_factory=list[str])
    aside: bool = False  # shown only when asked for


def cell_marks(cell: CellConfig, calibration: Calibration) -> list[Mark]:
    """What stands in the cell, and the arm at home."""
    bodies: list[tuple[Obstacle, str]] = [
        (cell.table, TABLE),
        *((body, CAMERA) for body in cell.camera_body),
        *((item, OBSTACLE) for item in cell.obstacles),
    ]
    marks = [Mark(item.name, _outline(item, cell), color) for item, color in bodies]
    keep = cell.object.keep_out
    cylinder = _rims(keep.base_from_object.matrix, keep.radius_m, keep.radius_m, keep.height_m)
    lens = np.array(calibration.base_from_camera)[:3, 3]
    top = geometry.transform(keep.base_from_object.matrix, _circle(keep.radius_m, keep.height_m)[::8])
    view = _gapped([np.stack([lens, point]) for point in top])
    return [
        *marks,
        Mark("the object's keep-out", cylinder, OBJECT),
        Mark("view", view, GREY),
        arm_mark("arm at home", np.array(cell.arm.home), cell),
    ]


def arm_mark(name: str, joints: FloatArray, cell: CellConfig, *, aside: bool = False) -> Mark:
    """The arm (its nominal links) and its tool as lines."""
    model = arm_model(cell.arm.model)
    frames = forward(model, joints[None])[0]
    lines = [np.stack([frames[link, :3, 3], frames[link + 1, :3, 3]]) for link in range(6)]
    for capsule in cell.arm.tool_capsules:
        lines.append(geometry.transform(frames[6], np.array([capsule.start_m, capsule.end_m])))
    return Mark(name, _gapped(lines), ARM, aside=aside)


def reach_marks(reach: ReachMap) -> list[Mark]:
    """The dome's positions: reachable ones, and the others by their reasons."""
    base_from_view = lamp_pose.base_from_view(reach.calibration)
    points = geometry.transform(base_from_view, np.array(reach.points).reshape(-1, 3))
    reasons = sorted({refusal.reason for refusal in reach.refusals if refusal is not None})
    marks = [_dots("reachable", points, [refusal is None for refusal in reach.refusals], LIGHT, [])]
    for number, reason in enumerate(reasons):
        own = [refusal is not None and refusal.reason == reason for refusal in reach.refusals]
        words = [refusal.detail for refusal in reach.refusals if refusal is not None and refusal.reason == reason]
        marks.append(_dots(reason, points, own, color_of(number), words))
    return marks


def color_of(number: int) -> str:
    """A colour for each reason of refusal."""
    colors = ("#c03030", "#7030a0", "#2060c0", "#208080", "#806020", "#e070a0", "#606060", "#a0a020", "#40a040")
    return colors[number % len(colors)]


def route_marks(route: Route, cell: CellConfig, calibration: Calibration) -> list[Mark]:
    """The lights in the order of travel, the lamp's way, and the arm at each light."""
    base_from_view = lamp_pose.base_from_view(calibration)
    lights = np.array([waypoint.light.position for waypoint in route.waypoints]).reshape(-1, 3)
    words = [
        f"{place + 1}: light {number}, after {waypoint.seconds:.1f} s"
        for place, (number, waypoint) in enumerate(zip(route.light_numbers, route.waypoints, strict=True))
    ]
    corners = [route.start, *(corner for waypoint in route.waypoints for corner in waypoint.path), *route.home_path]
    return [
        Mark("lamp's way", _lamp_way(np.array(corners), cell, calibration), WAY),
        Mark("lights", geometry.transform(base_from_view, lights), LIGHT, joined=False, words=words),
        *(
            arm_mark(f"arm at light {number}", np.array(waypoint.joints), cell, aside=True)
            for number, waypoint in zip(route.light_numbers, route.waypoints, strict=True)
        ),
    ]


def _lamp_way(corners: FloatArray, cell: CellConfig, calibration: Calibration) -> FloatArray:
    share = np.linspace(0.0, 1.0, _SAMPLES)[:, None]
    joints = np.concatenate([start + share * (end - start) for start, end in itertools.pairwise(corners)] or [corners])
    flange = forward(arm_model(cell.arm.model), joints)[:, 6]
    flange_from_lamp = cell.arm.flange_from_tool.matrix @ np.array(calibration.tool_from_lamp, dtype=float)
    return np.asarray((flange @ flange_from_lamp[:, 3])[:, :3], dtype=float)


def _dots(name: str, points: FloatArray, own: Sequence[bool], color: str, words: list[str]) -> Mark:
    return Mark(name, points[np.array(own, dtype=bool)], color, joined=False, words=words)


def _outline(item: Obstacle, cell: CellConfig) -> FloatArray:
    """The edges of a body as lines; of a half-space a square of its plane."""
    if isinstance(item, HalfSpace):
        normal = np.array(item.normal) / np.linalg.norm(item.normal)
        middle = np.array(cell.object.keep_out.base_from_object.position_m) / 2
        foot = middle - (normal @ (middle - np.array(item.point_m))) * normal
        aside = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
        aside /= np.linalg.norm(aside)
        corners = [foot + 0.8 * (a * aside + b * np.cross(normal, aside)) for a, b in _SQUARE]
        return np.array(corners, dtype=float)
    if isinstance(item, Capsule):
        return _capsule(item)
    if isinstance(item, Cone):
        return _rims(item.base_from_cone.matrix, item.foot_radius_m, item.top_radius_m, item.height_m)
    if isinstance(item, Box):
        corners = np.array(list(itertools.product((-1.0, 1.0), repeat=3))) * item.half_extents_m
        placed = geometry.transform(item.base_from_box.matrix, corners)
    else:
        placed = geometry.transform(item.base_from_mesh.matrix, np.array(item.vertices_m))
    faces = placed[ConvexHull(placed).simplices]
    return _gapped([face[[0, 1, 2, 0]] for face in faces])


_SQUARE = ((-1, -1), (-1, 1), (1, 1), (1, -1), (-1, -1))


def _capsule(item: Capsule | CapsuleShape) -> FloatArray:
    """The outline of a capsule: its two rims and four lines between them."""
    start, end = np.array(item.start_m), np.array(item.end_m)
    axis = end - start
    length = float(np.linalg.norm(axis))
    pose = np.eye(4)
    pose[:3, 3] = start
    if length > 0:
        z = axis / length
        x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
        x /= np.linalg.norm(x)
        pose[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    return _rims(pose, item.radius_m, item.radius_m, length)


def _rims(pose: FloatArray, foot_m: float, top_m: float, height_m: float) -> FloatArray:
    foot, top = _circle(foot_m, 0.0), _circle(top_m, height_m)
    lines = [foot, top, *(np.stack([foot[k], top[k]]) for k in range(0, 32, 8))]
    return geometry.transform(pose, _gapped(lines))


def _circle(radius_m: float, height_m: float) -> FloatArray:
    return np.stack([radius_m * np.cos(_ROUND), radius_m * np.sin(_ROUND), np.full_like(_ROUND, height_m)], axis=1)


def _gapped(lines: Sequence[FloatArray]) -> FloatArray:
    return np.concatenate([part for line in lines for part in (line, np.full((1, 3), np.nan))])
