"""Images that viewers turn or mirror are read as they are stored, whatever their format, and a warning names them."""

from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image

from acquisition.formats import folders
from acquisition.formats.folders import image_files
from tests.acquisition.formats.folders import small

STORED = np.random.default_rng(1).integers(0, 200, (5, 7, 3))


def tiff(path: Path, pixels: np.ndarray, stated: int, compression: str | None) -> None:
    tag = (image_files.ORIENTATION, "H", 1, stated, True)
    photometric = "rgb" if pixels.ndim == 3 else "minisblack"
    tifffile.imwrite(path, pixels, compression=compression, photometric=photometric, extratags=[tag])


@pytest.mark.parametrize("compression", [None, "zlib"])
@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("stated", range(1, 9))
def test_read_tiff_is_as_stored(stated: int, kind: type, compression: str | None, tmp_path: Path) -> None:
    for name, pixels in (("rgb.tif", STORED.astype(kind)), ("grey.tif", STORED[..., 0].astype(kind))):
        tiff(tmp_path / name, pixels, stated, compression)
        images = image_files.open_images(tmp_path, [name], tmp_path)
        np.testing.assert_array_equal(images(0, 0, 5), pixels)
        np.testing.assert_array_equal(image_files.decode(tmp_path / name), pixels)
        assert images.turned == ([] if stated == 1 else [name])


@pytest.mark.parametrize("suffix", ["jpg", "png"])
@pytest.mark.parametrize("stated", [1, 3, 6])
def test_read_exif_is_as_stored(stated: int, suffix: str, tmp_path: Path) -> None:
    exif = Image.Exif()
    exif[image_files.ORIENTATION] = stated
    name = f"1.{suffix}"
    Image.fromarray(np.full((5, 7), 90, np.uint8)).save(tmp_path / name, exif=exif)
    images = image_files.open_images(tmp_path, [name], tmp_path)
    assert images.size == (5, 7)
    assert images.turned == ([] if stated == 1 else [name])


def test_orientation_of_damaged_or_other_file_is_none(tmp_path: Path) -> None:
    for content in (
        b"",
        b"II*\0\x08\0\0\0",
        b"\xff\xd8\xff\xe1\0\x10Exif\0\0II*\0",
        b"\x89PNG\r\n\x1a\n",
        b"P5 1 1 255 a",
    ):
        (tmp_path / "x").write_bytes(content)
        assert image_files.orientation(tmp_path / "x") == 1


def test_read_folder_of_turned_images_is_told(tmp_path: Path) -> None:
    """Compressed files, which are decoded, and plain ones, which are read in place, are read alike."""
    folder = small.near(tmp_path / "in")
    plain = folders.read(folder, tmp_path)
    stored = [tifffile.imread(folder / name) for name in plain.names]
    for number, (name, pixels) in enumerate(zip(plain.names, stored, strict=True)):
        tiff(folder / name, pixels, 6, "zlib" if number % 2 else None)
    images = folders.read(folder, tmp_path)
    for number, pixels in enumerate(stored):
        np.testing.assert_array_equal(images.rows(number, 0, images.height), pixels)
    (told,) = set(images.notes["warnings"]) - set(plain.notes["warnings"])
    assert told.startswith("0.tiff, 1.tiff, 2.tiff, 3.tiff, 4.tiff, and 1 more: viewers turn or mirror")
