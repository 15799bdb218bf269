"""Process path (`movep`, UR script manual): straight pieces joined by circular blends, at a constant tool speed.

The path grows while the arm moves along it: a `movep` with a blend radius hands over before it has to slow down, and
the next one replaces the corner by an arc. The speed is as programmed. It is lower where an arc's centripetal
acceleration would exceed the programmed one, and where a later piece's speed, or rest at the end, could not be reached
otherwise. On straight pieces the tool rotates in step with the path. On an arc the rotation of the piece before fades
out while that of the next one fades in, so that joint speeds have no jump.
"""

import math
from dataclasses import dataclass

from hardware_sim.controller import limits, poses
from hardware_sim.controller.curves import Line
from hardware_sim.controller.motion import STANDSTILL, Follower, Twist
from hardware_sim.controller.moves import CartesianMove, end_joints
from hardware_sim.controller.poses import Frame, Vector

_STRAIGHT = 1e-4  # rad: a corner below this counts as straight
_BACK = math.pi - 0.05  # rad: a corner above this counts as a reversal, which has no arc
_SHORTEST = 1e-6  # m


@dataclass(frozen=True)
class _Piece:
    """A stretch of the path with its own speed limit (m/s) and acceleration (m/s²)."""

    shape: "_Straight | _Corner"
    length: float
    speed: float
    acceleration: float

    @property
    def ramp(self) -> float:
        """Seconds from rest to its speed, or to the greatest speed that its length allows."""
        return min(self.speed / self.acceleration, math.sqrt(self.length / self.acceleration))


class _Straight:
    """A line between two poses, used from `offset` m after its start.

    As for every shape, `at` is the tool's pose at the arc length x in m, `rate` its change per m.
    """

    def __init__(self, line: Line, offset: float = 0.0) -> None:
        self.line = line
        self.offset = offset

    def at(self, x: float) -> Frame:
        return self.line.at((self.offset + x) / self.line.length)

    def rate(self, x: float) -> Twist:
        del x
        return tuple(r / self.line.length for r in self.line.rate(0.0))

    @property
    def tangent(self) -> Vector:
        """The direction of travel."""
        x, y, z = self.rate(0.0)[:3]
        return (x, y, z)

    @property
    def turn(self) -> Vector:
        """Rotation vector per m, in the tool's frame."""
        rates = self.rate(0.0)
        return poses.rotate(poses.invert(poses.with_position(self.line.start, (0.0, 0.0, 0.0))), rates[3:])


class _Corner:
    """The arc that cuts the corner between two lines, tangential to both at `trim` m from it."""

    def __init__(self, before: _Straight, after: _Straight, trim: float) -> None:
        self._corner = after.line.at(0.0)
        self._from, to = before.tangent, after.tangent
        cosine = max(-1.0, min(1.0, poses.dot(self._from, to)))
        self.bend = math.acos(cosine)
        sine = math.sin(self.bend)
        self._turns = before.turn, after.turn
        self._trim = trim
        self.radius = trim / math.tan(0.5 * self.bend) if self.bend > _STRAIGHT else math.inf
        self.length = self.radius * self.bend if self.bend > _STRAIGHT else 2.0 * trim
        inwards = (
            (b - cosine * a) / sine if self.bend > _STRAIGHT else 0.0 for a, b in zip(self._from, to, strict=True)
        )
        x, y, z = inwards
        self._inwards = (x, y, z)

    def at(self, x: float) -> Frame:
        along, across = self._along(x)
        start = poses.position(self._corner)
        place = tuple(
            s + (along - self._trim) * a + across * b for s, a, b in zip(start, self._from, self._inwards, strict=True)
        )
        first, second = self._turns
        left, gone = self._shares(x / self.length)
        turned = poses.rotated(poses.rotated(self._corner, first, -left), second, gone)
        return poses.with_position(turned, place)

    def rate(self, x: float) -> Twist:
        angle = 0.0 if math.isinf(self.radius) else x / self.radius
        c, s = math.cos(angle), math.sin(angle)
        linear = (c * a + s * b for a, b in zip(self._from, self._inwards, strict=True))
        u = x / self.length
        first, second = self._turns
        left, _ = self._shares(u)
        # Derivatives of the two cubics in `_shares`.
        out = (3.0 * u - 1.0) * (u - 1.0) + 6.0 * (1.0 - u) * u * self._trim / self.length
        into = 6.0 * (1.0 - u) * u * self._trim / self.length + (3.0 * u - 2.0) * u
        a = poses.rotate(self._corner, first)
        b = poses.rotate(poses.rotated(self._corner, first, -left), second)
        return (*linear, *(out * p + into * q for p, q in zip(a, b, strict=True)))

    def _along(self, x: float) -> tuple[float, float]:
        if math.isinf(self.radius):
            return x, 0.0
        return self.radius * math.sin(x / self.radius), self.radius * (1.0 - math.cos(x / self.radius))

    def _shares(self, u: float) -> tuple[float, float]:
        """Arc lengths, m, left of the rotation before and covered of the next one (cubic Hermite)."""
        rise = (3.0 - 2.0 * u) * u * u * self._trim
        gone_before = (u * (u - 1.0) ** 2) * self.length + rise
        return self._trim - gone_before, rise + u * u * (u - 1.0) * self.length


class ProcessPath(CartesianMove):
    """Straight pieces and arcs in sequence, with rest at the end that is known so far."""

    def __init__(self, follower: Follower, line: Line, speed: float, acceleration: float) -> None:
        """Raises MotionError if the end is out of reach."""
        self.follower = follower
        self._last = _Straight(line)
        self._pieces = [_limited(self._last, line.length, line, speed, acceleration)]
        self._first = self._pieces[0]
        self._at = 0.0  # m into the present piece
        self._speed = 0.0
        self.base_from_end = line.at(1.0)
        self.end = end_joints(follower, line, follower.joints)
        self.finished = False

    def extend(self, line: Line, radius: float, speed: float, acceleration: float) -> bool:
        """Extends the path by `line`, which begins at the path's end, round a corner cut at `radius` m.

        Returns False at a reversal, or if the arm is too near to slow down for the arc. Raises MotionError if the end
        of the line is out of reach.
        """
        before, after = self._last, _Straight(line)
        last = self._pieces[-1]
        trim = min(radius, last.length - (self._at if len(self._pieces) == 1 else 0.0))
        while trim > _SHORTEST:
            arc = _Corner(before, after, trim)
            if arc.bend > _BACK:
                return False
            shorter = _Piece(last.shape, last.length - trim, last.speed, last.acceleration)
            fastest = math.sqrt(min(last.acceleration, acceleration) * arc.radius)
            piece = _limited(arc, arc.length, line, min(speed, fastest), acceleration)
            rest = _limited(_Straight(line, trim), line.length - trim, line, speed, acceleration)
            pieces = [*self._pieces[:-1], shorter, piece, rest]
            if self._speed <= _admitted(pieces, self._at) * (1.0 + 1e-9):
                end = end_joints(self.follower, line, self.end)
                self._pieces, self._last, self.end, self.base_from_end = pieces, after, end, line.at(1.0)
                return True
            trim *= 0.5
        return False

    @property
    def _left(self) -> float:
        return sum(piece.length for piece in self._pieces) - self._at

    @property
    def time_left(self) -> float:
        left, a = self._left, self._pieces[-1].acceleration
        if self._speed <= 0.0:
            return 0.0 if self.finished else 2.0 * math.sqrt(left / a)
        return max(self._speed / a, left / self._speed + 0.5 * self._speed / a)

    @property
    def ramp_in(self) -> float:
        return self._first.ramp

    @property
    def ramp_out(self) -> float:
        return self._pieces[-1].ramp

    def hands_over(self, base_from_tool: Frame, base_from_end: Frame, radius: float) -> bool:
        del base_from_tool, base_from_end
        last = self._pieces[-1]
        return self._left <= radius + 0.5 * last.speed**2 / last.acceleration

    def frame_after(self, seconds: float) -> Frame:
        return self._first.shape.at(min(self._first.length, 0.5 * self._first.acceleration * seconds**2))

    def frame_before_end(self, seconds: float) -> Frame:
        last = self._pieces[-1]
        return last.shape.at(max(0.0, last.length - 0.5 * last.acceleration * seconds**2))

    def advance(self, seconds: float) -> Frame:
        if seconds > 0.0:
            self._move_on(seconds)
        piece = self._pieces[0]
        self.rate = STANDSTILL if self.finished else tuple(self._speed * r for r in piece.shape.rate(self._at))
        return self.base_from_end if self.finished else piece.shape.at(self._at)

    def _move_on(self, seconds: float) -> None:
        piece = self._pieces[0]
        a = piece.acceleration
        # The highest speed from which the piece's end is reached at the speed admitted there, if the speed changes
        # linearly during this step.
        out = _admitted(self._pieces[1:], 0.0)
        half = 0.5 * a * seconds
        room = half**2 + out**2 + 2.0 * a * (piece.length - self._at) - a * self._speed * seconds
        speed = min(piece.speed, self._speed + a * seconds, max(out, math.sqrt(max(0.0, room)) - half))
        speed = max(speed, 0.0, self._speed - 2.0 * a * seconds)
        self._at += 0.5 * (self._speed + speed) * seconds
        self._speed = speed
        while len(self._pieces) > 1 and self._at >= self._pieces[0].length:
            self._at -= self._pieces.pop(0).length
        left = self._pieces[0].length - self._at
        if len(self._pieces) == 1 and (left <= 1e-9 or (speed <= 1e-9 and left <= a * seconds**2)):
            self.finished = True
            self._speed = 0.0


def _limited(shape: _Straight | _Corner, length: float, line: Line, speed: float, acceleration: float) -> _Piece:
    """A piece whose speed and acceleration keep the tool's limits, if the tool turns as on `line`."""
    turn = max(line.angle / line.length, 1e-9)
    return _Piece(
        shape,
        length,
        min(speed, limits.TOOL_SPEED, limits.TOOL_TURN / turn),
        min(acceleration, limits.TOOL_ACCELERATION, limits.TOOL_TURN_ACCELERATION / turn),
    )


def _admitted(pieces: list[_Piece], at: float) -> float:
    """The highest speed in m/s, `at` m into the first piece, from which all pieces' limits and rest at the end can be
    kept; zero without pieces.
    """
    speed = 0.0
    for number in reversed(range(len(pieces))):
        piece = pieces[number]
        length = piece.length - (at if number == 0 else 0.0)
        speed = min(piece.speed, math.sqrt(speed**2 + 2.0 * piece.acceleration * max(0.0, length)))
    return speed
