"""Solid bodies round the arm, as the world passes them to the controller: one npz file.

Half-spaces, capsules, boxes, cones and convex hulls are exact. The object has no formula. It is represented by points
that cover its surface, about `OBJECT_SPACING_M` apart, each with a ball of `OBJECT_BALL_M` round it that closes the
gaps. The log states a collision by the bodies' names.

Arrays of the file (m, base frame unless stated; any may be empty): `tool` (T, 7) capsules in the flange frame: start,
end, radius; `half_spaces` (K, 4) outward normal and offset; `capsules` (L, 7); `boxes` (M, 15) centre, axes (rows),
half extents; `cones` (C, 9) centre of the foot, axis, height, radii of foot and top; `hull_faces` (F, 10) corners of
the convex hulls' triangles, and the number of the hull; `names` (K + L + M + C + H,) in this order; `object_points`
(P, 3) in the object's frame; `base_from_object` (4, 4).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

OBJECT_SPACING_M = 0.0025
OBJECT_BALL_M = 0.001
_NO_AREA_M2 = 1e-14
_ARRAYS = ("tool", "half_spaces", "capsules", "boxes", "cones", "hull_faces", "object_points", "base_from_object")


@dataclass(frozen=True)
class Surroundings:
    """All that the arm can touch except itself; see the module's docstring for the arrays."""

    tool: FloatArray = field(default_factory=lambda: np.zeros((0, 7)))
    half_spaces: FloatArray = field(default_factory=lambda: np.zeros((0, 4)))
    capsules: FloatArray = field(default_factory=lambda: np.zeros((0, 7)))
    boxes: FloatArray = field(default_factory=lambda: np.zeros((0, 15)))
    cones: FloatArray = field(default_factory=lambda: np.zeros((0, 9)))
    hull_faces: FloatArray = field(default_factory=lambda: np.zeros((0, 10)))
    names: tuple[str, ...] = ()
    object_points: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    base_from_object: FloatArray = field(default_factory=lambda: np.eye(4))

    @property
    def object_in_base(self) -> FloatArray:
        """The object's points (P, 3) in base."""
        return self.object_points @ self.base_from_object[:3, :3].T + self.base_from_object[:3, 3]

    def distances(self, points: FloatArray, body: int) -> FloatArray:
        """Distances (N,) of points (N, 3), base frame, to one body of `names`, negative inside."""
        solids = ((self.half_spaces, _to_half_space), (self.capsules, _to_capsule), (self.boxes, _to_box))
        for rows, distance in (*solids, (self.cones, _to_cone)):
            if body < len(rows):
                return distance(points, rows[body])
            body -= len(rows)
        return _to_hull(points, self._hulls[body])

    @cached_property
    def _hulls(self) -> list[FloatArray]:
        """Triangles (F, 3, 3) of each hull, with corners in the order that makes their normals point outwards."""
        hulls: list[FloatArray] = []
        for number in np.unique(self.hull_faces[:, 9]):
            triangles = self.hull_faces[self.hull_faces[:, 9] == number, :9].reshape(-1, 3, 3)
            inside = triangles.reshape(-1, 3).mean(axis=0)
            normals = _normals(triangles)
            inwards = np.einsum("fi,fi->f", normals, triangles[:, 0] - inside) < 0.0
            turned = np.where(inwards[:, None, None], triangles[:, ::-1], triangles)
            hulls.append(turned[np.linalg.norm(normals, axis=1) > _NO_AREA_M2])
        return hulls

    def nudged(self, shift_m: Sequence[float], turn_rad: float) -> "Surroundings":
        """A copy with the object shifted by (3,) m and turned about its own z axis."""
        cosine, sine = np.cos(turn_rad), np.sin(turn_rad)
        pose = self.base_from_object.copy()
        pose[:3, :3] = pose[:3, :3] @ np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        pose[:3, 3] += np.array(shift_m)
        return replace(self, base_from_object=pose)

    def save(self, path: Path) -> None:
        """Writes the npz file. Raises OSError."""
        with path.open("wb") as file:
            np.savez(file, **{name: getattr(self, name) for name in _ARRAYS}, names=np.array(self.names, dtype=np.str_))


def load(path: Path) -> Surroundings:
    """Reads the npz file. Raises OSError, and ValueError if it is no such file or lacks an array."""
    with np.load(path, allow_pickle=False) as file:
        if not hasattr(file, "files"):
            raise ValueError(f"{path} is not a surroundings file")
        try:
            arrays = {name: file[name].astype(float) for name in _ARRAYS}
            names = tuple(str(name) for name in file["names"])
        except KeyError as error:
            raise ValueError(f"{path} is not a surroundings file: {error} is missing") from error
    return Surroundings(**arrays, names=names)


def _to_half_space(points: FloatArray, row: FloatArray) -> FloatArray:
    return points @ row[:3] - row[3]


def _to_capsule(points: FloatArray, row: FloatArray) -> FloatArray:
    return _to_segment(points, row[:3], row[3:6]) - row[6]


def _to_box(points: FloatArray, row: FloatArray) -> FloatArray:
    beyond = np.abs((points - row[:3]) @ row[3:12].reshape(3, 3).T) - row[12:]
    return np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)


def _to_segment(points: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    along = end - start
    squared = float(along @ along)
    away = points - start
    share = np.clip(away @ along / squared, 0.0, 1.0) if squared > 0.0 else np.zeros(len(points))
    return np.linalg.norm(away - share[:, None] * along, axis=1)


def _to_cone(points: FloatArray, row: FloatArray) -> FloatArray:
    """Distances (N,) to a cone or frustum, negative inside; in the plane of point and axis it is a trapezium."""
    (height, foot, top), away = row[6:], points - row[:3]
    along = away @ row[3:6]
    across = np.linalg.norm(away - along[:, None] * row[3:6], axis=1)
    place = np.stack([across, along], axis=1)
    corners = np.array([[0.0, 0.0], [foot, 0.0], [top, height], [0.0, height]])
    gaps = [_to_segment(place, start, end) for start, end in pairwise(corners)]
    inside = (along > 0.0) & (along < height) & (across < foot + (top - foot) * along / height)
    return np.where(inside, -1.0, 1.0) * np.min(gaps, axis=0)


def _to_hull(points: FloatArray, triangles: FloatArray) -> FloatArray:
    """Distances (N,) to a convex hull, negative inside."""
    normals = _normals(triangles)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    from_planes = points @ normals.T - np.einsum("fi,fi->f", normals, triangles[:, 0])
    result = from_planes.max(axis=1)
    outside = result > 0.0
    shape = (np.count_nonzero(outside), len(triangles))
    over, nearest = np.ones(shape, dtype=bool), np.full(shape, np.inf)
    for corner in range(3):  # the nearest point is on an edge, or in the face if the point is inside all edges
        start, end = triangles[:, corner], triangles[:, (corner + 1) % 3]
        along, away = end - start, points[outside, None] - start
        share = np.clip(np.einsum("nfi,fi->nf", away, along) / np.einsum("fi,fi->f", along, along), 0.0, 1.0)
        nearest = np.minimum(nearest, np.linalg.norm(away - share[..., None] * along, axis=2))
        over &= np.einsum("nfi,fi->nf", away, np.cross(along, normals)) <= 0.0
    nearest = np.where(over, np.abs(from_planes[outside]), nearest)
    result[outside] = nearest.min(axis=1)
    return result


def _normals(triangles: FloatArray) -> FloatArray:
    return np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
