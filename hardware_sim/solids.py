"""Conversion of the cell's solid bodies to the arrays of the controller's collision check.

Table, camera, obstacles and tool are those of the cell file. The object is the mesh that is rendered, not its
keep-out: a collision is a contact with its surface.
"""

import numpy as np
from scipy.spatial import ConvexHull

from acquisition import geometry
from acquisition.models.base import FloatArray
from acquisition.models.cell_config import Box, Capsule, CapsuleShape, CellConfig, Cone, ConvexMesh, HalfSpace
from hardware_sim.controller.surroundings import OBJECT_SPACING_M, Surroundings
from hardware_sim.sheets import Mesh


def surroundings(cell: CellConfig, mesh: Mesh) -> Surroundings:
    """Everything that the arm can touch in a cell; the object's mesh is in the object's frame."""
    bodies = [cell.table, *cell.camera_body, *cell.obstacles]
    half_spaces = [body for body in bodies if isinstance(body, HalfSpace)]
    capsules = [body for body in bodies if isinstance(body, Capsule)]
    boxes = [body for body in bodies if isinstance(body, Box)]
    cones = [body for body in bodies if isinstance(body, Cone)]
    hulls = [body for body in bodies if isinstance(body, ConvexMesh)]
    return Surroundings(
        tool=_rows([_capsule(capsule) for capsule in cell.arm.tool_capsules], 7),
        half_spaces=_rows([_half_space(body) for body in half_spaces], 4),
        capsules=_rows([_capsule(body) for body in capsules], 7),
        boxes=_rows([_box(body) for body in boxes], 15),
        cones=_rows([_cone(body) for body in cones], 9),
        hull_faces=np.concatenate([np.zeros((0, 10)), *(_faces(body, number) for number, body in enumerate(hulls))]),
        names=tuple(body.name for body in (*half_spaces, *capsules, *boxes, *cones, *hulls)),
        object_points=surface_points(mesh),
        base_from_object=cell.object.keep_out.base_from_object.matrix,
    )


def surface_points(mesh: Mesh) -> FloatArray:
    """Points (P, 3) that cover a mesh: many are sampled at random, and one is kept in each cell of a lattice."""
    random = np.random.default_rng(0)
    count = (16 * mesh.areas / OBJECT_SPACING_M**2 + random.random(len(mesh.areas))).astype(int)
    chosen = mesh.triangles[np.repeat(np.arange(len(count)), count)]
    first, second = random.random((2, len(chosen), 1))
    folded = first + second > 1
    first[folded], second[folded] = 1 - first[folded], 1 - second[folded]
    points = chosen[:, 0] + first * (chosen[:, 1] - chosen[:, 0]) + second * (chosen[:, 2] - chosen[:, 0])
    _, one_each = np.unique(np.floor(points / OBJECT_SPACING_M).astype(int), axis=0, return_index=True)
    return points[one_each]


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


def _cone(item: Cone) -> list[float]:
    pose = item.base_from_cone.matrix
    return [*pose[:3, 3], *pose[:3, 2], item.height_m, item.foot_radius_m, item.top_radius_m]


def _faces(item: ConvexMesh, number: int) -> FloatArray:
    vertices = geometry.transform(item.base_from_mesh.matrix, np.array(item.vertices_m))
    corners = vertices[ConvexHull(vertices).simplices].reshape(-1, 9)
    return np.hstack([corners, np.full((len(corners), 1), float(number))])
