"""Paths of the tool: straight line and circular arc, each from share 0 to share 1.

`at` is the pose at a share of the path, `rate` its change per unit of share (m and rad, base frame). `length` is the
arc length in m, `angle` the total rotation in rad.
"""

import math
from typing import Protocol

from hardware_sim.controller import poses
from hardware_sim.controller.poses import Frame, Vector

_COLLINEAR = 1e-6  # sine of the angle between two chords


class Curve(Protocol):
    """A path of the tool; see the module's docstring."""

    start: Frame
    length: float
    angle: float

    def at(self, share: float) -> Frame: ...
    def rate(self, share: float) -> tuple[float, ...]: ...


class Line:
    """A straight line; the tool rotates in step with it about one fixed axis."""

    def __init__(self, start: Frame, end: Frame) -> None:
        self.start, self._end = start, end
        self._turn = poses.rotation_vector(poses.compose(poses.invert(start), end))
        shift = (end[3] - start[3], end[7] - start[7], end[11] - start[11])
        self.length, self.angle = math.hypot(*shift), math.hypot(*self._turn)
        self._rate = (*shift, *poses.rotate(start, self._turn))

    def at(self, share: float) -> Frame:
        if share >= 1.0:
            return self._end
        x, y, z = self._rate[:3]
        start = self.start
        place = (start[3] + share * x, start[7] + share * y, start[11] + share * z)
        return poses.with_position(poses.rotated(start, self._turn, share), place)

    def rate(self, share: float) -> tuple[float, ...]:
        del share
        return self._rate


class Arc:
    """The circular arc from a start through a point to an end.

    The tool rotates in step from the start's to the end's rotation. If `fixed`, it keeps its angle to the tangent
    instead, and the end's rotation is ignored. Raises ValueError if the three points do not define a circle.
    """

    def __init__(self, start: Frame, via: Vector, end: Frame, fixed: bool) -> None:
        a, b, c = (start[3], start[7], start[11]), via, (end[3], end[7], end[11])
        to_via, to_end = poses.minus(b, a), poses.minus(c, a)
        across = poses.cross(to_via, to_end)
        area = math.hypot(*across)
        if area <= _COLLINEAR * math.hypot(*to_via) * math.hypot(*to_end):
            raise ValueError("start, via and end must be three points of a circle, but are on a line")
        self._normal = (across[0] / area, across[1] / area, across[2] / area)
        # The centre, from the start: (|ab|² ac − |ac|² ab) × normal / 2 area.
        v, e = poses.dot(to_via, to_via), poses.dot(to_end, to_end)
        mixed = tuple(v * q - e * p for p, q in zip(to_via, to_end, strict=True))
        x, y, z = poses.cross((mixed[0], mixed[1], mixed[2]), self._normal)
        x, y, z = x / (2.0 * area), y / (2.0 * area), z / (2.0 * area)
        self._centre = (a[0] + x, a[1] + y, a[2] + z)
        self._out = (-x, -y, -z)
        self._on = poses.cross(self._normal, self._out)
        arm = poses.minus(c, self._centre)
        self._swept = math.atan2(poses.dot(arm, self._on), poses.dot(arm, self._out)) % (2.0 * math.pi)
        self.length = self._swept * math.hypot(x, y, z)
        self.start = start
        self._turn = poses.rotation_vector(poses.compose(poses.invert(start), end))
        if fixed:
            # The normal in the tool's own frame, so that one formula serves both modes.
            n = poses.rotate(poses.invert(poses.with_position(start, (0.0, 0.0, 0.0))), self._normal)
            self._turn = (self._swept * n[0], self._swept * n[1], self._swept * n[2])
        self.angle = math.hypot(*self._turn)
        self._turn_rate = poses.rotate(start, self._turn)

    def at(self, share: float) -> Frame:
        c, s = math.cos(share * self._swept), math.sin(share * self._swept)
        x, y, z = (m + c * o + s * n for m, o, n in zip(self._centre, self._out, self._on, strict=True))
        return poses.with_position(poses.rotated(self.start, self._turn, share), (x, y, z))

    def rate(self, share: float) -> tuple[float, ...]:
        c, s = self._swept * math.cos(share * self._swept), self._swept * math.sin(share * self._swept)
        x, y, z = (c * n - s * o for o, n in zip(self._out, self._on, strict=True))
        return (x, y, z, *self._turn_rate)
