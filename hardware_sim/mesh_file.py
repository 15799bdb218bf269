"""Meshes from STL, PLY and OBJ files, made ready for the simulated cell.

Files seldom hold usable vertex normals, and STL holds none, so normals are computed here; they are smooth except across
creases. A mesh that does not bound a solid is refused, never mended: a mended hole would be a surface that the user's
object does not have, also in the truth against which normals are graded.

Colours, materials and textures of a file are not read; albedo and reflectance are the simulator's.
"""

from pathlib import Path

import numpy as np
import numpy.typing as npt
import trimesh
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from acquisition.models.base import FloatArray
from acquisition.models.errors import ErrorCode, RigError
from hardware_sim.sheets import Mesh

SUFFIXES = (".stl", ".ply", ".obj")

CREASE_DEG = 35.0
"""Angle, degrees, between the normals of two triangles beyond which their edge is a crease. The coarsest curved surface
that is drawn smooth has 360 / 35 ≈ 10 facets round; edges of machined parts and chamfers of 45° stay edges."""

LARGEST_IN_MM = 1.0
"""Largest extent, in units of the file, beyond which a mesh without a size is in millimetres, else in metres. Nothing
that fits under the camera is larger than a metre, and nothing worth an image is smaller than a millimetre."""

SMALLEST_M = 0.005
"""Largest extent, m, below which an object is refused: it covers fewer than 30 pixels of the 1024 of the image."""

LEAST_VOLUME = 1e-9
"""Volume, as a share of its largest extent cubed, below which a closed mesh is flat: foil of 0.1 nm on 0.1 m."""

LEAST_DOUBLE_AREA = 1e-14
"""Length, m², of the cross product of two sides below which a triangle (a needle of 10 µm × 1 nm) is left out."""


def read(path: Path, size_mm: float | None = None) -> Mesh:
    """Reads a closed mesh and places it: scaled, centred in x and y, its lowest point on z = 0; frame of the object.

    `size_mm` is its largest extent along an axis afterwards. If it is None, the file's unit is millimetres if the
    largest extent exceeds `LARGEST_IN_MM`, else metres. Raises RigError request.invalid with the file and a remedy.
    """
    if size_mm is not None and not 0 < size_mm < np.inf:
        raise _refused(path, f"cannot have a size of {size_mm:g} mm", "give --size-mm a length above 0")
    raw = _triangles(path)
    corners = np.asarray(raw.vertices, dtype=float)
    extent = float(np.ptp(corners, axis=0).max())
    scale = (1e-3 if extent > LARGEST_IN_MM else 1.0) if size_mm is None else 1e-3 * size_mm / max(extent, 1e-300)
    if extent * scale < SMALLEST_M:
        raise _refused(
            path,
            f"is {1e3 * extent * scale:.3g} mm in its largest extent, too small for the camera",
            "give its true size with --size-mm; without it, units are millimetres if the largest extent exceeds 1",
        )
    low, high = corners.min(axis=0), corners.max(axis=0)
    foot = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    # Placed before corners are merged, because the tolerance of merging is a length: 10 nm of the object.
    solid = trimesh.Trimesh((corners - foot) * scale, raw.faces, process=False)
    solid.merge_vertices()
    solid.update_faces(_three_corners(np.asarray(solid.faces)))
    _check_closed(path, solid)
    least = LEAST_VOLUME * (extent * scale) ** 3
    volume = float(np.sum(_signed_volumes(solid)))
    if abs(volume) < least:
        raise _refused(path, "has no volume: its triangles lie on top of one another", "give the solid a thickness")
    if volume < 0:
        solid.invert()
    _check_same_side(path, solid, least)
    triangles = np.asarray(solid.triangles, dtype=float)
    normals = smooth_normals(triangles, np.asarray(solid.faces), np.asarray(solid.face_adjacency))
    double = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
    kept = double > LEAST_DOUBLE_AREA
    return Mesh(triangles[kept], normals[kept])


def smooth_normals(triangles: FloatArray, faces: npt.NDArray[np.int64], adjacency: npt.NDArray[np.int64]) -> FloatArray:
    """Normals (F, 3, 3) of the corners of triangles (F, 3, 3): angle-weighted means over smoothing groups.

    `faces` (F, 3) are vertex numbers, `adjacency` (E, 2) pairs of faces that share an edge. The corners at a vertex
    belong to one group if edges without a crease join their faces, so that a crease may end within a surface.
    Weights: G. Thürmer and C. A. Wüthrich, Computing vertex normals from polygonal facets, J. Graphics Tools 1998.
    """
    double = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    flat = double / np.maximum(np.linalg.norm(double, axis=1, keepdims=True), 1e-300)
    cosine = np.einsum("ei,ei->e", flat[adjacency[:, 0]], flat[adjacency[:, 1]])
    first, second = adjacency[cosine > np.cos(np.radians(CREASE_DEG))].T
    # Corner c of face f has number 3 f + c; the corners of two smooth neighbours at a common vertex are joined.
    near, far = [], []
    for i in range(3):
        for j in range(3):
            same = faces[first, i] == faces[second, j]
            near.append(3 * first[same] + i)
            far.append(3 * second[same] + j)
    count = 3 * len(faces)
    start, end = np.concatenate(near), np.concatenate(far)
    links = coo_array((np.ones(len(start), dtype=np.int8), (start, end)), shape=(count, count))
    groups, group = connected_components(links, directed=False)
    weighted = (_corner_angles(triangles)[..., None] * flat[:, None, :]).reshape(-1, 3)
    sums = np.stack([np.bincount(group, column, groups) for column in weighted.T], axis=1)[group]
    length = np.linalg.norm(sums, axis=1, keepdims=True)
    own = np.repeat(flat, 3, axis=0)
    return np.where(length > 1e-9, sums / np.maximum(length, 1e-300), own).reshape(-1, 3, 3)


def _corner_angles(triangles: FloatArray) -> FloatArray:
    """Angles (F, 3) of triangles (F, 3, 3), rad."""
    ahead = np.roll(triangles, -1, axis=1) - triangles
    back = np.roll(triangles, 1, axis=1) - triangles
    return np.arctan2(np.linalg.norm(np.cross(ahead, back), axis=-1), np.einsum("fci,fci->fc", ahead, back))


def _three_corners(faces: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
    """Mask (F,) of faces with three distinct corners; dropping a face that merging made an edge opens no hole."""
    return (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])


def _triangles(path: Path) -> trimesh.Trimesh:
    """The file's triangles as they are. Raises RigError request.invalid."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise _refused(path, "has a format that is not supported", f"give a file that ends in {', '.join(SUFFIXES)}")
    try:
        with path.open("rb") as file:
            mesh = trimesh.load_mesh(file, file_type=suffix[1:], process=False, skip_materials=True)
    except OSError as error:
        raise _refused(path, f"cannot be read: {error.strerror or error}", "check path and permissions") from error
    except Exception as error:
        what = " ".join(str(error).split())[:200] or type(error).__name__
        raise _refused(path, f"is not a valid {suffix[1:].upper()} file: {what}", "export the mesh again") from error
    if len(mesh.faces) == 0:
        raise _refused(
            path,
            f"has no triangles: it is empty, a point cloud, or not a valid {suffix[1:].upper()} file",
            "export a solid as a triangle mesh",
        )
    if not np.isfinite(mesh.vertices).all():
        bad = int((~np.isfinite(mesh.vertices).all(axis=1)).sum())
        raise _refused(path, f"has {bad} vertices that are not finite (NaN or infinite)", "export the mesh again")
    return mesh


def _check_closed(path: Path, mesh: trimesh.Trimesh) -> None:
    """Raises RigError request.invalid if the triangles do not bound a solid."""
    if not mesh.is_watertight:
        edges = np.asarray(mesh.edges_sorted)
        _, faces_at = np.unique(edges, axis=0, return_counts=True)
        raise _refused(
            path,
            f"is not closed: {int((faces_at != 2).sum())} of its edges do not belong to exactly two triangles",
            "fill its holes and remove inner walls in the program that made it; the simulator repairs nothing",
        )
    if not mesh.is_winding_consistent:
        raise _refused(
            path,
            "has triangles that face inward beside triangles that face outward",
            "make its normals consistent (often “recalculate outside”) in the program that made it",
        )


def _signed_volumes(mesh: trimesh.Trimesh) -> FloatArray:
    """Volumes (F,) of the tetrahedra of triangles and origin, whose sum is a body's volume, m³."""
    a, b, c = np.moveaxis(np.asarray(mesh.triangles, dtype=float), 1, 0)
    return np.einsum("fi,fi->f", np.cross(a, b), c) / 6


def _check_same_side(path: Path, mesh: trimesh.Trimesh, least: float) -> None:
    """Raises RigError request.invalid if a body faces inward that is not a hollow of another one.

    Bodies of a volume below `least`, m³, have no inside.
    """
    pairs, count = np.asarray(mesh.face_adjacency), len(mesh.faces)
    links = coo_array((np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    bodies, body = connected_components(links, directed=False)
    volumes = np.bincount(body, _signed_volumes(mesh), bodies)
    triangles = np.asarray(mesh.triangles, dtype=float)
    turned = sum(
        _winding_number(triangles[body != number], triangles[body == number][0, 0]) < 0.5
        for number in np.flatnonzero(volumes < -least)
    )
    if turned:
        raise _refused(
            path,
            f"has {turned} of {bodies} bodies that face inward beside others that face outward",
            "make its normals consistent (often “recalculate outside”) in the program that made it",
        )


def _winding_number(triangles: FloatArray, point: FloatArray) -> float:
    """How often closed triangles (F, 3, 3) enclose a point (3,): the sum of their solid angles over 4π.

    A. Van Oosterom and J. Strackee, The solid angle of a plane triangle, IEEE Trans. Biomed. Eng. 1983.
    """
    a, b, c = np.moveaxis(triangles - point, 1, 0)
    la, lb, lc = (np.linalg.norm(one, axis=1) for one in (a, b, c))
    ab, bc, ca = (np.einsum("fi,fi->f", one, other) for one, other in ((a, b), (b, c), (c, a)))
    volume = np.einsum("fi,fi->f", np.cross(a, b), c)
    return float(np.sum(np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb)) / (2 * np.pi))


def _refused(path: Path, why: str, remedy: str) -> RigError:
    return RigError(ErrorCode.REQUEST_INVALID, f"the mesh {path} {why}; {remedy}", file=str(path))
