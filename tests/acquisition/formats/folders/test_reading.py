"""Folders of other programs: DiLiGenT, `.lp`, near light; true normals and masks."""

import json
import pickle
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
import tifffile
from scipy.io import savemat

from acquisition.formats import folders
from acquisition.formats.folders import ground_truth, image_files
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.result import SolveSettings
from acquisition.normals import near_light
from acquisition.normals.images.image_set import Camera, DistantLights, ImageSet, NearLights
from tests.acquisition.formats.folders import small


def distant_normals(images: ImageSet) -> np.ndarray:
    """Least squares over the lit measurements of each pixel, independent of the solvers."""
    assert isinstance(images.lights, DistantLights)
    stack = np.stack([images.values(index, 0, images.height) for index in range(images.count)])
    grey = stack if stack.ndim == 3 else (stack / images.lights.intensities[:, None, None]).mean(axis=-1)
    if stack.ndim == 3:
        grey = grey / images.lights.intensities[:, 0, None, None]
    units = images.lights.directions / np.linalg.norm(images.lights.directions, axis=1, keepdims=True)
    out = np.zeros((images.height, images.width, 3))
    for row, column in np.argwhere(images.mask):
        used = grey[:, row, column] > 1e-4
        if np.count_nonzero(used) >= 3:
            g = np.linalg.lstsq(units[used], grey[used, row, column], rcond=None)[0]
            out[row, column] = g / np.linalg.norm(g)
    return out


def error_deg(estimate: np.ndarray, true: np.ndarray) -> np.ndarray:
    both = (np.linalg.norm(estimate, axis=-1) > 0.5) & (np.linalg.norm(true, axis=-1) > 0.5)
    return np.degrees(np.arccos(np.clip(np.sum(estimate * true, axis=-1)[both], -1, 1)))


@pytest.mark.parametrize("colour", [True, False])
def test_read_diligent_folder_gives_its_images_and_lights(colour: bool, tmp_path: Path) -> None:
    folder = small.diligent(tmp_path / "in", colour)
    images = folders.read(folder, tmp_path)
    assert images.channels == (3 if colour else 1)
    assert images.names == tuple(f"{number:03d}.png" for number in range(1, 7))
    np.testing.assert_array_equal(images.mask, small.sphere()[1])
    assert error_deg(distant_normals(images), small.sphere()[0]).max() < 0.1


def test_read_diligent_folder_of_windows_gives_the_same(tmp_path: Path) -> None:
    """CRLF line ends, a byte order mark, columns of any width, a mask of three channels, true normals."""
    folder = small.diligent(tmp_path / "in")
    plain = folders.read(folder, tmp_path)
    for name in ("filenames.txt", "light_directions.txt", "light_intensities.txt"):
        lines = (folder / name).read_text().replace(" ", "   ").splitlines()
        (folder / name).write_bytes(b"\xef\xbb\xbf" + "\r\n".join(["", *lines, "", ""]).encode())
    cv2.imwrite(str(folder / "mask.png"), np.repeat(small.sphere()[1][..., None] * np.uint8(255), 3, axis=2))
    savemat(folder / "Normal_gt.mat", {"Normal_gt": small.sphere()[0], "other": np.eye(2)}, format="5")
    images = folders.read(folder, tmp_path)
    assert images.names == plain.names
    assert isinstance(images.lights, DistantLights)
    assert isinstance(plain.lights, DistantLights)
    np.testing.assert_array_equal(images.lights.directions, plain.lights.directions)
    np.testing.assert_array_equal(images.lights.intensities, plain.lights.intensities)
    np.testing.assert_array_equal(images.mask, plain.mask)
    assert images.truth is not None
    np.testing.assert_allclose(images.truth, small.sphere()[0], atol=1e-6)


def test_values_channels_are_in_order_of_their_intensities(tmp_path: Path) -> None:
    folder = small.diligent(tmp_path / "in")
    colours = np.zeros((small.SIZE, small.SIZE, 3), np.uint16)
    colours[..., 0] = 50_000  # red; OpenCV writes the last channel first
    cv2.imwrite(str(folder / "001.png"), colours[..., ::-1])
    rows = folders.read(folder, tmp_path).values(0, 0, 2)
    assert rows[0, 0].tolist() == pytest.approx([50_000 / 65535, 0, 0])


@pytest.mark.parametrize("bits", [8, 16])
def test_read_lp_folder_accepts_names_with_spaces(bits: int, tmp_path: Path) -> None:
    folder = small.lp(tmp_path / "in", bits)
    images = folders.read(folder, tmp_path)
    assert images.names[2] == "img 2.png"
    assert images.mask.all()
    assert error_deg(distant_normals(images), small.sphere()[0]).max() < (0.1 if bits == 16 else 5)
    assert any("8 bits" in sentence for sentence in images.notes["warnings"]) == (bits == 8)
    assert folders.read(folder / "lights.lp", tmp_path).names == images.names


def test_read_lp_file_with_foreign_paths_finds_its_images(tmp_path: Path) -> None:
    folder = small.lp(tmp_path / "in")
    text = (folder / "lights.lp").read_text()
    (folder / "lights.lp").write_text(text.replace("img 0", "C:\\rti\\img 0").replace("img 1", "/home/a/img 1"))
    assert folders.read(folder, tmp_path).count == 6


def test_read_near_light_folder_is_in_view_frame_and_metres(tmp_path: Path) -> None:
    images = folders.read(small.near(tmp_path / "in"), tmp_path)
    assert isinstance(images.lights, NearLights)
    assert images.lights.positions_m[1].tolist() == pytest.approx([0.25, 0.0, -0.15])
    assert images.lights.positions_m[3].tolist() == pytest.approx([0.0, -0.26, -0.12])
    assert images.lights.reference_m == pytest.approx(0.4)
    assert images.rough_depth_m == pytest.approx(0.48)
    assert images.truth is not None
    assert images.truth[small.SIZE // 2, small.SIZE // 2, 2] > 0.99
    assert any("black level" in sentence for sentence in images.notes["warnings"])


@pytest.mark.parametrize(("unit", "of_mm"), [("mm", 1.0), ("cm", 0.1), ("m", 0.001)])
def test_read_near_light_folder_converts_metric_units(unit: str, of_mm: float, tmp_path: Path) -> None:
    folder = small.near(tmp_path / "in")
    content = json.loads((folder / "lights.json").read_text())
    content["unit"] = unit
    for light in content["lights"]:
        light["position"] = [of_mm * value for value in light["position"]]
    (folder / "lights.json").write_text(json.dumps(content))
    images = folders.read(folder, tmp_path)
    assert isinstance(images.lights, NearLights)
    assert images.lights.positions_m[1].tolist() == pytest.approx([0.25, 0.0, -0.15])
    assert images.lights.reference_m == pytest.approx(0.4)
    assert images.rough_depth_m == pytest.approx(0.48)


def test_read_near_light_folder_states_what_is_known_of_lights_and_sensor(tmp_path: Path) -> None:
    folder = small.near(tmp_path / "in")
    content = json.loads((folder / "lights.json").read_text())
    assumed = near_light.calibration_of(folders.read(folder, tmp_path))
    content |= {"position_sigma_mm": 0.2, "intensity_sigma": 0.003}
    content["camera"] |= {"full_well_e": 30_000, "read_noise_e": 2}
    (folder / "lights.json").write_text(json.dumps(content))
    images = folders.read(folder, tmp_path)
    assert not any("not used" in sentence for sentence in images.notes["warnings"])
    stated = near_light.calibration_of(images)
    for known, position_m, intensity, full_well_e, read_e in (
        (assumed, 1e-3, 0.01, 10_000, 5),
        (stated, 2e-4, 0.003, 30_000, 2),
    ):
        assert known.lamp_position_sigma_m == pytest.approx(position_m)
        assert known.intensity_sigma == intensity
        assert (known.sensor.full_well_e, known.sensor.read_noise_e) == (full_well_e, read_e)


@pytest.mark.parametrize(("gain", "clipped"), [(1.0, True), (3.0, False)])
def test_read_float_images_above_one_are_not_saturated(gain: float, clipped: bool, tmp_path: Path) -> None:
    """They may be merged exposures or 16-bit values, which nobody can tell, so a warning says what they count as."""
    folder = small.near(tmp_path / "in")
    for path in folder.glob("*.tiff"):
        pixels = tifffile.imread(path).astype(np.float32) / 65535
        tifffile.imwrite(path, np.float32(gain) * pixels / max(1.0, float(pixels.max())))
    images = folders.read(folder, tmp_path)
    assert (images.saturated_from < 1) == clipped
    assert any("values above 1, and no full scale is stated" in said for said in images.notes["warnings"]) != clipped


def test_read_near_light_folder_unknown_fields_are_named(tmp_path: Path) -> None:
    folder = small.near(tmp_path / "in")
    content = json.loads((folder / "lights.json").read_text())
    content["blacklevel"] = 500
    content["camera"]["distortion"] = [0.1, 0, 0, 0, 0, 0, 0, 0]
    content["camera"]["name"] = "left"
    (folder / "lights.json").write_text(json.dumps(content))
    images = folders.read(folder, tmp_path)
    assert any("blacklevel, camera.name" in sentence for sentence in images.notes["warnings"])
    assert images.camera is not None
    assert images.camera.distortion.tolist() == [0.1, 0, 0, 0, 0]


def test_solve_cropped_images_keep_the_optical_axis(tmp_path: Path) -> None:
    """The optical axis lies outside the cropped images."""
    folder = small.near(tmp_path / "in")
    full = near_light.solve(folders.read(folder, tmp_path), SolveSettings(robust=False))
    first = small.SIZE // 2 + 2
    for path in folder.glob("*.tiff"):
        tifffile.imwrite(path, tifffile.imread(path)[:, first:])
    cv2.imwrite(str(folder / "mask.png"), small_mask(folder)[:, first:])
    np.save(folder / "normals_gt.npy", np.load(folder / "normals_gt.npy")[:, first:])
    content = json.loads((folder / "lights.json").read_text())
    content["camera"]["K"][0][2] -= first
    (folder / "lights.json").write_text(json.dumps(content))
    part = near_light.solve(folders.read(folder, tmp_path), SolveSettings(robust=False))
    # Depth is estimated from half of the surface only, so the normals differ a little.
    assert np.median(error_deg(part.normals, full.normals[:, first:])) < 1.0


def small_mask(folder: Path) -> np.ndarray:
    return np.asarray(cv2.imread(str(folder / "mask.png"), cv2.IMREAD_UNCHANGED))


def test_read_black_level_is_subtracted(tmp_path: Path) -> None:
    folder = small.near(tmp_path / "in")
    before = folders.read(folder, tmp_path).rows(0, 0, small.SIZE).copy()
    for path in folder.glob("*.tiff"):
        tifffile.imwrite(path, tifffile.imread(path) + np.uint16(500))
    text = (folder / "lights.json").read_text()
    (folder / "lights.json").write_text(text.replace('"unit"', '"black_level": 500, "unit"'))
    after = folders.read(folder, tmp_path)
    np.testing.assert_array_equal(after.rows(0, 0, small.SIZE), before)
    assert after.saturated_from == pytest.approx(0.985 - 500 / 65535)
    assert not any("black level" in sentence for sentence in after.notes["warnings"])


def test_store_plain_tiff_is_not_copied(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    grey = rng.integers(0, 65535, (9, 7), dtype=np.uint16)
    colour = rng.integers(0, 65535, (9, 7, 3), dtype=np.uint16)
    cases = {"big-endian": grey, "deflate": grey, "rgb": colour}
    tifffile.imwrite(tmp_path / "big-endian.tiff", grey, byteorder=">")
    cv2.imwrite(str(tmp_path / "deflate.tiff"), grey, [cv2.IMWRITE_TIFF_COMPRESSION, 8])
    tifffile.imwrite(tmp_path / "rgb.tiff", colour, photometric="rgb")
    for name, expected in cases.items():
        scratch = tmp_path / name
        scratch.mkdir()
        stored = image_files.open_images(tmp_path, [f"{name}.tiff"], scratch)
        rows = pickle.loads(pickle.dumps(stored))  # noqa: S301 - made here
        np.testing.assert_array_equal(rows(0, 2, 5), expected[2:5])
        assert rows(0, 2, 5).dtype == np.uint16  # native byte order
        assert rows(0, 2, 5).flags.c_contiguous
        assert bool(list(scratch.iterdir())) == (name == "deflate")


@pytest.mark.parametrize("name", ["Normal_gt.mat", "normals_gt.npy", "normals_gt.tiff", "normals_gt.exr"])
def test_read_truth_in_each_file_format_is_equal(name: str, tmp_path: Path) -> None:
    folder = small.diligent(tmp_path / "in")
    true = small.sphere()[0].astype(np.float32)
    match name.rsplit(".", maxsplit=1)[-1]:
        case "mat":
            savemat(folder / name, {"Normal_gt": true.astype(np.float64)})
        case "npy":
            np.save(folder / name, true)
        case "tiff":
            tifffile.imwrite(folder / name, true, photometric="rgb")
        case _:
            channels = {f"N.{axis}": np.ascontiguousarray(true[..., index]) for index, axis in enumerate("XYZ")}
            OpenEXR.File({"type": OpenEXR.scanlineimage}, channels).write(str(folder / name))
    truth = folders.read(folder, tmp_path).truth
    assert truth is not None
    np.testing.assert_allclose(truth, true, atol=1e-6)


def test_read_truth_of_any_length_is_normalised(tmp_path: Path) -> None:
    folder = small.diligent(tmp_path / "in")
    true, mask = small.sphere()
    length = np.random.default_rng(0).uniform(0.002, 0.03, (*mask.shape, 1))
    savemat(folder / "Normal_gt.mat", {"Normal_gt": np.where(mask[..., None], true * length, np.nan)})
    truth = folders.read(folder, tmp_path).truth
    assert truth is not None
    np.testing.assert_allclose(truth, true * mask[..., None], atol=1e-6)


def test_read_image_list_with_foreign_paths_finds_its_images(tmp_path: Path) -> None:
    folder = small.diligent(tmp_path / "in")
    (folder / "filenames.txt").write_text("".join(f"C:\\scans\\ball\\{number:03d}.png\r\n" for number in range(1, 7)))
    assert folders.read(folder, tmp_path).count == 6


def test_read_sphere_given_is_the_truth(tmp_path: Path) -> None:
    folder = small.diligent(tmp_path / "in")
    images = folders.read(folder, tmp_path, sphere=folders.Sphere(small.SIZE / 2, small.SIZE / 2, small.RADIUS))
    assert images.truth is not None
    np.testing.assert_allclose(images.truth[images.mask], small.sphere()[0][images.mask], atol=1e-6)
    assert images.evaluation_mask is not None
    np.testing.assert_array_equal(images.evaluation_mask, images.mask)


def test_sphere_normals_in_perspective_agree_with_truth(tmp_path: Path) -> None:
    images = folders.read(small.near(tmp_path / "in"), tmp_path)
    focal = images.camera.matrix[0, 0]  # type: ignore[union-attr]
    radius = focal * np.tan(np.arcsin(40 / 500))
    normals, inside = ground_truth.sphere_normals(
        ground_truth.Sphere(small.SIZE / 2, small.SIZE / 2, radius), images.height, images.width, images.camera
    )
    assert images.truth is not None
    np.testing.assert_array_equal(inside, images.mask)
    assert error_deg(normals, images.truth).max() < 0.1
    # Off the axis every normal on the outline is at right angles to its ray.
    wide = Camera(np.array([[100.0, 0, 50], [0, 100, 50], [0, 0, 1]]))
    normals, inside = ground_truth.sphere_normals(ground_truth.Sphere(120.0, 80.0, 30.0), 150, 200, wide)
    row, column = np.mgrid[:150, :200]
    ray = np.stack([(column - 50) / 100, -(row - 50) / 100, -np.ones(row.shape)], -1)
    cosine = -np.sum(normals * ray, axis=-1)[inside] / np.linalg.norm(ray, axis=-1)[inside]
    np.testing.assert_allclose(np.linalg.norm(normals[inside], axis=-1), 1, atol=1e-6)
    assert cosine.min() > 0
    assert cosine.max() > 0.999


def twelve_bits(folder: Path, top: int = 4095) -> Path:
    """An `.lp` folder whose 16-bit files hold values of a 12-bit camera, of which some are clipped."""
    small.lp(folder)
    for path in folder.glob("*.png"):
        pixels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) / 65535
        cv2.imwrite(str(path), np.minimum(np.round(2 * pixels * 4095), top).astype(np.uint16))
    return folder


def test_read_twelve_bits_in_sixteen_are_told_unless_stated(tmp_path: Path) -> None:
    folder = twelve_bits(tmp_path / "in")
    plain, stated = folders.read(folder, tmp_path), folders.read(folder, tmp_path, full_scale=4095)
    assert any("12 bits, state full_scale 4095" in one and "accurate" in one for one in plain.notes["warnings"])
    assert not any("full_scale" in sentence for sentence in stated.notes["warnings"])
    assert not any("full_scale" in one for one in folders.read(small.lp(tmp_path / "16"), tmp_path).notes["warnings"])
    values = stated.values(0, 0, small.SIZE)
    assert values.max() == pytest.approx(1, rel=1e-6)
    assert np.any(values >= stated.saturated_from)
    assert not np.any(plain.values(0, 0, small.SIZE) >= plain.saturated_from)


def test_read_near_full_scale_of_file_counts_and_option_is_refused(tmp_path: Path) -> None:
    folder = small.near(tmp_path / "in")
    before = folders.read(folder, tmp_path)
    content = json.loads((folder / "lights.json").read_text())
    (folder / "lights.json").write_text(json.dumps(content | {"full_scale": 2 * 65535, "black_level": 0}))
    after = folders.read(folder, tmp_path)
    np.testing.assert_allclose(2 * after.values(1, 0, small.SIZE), before.values(1, 0, small.SIZE), rtol=1e-6)
    assert any("hold values up to 65535" in sentence for sentence in after.notes["warnings"])
    assert not any("hold values up to" in sentence for sentence in before.notes["warnings"])
    with pytest.raises(RigError, match="is where full_scale belongs"):
        folders.read(folder, tmp_path, full_scale=4095)


def test_read_copied_image_is_named_and_not_refused(tmp_path: Path) -> None:
    folder = small.lp(tmp_path / "in")
    (folder / "img 3.png").write_bytes((folder / "img 1.png").read_bytes())
    said = folders.read(folder, tmp_path).notes["warnings"]
    assert any(one.startswith("img 1.png, img 3.png hold the same values") for one in said)


def test_read_plane_under_a_ring_is_not_taken_for_one_image(tmp_path: Path) -> None:
    """Its images are the same but for noise, as they should be."""
    folder = small.lp(tmp_path / "in")
    azimuth = np.arange(6) * np.pi / 3
    rows = [f"img {number}.png {np.cos(one)} {np.sin(one)} 1" for number, one in enumerate(azimuth)]
    (folder / "lights.lp").write_text("\n".join(["6", *rows]))
    albedo = np.random.default_rng(9).uniform(0.2, 0.8, (small.SIZE, small.SIZE))
    for number in range(6):
        noise = 0.004 * np.random.default_rng(number).standard_normal(albedo.shape)
        cv2.imwrite(str(folder / f"img {number}.png"), small.sixteen(np.clip(albedo + noise, 0, 1)))
    assert folders.read(folder, tmp_path).count == 6


def test_read_mask_of_alpha_is_its_alpha(tmp_path: Path) -> None:
    folder = small.diligent(tmp_path / "in")
    inside = small.sphere()[1]
    white = np.full((*inside.shape, 3), 255, np.uint8)
    cv2.imwrite(str(folder / "mask.png"), np.dstack([white, inside.astype(np.uint8) * 255]))
    np.testing.assert_array_equal(folders.read(folder, tmp_path).mask, inside)


def test_read_jpeg_of_any_folder_is_told(tmp_path: Path) -> None:
    folder = small.diligent(tmp_path / "in")
    names = [f"{number}.jpg" for number in range(6)]
    for name, path in zip(names, sorted(folder.glob("0*.png")), strict=True):
        cv2.imwrite(str(folder / name), cv2.imread(str(path)))
    (folder / "filenames.txt").write_text("\n".join(names))
    assert any("JPEG" in sentence for sentence in folders.read(folder, tmp_path).notes["warnings"])


def test_read_lp_file_of_capitals_is_found_in_its_folder(tmp_path: Path) -> None:
    folder = small.lp(tmp_path / "in")
    (folder / "lights.lp").rename(folder / "LIGHTS.LP")
    assert folders.read(folder, tmp_path).count == 6


def test_read_near_lamp_at_the_camera_is_solved(tmp_path: Path) -> None:
    """As a ring of LEDs round the lens is, about."""
    positions = [[0, 0, 0], [250, 0, 150], [-250, 50, 150], [0, 260, 120], [50, -240, 150], [180, 180, 200]]
    images = folders.read(small.near(tmp_path / "in", np.array(positions, float)), tmp_path)
    solved = near_light.solve(images, SolveSettings())
    assert images.truth is not None
    assert np.median(error_deg(solved.normals, images.truth)) < 0.6


def black_rows(image: int, start: int, stop: int) -> np.ndarray:
    return np.zeros((stop - start, small.SIZE), np.uint16)


@pytest.mark.parametrize("wrong", ["positions", "depth", "images"])
def test_solve_near_where_nothing_is_lit_is_infeasible_or_solved(wrong: str, tmp_path: Path) -> None:
    """Not an error of some index, whoever states such lamps; at a depth in another unit the lamps are as good as far
    away."""
    images = folders.read(small.near(tmp_path / "in"), tmp_path)
    assert isinstance(images.lights, NearLights)
    if wrong == "images":
        with pytest.raises(RigError, match="lit by two lamps") as refused:
            near_light.solve(replace(images, rows=black_rows), SolveSettings())
        assert refused.value.code is ErrorCode.NORMALS_INFEASIBLE
        return
    if wrong == "positions":
        changed = replace(images, lights=replace(images.lights, positions_m=1000 * images.lights.positions_m))
    else:
        changed = replace(images, rough_depth_m=0.00048)
    solved = near_light.solve(changed, SolveSettings())
    assert np.any(solved.mask)
    assert np.all(solved.depth[solved.mask] > 0)
    assert wrong != "depth" or "lamps" in [finding.kind for finding in solved.findings]
