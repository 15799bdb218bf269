"""Meshes from files that each test writes: where they end up, how they shade, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from acquisition.models.errors import ErrorCode, RigError
from hardware_sim import mesh_file
from hardware_sim.sheets import Mesh

SCALES = st.floats(0.01, 1e4)
SHIFTS = st.tuples(*[st.floats(-50, 50)] * 3)


def saved(body: trimesh.Trimesh, path: Path) -> Path:
    body.export(path)
    return path


def largest_m(mesh: Mesh) -> float:
    return float(np.ptp(mesh.triangles.reshape(-1, 3), axis=0).max())


@pytest.mark.parametrize("suffix", [".stl", ".ply", ".obj", ".STL"])
def test_read_sphere_of_each_format_has_its_normals(tmp_path: Path, suffix: str) -> None:
    body = trimesh.creation.icosphere(4, 50.0)
    path = tmp_path / f"ball{suffix}"
    with path.open("wb") as file:
        body.export(file, file_type=suffix[1:].lower())
    mesh = mesh_file.read(path)
    assert len(mesh.triangles) == len(body.faces)
    outward = mesh.triangles - [0.0, 0.0, 0.05]
    assert np.linalg.norm(outward, axis=-1) == pytest.approx(0.05, abs=1e-6)
    cosine = np.einsum("fci,fci->fc", outward / 0.05, mesh.corner_normals)
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() < 0.2  # the angle between faces is 2.5°


@settings(max_examples=25, deadline=None)
@given(scale=SCALES, shift=SHIFTS, size_mm=st.floats(10.0, 100.0))
def test_read_with_size_is_scaled_centred_and_stands(
    scale: float, shift: tuple[float, ...], size_mm: float, tmp_path_factory: pytest.TempPathFactory
) -> None:
    body = trimesh.creation.capsule(2.0, 1.0, count=(8, 12))
    body.vertices = (body.vertices + shift) * scale
    mesh = mesh_file.read(saved(body, tmp_path_factory.mktemp("mesh") / "capsule.ply"), size_mm)
    low, high = mesh.triangles.reshape(-1, 3).min(axis=0), mesh.triangles.reshape(-1, 3).max(axis=0)
    assert (high - low).max() == pytest.approx(1e-3 * size_mm, abs=1e-9)
    assert low[2] == pytest.approx(0.0, abs=1e-9)
    assert low[:2] == pytest.approx(-high[:2], abs=1e-9)
    assert (high - low)[:2] == pytest.approx(1e-3 * size_mm / 2, rel=1e-5)  # single precision at 50


@pytest.mark.parametrize(
    ("extent", "expected_m"),
    [(60.0, 0.060), (1.5, None), (1.0, 1.0), (0.08, 0.08), (6.0, 0.006)],
    ids=str,
)
def test_read_without_size_takes_mm_above_one_unit(tmp_path: Path, extent: float, expected_m: float | None) -> None:
    path = saved(trimesh.creation.box((extent, extent / 2, extent / 3)), tmp_path / "box.stl")
    if expected_m is None:
        with pytest.raises(RigError, match=r"1\.5 mm in its largest extent, too small"):
            mesh_file.read(path)
    else:
        assert largest_m(mesh_file.read(path)) == pytest.approx(expected_m, rel=1e-6)


def test_read_box_keeps_edges_and_cylinder_rounds_its_wall(tmp_path: Path) -> None:
    box = mesh_file.read(saved(trimesh.creation.box((10, 20, 30)), tmp_path / "box.stl"))
    assert np.abs(box.corner_normals).max(axis=-1) == pytest.approx(1.0, abs=1e-9)
    rod = mesh_file.read(saved(trimesh.creation.cylinder(20, 50, sections=48), tmp_path / "rod.stl"))
    wall = np.abs(rod.face_normals[:, 2]) < 0.5
    assert rod.corner_normals[~wall][..., 2] == pytest.approx(np.sign(rod.face_normals[~wall, 2])[:, None] * np.ones(3))
    outward = rod.triangles[wall][..., :2] / 0.02
    assert np.einsum("fci,fci->fc", rod.corner_normals[wall][..., :2], outward).min() > np.cos(np.radians(0.1))


@pytest.mark.parametrize(("bend_deg", "smooth"), [(25.0, True), (34.0, True), (36.0, False), (60.0, False)])
def test_read_crease_begins_at_its_angle(tmp_path: Path, bend_deg: float, smooth: bool) -> None:
    """A prism whose ridge turns by `bend_deg`."""
    half = np.radians(bend_deg / 2)
    top = np.array([[-20, 20 - 20 * np.tan(half)], [0, 20], [20, 20 - 20 * np.tan(half)]])
    outline = np.array([[-20.0, 0.0], *top, [20.0, 0.0]])
    corners = np.concatenate([np.insert(outline, 1, y, axis=1) for y in (-10.0, 10.0)])
    mesh = mesh_file.read(saved(trimesh.convex.convex_hull(corners), tmp_path / "prism.stl"))
    at_ridge = np.isclose(mesh.triangles[..., 2], 0.02, atol=1e-7) & (mesh.face_normals[:, 2] > 0.5)[:, None]
    tilt = np.degrees(np.arccos(np.clip(mesh.corner_normals[at_ridge][:, 2], -1, 1)))
    assert len(tilt) >= 4
    assert tilt.max() == pytest.approx(0.0 if smooth else bend_deg / 2, abs=bend_deg / 6 if smooth else 1e-3)


def test_read_inside_out_is_turned(tmp_path: Path) -> None:
    body = trimesh.creation.icosphere(2, 30.0)
    body.invert()
    mesh = mesh_file.read(saved(body, tmp_path / "inverted.stl"))
    assert np.einsum("fi,fi->f", mesh.face_normals, mesh.triangles.mean(axis=1) - [0, 0, 0.03]).min() > 0
    assert np.einsum("fi,fci->fc", mesh.face_normals, mesh.corner_normals).min() > 0.8


def ball(radius: float, x: float, inverted: bool) -> trimesh.Trimesh:
    body = trimesh.creation.icosphere(2, radius)
    body.apply_translation((x, 0, 0))
    if inverted:
        body.invert()
    return body


@pytest.mark.parametrize("flip", [False, True])
def test_read_hollow_is_kept_and_a_body_inside_it_too(tmp_path: Path, flip: bool) -> None:
    """A ball in a hollow of a ball, outside in as well."""
    shells = [ball(30, 0, flip), ball(20, 2, not flip), ball(10, 2, flip), ball(5, 40, flip)]
    mesh = mesh_file.read(saved(trimesh.util.concatenate(shells), tmp_path / "hollow.ply"))
    assert len(mesh.triangles) == sum(len(shell.faces) for shell in shells)
    a, b, c = np.moveaxis(mesh.triangles, 1, 0)
    expected = (1 if not flip else -1) * sum(shell.volume for shell in shells)
    assert np.einsum("fi,fi->", np.cross(a, b), c) / 6 == pytest.approx(1e-9 * expected, rel=1e-4)


@pytest.mark.parametrize("small_is_turned", [True, False])
def test_read_body_inside_out_beside_another_is_refused(tmp_path: Path, small_is_turned: bool) -> None:
    """As of mirrored parts of an assembly: it would be dark, and its true normals would point into it."""
    bodies = [ball(30, 0, not small_is_turned), ball(10, 41, small_is_turned), ball(5, -40, not small_is_turned)]
    with pytest.raises(RigError, match="1 of 3 bodies that face inward beside others"):
        mesh_file.read(saved(trimesh.util.concatenate(bodies), tmp_path / "assembly.stl"))


def obj(*lines: str) -> bytes:
    return "\n".join(lines).encode()


def open_box() -> bytes:
    body = trimesh.creation.box((20, 20, 20))
    body.update_faces(np.arange(len(body.faces)) < 10)
    return body.export(file_type="stl")


def mixed_winding() -> bytes:
    body = trimesh.creation.box((20, 20, 20))
    body.faces[0] = body.faces[0][::-1]
    return body.export(file_type="stl")


BOX = trimesh.creation.box((20, 20, 20))


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("open.stl", open_box(), r"open\.stl is not closed: 4 of its edges"),
        ("mixed.stl", mixed_winding(), "face inward"),
        ("empty.stl", b"", r"empty\.stl has no triangles"),
        ("garbage.stl", bytes(range(256)) * 9, r"garbage\.stl (has no triangles|is not a valid STL file)"),
        ("garbage.ply", bytes(range(256)) * 9, r"garbage\.ply is not a valid PLY file"),
        ("garbage.obj", bytes(range(256)) * 9, r"garbage\.obj has no triangles"),
        ("cut.stl", BOX.export(file_type="stl")[:300], r"cut\.stl (has no triangles|is not a valid STL file)"),
        ("points.obj", obj("v 0 0 0", "v 1 1 1"), "has no triangles"),
        ("far.obj", obj("v 0 0 0", "v 1 1 1", "v 1 0 0", "f 1 2 9"), r"far\.obj is not a valid OBJ file"),
        ("nan.obj", obj("v 0 0 nan", "v 9 9 9", "v 9 0 0", "f 1 2 3"), "has 1 vertices that are not finite"),
        ("flat.obj", obj("v 0 0 0", "v 9 9 0", "v 9 0 0", "f 1 2 3", "f 3 2 1"), "has no volume"),
        ("speck.obj", obj("v 0 0 0", "v 0 0 0", "v 0 0 0", "f 1 2 3"), "too small"),
        ("box.step", BOX.export(file_type="stl"), r"\.stl, \.ply, \.obj"),
        ("box", BOX.export(file_type="stl"), r"\.stl, \.ply, \.obj"),
    ],
    ids=lambda value: value if isinstance(value, str) and "." in value and " " not in value else "",
)
def test_read_bad_file_is_refused_by_name(tmp_path: Path, name: str, content: bytes, said: str) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(RigError, match=said) as caught:
        mesh_file.read(path)
    assert caught.value.code == ErrorCode.REQUEST_INVALID
    assert name in caught.value.detail
    assert ";" in caught.value.detail  # what to do


def test_read_missing_file_and_folder_are_refused(tmp_path: Path) -> None:
    (tmp_path / "folder.stl").mkdir()
    for name, said in (("nowhere.stl", "No such file"), ("folder.stl", "Is a directory")):
        with pytest.raises(RigError, match=said):
            mesh_file.read(tmp_path / name)


@pytest.mark.parametrize("size_mm", [0.0, -3.0, float("nan"), float("inf"), 4.0])
def test_read_impossible_size_is_refused(tmp_path: Path, size_mm: float) -> None:
    with pytest.raises(RigError, match="--size-mm"):
        mesh_file.read(saved(BOX, tmp_path / "box.stl"), size_mm)
