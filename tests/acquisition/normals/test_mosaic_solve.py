"""Mosaic sensors: each site solved as a pixel of its own, against the same scene seen by a monochrome sensor."""

from dataclasses import replace

import numpy as np
import pytest

from acquisition import mosaic, normals
from acquisition.models.calibration import Calibration
from acquisition.models.colour import ColourCalibration
from acquisition.models.light_plan import Light
from acquisition.models.result import NormalMap, SolveSettings
from acquisition.normals.alternatives import changed_images
from acquisition.normals.images import colour_albedo
from acquisition.normals.images.normalised_images import ImageBlock, Images
from acquisition.normals.pixels import image_terms, pixel_solve
from acquisition.normals.pixels.image_terms import ImageTerms
from acquisition.plan import baselines
from tests.acquisition import scenes
from tests.acquisition.normals.shared_scene import measured

SIZE = 96
WHOLE = slice(0, SIZE)
WHITE = np.array([0.9, 1.2, 0.7])
SURFACE = np.array([0.7, 0.35, 0.2])
"""Albedo of the object's R, G, B: brick red."""

MATRIX = np.array([[1.8, -0.8, 0.0], [-0.2, 1.5, -0.3], [0.0, -0.4, 1.4]])


def _calibration(pattern: str | None) -> Calibration:
    known = scenes.calibration(SIZE)
    colour = ColourCalibration(
        white=tuple(WHITE.tolist()), matrix=tuple(tuple(row) for row in MATRIX.tolist()), delta_e_mean=1.0,
        delta_e_max=2.0, chart="made up",
    )  # fmt: skip
    return known.model_copy(update={"sensor": known.sensor.model_copy(update={"mosaic": pattern}), "colour": colour})


def _lights() -> list[Light]:
    center = scenes.Dome(refused=0).center
    return [
        Light(position=tuple((center + 0.45 * unit).tolist()), axis=tuple((-unit).tolist()))
        for unit in baselines.two_rings(10, 0.2)
    ]


def _solved(pattern: str | None) -> tuple[scenes.Scene, NormalMap]:
    """From frames, the silhouette found in them: a table of grey, the object of one colour."""
    known = _calibration(pattern)
    object_albedo, table = float(SURFACE @ (colour_albedo.CELL_SHARES * WHITE)), 0.08
    true = scenes.scene(scenes.bumps, known, object_albedo, table)
    if pattern is not None:
        sites = mosaic.sites(pattern, WHOLE, WHOLE)
        true = replace(true, albedo=np.where(true.mask, (SURFACE * WHITE)[sites], table * WHITE[sites]))
    # Without errors of lamps, which would be drawn anew for each sensor.
    observations = scenes.capture(true, _lights(), seed=3, intensity_sigma=0, position_sigma_m=0)
    return true, normals.solve(observations, known, SolveSettings(), normals.ObjectPlace(scenes.TABLE_DEPTH - 0.045))


@pytest.fixture(scope="module")
def seen() -> tuple[scenes.Scene, NormalMap]:
    return _solved("grbg")


def test_solve_mosaic_of_a_coloured_surface_is_near_monochrome(seen: tuple[scenes.Scene, NormalMap]) -> None:
    true, found = seen
    plain_scene, plain = _solved(None)
    error = float(np.mean(true.error_deg(found.normals)))
    assert error < 1.25 * float(np.mean(plain_scene.error_deg(plain.normals)))
    assert np.mean(found.mask[true.graded]) > 0.995
    outside = found.mask & ~true.mask
    assert np.count_nonzero(outside) < 1.3 * max(np.count_nonzero(plain.mask & ~true.mask), 100)


def test_solve_mosaic_sigma_is_as_large_as_its_errors(seen: tuple[scenes.Scene, NormalMap]) -> None:
    true, found = seen
    ratio = true.error_deg(found.normals) / found.sigma_deg[true.graded]
    assert 0.5 < float(np.sqrt(np.nanmean(ratio**2))) < 1.5
    # No channel's sites are surer than they should be.
    sites = mosaic.sites("grbg", WHOLE, WHOLE)[true.graded]
    for channel in range(3):
        assert 0.5 < float(np.mean(ratio[sites == channel] < 1)) < 0.9


def test_solve_mosaic_gives_albedo_in_linear_srgb(seen: tuple[scenes.Scene, NormalMap]) -> None:
    true, found = seen
    assert found.albedo_rgb is not None
    assert found.notes["colour"] == colour_albedo.SRGB
    inner = true.graded & (np.nan_to_num(found.sigma_deg, nan=90) < 3)
    np.testing.assert_allclose(np.median(found.albedo_rgb[inner], axis=0), MATRIX @ SURFACE, atol=0.03)
    # The mean over channels has no pattern of sites: neighbours along a row differ by noise alone.
    grey = found.albedo
    both = inner[:, 1:] & inner[:, :-1]
    across = np.abs(np.diff(grey, axis=1))[both]
    assert float(np.median(across)) < 0.02


def test_solve_mosaic_without_colour_calibration_says_so() -> None:
    known = _calibration("grbg").model_copy(update={"colour": None})
    flat = np.full((SIZE, SIZE), 0.5, np.float32)
    none = np.zeros((SIZE, SIZE), bool)
    _, found = _solved("grbg")
    bare = colour_albedo.of_sites(replace(found, albedo=flat, mask=~none), known)
    assert bare.notes["colour"] == colour_albedo.CAMERA
    assert bare.albedo_rgb is not None
    np.testing.assert_allclose(bare.albedo_rgb, 0.5, atol=1e-6)


def test_channel_ratios_are_those_of_the_sites(seen: tuple[scenes.Scene, NormalMap]) -> None:
    true, found = seen
    rows, columns = np.nonzero(true.graded)
    ratios = colour_albedo.channel_ratios(found, _calibration("grbg"), rows, columns)
    expected = SURFACE * WHITE / (colour_albedo.CELL_SHARES @ (SURFACE * WHITE))
    np.testing.assert_allclose(np.median(ratios, axis=1), expected, rtol=0.03)
    plain = colour_albedo.channel_ratios(found, _calibration(None), rows, columns)
    np.testing.assert_array_equal(plain, np.ones((1, len(rows))))


def test_of_sites_of_a_monochrome_sensor_changes_nothing(seen: tuple[scenes.Scene, NormalMap]) -> None:
    assert colour_albedo.of_sites(seen[1], _calibration(None)) is seen[1]


def test_translated_mosaic_mixes_no_channels() -> None:
    sites = mosaic.sites("rggb", WHOLE, WHOLE)
    even = (SURFACE.astype(np.float32))[sites][None]
    stack = Images(ImageBlock(even, even > 2).rows, tuple(_lights()[:1]), WHOLE, WHOLE, np.ones(1), np.ones(1))
    moved = changed_images.translated(stack, np.array([[1.3, -0.7]]), mosaic.CELL).read(11, 40).values
    np.testing.assert_allclose(moved, even[:, 11:40], atol=1e-6)
    mixed = changed_images.translated(stack, np.array([[1.3, -0.7]])).read(11, 40).values
    assert np.abs(mixed - even[:, 11:40]).max() > 0.1


def test_translated_mosaic_moves_content_as_far_as_asked() -> None:
    row, column = np.mgrid[:SIZE, :SIZE].astype(np.float32)
    ramp = (0.01 * column + 0.02 * row)[None]
    stack = Images(ImageBlock(ramp, ramp > 9).rows, tuple(_lights()[:1]), WHOLE, WHOLE, np.ones(1), np.ones(1))
    moved = changed_images.translated(stack, np.array([[3.0, -1.0]]), mosaic.CELL).read(20, 60).values
    np.testing.assert_allclose(moved[:, :, 20:-20], (ramp + 0.03 - 0.02)[:, 20:60, 20:-20], atol=1e-5)


def test_highlights_of_a_mosaic_have_the_lamps_colour() -> None:
    made = measured()
    count = made.values.shape[1]
    channel = np.resize(np.array([0, 1, 2], np.uint8), count)
    known = made.calibration.model_copy(update={"colour": _calibration("rggb").colour})
    solution = pixel_solve.solve(
        replace(made.pixels, channel=channel), made.values, made.depth_m, replace(made.scene, calibration=known),
    )  # fmt: skip
    assert solution.response is not None
    np.testing.assert_allclose(solution.response, WHITE[channel], rtol=1e-6)
    view = -made.ray_direction / np.linalg.norm(made.ray_direction, axis=0)

    seen, unseen = (
        image_terms.evaluate(
            ImageTerms(gloss=0.2, strength=1.5), solution.g, made.light, solution.usable, view.astype(np.float32), one
        )
        for one in (solution.response, None)
    )
    assert unseen.lobe.max() > 0.01
    np.testing.assert_allclose(seen.lobe, unseen.lobe * solution.response, rtol=1e-5)
    np.testing.assert_allclose(seen.by_g, unseen.by_g * solution.response, rtol=1e-5)
