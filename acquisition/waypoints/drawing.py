"""Draws a cell, its lights, reach and routes: SVG elements, PNG images, and HTML pages that need no network.

All use the same marks: lines and points in the base frame. The SVG views are written as text, because every solve ends
with the result pages, and matplotlib and plotly take a second to load and make images a hundred times as large. Both
are imported only for a PNG image or an HTML page.
"""

import html
import io
import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import ConvexHull

from acquisition import geometry, lamp_pose
from acquisition.models.base import FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import Box, Capsule, CapsuleShape, CellConfig, Cone, HalfSpace, Obstacle
from acquisition.models.route import Route
from acquisition.waypoints.kinematics import arm_model, forward
from acquisition.waypoints.reach import ReachMap

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDTH_PX, BORDER_PX = 340.0, 12.0
"""Width and border of an SVG view."""

_DPI = 110
"""Resolution of the PNG images."""
GREY, TABLE, OBSTACLE, CAMERA, OBJECT = "#888888", "#b9a98a", "#a05050", "#303030", "#c08030"
ARM, PATH, LIGHT, REFUSED = "#4060a0", "#2a8a4a", "#f0a000", "#c03030"
_LINE_WIDTHS = {ARM: 2.5, PATH: 0.7, OBJECT: 1.5}
_ROUND = np.linspace(0.0, 2 * np.pi, 33)
"""Azimuths in rad at which circles are drawn."""
_SAMPLES = 16


@dataclass(frozen=True)
class Mark:
    """One item of a drawing: points (N, 3), m, joined by lines (rows of NaN are gaps) or single and labelled."""

    name: str
    points: FloatArray
    color: str
    joined: bool = True
    labels: list[str] = field(default_factory=list[str])
    legend_only: bool = False  # hidden until selected in the legend


def cell_marks(cell: CellConfig, calibration: Calibration) -> list[Mark]:
    """Returns marks of a cell's obstacles, camera and object, and of the arm at home."""
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


def arm_mark(name: str, joints: FloatArray, cell: CellConfig, *, legend_only: bool = False) -> Mark:
    """Draws the arm (its nominal links) and its tool as lines."""
    model = arm_model(cell.arm.model)
    frames = forward(model, joints[None])[0]
    lines = [np.stack([frames[link, :3, 3], frames[link + 1, :3, 3]]) for link in range(6)]
    for capsule in cell.arm.tool_capsules:
        lines.append(geometry.transform(frames[6], np.array([capsule.start_m, capsule.end_m])))
    return Mark(name, _gapped(lines), ARM, legend_only=legend_only)


def reach_marks(reach: ReachMap) -> list[Mark]:
    """Returns marks of the dome's positions: the reachable ones, and the others by refusal reason."""
    base_from_view = lamp_pose.base_from_view(reach.calibration)
    points = geometry.transform(base_from_view, np.array(reach.points).reshape(-1, 3))
    reasons = sorted({refusal.reason for refusal in reach.refusals if refusal is not None})
    marks = [_points_mark("reachable", points, [refusal is None for refusal in reach.refusals], LIGHT, [])]
    for number, reason in enumerate(reasons):
        chosen = [refusal is not None and refusal.reason == reason for refusal in reach.refusals]
        labels = [refusal.detail for refusal in reach.refusals if refusal is not None and refusal.reason == reason]
        marks.append(_points_mark(reason, points, chosen, color_of(number), labels))
    return marks


def color_of(number: int) -> str:
    """Returns the colour (hex) of a refusal reason by its number."""
    colors = ("#c03030", "#7030a0", "#2060c0", "#208080", "#806020", "#e070a0", "#606060", "#a0a020", "#40a040")
    return colors[number % len(colors)]


def route_marks(route: Route, cell: CellConfig, calibration: Calibration) -> list[Mark]:
    """Returns marks of the lights in the order of travel, of the lamp's path, and of the arm at each light."""
    base_from_view = lamp_pose.base_from_view(calibration)
    lights = np.array([waypoint.light.position for waypoint in route.waypoints]).reshape(-1, 3)
    labels = [
        f"{place + 1}: light {number}, after {waypoint.seconds:.1f} s"
        for place, (number, waypoint) in enumerate(zip(route.light_numbers, route.waypoints, strict=True))
    ]
    corners = [route.start, *(corner for waypoint in route.waypoints for corner in waypoint.path), *route.home_path]
    return [
        Mark("lamp's path", _lamp_path(np.array(corners), cell, calibration), PATH),
        Mark("lights", geometry.transform(base_from_view, lights), LIGHT, joined=False, labels=labels),
        *(
            arm_mark(f"arm at light {number}", np.array(waypoint.joints), cell, legend_only=True)
            for number, waypoint in zip(route.light_numbers, route.waypoints, strict=True)
        ),
    ]


def _lamp_path(corners: FloatArray, cell: CellConfig, calibration: Calibration) -> FloatArray:
    share = np.linspace(0.0, 1.0, _SAMPLES)[:, None]
    joints = np.concatenate([start + share * (end - start) for start, end in itertools.pairwise(corners)] or [corners])
    flange = forward(arm_model(cell.arm.model), joints)[:, 6]
    flange_from_lamp = cell.arm.flange_from_tool.matrix @ np.array(calibration.tool_from_lamp, dtype=float)
    return np.asarray((flange @ flange_from_lamp[:, 3])[:, :3], dtype=float)


def _points_mark(name: str, points: FloatArray, chosen: Sequence[bool], color: str, labels: list[str]) -> Mark:
    return Mark(name, points[np.array(chosen, dtype=bool)], color, joined=False, labels=labels)


def _outline(item: Obstacle, cell: CellConfig) -> FloatArray:
    """Returns the edges of an obstacle as lines; for a half-space a square of its plane."""
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
    """Returns the outline of a capsule: its two rims and four lines between them."""
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


def svg_views(routes: Sequence[Route], cell: CellConfig, calibration: Calibration) -> list[tuple[str, str]]:
    """Returns SVG views of routes as pairs (caption, SVG element); lights are numbered in the order of the images."""
    marks = cell_marks(cell, calibration)
    first = 0
    for route in routes:
        marks += [_numbered(mark, route, first) for mark in route_marks(route, cell, calibration)]
        first += len(route.waypoints)
    marks = [mark for mark in marks if not mark.legend_only and len(mark.points)]
    middle = np.array(cell.object.keep_out.base_from_object.position_m[:2])
    outwards = middle / max(float(np.linalg.norm(middle)), 1e-9)
    return [
        ("Cell from above, the arm's base at the origin", _svg("cell from above", marks, np.eye(3)[:2])),
        (
            "Cell from the side, the object to the right of the arm's base",
            _svg("cell from the side", marks, np.array([[*outwards, 0.0], [0.0, 0.0, 1.0]])),
        ),
    ]


def _numbered(mark: Mark, route: Route, first: int) -> Mark:
    """Labels a route's lights with their image numbers; `first` is that of the pass's first image."""
    if mark.joined:
        return mark
    words = [str(first + number) for number in route.light_numbers]
    return Mark(mark.name, mark.points, mark.color, joined=False, labels=words)


def _svg(label: str, marks: list[Mark], axes: FloatArray) -> str:
    """Projects marks orthographically to an SVG element; `axes` (2, 3) are the view's right and up directions."""
    flat = [mark.points @ axes.T for mark in marks]
    low, high = np.nanmin(np.vstack(flat), axis=0), np.nanmax(np.vstack(flat), axis=0)
    scale = (WIDTH_PX - 2 * BORDER_PX) / max(float(high[0] - low[0]), 1e-9)
    height = 2 * BORDER_PX + scale * float(high[1] - low[1])
    parts: list[str] = []
    for mark, points in zip(marks, flat, strict=True):
        places = np.stack([points[:, 0] - low[0], high[1] - points[:, 1]], axis=1) * scale + BORDER_PX
        draw = _svg_lines if mark.joined else _svg_points
        parts.append(f"<g><title>{html.escape(mark.name)}</title>{draw(mark, places)}</g>")
    head = f'<svg viewBox="0 0 {WIDTH_PX:.0f} {height:.0f}" role="img" aria-label="{html.escape(label)}">'
    return f"{head}{''.join(parts)}</svg>"


def _svg_lines(mark: Mark, places: FloatArray) -> str:
    """Returns SVG polylines through points (N, 2) in pixels; rows of NaN are gaps."""
    gap = np.isnan(places[:, 0])
    steps = [
        "" if empty else f"{'M' if starts else 'L'}{x:.1f} {y:.1f}"
        for (x, y), empty, starts in zip(places.tolist(), gap, np.concatenate([[True], gap[:-1]]), strict=True)
    ]
    wide = _LINE_WIDTHS.get(mark.color, 0.8)
    return f'<path d="{"".join(steps)}" fill="none" stroke="{mark.color}" stroke-width="{wide}" />'


def _svg_points(mark: Mark, places: FloatArray) -> str:
    return "".join(
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3.5" fill="{mark.color}" />'
        f'<text x="{x + 4:.1f}" y="{y - 3:.1f}" class="tick">{html.escape(word)}</text>'
        for (x, y), word in zip(places.tolist(), mark.labels, strict=True)
    )


def reach_png(reach: ReachMap) -> bytes:
    """Polar plot of the dome as seen from the camera (PNG): slant, azimuth, and a colour for each refusal reason."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - slow to load and seldom needed

    figure = Figure(figsize=(8, 6), layout="constrained")
    axes = figure.add_subplot(projection="polar")
    slants, azimuths = geometry.slant_azimuth(np.array(reach.points).reshape(-1, 3) - reach.center)
    reasons = ["reachable" if refusal is None else refusal.reason for refusal in reach.refusals]
    names = ["reachable", *sorted(set(reasons) - {"reachable"})]
    for number, name in enumerate(names):
        own = np.array([reason == name for reason in reasons], dtype=bool)
        color = LIGHT if number == 0 else color_of(number - 1)
        label = f"{name} ({np.count_nonzero(own)})"
        axes.scatter(azimuths[own], np.degrees(slants[own]), s=24, color=color, label=label)
    axes.set_ylim(0, 1.05 * np.degrees(slants.max(initial=0.1)))
    axes.set_title(f"Reach of {reach.cell.arm.model} in '{reach.cell.name}', slant in degrees")
    figure.legend(loc="outside right upper")
    return _png(figure)


def reach_html(reach: ReachMap) -> str:
    """Cell and dome as an HTML page; each refused position is labelled with its reason."""
    marks = [*cell_marks(reach.cell, reach.calibration), *reach_marks(reach)]
    return _page(f"Reach of {reach.cell.arm.model} in '{reach.cell.name}'", marks)


def route_png(route: Route, cell: CellConfig, calibration: Calibration) -> bytes:
    """Cell, lights and the lamp's path in side view (PNG)."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - slow to load and seldom needed
    from mpl_toolkits.mplot3d import Axes3D  # noqa: PLC0415 - slow to load and seldom needed

    figure = Figure(figsize=(8, 7))
    axes = Axes3D(figure, auto_add_to_figure=False)
    figure.add_axes(axes)
    marks = [*cell_marks(cell, calibration), *route_marks(route, cell, calibration)]
    for mark in marks:
        if mark.legend_only or not len(mark.points):
            continue
        x, y, z = mark.points.T
        if mark.joined:
            wide = 3.0 if mark.color == ARM else 1.2
            axes.plot(x, y, z, color=mark.color, linewidth=wide, label=mark.name)
        else:
            axes.scatter(x, y, z, color=mark.color, s=30, label=mark.name)
            for place, (x, y, z) in enumerate(mark.points.tolist()):
                axes.text(x, y, z, str(place + 1))
    axes.set_aspect("equal")
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    axes.set_zlabel("z (m)")
    figure.suptitle(_title(route))
    return _png(figure)


def route_html(route: Route, cell: CellConfig, calibration: Calibration) -> str:
    """Cell, lights, the lamp's path, and the arm at each light (selected in the legend), as an HTML page."""
    return _page(_title(route), [*cell_marks(cell, calibration), *route_marks(route, cell, calibration)])


def _title(route: Route) -> str:
    return (
        f"{len(route.waypoints)} lights in {route.seconds:.1f} s of moves, lower bound of straight legs "
        f"{route.lower_bound_s:.1f} s"
    )


def _png(figure: "Figure") -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=_DPI)
    return buffer.getvalue()


def _page(title: str, marks: list[Mark]) -> str:
    import plotly.graph_objects as plotly  # noqa: PLC0415 - slow to load and seldom needed

    traces = [
        plotly.Scatter3d(
            x=mark.points[:, 0],
            y=mark.points[:, 1],
            z=mark.points[:, 2],
            name=mark.name,
            mode="lines" if mark.joined else "markers",
            line={"color": mark.color, "width": 8 if mark.color == ARM else 3},
            marker={"color": mark.color, "size": 4},
            text=mark.labels or mark.name,
            hoverinfo="text",
            visible="legendonly" if mark.legend_only else True,
        )
        for mark in marks
    ]
    figure = plotly.Figure(traces)
    figure.update_layout(title=title, scene={"aspectmode": "data"}, margin={"l": 0, "r": 0, "b": 0, "t": 40})
    return figure.to_html(include_plotlyjs=True, full_html=True)
