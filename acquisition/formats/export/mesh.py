"""Export of the surface as a PLY mesh: a vertex with normal for each solved pixel, two triangles for four neighbours.

Triangles nearly along the viewing ray, which join surfaces across a depth discontinuity, are omitted.
"""

from pathlib import Path

import numpy as np

from acquisition.formats.export import map_files
from acquisition.models.base import BoolArray, Float32Array

MAX_DEPTH_STEP = 8.0
"""Greatest depth step between neighbouring vertices, as a multiple of the width of a pixel there: 83°."""


def write(path: Path, points: Float32Array, normals: Float32Array, mask: BoolArray, unit: str) -> None:
    """Writes points (3, H, W) and normals (H, W, 3), both in the view frame, where `mask` (H, W), as binary PLY."""
    vertex = np.empty((np.count_nonzero(mask), 6), "<f4")
    vertex[:, :3] = points[:, mask].T
    vertex[:, 3:] = normals[mask]
    corners = _triangles(points, mask)
    face = np.empty(len(corners), [("count", "u1"), ("corners", "<i4", 3)])
    face["count"], face["corners"] = 3, corners
    header = "\n".join(
        [
            "ply",
            "format binary_little_endian 1.0",
            f"comment {map_files.FRAME}; unit {unit}",
            f"element vertex {len(vertex)}",
            *[f"property float {name}" for name in ("x", "y", "z", "nx", "ny", "nz")],
            f"element face {len(face)}",
            "property list uchar int vertex_indices",
            "end_header\n",
        ]
    )
    with path.open("wb") as file:
        file.write(header.encode("ascii"))
        file.write(vertex.data)
        file.write(face.data)


def _triangles(points: Float32Array, mask: BoolArray) -> np.ndarray:
    """Corners (T, 3) as numbers of vertices, counter-clockwise as the camera sees them."""
    number = np.cumsum(mask.ravel(), dtype=np.int32).reshape(mask.shape) - 1
    near = MAX_DEPTH_STEP * _pixel(points, mask)
    z = points[2]
    upper, lower, left, right = slice(None, -1), slice(1, None), slice(None, -1), slice(1, None)
    a, b, c, d = (upper, left), (upper, right), (lower, left), (lower, right)
    triangles: list[np.ndarray] = []
    for one, two, three in ((a, c, b), (b, c, d)):
        depths = np.stack([z[one], z[two], z[three]])
        connected = mask[one] & mask[two] & mask[three] & (np.ptp(depths, axis=0) < near)
        triangles.append(np.stack([number[one][connected], number[two][connected], number[three][connected]], axis=1))
    return np.concatenate(triangles)


def _pixel(points: Float32Array, mask: BoolArray) -> float:
    """The width of a pixel on the surface: the median distance between neighbours along a row."""
    both = mask[:, 1:] & mask[:, :-1]
    steps = np.abs(np.diff(points[0], axis=1))[both]
    return float(np.median(steps)) if steps.size else 0.0
