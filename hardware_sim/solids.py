"""The cell's solid bodies for the controller's collision check: what the world knows of shapes, as numbers.

Table, camera, obstacles and tool are as the cell file has them. The object is the mesh that is rendered, not its
keep-out: only what is really touched counts.
"""

import numpy as np
from scipy.spatial import KDTree

from acquisition.config import Box, Capsule, CapsuleShape, CellConfig, HalfSpace
from acquisition.types import BoolArray, FloatArray
from hardware_sim.controller.surroundings import DistanceGrid, Surroundings
from hardware_sim.sheets import Mesh
from hardware_sim.tracing import Tracer

SPACING_M = 0.004
"""Of the grid of distances; between its points distances are linear, which rounds sharp edges by under 1 mm."""

_MARGIN_M = 3 * SPACING_M
_SAMPLE_M = 0.001
_FAR_M = 0.016
_MOST_CORNERS = 20_000  # a fine mesh's are among the samples anyway


def surroundings(cell: CellConfig, tracer: Tracer) -> Surroundings:
    """Everything that the arm can touch in a cell with an object, whose mesh is the tracer's, object frame."""
    bodies = [cell.table, *cell.camera_body, *cell.obstacles]
    half_spaces = [body for body in bodies if isinstance(body, HalfSpace)]
    capsules = [body for body in bodies if isinstance(body, Capsule)]
    boxes = [body for body in bodies if isinstance(body, Box)]
    return Surroundings(
        tool=_rows([_capsule(capsule) for capsule in cell.arm.tool_capsules], 7),
        half_spaces=_rows([_half_space(body) for body in half_spaces], 4),
        capsules=_rows([_capsule(body) for body in capsules], 7),
        boxes=_rows([_box(body) for body in boxes], 15),
        names=tuple(body.name for body in (*half_spaces, *capsules, *boxes)),
        object=distance_grid(tracer, cell.object.keep_out.base_from_object.matrix),
    )


def distance_grid(tracer: Tracer, base_from_object: FloatArray) -> DistanceGrid:
    """Signed distances to a mesh, which may consist of solids that overlap and be open where it stands on z = 0."""
    corners = tracer.mesh.triangles.reshape(-1, 3)
    low, high = corners.min(axis=0) - _MARGIN_M, corners.max(axis=0) + _MARGIN_M
    low[2] = corners[:, 2].min()
    axes = [np.arange(a, b + SPACING_M, SPACING_M) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    flat = points.reshape(-1, 3)
    found, _ = KDTree(_samples(tracer.mesh)).query(flat, distance_upper_bound=_FAR_M, eps=0.02)
    distances = np.minimum(found, _FAR_M)
    distances[_inside(tracer, flat, distances < _MARGIN_M)] *= -1.0
    return DistanceGrid(distances.reshape(points.shape[:3]).astype(np.float32), low, SPACING_M, base_from_object)


def _inside(tracer: Tracer, points: FloatArray, near: BoolArray) -> BoolArray:
    """Whether each of (N, 3) is inside any of the mesh's solids: some ray from it meets a surface from behind.

    One ray tells, but for points in two solids at once; `near` (N,) are worth more rays.
    """
    normals = tracer.mesh.face_normals
    inside = np.zeros(len(points), dtype=bool)
    for number, axis in enumerate((2, 2, 0, 0, 1, 1)):
        direction = np.full(3, 0.0123)  # a little askew, so that no ray runs along an edge of a lattice
        direction[axis] = -1.0 if number % 2 else 1.0
        asked = np.flatnonzero(~inside & (near | (number == 0)))
        start = points[asked].astype(np.float32)
        hits = tracer.first_hits(start, np.broadcast_to(direction.astype(np.float32), start.shape))
        inside[asked] = (hits.triangles >= 0) & (normals[hits.triangles] @ direction > 0)
    return inside


def _samples(mesh: Mesh) -> FloatArray:
    """Points (N, 3) all over a mesh, none farther than about `_SAMPLE_M` from the next."""
    random = np.random.default_rng(0)
    count = (mesh.areas / (_SAMPLE_M / 2) ** 2 + random.random(len(mesh.areas))).astype(int)
    chosen = mesh.triangles[np.repeat(np.arange(len(count)), count)]
    first, second = random.random((2, len(chosen), 1))
    folded = first + second > 1
    first[folded], second[folded] = 1 - first[folded], 1 - second[folded]
    inner = chosen[:, 0] + first * (chosen[:, 1] - chosen[:, 0]) + second * (chosen[:, 2] - chosen[:, 0])
    corners = mesh.triangles.reshape(-1, 3)
    return np.concatenate([inner, corners[:: max(1, len(corners) // _MOST_CORNERS)]])


def _rows(rows: list[list[float]], width: int) -> FloatArray:
    return np.array(rows, dtype=float).reshape(-1, width)


def _capsule(item: Capsule | CapsuleShape) -> list[float]:
    return [*item.start_m, *item.end_m, item.radius_m]


def _half_space(item: HalfSpace) -> list[float]:
    normal = np.array(item.normal) / np.linalg.norm(item.normal)
    return [*normal.tolist(), float(normal @ np.array(item.point_m))]


def _box(item: Box) -> list[float]:
    pose = item.base_from_box.matrix
    return [*pose[:3, 3], *pose[:3, :3].T.ravel(), *item.half_extents_m]
