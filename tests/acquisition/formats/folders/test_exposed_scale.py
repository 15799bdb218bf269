"""Images without a stated full scale: the first guess of noise follows their values, not the type of their files."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile

from acquisition.formats import folders
from acquisition.models.result import NormalMap, SolveSettings
from acquisition.normals import distant
from acquisition.normals.images.image_set import FULL_WELL_E
from tests.acquisition.formats.folders import small


def exposed(folder: Path, white: float, kind: type) -> Path:
    """A DiLiGenT-style folder of a noisy sphere, whose value `white` is 1.0 in other files."""
    small.diligent(folder, colour=False)
    rng = np.random.default_rng(0)
    for path in sorted(folder.glob("0*.png")):
        value = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) / 65535
        value = rng.poisson(value * FULL_WELL_E) / FULL_WELL_E * white
        path.unlink()
        tifffile.imwrite(
            path.with_suffix(".tiff"), np.round(value).astype(kind) if kind is np.uint16 else value.astype(kind)
        )
    names = folder / "filenames.txt"
    names.write_text(names.read_text().replace(".png", ".tiff"))
    return folder


def solved(folder: Path, scratch: Path, full_scale: float | None = None) -> NormalMap:
    return distant.solve(folders.read(folder, scratch, full_scale=full_scale), SolveSettings())


@pytest.mark.parametrize(("white", "expected"), [(500, 1023), (3000, 4095), (20_000, 16_383), (65_535, 65_535)])
def test_full_well_is_that_of_the_probable_range(white: float, expected: float, tmp_path: Path) -> None:
    folder = exposed(tmp_path / "in", white, np.uint16)
    assert folders.read(folder, tmp_path).full_well_e == pytest.approx(FULL_WELL_E * 65535 / expected)
    assert folders.read(folder, tmp_path, full_scale=65535).full_well_e == FULL_WELL_E


@pytest.mark.parametrize("white", [1e-6, 0.001, 300.0])
def test_solve_float_images_in_any_unit_are_solved_alike(white: float, tmp_path: Path) -> None:
    one, other = (solved(exposed(tmp_path / f"{unit}", unit, np.float32), tmp_path) for unit in (1.0, white))
    np.testing.assert_allclose(other.normals, one.normals, atol=2e-3)
    np.testing.assert_allclose(other.sigma_deg, one.sigma_deg, rtol=0.05)


def test_solve_dark_images_of_unstated_scale_as_if_it_were_stated(tmp_path: Path) -> None:
    folder = exposed(tmp_path / "in", 700, np.uint16)
    plain, stated = solved(folder, tmp_path), solved(folder, tmp_path, full_scale=1023)
    np.testing.assert_allclose(plain.normals, stated.normals, atol=2e-3)
    np.testing.assert_allclose(plain.sigma_deg, stated.sigma_deg, rtol=0.05)


@pytest.mark.parametrize("highlight", [10.0, 1e5])
def test_solve_float_images_with_one_bright_pixel_are_solved_alike(highlight: float, tmp_path: Path) -> None:
    """A highlight or a hot pixel of one image does not tell how bright the others could have been. It counts four times
    as the brightest percent does, so that the noise of the first guess is at most twice as large."""
    plain = solved(exposed(tmp_path / "plain", 1.0, np.float32), tmp_path)
    folder = exposed(tmp_path / "bright", 1.0, np.float32)
    image = folder / "002.tiff"
    values = tifffile.imread(image)
    values[small.SIZE // 2, small.SIZE // 2 + 3] = highlight
    tifffile.imwrite(image, values)
    bright = solved(folder, tmp_path)
    errors = [np.linalg.norm(one.normals - small.sphere()[0], axis=-1)[plain.mask] for one in (plain, bright)]
    assert np.median(errors[1]) < 1.2 * np.median(errors[0])
    ratio = bright.sigma_deg[plain.mask] / plain.sigma_deg[plain.mask]
    assert 0.9 < np.median(ratio) < 2
