"""Polygonisation of implicit surfaces by surface nets (Gibson, MICCAI 1998).

It serves shapes that no grid of points can describe. Each lattice cell that the surface crosses has one vertex. Newton
steps along the gradient move it onto the surface, so that the lattice leaves no trace in positions or normals.
"""

from collections.abc import Callable

import numpy as np

from acquisition.models.base import FloatArray
from hardware_sim import sheets

Field = Callable[[FloatArray], FloatArray]
"""Points (..., 3) → values (...), negative inside."""


def gradient(field: Field, points: FloatArray, step_m: float = 2e-5) -> FloatArray:
    """The field's gradient at points (N, 3) by central differences."""
    result = np.empty_like(points)
    for axis in range(3):
        shift = np.zeros(3)
        shift[axis] = step_m
        result[:, axis] = (field(points + shift) - field(points - shift)) / (2 * step_m)
    return result


def mesh(field: Field, low: FloatArray, high: FloatArray, spacing_m: float) -> sheets.Mesh:
    """The closed surface field = 0 inside the box from `low` to `high` (3,), m; it must not touch the box.

    The field's slope must nowhere exceed 1, that of a distance.
    """
    inside = inside_lattice(field, low, high, spacing_m)
    corners = [inside[i : i - 1 or None, j : j - 1 or None, k : k - 1 or None] for i, j, k in np.ndindex(2, 2, 2)]
    crossed = np.any(corners, axis=0) & ~np.all(corners, axis=0)
    number = np.full(crossed.shape, -1, dtype=np.int64)
    number[crossed] = np.arange(int(crossed.sum()))
    vertices = low + spacing_m * (np.argwhere(crossed) + 0.5)
    for _ in range(4):
        slope = gradient(field, vertices)
        distance = field(vertices) / np.einsum("vi,vi->v", slope, slope)
        vertices = vertices - np.clip(distance, -spacing_m / 3, spacing_m / 3)[:, None] * slope
    normals = gradient(field, vertices)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    faces = np.concatenate([_faces_across(inside, number, axis) for axis in range(3)])
    return sheets.indexed(vertices, normals, faces)


def inside_lattice(field: Field, low: FloatArray, high: FloatArray, spacing_m: float) -> np.ndarray:
    """Whether each lattice point is inside; the field is evaluated only where the surface may be.

    The lattice starts at `low` and may reach up to 8 spacings beyond `high`.
    """
    edge = 8
    blocks = np.ceil((high - low) / (edge * spacing_m)).astype(int)
    starts = np.stack(np.meshgrid(*(np.arange(n) for n in blocks), indexing="ij"), axis=-1).reshape(-1, 3) * edge
    offsets = np.stack(np.meshgrid(*[np.arange(edge)] * 3, indexing="ij"), axis=-1)
    centre_value = field(low + spacing_m * (starts + (edge - 1) / 2))
    inside = np.empty((len(starts), edge, edge, edge), dtype=bool)
    inside[:] = (centre_value < 0)[:, None, None, None]
    near = np.abs(centre_value) < spacing_m * edge * np.sqrt(3) / 2
    inside[near] = field(low + spacing_m * (starts[near][:, None, None, None] + offsets)) < 0
    return inside.reshape(*blocks, edge, edge, edge).transpose(0, 3, 1, 4, 2, 5).reshape(*(blocks * edge))


def _faces_across(inside: np.ndarray, number: np.ndarray, axis: int) -> np.ndarray:
    """Two triangles between the four cells round each lattice edge along `axis` that crosses the surface."""
    first = np.moveaxis(inside, axis, 0)
    cells = np.moveaxis(number, axis, 0)
    i, j, k = np.nonzero(first[:-1, 1:-1, 1:-1] != first[1:, 1:-1, 1:-1])
    around = [cells[i, j, k], cells[i, j + 1, k], cells[i, j + 1, k + 1], cells[i, j, k + 1]]
    return np.concatenate([np.stack(around[:3], axis=1), np.stack([around[0], *around[2:]], axis=1)])
