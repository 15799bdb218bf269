"""Exports for other programs, read back with independent libraries."""

import errno
import json
import os
import subprocess
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
import tifffile
import trimesh

from acquisition.formats import export, folders
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.result import LIT, FisherInformation, NormalMap
from acquisition.normals.images.image_set import ImageSet
from tests.acquisition.formats.folders import small


def truth_as_result(images: ImageSet, depth: np.ndarray) -> NormalMap:
    """The true normals as the result of a solve."""
    assert images.truth is not None
    mask = images.mask & (np.linalg.norm(images.truth, axis=-1) > 0.5)
    shape = mask.shape
    return NormalMap(
        normals=np.where(mask[..., None], images.truth, 0).astype(np.float32),
        albedo=np.where(mask, small.ALBEDO, 0).astype(np.float32),
        depth=np.where(mask, depth, 0).astype(np.float32),
        sigma_deg=np.where(mask, 0.7, np.nan).astype(np.float32),
        residual=np.where(mask, 1.0, 0).astype(np.float32),
        mask=mask,
        silhouette=images.mask,
        flags=np.where(mask, LIT, 0).astype(np.uint8) * np.ones((images.count, 1, 1), np.uint8),
        intensity_factors=np.ones(images.count),
        information=FisherInformation(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 4, 4))),
        indirect=np.full(shape, 0.25, np.float32),
        doubtful=mask & (np.arange(shape[1]) < 3),
        albedo_rgb=np.where(mask[..., None], [0.5, 0.6, 0.7], 0).astype(np.float32),
    )


@pytest.fixture
def near(tmp_path: Path) -> export.Source:
    """A ball 500 mm away, seen in perspective."""
    images = folders.read(small.near(tmp_path / "near"), tmp_path)
    assert images.truth is not None
    z = 0.5 - 0.04 * images.truth[..., 2]  # the ball's centre is on the axis, 0.5 m away
    return export.Source(truth_as_result(images, z), images)


@pytest.fixture
def distant(tmp_path: Path) -> export.Source:
    folder = small.diligent(tmp_path / "distant")
    np.save(folder / "normals_gt.npy", small.sphere()[0])
    images = folders.read(folder, tmp_path)
    return export.Source(truth_as_result(images, 50 - 16 * small.sphere()[0][..., 2]), images)


def made(name: str, source: export.Source, folder: Path) -> Path:
    folder.mkdir(exist_ok=True)
    export.make(name, source, folder)
    return folder / name


def png_text(path: Path) -> str:
    content = path.read_bytes()
    at = content.index(b"tEXt")
    length = int.from_bytes(content[at - 4 : at], "big")
    return content[at + 4 : at + 4 + length].decode("latin-1").split("\0", 1)[1]


def test_write_optional_maps_read_back_exactly(near: export.Source, tmp_path: Path) -> None:
    names = export.write(near.normal_map, tmp_path / "result")
    again = export.read(tmp_path / "result")
    assert {"indirect.tiff", "doubtful.png", "albedo_rgb.tiff"} <= set(names)
    for name in ("indirect", "doubtful", "albedo_rgb"):
        np.testing.assert_array_equal(getattr(again, name), getattr(near.normal_map, name))
    bare = replace(near.normal_map, indirect=None, albedo_rgb=None)
    assert not {"indirect.tiff", "albedo_rgb.tiff"} & set(export.write(bare, tmp_path / "result"))
    again = export.read(tmp_path / "result")
    assert again.indirect is None
    assert again.albedo_rgb is None


def test_normal_images_name_convention_and_directx_inverts_green(near: export.Source, tmp_path: Path) -> None:
    normal_map = near.normal_map
    export.write(normal_map, tmp_path / "result")
    pictures = {}
    for name, path in (
        ("OpenGL", tmp_path / "result" / "normals.png"),
        ("DirectX", made("normals_directx.png", near, tmp_path / "out")),
    ):
        assert name in png_text(path)
        pixels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[..., ::-1]
        pictures[name] = pixels.astype(float) / 65535 * 2 - 1
        assert not np.any(pixels[~normal_map.mask])
    np.testing.assert_allclose(pictures["OpenGL"][normal_map.mask], normal_map.normals[normal_map.mask], atol=1.6e-5)
    np.testing.assert_allclose(
        pictures["DirectX"][normal_map.mask], normal_map.normals[normal_map.mask] * [1, -1, 1], atol=1.6e-5
    )
    with tifffile.TiffFile(tmp_path / "result" / "depth.tiff") as file:
        assert "depth along the camera's axis, m" in file.pages.first.description


def test_exr_channels_equal_the_maps(near: export.Source, tmp_path: Path) -> None:
    normal_map = near.normal_map
    file = OpenEXR.File(str(made("maps.exr", near, tmp_path / "out")), separate_channels=True)
    channels = {name: channel.pixels for name, channel in file.channels().items()}
    normals = np.stack([channels[f"N.{axis}"] for axis in "XYZ"], -1)
    # Half floats below 1 are rounded by 2⁻¹² at most: 0.024° if all three components are.
    np.testing.assert_allclose(normals, normal_map.normals, atol=2**-12)
    np.testing.assert_array_equal(channels["Z"], normal_map.depth)
    np.testing.assert_array_equal(channels["sigma_deg"], np.nan_to_num(normal_map.sigma_deg))
    np.testing.assert_allclose(channels["albedo"], normal_map.albedo, atol=5e-4)
    np.testing.assert_array_equal(channels["indirect"], normal_map.indirect)
    assert "y up" in file.header()["convention"]
    assert "axis, m;" in file.header()["units"]
    np.testing.assert_allclose(channels["G"], normal_map.albedo_rgb[..., 1], atol=5e-4)  # type: ignore[index]


def test_mesh_of_ball_has_its_radius_and_faces_the_camera(near: export.Source, tmp_path: Path) -> None:
    path = made("mesh.ply", near, tmp_path / "out")
    assert b"comment view frame: x right, y up" in path.read_bytes()[:300]
    mesh = trimesh.load(path, process=False)
    assert len(mesh.vertices) == np.count_nonzero(near.normal_map.mask)
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices - [0, 0, -0.5], axis=1), 0.04, atol=2e-4)
    np.testing.assert_allclose(mesh.vertex_normals, near.normal_map.normals[near.normal_map.mask], atol=1e-6)
    toward = -np.sum(mesh.face_normals * mesh.triangles_center, axis=1)
    assert toward.min() > 0
    assert len(mesh.faces) > 1.7 * len(mesh.vertices)


def test_mesh_depth_discontinuity_is_not_bridged(distant: export.Source, tmp_path: Path) -> None:
    shape = distant.normal_map.mask.shape
    step = np.where(np.arange(shape[1]) < shape[1] // 2, 10.0, 30.0) * np.ones(shape)
    flat = replace(distant.normal_map, depth=step.astype(np.float32), mask=np.ones(shape, bool))
    mesh = trimesh.load(made("mesh.ply", replace(distant, normal_map=flat), tmp_path / "out"), process=False)
    assert len(mesh.faces) == 2 * (shape[0] - 1) * (shape[1] - 2)
    assert np.ptp(mesh.triangles[..., 2], axis=1).max() == 0


def test_lights_lp_and_dome_give_directions_and_positions(near: export.Source, tmp_path: Path) -> None:
    rows = made("lights.lp", near, tmp_path / "out").read_text().splitlines()
    assert int(rows[0]) == near.images.count == len(rows) - 1
    name, x, y, z = rows[2].split()
    assert name == "1.tiff"
    expected = np.array([0.25, 0, -0.15]) - near.centre
    np.testing.assert_allclose([float(x), float(y), float(z)], expected / np.linalg.norm(expected), atol=1e-5)

    dome = json.loads(made("lights.dome", near, tmp_path / "out").read_text())
    assert dome["lightConfiguration"] == "lights3d"
    place = np.array([dome["positions3d"][1][axis] for axis in "xyz"])
    np.testing.assert_allclose(place, expected * 1000, atol=1e-3)
    assert dome["imageWidth"] == pytest.approx(1000 * near.width_m)
    assert 0.08 < near.width_m < 0.11  # the ball of 80 mm is 32 of 40 pixels wide
    adjust = np.array([one["g"] for one in dome["ledAdjust"]])
    assert adjust.shape == (6,)


def test_diligent_export_reads_back_unchanged(distant: export.Source, tmp_path: Path) -> None:
    again = folders.read(made("diligent", distant, tmp_path / "out"), tmp_path)
    for index in range(again.count):
        np.testing.assert_array_equal(
            again.values(index, 0, again.height), distant.images.values(index, 0, again.height)
        )
    np.testing.assert_array_equal(again.mask, distant.images.mask)
    np.testing.assert_allclose(again.lights.intensities, distant.images.lights.intensities, rtol=1e-8)  # type: ignore[union-attr]
    units = distant.images.lights.directions  # type: ignore[union-attr]
    units = units / np.linalg.norm(units, axis=1, keepdims=True)
    np.testing.assert_allclose(again.lights.directions, units, atol=1e-8)  # type: ignore[union-attr]


def test_diligent_export_near_light_is_stated_in_readme(near: export.Source, tmp_path: Path) -> None:
    folder = made("diligent", near, tmp_path / "out")
    assert "near" in (folder / "README.txt").read_text()
    assert folders.read(folder, tmp_path).count == near.images.count


def test_diligent_export_of_mosaic_sites_is_stated_in_readme(near: export.Source, tmp_path: Path) -> None:
    assert near.images.channels == 1
    of_sites = made("diligent", near, tmp_path / "sites") / "README.txt"
    grey = replace(near, normal_map=replace(near.normal_map, albedo_rgb=None))
    assert "mosaic" in of_sites.read_text()
    assert "mosaic" not in (made("diligent", grey, tmp_path / "grey") / "README.txt").read_text()


def test_diligent_export_of_twelve_bits_fills_the_scale(near: export.Source, tmp_path: Path) -> None:
    """A session's values: what was clipped stays clipped, and albedo keeps its scale."""
    twelve = replace(near.images, rows=lambda *rows: near.images.rows(*rows) // 16, full_scale=4095.0)  # type: ignore[arg-type]
    again = folders.read(made("diligent", replace(near, images=twelve), tmp_path / "out"), tmp_path)
    for index in range(again.count):
        whole = index, 0, again.height
        np.testing.assert_allclose(again.values(*whole), twelve.values(*whole), atol=1e-5)  # half a step of 16 bits


@pytest.mark.parametrize("bits", [8, 16])
def test_diligent_export_of_lp_folder_has_sixteen_bits(bits: int, tmp_path: Path) -> None:
    images = folders.read(small.lp(tmp_path / "in", bits), tmp_path)
    source = export.Source(
        truth_as_result(replace(images, truth=small.sphere()[0]), np.ones(images.mask.shape)), images
    )
    again = folders.read(made("diligent", source, tmp_path / "out"), tmp_path)
    np.testing.assert_allclose(again.values(1, 0, again.height), images.values(1, 0, again.height), atol=1e-7)


def test_integration_export_has_camera_matrix_for_near_light_only(
    near: export.Source, distant: export.Source, tmp_path: Path
) -> None:
    folder = made("integration", near, tmp_path / "near-out")
    np.testing.assert_allclose(np.loadtxt(folder / "K.txt"), near.images.camera.matrix, rtol=1e-8)  # type: ignore[union-attr]
    assert cv2.imread(str(folder / "normal_map.png"), cv2.IMREAD_UNCHANGED).dtype == np.uint16
    mask = cv2.imread(str(folder / "mask.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(mask > 0, near.normal_map.mask)
    assert not (made("integration", distant, tmp_path / "distant-out") / "K.txt").exists()


def test_atomic_folder_failure_leaves_nothing(tmp_path: Path) -> None:
    target = tmp_path / "out"

    def broken() -> None:
        with export.atomic_folder(target) as partial:
            (partial / "half").write_text("half")
            raise subprocess.SubprocessError("in the middle")

    with pytest.raises(subprocess.SubprocessError):
        broken()
    assert list(tmp_path.iterdir()) == []
    with export.atomic_folder(target) as partial:
        (partial / "all").write_text("all")
        assert not target.exists()
    assert [path.name for path in target.iterdir()] == ["all"]
    with export.atomic_folder(target) as partial:
        (partial / "new").write_text("new")
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    assert [path.name for path in target.iterdir()] == ["new"]


def test_atomic_folder_is_on_the_disk_before_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    flushed, fsync, rename = list[int](), os.fsync, Path.rename

    def flush(descriptor: int) -> None:
        flushed.append(os.fstat(descriptor).st_ino)
        fsync(descriptor)

    def move(partial: Path, target: Path) -> Path:
        assert {path.stat().st_ino for path in (partial, *partial.rglob("*"))} <= set(flushed)
        flushed.clear()
        return rename(partial, target)

    monkeypatch.setattr(os, "fsync", flush)
    monkeypatch.setattr(Path, "rename", move)
    with export.atomic_folder(tmp_path / "out") as partial:
        (partial / "maps").mkdir()
        (partial / "maps" / "normals.png").write_text("normals")
    assert flushed == [tmp_path.stat().st_ino]


def test_refuse_foreign_folder_with_other_files_is_refused(tmp_path: Path) -> None:
    export.refuse_foreign(tmp_path / "new", "ours.json")
    export.refuse_foreign(tmp_path, "ours.json")
    (tmp_path / "thesis.tex").write_text("years of work")
    for target in (tmp_path, tmp_path / "thesis.tex"):
        with pytest.raises(RigError) as refused:
            export.refuse_foreign(target, "ours.json")
        assert refused.value.code is ErrorCode.FOLDER_INVALID
    for unlisted in ("{}", "[]", "no JSON", '{"files": 3}'):
        (tmp_path / "ours.json").write_text(unlisted)
        with pytest.raises(RigError, match="does not list"):
            export.refuse_foreign(tmp_path, "ours.json")
    (tmp_path / "ours.json").write_text('{"files": {}}')
    with pytest.raises(RigError, match=r"thesis\.tex"):
        export.refuse_foreign(tmp_path, "ours.json")


def test_refuse_foreign_own_folder_as_written_is_accepted(tmp_path: Path) -> None:
    """Until a file is changed, or another one or a link is put beside, also in a folder of the folder."""
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "mask.png").write_text("as written")
    (tmp_path / "ours.json").write_text(json.dumps({"files": export.checksums(tmp_path)}))
    (tmp_path / ".DS_Store").write_text("litter")
    export.refuse_foreign(tmp_path, "ours.json")
    (tmp_path / "maps" / "mask.png").write_text("corrected by hand")
    with pytest.raises(RigError, match=r"maps/mask\.png, which was changed"):
        export.refuse_foreign(tmp_path, "ours.json")
    (tmp_path / "maps" / "mask.png").write_text("as written")
    (tmp_path / "maps" / "link").symlink_to(tmp_path)
    with pytest.raises(RigError, match="maps/link, which this program did not write"):
        export.refuse_foreign(tmp_path, "ours.json")


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_diligent_export_outside_the_mask_is_black_where_not_a_number(distant: export.Source, tmp_path: Path) -> None:
    outside = ~distant.images.mask

    def rows(_: int, start: int, stop: int) -> np.ndarray:
        return np.where(outside[start:stop], np.nan, 0.5).astype(np.float32)

    images = replace(distant.images, rows=rows, channels=1, full_scale=1.0)
    written = made("diligent", replace(distant, images=images), tmp_path / "out")
    pixels = cv2.imread(str(written / "001.png"), cv2.IMREAD_UNCHANGED)
    assert np.array_equal(pixels, np.where(outside, 0, 32768))


@pytest.mark.parametrize("gain", [255.0, 1.0])
def test_diligent_folder_of_merged_exposures_keeps_their_values(gain: float, tmp_path: Path) -> None:
    """Values above full scale, of which none is clipped, are not in the folder's 16-bit images either."""
    folder = small.diligent(tmp_path / "in", colour=False)
    for path in folder.glob("0*.png"):
        pixels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        tifffile.imwrite(path.with_suffix(".tiff"), (gain * pixels / 65535).astype(np.float32))
        path.unlink()
    names = folder / "filenames.txt"
    names.write_text(names.read_text().replace(".png", ".tiff"))
    np.save(folder / "normals_gt.npy", small.sphere()[0])
    images = folders.read(folder, tmp_path)
    source = export.Source(truth_as_result(images, np.zeros(images.mask.shape)), images)
    again = folders.read(made("diligent", source, tmp_path / "out"), tmp_path)
    for number in range(images.count):
        # of RGB intensities, a grey image has the mean
        one, two = (
            each.values(number, 0, each.height) / each.lights.intensities[number].mean()  # type: ignore[union-attr]
            for each in (images, again)
        )
        np.testing.assert_allclose(one, two, atol=2e-5 * gain)
        assert again.values(number, 0, again.height).max() < again.saturated_from


@pytest.mark.parametrize("name", ["maps.exr", "albedo.exr", "mesh.ply", "albedo.png"])
def test_file_on_a_full_disk_is_an_error_of_the_disk(near: export.Source, tmp_path: Path, name: str) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / name).symlink_to("/dev/full")
    with pytest.raises(OSError, match="No space left") as full:
        export.make(name, near, tmp_path / "out")
    assert full.value.errno == errno.ENOSPC
