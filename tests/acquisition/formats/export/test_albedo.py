"""The albedo's pictures, read back by others' libraries: LittleCMS (through Pillow) and OpenEXR's own."""

import io
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
import tifffile
from PIL import Image, ImageCms

from acquisition import colour
from acquisition.formats.export import exr, map_files, result_folder
from acquisition.models.result import FisherInformation, NormalMap
from acquisition.normals.images.colour_albedo import CAMERA, SRGB

COLOURS = np.array([[0.18, 0.18, 0.18], [0.6, 0.1, 0.05], [0.05, 0.3, 0.6], [0.9, 0.85, 0.2]])


@pytest.fixture
def result() -> NormalMap:
    """Four colours in columns, the last row outside the object; one value beyond white, one below black."""
    rgb = np.broadcast_to(COLOURS, (6, 4, 3)).astype(np.float32).copy()
    rgb[0, 3, 0], rgb[0, 1, 2] = 1.5, -0.1
    mask = np.ones((6, 4), bool)
    mask[-1] = False
    flat = np.zeros((6, 4), np.float32)
    return NormalMap(
        normals=np.zeros((6, 4, 3), np.float32), albedo=rgb.mean(axis=-1), depth=flat, sigma_deg=flat, residual=flat,
        mask=mask, silhouette=mask, flags=np.zeros((1, 6, 4), np.uint8), intensity_factors=np.ones(1),
        information=FisherInformation(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 4, 4))),
        doubtful=np.zeros_like(mask), albedo_rgb=rgb, notes={"colour": SRGB},
    )  # fmt: skip


def test_srgb_profile_is_the_same_each_time() -> None:
    profile = map_files.srgb_profile()
    assert profile == map_files.srgb_profile()
    assert ImageCms.ImageCmsProfile(io.BytesIO(profile)).profile.creation_date.year == 2026


def test_albedo_png_of_calibrated_colours_has_the_lab_that_is_meant(result: NormalMap, tmp_path: Path) -> None:
    path = tmp_path / "albedo.png"
    map_files.albedo_png(path, result)
    picture = Image.open(path)
    embedded = ImageCms.ImageCmsProfile(io.BytesIO(picture.info["icc_profile"]))
    lab = ImageCms.profileToProfile(
        picture.convert("RGB"), embedded, ImageCms.createProfile("LAB", 5000), outputMode="LAB",
        renderingIntent=ImageCms.Intent.RELATIVE_COLORIMETRIC,
    )  # fmt: skip
    assert lab is not None
    light, a, b = np.moveaxis(np.asarray(lab)[2].astype(float), -1, 0)
    a, b = (np.where(one > 127, one - 256, one) for one in (a, b))
    found = np.stack([light * 100 / 255, a, b], axis=-1)
    assert colour.delta_e_2000(found, colour.lab_from_srgb(COLOURS)).max() < 1.0  # 8-bit Lab has steps of 1


def test_albedo_png_clips_and_leaves_the_outside_black(result: NormalMap, tmp_path: Path) -> None:
    path = tmp_path / "albedo.png"
    map_files.albedo_png(path, result)
    pixels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[..., ::-1]
    assert pixels.dtype == np.uint16
    assert pixels[0, 3, 0] == 65535
    assert pixels[0, 1, 2] == 0
    assert not pixels[-1].any()
    expected = np.round(65535 * colour.encoded_srgb(COLOURS))
    np.testing.assert_allclose(pixels[3], expected, atol=1)


def test_albedo_png_of_uncalibrated_colours_claims_no_profile(result: NormalMap, tmp_path: Path) -> None:
    path = tmp_path / "albedo.png"
    map_files.albedo_png(path, replace(result, notes={"colour": CAMERA}))
    picture = Image.open(path)
    assert "icc_profile" not in picture.info
    assert "is white" in picture.info["Description"]
    map_files.albedo_png(path, replace(result, albedo_rgb=None, notes={}))
    assert cv2.imread(str(path), cv2.IMREAD_UNCHANGED).shape == (6, 4)


def test_albedo_exr_is_linear_with_primaries(result: NormalMap, tmp_path: Path) -> None:
    path = tmp_path / "albedo.exr"
    exr.write_albedo(path, result)
    file = OpenEXR.File(str(path), separate_channels=True)
    assert np.array(file.header()["chromaticities"]) == pytest.approx(colour.SRGB_CHROMATICITIES)
    assert result.albedo_rgb is not None
    for index, name in enumerate("RGB"):
        np.testing.assert_allclose(file.channels()[name].pixels, result.albedo_rgb[..., index], rtol=1e-3)
    exr.write_albedo(path, replace(result, albedo_rgb=None, notes={}))
    grey = OpenEXR.File(str(path), separate_channels=True)
    assert set(grey.channels()) == {"Y"}
    assert "chromaticities" not in grey.header()


@pytest.mark.parametrize("space", [SRGB, CAMERA])
def test_float_albedo_states_its_colour_space(space: str, result: NormalMap, tmp_path: Path) -> None:
    result_folder.write_maps(replace(result, notes={"colour": space}), tmp_path)
    with tifffile.TiffFile(tmp_path / "albedo_rgb.tiff") as file:
        assert space in file.pages.first.description
    with tifffile.TiffFile(tmp_path / "albedo.tiff") as file:
        assert space not in file.pages.first.description


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_albedo_exr_of_any_unit_holds_it(unit: float, result: NormalMap, tmp_path: Path) -> None:
    """Half floats end at 65504, and have no digits left below 1e-7."""
    assert result.albedo_rgb is not None
    scaled = replace(result, albedo=result.albedo * unit, albedo_rgb=result.albedo_rgb * unit)
    exr.write_albedo(tmp_path / "albedo.exr", scaled)
    exr.write_maps(tmp_path / "maps.exr", scaled)
    for name, channel, expected in (
        ("albedo.exr", "RGB", scaled.albedo_rgb), ("maps.exr", "RGB", scaled.albedo_rgb),
        ("maps.exr", "albedo", scaled.albedo),
    ):  # fmt: skip
        stored = OpenEXR.File(str(tmp_path / name)).channels()[channel].pixels
        np.testing.assert_allclose(stored, expected, rtol=2**-11)
