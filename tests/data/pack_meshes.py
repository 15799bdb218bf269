"""Packs link meshes for the suite, losslessly: python tests/data/pack_meshes.py FOLDER, of MODEL/*.stl in DH frames.

Welds equal corners as trimesh does on loading, and keeps single-precision coordinates as the STL files have them.
"""

import sys
from pathlib import Path

import numpy as np
import trimesh

MESHES = Path(__file__).parents[2] / "acquisition" / "waypoints" / "meshes"

for folder in sorted(path for path in Path(sys.argv[1]).iterdir() if path.is_dir()):
    arrays = {}
    for path in sorted(folder.glob("*.stl")):
        mesh = trimesh.load_mesh(path)
        vertices, faces = mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint16)
        assert np.array_equal(vertices, mesh.vertices), path
        assert np.array_equal(faces, mesh.faces), path
        arrays |= {f"{path.stem}_vertices": vertices, f"{path.stem}_faces": faces}
    np.savez_compressed(MESHES / f"{folder.name}.npz", **arrays)
