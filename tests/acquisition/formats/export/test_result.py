"""A stored result reads back exactly; its images encode the maps."""

from dataclasses import fields, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile

from acquisition.formats import export
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.result import CAST, LIT, FisherInformation, GoodnessOfFit, ModelFinding, NormalMap


@pytest.fixture
def normal_map() -> NormalMap:
    rng = np.random.default_rng(0)
    shape, lights = (37, 53), 5  # odd sizes: masks are packed into bits
    mask = rng.random(shape) < 0.6
    normals = rng.normal(size=(*shape, 3))
    normals[..., 2] = np.abs(normals[..., 2])
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    half = rng.normal(size=(20, 4, 4))
    rows, columns = np.nonzero(mask)

    def masked(values: np.ndarray, outside: float = 0.0) -> np.ndarray:
        return np.where(mask if values.ndim == 2 else mask[..., None], values, outside).astype(np.float32)

    return NormalMap(
        normals=masked(normals),
        albedo=masked(rng.random(shape)),
        depth=masked(0.8 + 0.1 * rng.random(shape)),
        sigma_deg=masked(rng.random(shape), np.nan),
        residual=masked(rng.random(shape)),
        mask=mask,
        silhouette=mask | (rng.random(shape) < 0.1),
        flags=rng.choice([0, LIT, CAST, LIT | 16], size=(lights, *shape)).astype(np.uint8),
        intensity_factors=1 + 0.01 * rng.normal(size=lights),
        information=FisherInformation(
            rows=rows[:20].astype(np.int64),
            columns=columns[:20].astype(np.int64),
            matrices=half @ half.transpose(0, 2, 1),
        ),
        doubtful=mask & (rng.random(shape) < 0.1),
        noise={"intensity": 0.012, "direction": 0.004},
        notes={"shift_m": 0.0012, "threshold": 0.08},
        fit=GoodnessOfFit(
            misfit=0.8,
            probability=0.7,
            image_misfits=[0.7, None, 0.9, 0.8, 1.1],
            image_probabilities=[0.8, None, 0.6, 0.7, 0.5],
            region_misfits=[[0.5, None], [None, 1.5]],
        ),
        findings=(ModelFinding(kind="stray light", message="a black level", corrected=True, value=0.03),),
    )


def test_write_result_reads_back_exactly(normal_map: NormalMap, tmp_path: Path) -> None:
    export.write(normal_map, tmp_path / "result")
    again = export.read(tmp_path / "result")
    for field in fields(NormalMap):
        before, after = getattr(normal_map, field.name), getattr(again, field.name)
        if isinstance(before, np.ndarray):
            assert after.dtype == before.dtype, field.name
            np.testing.assert_array_equal(after, before, err_msg=field.name)
        elif isinstance(before, FisherInformation):
            np.testing.assert_array_equal(after.rows, before.rows)
            np.testing.assert_array_equal(after.columns, before.columns)
            np.testing.assert_array_equal(after.matrices, before.matrices)
        else:
            assert after == before


def test_write_normals_png_encodes_half_of_n_plus_one_in_16_bits(normal_map: NormalMap, tmp_path: Path) -> None:
    export.write(normal_map, tmp_path / "result")
    picture = cv2.imread(str(tmp_path / "result" / "normals.png"), cv2.IMREAD_UNCHANGED)
    assert picture.dtype == np.uint16
    decoded = picture[..., ::-1].astype(float) / 65535 * 2 - 1  # OpenCV reads BGR
    np.testing.assert_allclose(decoded[normal_map.mask], normal_map.normals[normal_map.mask], atol=1.6e-5)
    assert not np.any(picture[~normal_map.mask])


def test_write_images_equal_the_maps(normal_map: NormalMap, tmp_path: Path) -> None:
    names = export.write(normal_map, tmp_path / "result")
    folder = tmp_path / "result"
    assert set(names) == {path.name for path in folder.iterdir()}
    mask = cv2.imread(str(folder / "mask.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(mask, np.where(normal_map.mask, 255, 0))
    counts = cv2.imread(str(folder / "lights_used.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(counts, np.sum(normal_map.flags & LIT, axis=0))
    for name in ("normals", "depth", "sigma_deg", "albedo"):
        stored = tifffile.imread(folder / f"{name}.tiff")
        assert stored.dtype == np.float32
        np.testing.assert_array_equal(stored, getattr(normal_map, name))


@pytest.mark.parametrize("images", [255, 258])
def test_lights_used_of_many_images_is_their_number(normal_map: NormalMap, tmp_path: Path, images: int) -> None:
    flags = np.full((images, *normal_map.mask.shape), LIT, np.uint8)
    export.write(replace(normal_map, flags=flags), tmp_path / "result")
    stored = cv2.imread(str(tmp_path / "result/lights_used.png"), cv2.IMREAD_UNCHANGED)
    assert stored is not None
    assert np.all(stored == images)


def test_write_second_result_removes_all_files_of_the_first(normal_map: NormalMap, tmp_path: Path) -> None:
    folder = tmp_path / "result"
    export.write(normal_map, folder)
    (folder / "stale.txt").write_text("of another result")
    export.write(normal_map, folder)
    assert not (folder / "stale.txt").exists()
    assert [path.name for path in tmp_path.iterdir()] == ["result"]


@pytest.mark.parametrize(
    "damage",
    [
        "missing",
        "cut",
        "empty",
    ],
)
def test_read_damaged_archive_is_named(damage: str, normal_map: NormalMap, tmp_path: Path) -> None:
    export.write(normal_map, tmp_path / "result")
    archive = tmp_path / "result" / export.ARCHIVE
    if damage == "missing":
        archive.unlink()
    elif damage == "cut":
        archive.write_bytes(archive.read_bytes()[: archive.stat().st_size // 2])
    else:
        archive.write_bytes(b"")
    with pytest.raises(RigError) as caught:
        export.read(tmp_path / "result")
    assert caught.value.code == ErrorCode.STORE_CORRUPT
    assert caught.value.context["file"] == str(archive)
