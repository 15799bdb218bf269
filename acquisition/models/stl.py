"""STL files, the one mesh format that every drawing program writes and reads.

Reading returns the vertices only, since obstacles are their convex hulls. Writing takes whole surfaces.
"""

import re
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from acquisition.models.base import FloatArray
from acquisition.models.errors import ErrorCode, RigError

LARGEST_M = 20.0
"""Largest extent, m, of a body in a cell: none is larger, but one of 2 cm is whose file is in mm, as most programs
write it. STL files do not state their unit."""

_HEADER, _COUNT, _FACE = 80, 4, 50
_VERTEX = re.compile(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)")
_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def vertices(path: Path) -> FloatArray:
    """Reads the distinct vertices (N, 3) of a binary or text STL file, in its own unit. Raises OSError, ValueError."""
    data = path.read_bytes()
    faces = int.from_bytes(data[_HEADER : _HEADER + _COUNT], "little")
    if len(data) == _HEADER + _COUNT + faces * _FACE:
        corners = np.frombuffer(data, _RECORD, faces, _HEADER + _COUNT)["corners"].reshape(-1, 3).astype(float)
    else:
        corners = np.array(_VERTEX.findall(data)).astype(float).reshape(-1, 3)
    if len(corners) < 4 or not np.isfinite(corners).all():
        raise ValueError("it holds no solid: fewer than four finite vertices")
    return np.unique(corners, axis=0)


def encoded(vertices: npt.ArrayLike, faces: npt.ArrayLike) -> bytes:
    """Encodes triangles `faces` (F, 3), facing outwards, over `vertices` (V, 3) in their own unit as binary STL."""
    corners = np.asarray(vertices, np.float32)[np.asarray(faces)]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    records = np.zeros(len(corners), _RECORD)
    records["corners"] = corners
    records["normal"] = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
    return bytes(_HEADER) + len(corners).to_bytes(_COUNT, "little") + records.tobytes()


def read_meshes(content: dict[str, Any], cell_file: Path) -> None:
    """Replaces the mesh files that a cell file's obstacles name by their vertices. Raises RigError config.invalid."""
    obstacles = content.get("obstacles")
    for item in obstacles if isinstance(obstacles, list) else []:
        if isinstance(item, dict) and "file" in item:
            mesh = cell_file.parent / str(item.pop("file"))
            try:
                item["vertices_m"] = _in_metres(vertices(mesh)).tolist()
            except (OSError, ValueError) as error:
                raise RigError(ErrorCode.CONFIG_INVALID, f"{mesh}: {error}", file=str(mesh)) from error


def _in_metres(vertices: FloatArray) -> FloatArray:
    """Returns the vertices as they are. Raises ValueError if their unit cannot be the metre."""
    extent = float(np.ptp(vertices, axis=0).max())
    if extent > LARGEST_M:
        raise ValueError(
            f"it would be {extent:.4g} m large, since its lengths count as m: export it in m, that is, scaled by 0.001 "
            "if it is drawn in mm"
        )
    return vertices
