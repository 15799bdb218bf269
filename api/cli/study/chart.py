"""Log–log line charts as SVG text, so that a page with charts needs no library, no script and no network."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from math import ceil, floor, log10

WIDTH, HEIGHT = 760, 420
LEFT, RIGHT, TOP, BOTTOM = 64, 170, 16, 52
COLOURS = ("#c1121f", "#1d4ed8", "#15803d", "#a16207", "#7e22ce", "#0e7490", "#57534e", "#be185d")
_STEPS = (1, 2, 3, 5, 7)


@dataclass(frozen=True)
class Line:
    """Points (x, y) of one line, and half heights of their error bars (none: no bars)."""

    name: str
    points: Sequence[tuple[float, float]]
    half_heights: Sequence[float] = ()
    dashed: bool = False


@dataclass(frozen=True)
class Axis:
    """Label of an axis; its marks and range follow from the values unless given."""

    label: str
    marks: Sequence[float] = ()
    low: float | None = None
    high: float | None = None


def svg(lines: Sequence[Line], x: Axis, y: Axis) -> str:
    """Draws lines in a chart with both axes logarithmic; all values must be positive."""
    across = _Scale(x, [point[0] for line in lines for point in line.points], LEFT, WIDTH - RIGHT)
    up = _Scale(y, [point[1] for line in lines for point in line.points], HEIGHT - BOTTOM, TOP)
    parts = [
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" font-family="sans-serif" font-size="12">',
        *(_mark(across.at(value), HEIGHT - BOTTOM, TOP, _number(value), upright=True) for value in across.marks),
        *(_mark(up.at(value), LEFT, WIDTH - RIGHT, _number(value), upright=False) for value in up.marks),
        f'<text x="{(LEFT + WIDTH - RIGHT) / 2}" y="{HEIGHT - 12}" text-anchor="middle">{escape(x.label)}</text>',
        f'<text transform="translate(16,{(TOP + HEIGHT - BOTTOM) / 2}) rotate(-90)" text-anchor="middle">'
        f"{escape(y.label)}</text>",
    ]
    for number, line in enumerate(lines):
        parts += _line_svg(line, COLOURS[number % len(COLOURS)], across, up, TOP + 12 + 20 * number)
    return "\n".join([*parts, "</svg>"])


class _Scale:
    """Maps values to positions along one logarithmic axis."""

    def __init__(self, axis: Axis, values: Sequence[float], start: float, end: float) -> None:
        self._low = log10(axis.low or min(values) / 1.08)
        self._high = log10(axis.high or max(values) * 1.08)
        self._start, self._end = start, end
        everything = [step * 10.0**power for power in range(floor(self._low), ceil(self._high) + 1) for step in _STEPS]
        inside = [value for value in (axis.marks or everything) if self._low <= log10(value) <= self._high]
        self.marks = inside

    def at(self, value: float) -> float:
        share = (log10(max(value, 1e-12)) - self._low) / (self._high - self._low)
        return self._start + min(max(share, 0.0), 1.0) * (self._end - self._start)


def _mark(position: float, start: float, end: float, text: str, *, upright: bool) -> str:
    if upright:
        line = f'x1="{position:.1f}" x2="{position:.1f}" y1="{start}" y2="{end}"'
        label = f'<text x="{position:.1f}" y="{start + 18}" text-anchor="middle">{text}</text>'
    else:
        line = f'y1="{position:.1f}" y2="{position:.1f}" x1="{start}" x2="{end}"'
        label = f'<text x="{start - 6}" y="{position + 4:.1f}" text-anchor="end">{text}</text>'
    return f'<line {line} stroke="#8884" />{label}'


def _line_svg(line: Line, colour: str, across: _Scale, up: _Scale, legend_y: float) -> list[str]:
    positions = [(across.at(x), up.at(y)) for x, y in line.points]
    path = " ".join(f"{x:.1f},{y:.1f}" for x, y in positions)
    dashes = ' stroke-dasharray="5 4"' if line.dashed else ""
    parts = [f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="2"{dashes} />']
    for (_, y), (left, _), half in zip(line.points, positions, line.half_heights, strict=False):
        if half > 0:
            low, high = up.at(max(y - half, 1e-6)), up.at(y + half)
            parts.append(f'<line x1="{left:.1f}" x2="{left:.1f}" y1="{low:.1f}" y2="{high:.1f}" stroke="{colour}" />')

    if not line.dashed:
        parts += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2.6" fill="{colour}" />' for x, y in positions]
    edge = WIDTH - RIGHT + 12
    parts.append(
        f'<line x1="{edge}" x2="{edge + 22}" y1="{legend_y}" y2="{legend_y}" stroke="{colour}" stroke-width="2"'
        f"{dashes} />"
    )
    parts.append(f'<text x="{edge + 28}" y="{legend_y + 4}">{escape(line.name)}</text>')
    return parts


def _number(value: float) -> str:
    return f"{value:g}"
