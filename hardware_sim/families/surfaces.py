"""Meshes of the families: closed grids, normals that are smooth except at creases, and placement on the table."""

import numpy as np
import numpy.typing as npt

from acquisition.models.base import FloatArray
from hardware_sim.sheets import Mesh

Faces = npt.NDArray[np.int64]

CREASE_RAD = np.radians(32.0)
"""Angle, rad, between two faces of a vertex beyond which they share no normal: an edge. At this fineness modelled
surfaces bend by less than 15° from face to face, and edges of solids by 45° or more."""


def creased(vertices: FloatArray, faces: Faces, crease_rad: float = CREASE_RAD) -> Mesh:
    """A mesh from vertices (V, 3) and faces (F, 3), counter-clockwise from outside, with normals smooth but at creases.

    A corner's normal is the area-weighted mean of the normals of its vertex's faces within `crease_rad` of its own
    face. Triangles without area are left out.
    """
    triangles = vertices[faces]
    double = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    length = np.linalg.norm(double, axis=1)
    solid = length > LEAST_DOUBLE_AREA_M2
    triangles, faces, double, length = triangles[solid], faces[solid], double[solid], length[solid]
    unit = double / length[:, None]
    owner, vertex = np.repeat(np.arange(len(faces)), 3), faces.ravel()
    mean = np.stack([np.bincount(vertex, component, len(vertices)) for component in double[owner].T], axis=1)
    total = mean[vertex]
    # Faces that all lie within half the angle of their mean lie within the angle of one another.
    along = np.einsum("ci,ci->c", total, unit[owner])
    bent = np.zeros(len(vertices), dtype=bool)
    bent[vertex[along < np.cos(crease_rad / 2) * np.linalg.norm(total, axis=1)]] = True
    corners = np.nonzero(bent[vertex])[0]
    corners = corners[np.argsort(vertex[corners], kind="stable")]  # those of one vertex side by side
    first = np.searchsorted(vertex[corners], vertex[corners])
    valence = np.bincount(vertex[corners], minlength=len(vertices))[vertex[corners]]
    total[corners] = 0.0
    for turn in range(int(valence.max(initial=0))):
        long = np.nonzero(valence > turn)[0]
        own, fellow = owner[corners[long]], owner[corners[first[long] + turn]]
        near = np.einsum("ci,ci->c", unit[fellow], unit[own]) > np.cos(crease_rad)
        total[corners[long[near]]] += double[fellow[near]]
    total /= np.linalg.norm(total, axis=1, keepdims=True)
    return Mesh(triangles, total.reshape(-1, 3, 3))


LEAST_DOUBLE_AREA_M2 = 1e-13
"""Twice the least area, m², of a triangle that is kept: a sliver of 0.1 mm × 1 nm has no reliable normal."""


def grid(points: FloatArray, *, around: bool = False, closed: bool = False) -> tuple[FloatArray, Faces]:
    """Vertices and faces of a grid of points (R, C, 3); the cross product rows × columns points outward.

    `around` joins the last column to the first, `closed` the last row to the first.
    """
    rows, columns = points.shape[:2]
    i, j = np.meshgrid(np.arange(rows - (not closed)), np.arange(columns - (not around)), indexing="ij")
    i, j = i.ravel(), j.ravel()
    down, right = (i + 1) % rows, (j + 1) % columns
    a, b, c, d = i * columns + j, down * columns + j, down * columns + right, i * columns + right
    return points.reshape(-1, 3), np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def welded(vertices: FloatArray, faces: Faces) -> tuple[FloatArray, Faces]:
    """Merges vertices that coincide to 0.1 µm."""
    _, kept, number = np.unique(
        np.rint(vertices * 1e7).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    return vertices[kept], number.ravel()[faces]


def placed(mesh: Mesh, extent_m: float) -> Mesh:
    """The mesh scaled to its largest extent along an axis, centred in x and y, standing on z = 0."""
    points = mesh.triangles.reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    scale = extent_m / float((high - low).max())
    foot = np.array([*(low + high)[:2] / 2, low[2]])
    return Mesh((mesh.triangles - foot) * scale, mesh.corner_normals)


def turned_by(axis: FloatArray, angle_rad: float) -> FloatArray:
    """The rotation (3, 3) about an axis of any length (Rodrigues)."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle_rad) * cross + (1 - np.cos(angle_rad)) * (cross @ cross)
