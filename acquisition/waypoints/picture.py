"""Pictures of reach and route: stills (PNG), and pages (HTML) that can be turned and need no network.

Libraries that draw are slow to load, so this module is imported only where a picture is made.
"""

import io

import numpy as np
import plotly.graph_objects as plotly
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D

from acquisition import geometry
from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import CellConfig
from acquisition.models.route import Route
from acquisition.waypoints import drawing
from acquisition.waypoints.drawing import Mark
from acquisition.waypoints.reach import ReachMap

_DPI = 110


def reach_still(reach: ReachMap) -> bytes:
    """The dome seen from the camera (PNG): slant outwards, azimuth round, and a colour for each reason."""
    figure = Figure(figsize=(8, 6), layout="constrained")
    axes = figure.add_subplot(projection="polar")
    slants, azimuths = geometry.slant_azimuth(np.array(reach.points).reshape(-1, 3) - reach.center)
    reasons = ["reachable" if refusal is None else refusal.reason for refusal in reach.refusals]
    names = ["reachable", *sorted(set(reasons) - {"reachable"})]
    for number, name in enumerate(names):
        own = np.array([reason == name for reason in reasons], dtype=bool)
        color = drawing.LIGHT if number == 0 else drawing.color_of(number - 1)
        label = f"{name} ({np.count_nonzero(own)})"
        axes.scatter(azimuths[own], np.degrees(slants[own]), s=24, color=color, label=label)
    axes.set_ylim(0, 1.05 * np.degrees(slants.max(initial=0.1)))
    axes.set_title(f"Reach of {reach.cell.arm.model} in '{reach.cell.name}', slant in degrees")
    figure.legend(loc="outside right upper")
    return _png(figure)


def reach_page(reach: ReachMap) -> str:
    """Cell and dome as a page: each refused position tells its reason."""
    marks = [*drawing.cell_marks(reach.cell, reach.calibration), *drawing.reach_marks(reach)]
    return _page(f"Reach of {reach.cell.arm.model} in '{reach.cell.name}'", marks)


def route_still(route: Route, cell: CellConfig, calibration: Calibration) -> bytes:
    """Cell, lights and the lamp's way from the side (PNG)."""
    figure = Figure(figsize=(8, 7))
    axes = Axes3D(figure, auto_add_to_figure=False)
    figure.add_axes(axes)
    marks = [*drawing.cell_marks(cell, calibration), *drawing.route_marks(route, cell, calibration)]
    for mark in marks:
        if mark.aside or not len(mark.points):
            continue
        x, y, z = mark.points.T
        if mark.joined:
            wide = 3.0 if mark.color == drawing.ARM else 1.2
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


def route_page(route: Route, cell: CellConfig, calibration: Calibration) -> str:
    """Cell, lights, the lamp's way, and the arm at each light (a click on its name), as a page."""
    return _page(
        _title(route), [*drawing.cell_marks(cell, calibration), *drawing.route_marks(route, cell, calibration)]
    )


def _title(route: Route) -> str:
    return (
        f"{len(route.waypoints)} lights in {route.seconds:.1f} s of moves, no tour of straight legs under "
        f"{route.lower_bound_s:.1f} s"
    )


def _png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=_DPI)
    return buffer.getvalue()


def _page(title: str, marks: list[Mark]) -> str:
    traces = [
        plotly.Scatter3d(
            x=mark.points[:, 0],
            y=mark.points[:, 1],
            z=mark.points[:, 2],
            name=mark.name,
            mode="lines" if mark.joined else "markers",
            line={"color": mark.color, "width": 8 if mark.color == drawing.ARM else 3},
            marker={"color": mark.color, "size": 4},
            text=mark.words or mark.name,
            hoverinfo="text",
            visible="legendonly" if mark.aside else True,
        )
        for mark in marks
    ]
    figure = plotly.Figure(traces)
    figure.update_layout(title=title, scene={"aspectmode": "data"}, margin={"l": 0, "r": 0, "b": 0, "t": 40})
    return figure.to_html(include_plotlyjs=True, full_html=True)
