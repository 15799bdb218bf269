"""What stands round the arm, as the world hands it to the controller: one npz file.

Half-spaces, capsules and boxes are exact. The object is a grid of signed distances: its surface has no formula, and
reading a distance off a grid costs the same for every shape. Names go into the log: what did the arm touch?

Arrays of the file (m, base frame; K, L, M may be 0): `tool` (T, 7) capsules in the flange frame: start, end, radius;
`half_spaces` (K, 4) outward normal and offset; `capsules` (L, 7); `boxes` (M, 15) centre, axes (rows), half extents;
`names` (K + L + M,) in this order; and, where there is an object, `distances` (X, Y, Z) at lattice points of its
frame, `corner` (3,), `spacing`, `base_from_object` (4, 4).
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]


@dataclass(frozen=True)
class DistanceGrid:
    """The object: signed distances (X, Y, Z) in m at `corner` + `spacing` · (i, j, k), its own frame."""

    distances: Float32Array
    corner: FloatArray
    spacing: float
    base_from_object: FloatArray

    def at(self, points: FloatArray) -> FloatArray:
        """Distances (N,) at points (N, 3), base frame; outside the grid a bound that the truth does not fall below."""
        pose = self.base_from_object
        place = ((points - pose[:3, 3]) @ pose[:3, :3] - self.corner) / self.spacing
        most = np.array(self.distances.shape) - 1.0
        inside = np.clip(place, 0.0, most)
        outside = np.sqrt(((place - inside) ** 2).sum(axis=1)) * self.spacing
        cell = np.minimum(inside.astype(np.int64), (most - 1.0).astype(np.int64))
        share = inside - cell
        values = np.zeros(len(points))
        for i in (0, 1):
            for j in (0, 1):
                for k in (0, 1):
                    weight = np.abs(1 - i - share[:, 0]) * np.abs(1 - j - share[:, 1]) * np.abs(1 - k - share[:, 2])
                    values += weight * self.distances[cell[:, 0] + i, cell[:, 1] + j, cell[:, 2] + k]
        # From a point outside, the way to the object leads through the grid's side.
        return np.where(outside > 0.0, outside + self._margin, values)

    @cached_property
    def _margin(self) -> float:
        d = self.distances  # its lowest layer is left out: the object stands on it, and so does the table
        return max(0.0, float(min(s.min() for s in (d[0], d[-1], d[:, 0], d[:, -1], d[:, :, -1]))))


@dataclass(frozen=True)
class Surroundings:
    """All that the arm can touch but itself; see the module's docstring for the arrays."""

    tool: FloatArray = field(default_factory=lambda: np.zeros((0, 7)))
    half_spaces: FloatArray = field(default_factory=lambda: np.zeros((0, 4)))
    capsules: FloatArray = field(default_factory=lambda: np.zeros((0, 7)))
    boxes: FloatArray = field(default_factory=lambda: np.zeros((0, 15)))
    names: tuple[str, ...] = ()
    object: DistanceGrid | None = None

    @property
    def bodies(self) -> tuple[str, ...]:
        """The names of all bodies, in the order of `distances`."""
        return self.names if self.object is None else (*self.names, "object")

    def distances(self, points: FloatArray, body: int) -> FloatArray:
        """Distances (N,) of points (N, 3), base frame, to one body, negative inside."""
        if body < len(self.half_spaces):
            row = self.half_spaces[body]
            return points @ row[:3] - row[3]
        body -= len(self.half_spaces)
        if body < len(self.capsules):
            row = self.capsules[body]
            return _to_segment(points, row[:3], row[3:6]) - row[6]
        body -= len(self.capsules)
        if body < len(self.boxes):
            row = self.boxes[body]
            beyond = np.abs((points - row[:3]) @ row[3:12].reshape(3, 3).T) - row[12:]
            return np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)
        assert self.object is not None  # noqa: S101 - bodies are numbered by `bodies`
        return self.object.at(points)

    def nudged(self, shift_m: FloatArray, turn_rad: float) -> "Surroundings":
        """The same with the object shifted by (3,) m and turned about its own z axis."""
        if self.object is None:
            return self
        cosine, sine = np.cos(turn_rad), np.sin(turn_rad)
        pose = self.object.base_from_object.copy()
        pose[:3, :3] = pose[:3, :3] @ np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        pose[:3, 3] += shift_m
        return replace(self, object=replace(self.object, base_from_object=pose))

    def save(self, path: Path) -> None:
        """Writes the npz file. Raises OSError."""
        arrays: dict[str, npt.NDArray[np.generic]] = {
            "tool": self.tool,
            "half_spaces": self.half_spaces,
            "capsules": self.capsules,
            "boxes": self.boxes,
            "names": np.array(self.names, dtype=np.str_),
        }
        grid = self.object
        if grid is not None:
            arrays |= {
                "distances": grid.distances,
                "corner": grid.corner,
                "spacing": np.array(grid.spacing),
                "base_from_object": grid.base_from_object,
            }
        with path.open("wb") as file:
            np.savez(file, **arrays)  # pyright: ignore[reportArgumentType] - its last parameter is no array


def load(path: Path) -> Surroundings:
    """Reads the npz file. Raises OSError, ValueError where it is none or an array is missing."""
    with np.load(path, allow_pickle=False) as file:
        if not hasattr(file, "files"):
            raise ValueError(f"{path} is not a file of surroundings")
        try:
            rows = {name: file[name].astype(float) for name in ("tool", "half_spaces", "capsules", "boxes")}
            names = tuple(str(name) for name in file["names"])
            grid = None
            if "distances" in file.files:
                grid = DistanceGrid(
                    file["distances"], file["corner"], float(file["spacing"]), file["base_from_object"].astype(float)
                )
        except KeyError as error:
            raise ValueError(f"{path} is not a file of surroundings: {error} is missing") from error
    return Surroundings(**rows, names=names, object=grid)


def _to_segment(points: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    along = end - start
    squared = float(along @ along)
    away = points - start
    share = np.clip(away @ along / squared, 0.0, 1.0) if squared > 0.0 else np.zeros(len(points))
    return np.linalg.norm(away - share[:, None] * along, axis=1)
