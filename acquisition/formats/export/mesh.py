"""Export of the surface as a PLY mesh: a vertex with normal for each solved pixel, two triangles for four neighbours.

Triangles nearly along the viewing ray, which join surfaces across a depth discontinuity, are omitted.
"""

from pathlib import Path

import numpy as np

from acquisition.formats.export import map_files
from acquisition.models.base import BoolArray, Float32Array
from acquisition.models.result import NormalMap

MAX_DEPTH_STEP = 8.0
"""Greatest depth step between neighbouring vertices, as a multiple of the width of a pixel there: 83°."""


def write(path: Path, points: Float32Array, normal_map: NormalMap) -> None:
    """Writes points (3, H, W), view frame, and normals of the solved pixels as binary PLY."""
    mask, unit = normal_map.mask, map_files.depth_unit(normal_map)
    vertex = np.empty((np.count_nonzero(mask), 6), "<f4")
    vertex[:, :3] = points[:, mask].T
    vertex[:, 3:] = normal_map.normals[mask]
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
    steps = np.abs(np.diff(points[0], axis=1))[mask[:, 1:] & mask[:, :-1]]
    near = MAX_DEPTH_STEP * float(np.median(steps)) if steps.size else 0.0
    # The four corners of each square: upper left and right, lower left and right.
    a, b, c, d = ((rows, columns) for rows in (slice(-1), slice(1, None)) for columns in (slice(-1), slice(1, None)))
    triangles: list[np.ndarray] = []
    for corners in ((a, c, b), (b, c, d)):
        depths = np.stack([points[2][corner] for corner in corners])
        connected = np.logical_and.reduce([mask[corner] for corner in corners]) & (np.ptp(depths, axis=0) < near)
        triangles.append(np.stack([number[corner][connected] for corner in corners], axis=1))
    return np.concatenate(triangles)
