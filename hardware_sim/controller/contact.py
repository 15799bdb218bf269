"""Collision check of the arm by sphere sets and conservative advancement; a collision causes a protective stop.

It shares neither code nor shapes nor clearances with the planner, so that the planner's errors show here. Links are
sphere sets (`link_spheres.json`, made by `hardware_sim.link_spheres`). Contact is reported at the latest when a link is
2 mm deep in something (4 mm for two links, or for the object), and never while they are over 1 mm (2 mm) apart. For
UR15, UR20 and UR30, whose shape is an estimate, these lengths are three times as large.

Conservative advancement (Mirtich, 1996): a check gives the distance of a pair of bodies. The pair is not checked again
until a bound on the relative movement of all their points has used up that distance. Most ticks check none of the two
dozen pairs; near a body there is one check for each `RESOLUTION_M` of movement.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hardware_sim.controller import poses
from hardware_sim.controller.kinematics import ArmModel
from hardware_sim.controller.poses import Frame
from hardware_sim.controller.surroundings import OBJECT_BALL_M, FloatArray, Surroundings

BoolArray = npt.NDArray[np.bool_]
PARTS = ("base", "shoulder", "upper arm", "forearm", "wrist 1", "wrist 2", "wrist 3", "tool", "object")
RESOLUTION_M = 0.001
"""Greatest movement, m, of any point of the arm between two checks of bodies that are this close."""

_TOOL, _OBJECT = 7, 8
_FRAMES = (0, 1, 2, 3, 4, 5, 6, 6, 0)  # number of the link frame of each part
_UNIT_M = 1e-4
_GROUP = 20
_FAR_M = 0.03  # beyond this a lower bound of the distance suffices
_TOOL_DIP_M = 0.0005
# Wrist 1 and wrist 3 cannot meet, whatever the joints. The tool sits on the flange, which turns in wrist 2.
_NEVER = {(4, 6), (5, _TOOL)}


@dataclass(frozen=True)
class Contact:
    """Two parts that touch, and the joints (6,) in rad at which they began to touch."""

    first: str
    second: str
    joints: tuple[float, ...]


@dataclass(frozen=True)
class _Part:
    """The spheres of one part in its frame, m, grouped with their neighbours; each group has an enclosing sphere."""

    spheres: FloatArray  # (S, 3) centres
    radii: FloatArray  # (S,)
    members: npt.NDArray[np.int64]  # (S,) the group of each
    centers: FloatArray  # (K, 3)
    bounds: FloatArray  # (K,) radii round the groups
    center: FloatArray  # (3,)
    radius: float  # round all of them


class _Pair(NamedTuple):
    """A part of the arm, and another part (`other` ≥ 0) or a body of the surroundings (`body` ≥ 0)."""

    part: int
    other: int
    body: int


class ContactCheck:
    """The collision check of one arm."""

    def __init__(self, model: ArmModel, surroundings: Surroundings) -> None:
        self._surroundings = surroundings
        self._links = model.links
        around = surroundings.object_in_base
        object_spheres = np.hstack([around, np.full((len(around), 1), OBJECT_BALL_M)])
        spheres = [*_links(model.name), _tool(surroundings.tool), object_spheres]
        self._parts = [_part(s) for s in spheres]
        arm = [part for part in range(_OBJECT) if len(spheres[part])]
        # The base stands on the table and cannot move.
        self._pairs = [_Pair(part, -1, body) for body in range(len(surroundings.names)) for part in arm if part > 0]
        self._pairs += [_Pair(part, _OBJECT, -1) for part in arm if part > 0 and len(around)]
        self._pairs += [
            _Pair(part, other, -1) for part in arm for other in arm if other - part >= 2 and (part, other) not in _NEVER
        ]
        self._lever_arms = np.array([self._lever_arm(pair) for pair in self._pairs])
        self._slack_m = np.full(len(self._pairs), -1.0)
        self._joints: FloatArray | None = None

    def reset(self) -> None:
        """Forgets the arm's position: the next `advance` checks all pairs."""
        self._joints = None

    def advance(self, joints: Sequence[float]) -> Contact | None:
        """First contact on the joint-space segment from the joints of the last call to `joints` (6,), rad."""
        goal = np.array(joints, dtype=float)
        if self._joints is None:
            self._joints = goal
            self._slack_m[:] = -1.0
        start, self._joints = self._joints, goal
        moved = self._lever_arms @ np.abs(goal - start)
        steps = max(1, math.ceil(float(moved.max()) / RESOLUTION_M))
        for step in range(1, steps + 1):
            self._slack_m -= moved / steps
            if self._slack_m.min() < 0.0:
                present = start + step / steps * (goal - start)
                touching = self._touching_pair(present.tolist())
                if touching is not None:
                    first, second = self._names(touching)
                    return Contact(first, second, tuple(present.tolist()))
        return None

    def distances(self, joints: Sequence[float]) -> dict[tuple[str, str], float]:
        """Distance in m of each pair of bodies, negative in penetration; exact below 30 mm, else a lower bound."""
        frames = self.frames(joints)
        return {self._names(pair): self._distance(pair, frames) for pair in self._pairs}

    def _touching_pair(self, joints: Sequence[float]) -> _Pair | None:
        """Checks the pairs that may have met; returns the one in deepest contact, or None."""
        frames = self.frames(joints)
        deepest: tuple[float, _Pair | None] = (0.0, None)
        for number in np.flatnonzero(self._slack_m < 0.0):
            distance = self._distance(self._pairs[number], frames)
            self._slack_m[number] = distance
            if distance <= deepest[0]:
                deepest = distance, self._pairs[number]
        return deepest[1]

    def _names(self, pair: _Pair) -> tuple[str, str]:
        other = PARTS[pair.other] if pair.body < 0 else self._surroundings.names[pair.body]
        return PARTS[pair.part], other

    def _distance(self, pair: _Pair, frames: list[Frame]) -> float:
        """Distance of a pair by branch and bound, or a lower bound if that is beyond `_FAR_M`."""
        one = self._parts[pair.part]
        rotation, shift = _rotation_and_shift(frames[_FRAMES[pair.part]])
        if pair.body >= 0:
            around = (rotation @ one.center + shift)[None]
            bound = float(self._surroundings.distances(around, pair.body)[0]) - one.radius
            if bound >= _FAR_M:
                return bound
            points = one.spheres @ rotation.T + shift
            return float((self._surroundings.distances(points, pair.body) - one.radii).min())
        two = self._parts[pair.other]
        other_rotation, other_shift = _rotation_and_shift(frames[_FRAMES[pair.other]])
        # Everything in the frame of the first part.
        turn, offset = rotation.T @ other_rotation, rotation.T @ (other_shift - shift)

        def least(mine: BoolArray, its: BoolArray) -> float:
            places = two.spheres[its] @ turn.T + offset
            return float(_pairwise_distances(one.spheres[mine], one.radii[mine], places, two.radii[its]).min())

        bounds = _pairwise_distances(one.centers, one.bounds, two.centers @ turn.T + offset, two.bounds)
        nearest = int(bounds.argmin())
        if bounds.flat[nearest] >= _FAR_M:
            return float(bounds.flat[nearest])
        mine, its = one.members == nearest // len(two.centers), two.members == nearest % len(two.centers)
        best = least(mine, its)
        rivals = np.argwhere(bounds < best)
        if len(rivals) > 1:
            mine, its = np.isin(one.members, rivals[:, 0]), np.isin(two.members, rivals[:, 1])
            best = least(mine, its)
        return best

    def frames(self, joints: Sequence[float]) -> list[Frame]:
        """Forward kinematics of all links (Denavit–Hartenberg): seven frames in base, 0 the base, 6 the flange."""
        frames = [poses.IDENTITY]
        for angle, link in zip(joints, self._links, strict=True):
            q, a, ct, st = angle + link.offset, link.length, link.cos_twist, link.sin_twist
            c, s = math.cos(q), math.sin(q)
            step = (c, -s * ct, s * st, a * c, s, c * ct, -c * st, a * s, 0.0, st, ct, link.distance)
            frames.append(poses.compose(frames[-1], step))
        return frames

    def _lever_arm(self, pair: _Pair) -> list[float]:
        """Lever arms (6,) in m: bounds, in the other part's frame, of any moved point's distance from each axis."""
        alone = pair.body >= 0 or pair.other == _OBJECT
        moving, near = (pair.part, 0) if alone else (pair.other, _FRAMES[pair.part])
        part, far = self._parts[moving], _FRAMES[moving]
        lever_arms = [0.0] * 6
        # The last joint turns the part about z of the frame before it; for earlier joints only its reach is known.
        link = self._links[far - 1]
        x = part.spheres[:, 0] + link.length
        y = link.cos_twist * part.spheres[:, 1] - link.sin_twist * part.spheres[:, 2]
        z = link.sin_twist * part.spheres[:, 1] + link.cos_twist * part.spheres[:, 2] + link.distance
        lever_arms[far - 1] = float((np.hypot(x, y) + part.radii).max())
        reach = float((np.sqrt(x**2 + y**2 + z**2) + part.radii).max())
        for joint in range(far - 2, near - 1, -1):
            # The offset along a joint's own axis adds nothing to that joint's lever arm.
            lever_arms[joint] = abs(self._links[joint].length) + reach
            reach += math.hypot(self._links[joint].length, self._links[joint].distance)
        return lever_arms


def _links(model: str) -> list[FloatArray]:
    """The spheres (S, 4) of the seven links, each in its frame, m."""
    text = Path(__file__).with_name("link_spheres.json").read_text(encoding="utf-8")
    table = json.loads(text)
    links = table[model]
    return [np.array(link).reshape(-1, 4) * _UNIT_M for link in (table[links] if isinstance(links, str) else links)]


def _tool(capsules: FloatArray) -> FloatArray:
    """Spheres (S, 4) for capsules (T, 7), so dense that at most a depth of `_TOOL_DIP_M` is missing between them."""
    spheres: list[FloatArray] = []
    for row in capsules:
        start, end, radius = row[:3], row[3:6], float(row[6])
        spacing = math.sqrt(8.0 * radius * _TOOL_DIP_M)
        count = int(np.linalg.norm(end - start) / spacing) + 2
        share = np.linspace(0.0, 1.0, count)[:, None]
        spheres.append(np.hstack([start + share * (end - start), np.full((count, 1), radius)]))
    return np.vstack(spheres) if spheres else np.zeros((0, 4))


def _part(spheres: FloatArray) -> _Part:
    groups = _groups(spheres)
    ordered = np.vstack(groups) if groups else np.zeros((0, 4))
    around = np.array([_enclosing_sphere(group) for group in groups]).reshape(-1, 4)
    enclosing = _enclosing_sphere(spheres) if len(spheres) else np.zeros(4)
    members = np.repeat(np.arange(len(groups)), [len(group) for group in groups])
    return _Part(
        ordered[:, :3].copy(), ordered[:, 3].copy(), members, around[:, :3].copy(), around[:, 3].copy(), enclosing[:3],
        float(enclosing[3]),
    )  # fmt: skip


def _enclosing_sphere(spheres: FloatArray) -> FloatArray:
    """A sphere (4,) round spheres (S, 4)."""
    center = (spheres[:, :3].min(axis=0) + spheres[:, :3].max(axis=0)) / 2
    return np.array([*center, (np.linalg.norm(spheres[:, :3] - center, axis=1) + spheres[:, 3]).max()])


def _groups(spheres: FloatArray) -> list[FloatArray]:
    """Splits spheres (S, 4) across their longest extent until each group is small."""
    if len(spheres) <= _GROUP:
        return [spheres] if len(spheres) else []
    extent = np.ptp(spheres[:, :3], axis=0)
    order = np.argsort(spheres[:, int(np.argmax(extent))], kind="stable")
    half = len(order) // 2
    return _groups(spheres[order[:half]]) + _groups(spheres[order[half:]])


def _rotation_and_shift(frame: Frame) -> tuple[FloatArray, FloatArray]:
    rows = np.array(frame).reshape(3, 4)
    return rows[:, :3], rows[:, 3]


def _pairwise_distances(a: FloatArray, a_radii: FloatArray, b: FloatArray, b_radii: FloatArray) -> FloatArray:
    """Distances (A, B) of spheres round a (A, 3) from spheres round b (B, 3)."""
    squared = np.add.outer(np.einsum("ai,ai->a", a, a), np.einsum("bi,bi->b", b, b)) - 2.0 * (a @ b.T)
    return np.sqrt(np.maximum(squared, 0.0)) - np.add.outer(a_radii, b_radii)
