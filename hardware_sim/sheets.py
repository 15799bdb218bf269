"""Surfaces as smooth sheets: grids of points with a normal at each, joined into one triangle mesh.

Built-in objects, except `figure`, are unions of sheets. Normals are interpolated within a sheet, so that a curved
surface shades smoothly. Two sheets that meet keep their own normals, so that a machined edge stays sharp. No boolean
operations are needed: solids may overlap, since a ray stops at the outermost surface.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from acquisition.models.base import FloatArray


@dataclass(frozen=True)
class Mesh:
    """Triangles (F, 3, 3) in m, with their front outside, and normals (F, 3, 3) of their corners; object frame."""

    triangles: FloatArray
    corner_normals: FloatArray

    def transformed(self, rotation: FloatArray, shift_m: FloatArray) -> "Mesh":
        """The mesh rotated by (3, 3), then shifted by (3,) m."""
        return Mesh(self.triangles @ rotation.T + shift_m, self.corner_normals @ rotation.T)

    def scaled(self, factor: float) -> "Mesh":
        """The mesh enlarged by a factor about the frame's origin."""
        return Mesh(factor * self.triangles, self.corner_normals)

    @property
    def areas(self) -> FloatArray:
        """Area (F,) of each triangle, m²."""
        return np.linalg.norm(_double_areas(self.triangles), axis=1) / 2

    @property
    def face_normals(self) -> FloatArray:
        """Unit normals (F, 3) of the flat triangles."""
        double = _double_areas(self.triangles)
        return double / np.linalg.norm(double, axis=1, keepdims=True)


def _double_areas(triangles: FloatArray) -> FloatArray:
    return np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])


def joined(meshes: Sequence[Mesh]) -> Mesh:
    """Concatenates meshes."""
    return Mesh(
        np.concatenate([mesh.triangles for mesh in meshes]), np.concatenate([mesh.corner_normals for mesh in meshes])
    )


def indexed(vertices: FloatArray, normals: FloatArray, faces: np.ndarray) -> Mesh:
    """A mesh from vertices (V, 3), their normals (V, 3) and faces (F, 3), which are oriented along the normals.

    Triangles without area (the poles of a grid) are left out.
    """
    triangles, corner_normals = vertices[faces], normals[faces]
    double = _double_areas(triangles)
    solid = np.linalg.norm(double, axis=1) > 1e-14
    triangles, corner_normals, double = triangles[solid], corner_normals[solid], double[solid]
    inward = np.einsum("fi,fi->f", double, corner_normals.sum(axis=1)) < 0
    triangles[inward] = triangles[inward][:, ::-1]
    corner_normals[inward] = corner_normals[inward][:, ::-1]
    return Mesh(triangles, corner_normals)


def sheet(points: FloatArray, normals: FloatArray) -> Mesh:
    """A mesh from a grid of points (R, C, 3) and normals (R, C, 3) of any length."""
    rows, columns = points.shape[:2]
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)[None, :]).ravel()
    faces = np.concatenate(
        [
            np.stack([corner, corner + columns, corner + columns + 1], axis=1),
            np.stack([corner, corner + columns + 1, corner + 1], axis=1),
        ]
    )
    unit = normals / np.linalg.norm(normals, axis=-1, keepdims=True)
    return indexed(points.reshape(-1, 3), unit.reshape(-1, 3), faces)


def quad(a: Sequence[float], b: Sequence[float], c: Sequence[float], d: Sequence[float]) -> Mesh:
    """A flat quadrilateral a, b, c, d, counter-clockwise seen from outside."""
    points = np.array([[a, b], [d, c]], dtype=float)
    normal = np.cross(points[0, 1] - points[0, 0], points[1, 0] - points[0, 0])
    return sheet(points, np.broadcast_to(normal, points.shape))


def box(low: Sequence[float], high: Sequence[float]) -> Mesh:
    """A box between two corners, six flat faces."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    return joined(
        [
            quad((x0, y0, z1), (x1, y0, z1), (x1, y1, z1), (x0, y1, z1)),
            quad((x0, y1, z0), (x1, y1, z0), (x1, y0, z0), (x0, y0, z0)),
            quad((x0, y0, z0), (x1, y0, z0), (x1, y0, z1), (x0, y0, z1)),
            quad((x1, y1, z0), (x0, y1, z0), (x0, y1, z1), (x1, y1, z1)),
            quad((x0, y1, z0), (x0, y0, z0), (x0, y0, z1), (x0, y1, z1)),
            quad((x1, y0, z0), (x1, y1, z0), (x1, y1, z1), (x1, y0, z1)),
        ]
    )


def revolved(radius: FloatArray, height: FloatArray, normal: FloatArray, segments: int) -> Mesh:
    """A surface of revolution about z.

    `radius` and `height` (R,), m, are those along the profile, `normal` (R, 2) its radial and axial normal.
    """
    angle = np.linspace(0, 2 * np.pi, segments + 1)
    angle[-1] = 0.0  # the seam's two sides are the same points
    cosine, sine = np.cos(angle), np.sin(angle)
    ones = np.ones_like(angle)
    points = np.stack([np.outer(radius, cosine), np.outer(radius, sine), np.outer(height, ones)], axis=-1)
    normals = np.stack(
        [np.outer(normal[:, 0], cosine), np.outer(normal[:, 0], sine), np.outer(normal[:, 1], ones)], axis=-1
    )
    return sheet(points, normals)


def cone(start: tuple[float, float], end: tuple[float, float], outward: tuple[float, float], segments: int) -> Mesh:
    """A cone, cylinder or disc about z between two (radius, height) in m, with one normal."""
    profile = np.array([start, end])
    return revolved(profile[:, 0], profile[:, 1], np.array([outward, outward], dtype=float), segments)


def cube_directions(edge: int) -> list[FloatArray]:
    """Unit vectors of a cube's six sides, each (edge + 1, edge + 1, 3), about equally spaced, without poles."""
    span = np.tan(np.linspace(-np.pi / 4, np.pi / 4, edge + 1))
    u, v = np.meshgrid(span, span, indexing="ij")
    one = np.ones_like(u)
    sides = [(one, u, v), (-one, u, v), (u, one, v), (u, -one, v), (u, v, one), (u, v, -one)]
    grids = [np.stack(side, axis=-1) for side in sides]
    return [grid / np.linalg.norm(grid, axis=-1, keepdims=True) for grid in grids]
