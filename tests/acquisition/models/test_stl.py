"""STL meshes of cell files: binary and ASCII give the same vertices; invalid meshes are named."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from acquisition.models import cell_config, stl
from acquisition.models.cell_config import ConvexMesh
from acquisition.models.errors import ErrorCode, RigError

CELLS = Path(__file__).resolve().parents[3] / "hardware_sim" / "cells"
MESH = trimesh.creation.box((0.1, 0.2, 0.3))


def cell_with(folder: Path, obstacle: str) -> Path:
    """The simulated cell's file with one obstacle more."""
    file = folder / "cell.toml"
    file.write_text((CELLS / "cell.sim.toml").read_text(encoding="utf-8") + obstacle, encoding="utf-8")
    return file


@pytest.mark.parametrize("form", ["stl", "stl_ascii"])
def test_stl_vertices_binary_and_ascii_are_equal(tmp_path: Path, form: str) -> None:
    file = tmp_path / "box.stl"
    content = MESH.export(file_type=form)
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    assert np.allclose(stl.vertices(file), np.unique(MESH.vertices, axis=0), atol=1e-6)


@pytest.mark.parametrize("content", [b"", b"solid nothing\nendsolid", b"vertex 1 2 nan\n" * 4])
def test_stl_vertices_invalid_file_is_refused(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "box.stl"
    file.write_bytes(content)
    with pytest.raises(ValueError, match="solid"):
        stl.vertices(file)


OBSTACLE = """
[[obstacles]]
kind = "convex-mesh"
name = "lathe"
clearance_m = 0.05
file = "box.stl"
base_from_mesh = { position_m = [0.0, 0.6, 0.15] }
"""


def test_load_cell_reads_vertices_of_named_meshes(tmp_path: Path) -> None:
    MESH.export(tmp_path / "box.stl")
    cell = cell_config.load(cell_with(tmp_path, OBSTACLE))
    (lathe,) = cell.obstacles
    assert isinstance(lathe, ConvexMesh)
    assert len(lathe.vertices_m) == 8
    other = trimesh.creation.box((0.1, 0.2, 0.31))
    other.export(tmp_path / "box.stl")
    assert cell_config.load(tmp_path / "cell.toml").fingerprint != cell.fingerprint


def test_load_cell_mesh_in_millimetres_is_refused(tmp_path: Path) -> None:
    trimesh.creation.box((100, 200, 300)).export(tmp_path / "box.stl")
    with pytest.raises(RigError, match=r"box.stl: it would be 300 m large.*export it in m, .* by 0.001") as caught:
        cell_config.load(cell_with(tmp_path, OBSTACLE))
    assert caught.value.code == ErrorCode.CONFIG_INVALID


def test_load_cell_missing_mesh_is_named(tmp_path: Path) -> None:
    with pytest.raises(RigError) as caught:
        cell_config.load(cell_with(tmp_path, OBSTACLE))
    assert caught.value.code == ErrorCode.CONFIG_INVALID
    assert "box.stl" in caught.value.detail


def test_load_cell_flat_mesh_is_refused(tmp_path: Path) -> None:
    flat = """
[[obstacles]]
kind = "convex-mesh"
name = "sheet"
vertices_m = [[0.0, 0.0, 0.1], [0.2, 0.0, 0.1], [0.2, 0.3, 0.1], [0.0, 0.3, 0.1], [0.1, 0.1, 0.1]]
base_from_mesh = { position_m = [0.0, 0.6, 0.15], rotation_vector_rad = [0.3, 0.0, 0.0] }
"""
    with pytest.raises(RigError, match="lie in a plane") as caught:
        cell_config.load(cell_with(tmp_path, flat))
    assert caught.value.code is ErrorCode.CONFIG_INVALID
