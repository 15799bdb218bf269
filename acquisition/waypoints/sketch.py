"""Cell, lights and the lamp's way as two small drawings (SVG), from above and from the side, for a page of others.

Drawn as text, because the pages of results are made at the end of every solve: a library that draws takes a second to
load, and its pictures are a hundred times as large.
"""

import html
from collections.abc import Sequence

import numpy as np

from acquisition.models.base import FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import CellConfig
from acquisition.models.route import Route
from acquisition.waypoints import drawing
from acquisition.waypoints.drawing import Mark

WIDTH_PX, BORDER_PX = 340.0, 12.0
_WIDE = {drawing.ARM: 2.5, drawing.WAY: 0.7, drawing.OBJECT: 1.5}


def views(routes: Sequence[Route], cell: CellConfig, calibration: Calibration) -> list[tuple[str, str]]:
    """What each drawing shows, and the drawing as an SVG element; lights are numbered in the order of the images."""
    marks = drawing.cell_marks(cell, calibration)
    first = 0
    for route in routes:
        marks += [_numbered(mark, route, first) for mark in drawing.route_marks(route, cell, calibration)]
        first += len(route.waypoints)
    marks = [mark for mark in marks if not mark.aside and len(mark.points)]
    middle = np.array(cell.object.keep_out.base_from_object.position_m[:2])
    outwards = middle / max(float(np.linalg.norm(middle)), 1e-9)
    return [
        ("Cell from above, the arm's base at its own origin", _svg("cell from above", marks, np.eye(3)[:2])),
        (
            "Cell from the side, the object to the right of the arm's base",
            _svg("cell from the side", marks, np.array([[*outwards, 0.0], [0.0, 0.0, 1.0]])),
        ),
    ]


def _numbered(mark: Mark, route: Route, first: int) -> Mark:
    """A route's lights with the numbers of their images: `first` is that of the pass's first one."""
    if mark.joined:
        return mark
    words = [str(first + number) for number in route.light_numbers]
    return Mark(mark.name, mark.points, mark.color, joined=False, words=words)


def _svg(label: str, marks: list[Mark], axes: FloatArray) -> str:
    """Marks seen along a direction; `axes` (2, 3) are what is right and what is up in it."""
    flat = [mark.points @ axes.T for mark in marks]
    low, high = np.nanmin(np.vstack(flat), axis=0), np.nanmax(np.vstack(flat), axis=0)
    scale = (WIDTH_PX - 2 * BORDER_PX) / max(float(high[0] - low[0]), 1e-9)
    height = 2 * BORDER_PX + scale * float(high[1] - low[1])
    parts: list[str] = []
    for mark, points in zip(marks, flat, strict=True):
        places = np.stack([points[:, 0] - low[0], high[1] - points[:, 1]], axis=1) * scale + BORDER_PX
        draw = _lines if mark.joined else _dots
        parts.append(f"<g><title>{html.escape(mark.name)}</title>{draw(mark, places)}</g>")
    head = f'<svg viewBox="0 0 {WIDTH_PX:.0f} {height:.0f}" role="img" aria-label="{html.escape(label)}">'
    return f"{head}{''.join(parts)}</svg>"


def _lines(mark: Mark, places: FloatArray) -> str:
    """Lines through places (N, 2) in pixels; rows of NaN are gaps."""
    gap = np.isnan(places[:, 0])
    steps = [
        "" if empty else f"{'M' if starts else 'L'}{x:.1f} {y:.1f}"
        for (x, y), empty, starts in zip(places.tolist(), gap, np.concatenate([[True], gap[:-1]]), strict=True)
    ]
    wide = _WIDE.get(mark.color, 0.8)
    return f'<path d="{"".join(steps)}" fill="none" stroke="{mark.color}" stroke-width="{wide}" />'


def _dots(mark: Mark, places: FloatArray) -> str:
    return "".join(
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3.5" fill="{mark.color}" />'
        f'<text x="{x + 4:.1f}" y="{y - 3:.1f}" class="tick">{html.escape(word)}</text>'
        for (x, y), word in zip(places.tolist(), mark.words, strict=True)
    )
