"""Vertices of an STL file, the one mesh format that every drawing program writes.

Only the vertices are read: obstacles are convex hulls, so faces say nothing more.
"""

import re
from pathlib import Path

import numpy as np

from acquisition.models.base import FloatArray

_HEADER, _COUNT, _FACE = 80, 4, 50
_VERTEX = re.compile(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)")


def vertices(path: Path) -> FloatArray:
    """The different vertices (N, 3) of a binary or text STL file, in its own unit. Raises OSError, ValueError."""
    data = path.read_bytes()
    faces = int.from_bytes(data[_HEADER : _HEADER + _COUNT], "little")
    if len(data) == _HEADER + _COUNT + faces * _FACE:
        record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
        corners = np.frombuffer(data, record, faces, _HEADER + _COUNT)["corners"].reshape(-1, 3).astype(float)
    else:
        corners = np.array(_VERTEX.findall(data)).astype(float).reshape(-1, 3)
    if len(corners) < 4 or not np.isfinite(corners).all():
        raise ValueError("it holds no solid: fewer than four finite vertices")
    return np.unique(corners, axis=0)
