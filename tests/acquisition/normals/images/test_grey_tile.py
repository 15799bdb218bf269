"""A grey tile in the picture: a lamp that drifts does no harm, and a tile that does not serve is noticed and named."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from acquisition import normals, photometry
from acquisition.capture import region
from acquisition.models import cell_config
from acquisition.models.cell_config import GreyTileConfig
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.result import NormalMap, SolveSettings
from acquisition.models.shot import Observations
from acquisition.normals.images import grey_tile
from acquisition.normals.images.grey_tile import GreyTile
from tests.acquisition import scenes

SIZE, COUNT = 96, 12
TILE = (slice(6, 16), slice(6, 16))
"""In a corner of the image: 100 pixels."""
DRIFT = np.linspace(0.975, 1.025, COUNT)
"""A lamp that warms up: 5 % over the session."""
CELL = cell_config.load(Path(__file__).parents[4] / "tests" / "data" / "cell.test.toml")


def true_scene(albedo: float = 0.3) -> scenes.Scene:
    """A cushion on the table, and the tile."""
    made = scenes.scene(scenes.bumps, scenes.calibration(SIZE, intensity_sigma=0.01, lamp_position_sigma_m=0.0003))
    made.albedo[TILE] = albedo
    return made


def tile(true: scenes.Scene) -> GreyTile:
    mask = np.zeros((SIZE, SIZE), bool)
    mask[TILE] = True
    return GreyTile(mask, np.full((SIZE, SIZE), scenes.TABLE_DEPTH, np.float32), np.array([0.0, 0.0, 1.0]))


@cache
def dimmed() -> tuple[scenes.Scene, Observations]:
    """The usual scene and its images, which no test changes."""
    true = true_scene()
    return true, captured(true)


def captured(true: scenes.Scene, seed: int = 0) -> Observations:
    lights = [*scenes.ring(COUNT // 2, 25.0), *scenes.ring(COUNT // 2, 48.0, 0.3)]
    return scenes.capture(true, lights, seed, 0.001, 0.0003, brightness=DRIFT.tolist())


def solved(true: scenes.Scene, observations: Observations, with_tile: bool) -> tuple[NormalMap, np.ndarray]:
    """The result, and its errors in degrees."""
    shown = tile(true) if with_tile else None
    region_of_object = true.mask.copy()
    found = normals.solve(
        observations,
        true.calibration,
        SolveSettings(),
        normals.ObjectPlace(0.88, region=region_of_object),
        grey_tile=shown,
    )
    return found, true.error_deg(found.normals)


def changed(observations: Observations, numbers: list[int], change: Callable[[np.ndarray], None]) -> Observations:
    """The tile's values of some images changed."""
    frames = scenes.Frames()
    frames.stored = {name: pixels.copy() for name, pixels in observations.frames.stored.items()}  # type: ignore[attr-defined]
    for number in numbers:
        change(frames.stored[f"{number}.tiff"][TILE])
    return replace(observations, frames=frames)


def test_tile_tells_the_drift_of_the_lamp() -> None:
    true, observations = dimmed()
    found = grey_tile.measure(observations, true.calibration, tile(true))
    assert found is not None
    assert found.finding is None
    error = found.log_intensity - np.log(DRIFT)
    assert np.std(error) < 1.5 * found.sigma
    assert 0.004 < found.sigma < 0.01


@pytest.mark.long
def test_tile_lowers_the_error_of_a_lamp_that_drifts() -> None:
    with_tile, without = list[float](), list[float]()
    for seed in range(4):
        true = true_scene()
        observations = captured(true, seed)
        found, error = solved(true, observations, with_tile=True)
        with_tile.append(float(error.mean()))
        assert np.std(np.log(found.intensity_factors) - np.log(DRIFT)) < 0.012
        without.append(float(solved(true, observations, with_tile=False)[1].mean()))
    print(f"mean error with the tile {np.mean(with_tile):.3f}°, without {np.mean(without):.3f}°")
    assert np.mean(with_tile) < np.mean(without)


def test_tile_in_a_shadow_is_noticed_and_named() -> None:
    true, sound = dimmed()
    dark = int(true.calibration.sensor.black_level_dn)

    def half(pixels: np.ndarray) -> None:
        pixels[:5] = dark + (pixels[:5] - dark) // 3

    def whole(pixels: np.ndarray) -> None:
        pixels[:] = dark + (pixels - dark) // 3

    observations = changed(changed(sound, [4], half), [7], whole)
    found = grey_tile.measure(observations, true.calibration, tile(true))
    assert found is not None
    assert found.finding is not None
    assert found.finding.message.startswith("the grey tile lies in a shadow in image 4, 7: ")
    np.testing.assert_allclose(found.log_intensity, np.log(DRIFT), atol=0.02)


def test_lamp_at_half_its_brightness_is_measured() -> None:
    true, sound = dimmed()
    dark = int(true.calibration.sensor.black_level_dn)

    def half(pixels: np.ndarray) -> None:
        pixels[:] = dark + (pixels - dark) // 2

    found = grey_tile.measure(changed(sound, [7], half), true.calibration, tile(true))
    assert found is not None
    assert found.finding is None
    assert found.log_intensity[7] == pytest.approx(np.log(DRIFT[7] / 2), abs=3 * found.sigma)


def test_saturated_tile_is_noticed_and_named() -> None:
    true, sound = dimmed()

    def full(pixels: np.ndarray) -> None:
        pixels[2:4] = 4095

    found = grey_tile.measure(changed(sound, [3], full), true.calibration, tile(true))
    assert found is not None
    assert found.finding is not None
    assert "is saturated in image 3" in found.finding.message
    assert grey_tile.measure(changed(sound, list(range(8)), full), true.calibration, tile(true)) is None


def test_solve_with_tile_that_does_not_serve_is_as_without_and_says_so() -> None:
    true, sound = dimmed()

    def full(pixels: np.ndarray) -> None:
        pixels[:] = 4095

    observations = changed(sound, list(range(COUNT)), full)
    found, _ = solved(true, observations, with_tile=True)
    plain, _ = solved(true, observations, with_tile=False)
    np.testing.assert_array_equal(found.normals, plain.normals)
    assert found.findings[-1].kind == photometry.GREY_TILE
    assert not found.findings[-1].corrected
    # σ is of the normals, which are as without it: what is forecast of further images, too.
    assert photometry.capture_sigma_deg(found.findings) == photometry.capture_sigma_deg(plain.findings)


def test_outline_of_cell_file_becomes_pixels_within_the_edge() -> None:
    known = scenes.calibration(SIZE)
    outline = GreyTileConfig(outline_px=[(10, 20), (29, 20), (29, 39), (10, 39)])
    cell = CELL.model_copy(update={"grey_tile": outline})
    mask = region.grey_tile(cell, known)
    assert mask is not None
    rows, columns = np.nonzero(mask)
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (22, 37, 12, 27)
    assert region.grey_tile(CELL, known) is None
    assert cell.fingerprint != CELL.fingerprint
    outside = cell.model_copy(update={"grey_tile": GreyTileConfig(outline_px=[(200, 0), (220, 0), (220, 20)])})
    with pytest.raises(RigError, match="outline_px") as refused:
        region.grey_tile(outside, known)
    assert refused.value.code is ErrorCode.CONFIG_INVALID
