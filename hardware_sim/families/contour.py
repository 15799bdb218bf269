"""Polygonisation of implicit solids with sharp edges by dual contouring (Ju et al., SIGGRAPH 2002).

Machined edges and the seams of joined solids stay sharp, whereas surface nets (`hardware_sim.implicit`) round them off.
Each cell's vertex minimises the squared distance to the tangent planes where the cell's edges cross the surface. If the
planes differ little there is no edge, and the vertex is moved onto the smooth surface instead.
"""

import numpy as np

from acquisition.models.base import BoolArray, FloatArray
from hardware_sim import implicit
from hardware_sim.families.surfaces import Faces, creased
from hardware_sim.implicit import Field
from hardware_sim.sheets import Mesh

EDGE_FROM = 0.04
"""Least ratio of the second to the first eigenvalue of a cell's scatter of normals at an edge: planes that differ by
23°."""
STEP = 2e-5
"""Half-width of the central difference of a field of about unit size."""


def contour(field: Field, half_size: FloatArray, spacing: float) -> Mesh:
    """The closed surface field = 0 within ± `half_size` (3,), which it must not touch.

    The field's slope must nowhere exceed 1, that of a distance; it need be exact only at the surface.
    """
    inside = implicit.inside_lattice(field, -half_size, half_size, spacing)
    corners = [inside[i : i - 1 or None, j : j - 1 or None, k : k - 1 or None] for i, j, k in np.ndindex(2, 2, 2)]
    crossed = np.any(corners, axis=0) & ~np.all(corners, axis=0)
    number = np.full(crossed.shape, -1, dtype=np.int64)
    number[crossed] = np.arange(int(crossed.sum()))
    centres = spacing * (np.argwhere(crossed) + 0.5) - half_size

    parts = [_quads(inside, number, axis) for axis in range(3)]
    quads = np.concatenate([quads for quads, _, _ in parts])
    starts = spacing * np.concatenate([starts for _, starts, _ in parts]) - half_size
    ends = starts + spacing * np.repeat(np.eye(3), [len(quads) for quads, _, _ in parts], axis=0)
    points = _crossings(field, starts, ends, np.concatenate([rising for _, _, rising in parts]))
    normals = implicit.gradient(field, points, STEP)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)

    vertices, sharpness = _features(quads, points, normals, centres, spacing)
    smooth = sharpness < EDGE_FROM
    slope = implicit.gradient(field, vertices[smooth], STEP)
    ahead = field(vertices[smooth]) / np.maximum(np.einsum("vi,vi->v", slope, slope), 1e-3)
    vertices[smooth] -= np.clip(ahead, -spacing / 4, spacing / 4)[:, None] * slope
    vertices = np.clip(vertices, centres - spacing / 2, centres + spacing / 2)
    # An edge of the solid must be an edge of the mesh, so the diagonal joins the sharper pair.
    along = sharpness[quads[:, 0]] + sharpness[quads[:, 2]] >= sharpness[quads[:, 1]] + sharpness[quads[:, 3]]
    a, b, c, d = np.where(along[:, None], quads, np.roll(quads, -1, axis=1)).T
    return creased(vertices, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]))


def _quads(inside: BoolArray, number: Faces, axis: int) -> tuple[Faces, FloatArray, BoolArray]:
    """Lattice edges (E) along an axis that cross the surface.

    Returns the four cells round each, counter-clockwise from outside, its first lattice point, whether that is inside.
    """
    first, cells = np.moveaxis(inside, axis, 0), np.moveaxis(number, axis, 0)
    i, j, k = np.nonzero(first[:-1, 1:-1, 1:-1] != first[1:, 1:-1, 1:-1])
    quads = np.stack([cells[i, j, k], cells[i, j + 1, k], cells[i, j + 1, k + 1], cells[i, j, k + 1]], axis=1)
    rising = first[i, j + 1, k + 1]
    # The other two axes in order turn left about x and z, right about y.
    flipped = rising == (axis == 1)
    quads[flipped] = quads[flipped][:, ::-1]
    start: FloatArray = np.stack([i, j + 1, k + 1], axis=1).astype(np.float64)
    order = [axis, *(other for other in range(3) if other != axis)]
    return quads, start[:, np.argsort(order)], rising


def _crossings(field: Field, starts: FloatArray, ends: FloatArray, rising: BoolArray) -> FloatArray:
    """Zeros (E, 3) of the field between points inside and outside, by bisection and one secant step."""
    near, far = np.where(rising[:, None], starts, ends), np.where(rising[:, None], ends, starts)
    for _ in range(3):
        middle = (near + far) / 2
        within = (field(middle) < 0)[:, None]
        near, far = np.where(within, middle, near), np.where(within, far, middle)
    low, high = np.minimum(field(near), 0.0), np.maximum(field(far), 0.0)
    share = low / np.minimum(low - high, -1e-12)
    return near + share[:, None] * (far - near)


def _features(
    quads: Faces, points: FloatArray, normals: FloatArray, centres: FloatArray, spacing: float
) -> tuple[FloatArray, FloatArray]:
    """Each cell's vertex (V, 3) with the least squared distance to its tangent planes, and its sharpness (V,)."""
    count = len(centres)
    cell = quads.T.ravel()

    def summed(values: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(cell, np.tile(values, 4), count), dtype=np.float64)

    weight = np.maximum(np.bincount(cell, minlength=count), 1)
    mean = np.stack([summed(component) for component in points.T], axis=1) / weight[:, None]
    offset = np.einsum("ei,ei->e", normals, points)
    scatter = np.empty((count, 3, 3))
    for i in range(3):
        for j in range(i, 3):
            scatter[:, i, j] = scatter[:, j, i] = summed(normals[:, i] * normals[:, j])
    right = np.stack([summed(normals[:, i] * offset) for i in range(3)], axis=1)
    right -= np.einsum("vij,vj->vi", scatter, mean)
    values, vectors = np.linalg.eigh(scatter)
    kept = values > EDGE_FROM * values[:, 2:]
    inverse = np.where(kept, 1 / np.where(kept, values, 1.0), 0.0)
    move = np.einsum("vik,vk,vjk,vj->vi", vectors, inverse, vectors, right)
    # An intersection of the planes outside of the cell is not used.
    wild = np.abs(mean + move - centres).max(axis=1) > spacing
    move[wild] = 0.0
    return mean + move, np.where(wild, 0.0, values[:, 1] / np.maximum(values[:, 2], 1e-9))
