"""The final solve in blocks of rows against all rows at once, and streamed images against those held in memory."""

from dataclasses import replace

import numpy as np
import pytest

from acquisition import image_values, normals, photometry
from acquisition.models.calibration import Calibration
from acquisition.models.result import HIGHLIGHT, LIT, NormalMap, SolveSettings
from acquisition.normals import final_solve, pixel_solution, pyramid
from acquisition.normals.alternation import AlternationResult
from acquisition.normals.images import normalised_images, session_images
from acquisition.normals.images.normalised_images import Images
from acquisition.normals.indirect_light.shadow_light import ShadowEquations
from acquisition.normals.pixels.image_terms import ImageTerms
from acquisition.normals.pixels.pixel_solve import Scene
from acquisition.normals.pyramid import MaskedImages, PyramidLevel
from acquisition.normals.self_calibration import SharedParameters
from acquisition.normals.surface import integrability
from tests.acquisition import scenes

SIZE = 96
ROUNDING = 5e-5
"""Of a map's largest value, by which two solves of a pixel may differ whose sums are taken in another order.

Where a pixel stands in a block decides whether its loops are vectorised, and so, by the processor, which products are
fused and in which order they are added. A normal equation sums some n = 80 products (8 images, 10 unknown products
each): their rounding is √n u = 5e-7, u = 6e-8 being the unit roundoff of single precision; it grows by the condition of
the equations, which under these two rings is 20 at the median and 73 at 99 % (diagonal scaled to 1). A whitened
residual is a difference of values of which each is up to 100 times its noise (1 % of the light): it differs by as much.
"""
FACTOR = 3
LIGHTS = [*scenes.ring(4, 30.0), *scenes.ring(4, 55.0, turn=0.4)]


@pytest.fixture(scope="module")
def cushion() -> scenes.Scene:
    return scenes.scene(scenes.bumps, scenes.calibration(SIZE))


def images(true: scenes.Scene) -> Images:
    all_pixels = slice(0, SIZE)
    return session_images.read(scenes.capture(true, LIGHTS, seed=1), true.calibration, all_pixels, all_pixels)


def model(known: Calibration, stack: Images) -> Scene:
    noise = image_values.model_noise(known, stack.shot, stack.floor, 0.45)
    return Scene(photometry.lamps(stack.lights), known, noise, SolveSettings(), median_albedo=0.5)


def refined(gathered: PyramidLevel, noise: image_values.Noise, received: float) -> AlternationResult:
    """A coarse surface that is not flat, as an alternation might end with."""
    coarse = gathered.coarse
    count, lights = coarse.values.shape[1], len(coarse.values)
    wave = 0.86 + 0.004 * np.sin(np.arange(count) / 9)
    light = np.random.default_rng(3).uniform(0, received, (lights, count)) if received else None
    return AlternationResult(
        depth_m=wave.astype(np.float32),
        continuity_weight=np.where(wave > 0.862, 0.5, 1).astype(np.float32),
        mixed=np.zeros(count, np.float32),
        sky=np.ones(count, np.float32),
        shadows=ShadowEquations.none(),
        shared=replace(SharedParameters.nominal(lights), log_intensity=np.linspace(-0.01, 0.01, lights)),
        shared_variance=np.full(count, 1e-5, np.float32),
        indirect_irradiance=None if light is None else light.astype(np.float32),
        typical_albedo=0.5,
        noise=noise,
        normals=np.zeros((3, count), np.float32),
    )


def same(one: NormalMap, two: NormalMap) -> None:
    assert np.count_nonzero(one.mask) > 1500
    for name in ("mask", "silhouette", "flags", "doubtful"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name), name)
    # Tukey's biweight redescends: where a regression stands between two fits, it makes 4e-6 of the normals' 1e-7.
    np.testing.assert_allclose(one.sigma_deg, two.sigma_deg, rtol=1e-3)
    apart = np.abs(one.sigma_deg - two.sigma_deg)[one.mask]
    assert np.quantile(apart, 0.999) <= ROUNDING * np.nanmax(one.sigma_deg)
    for name in ("normals", "albedo", "depth", "residual", "indirect", "intensity_factors"):
        atol = ROUNDING * np.nanmax(np.abs(getattr(one, name)))
        np.testing.assert_allclose(getattr(one, name), getattr(two, name), rtol=0, atol=atol, err_msg=name)
    np.testing.assert_array_equal(one.information.rows, two.information.rows)
    np.testing.assert_array_equal(one.information.columns, two.information.columns)
    # A sum of products x_i x_j is at most √(M_ii M_jj), and rounds in proportion to that (Cauchy–Schwarz).
    scale = np.sqrt(np.einsum("nii->ni", one.information.matrices))
    scale = scale[:, :, None] * scale[:, None, :]
    apart = np.abs(one.information.matrices - two.information.matrices)
    assert np.all(apart <= ROUNDING * scale)
    assert one.notes["interreflection"]["share"] == pytest.approx(two.notes["interreflection"]["share"], rel=ROUNDING)


@pytest.mark.parametrize(
    ("terms", "received"),
    [(None, 0.0), (None, 0.2), (ImageTerms(gloss=0.3, strength=0.5), 0.2)],
    ids=["plain", "in turns", "glossy"],
)
def test_solve_in_blocks_of_rows_equals_solve_in_one(
    terms: ImageTerms | None, received: float, cushion: scenes.Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    stack = images(cushion)
    all_pixels = slice(0, SIZE)
    masked = MaskedImages(stack, cushion.mask, photometry.rays(cushion.calibration, all_pixels, all_pixels))
    known = replace(model(cushion.calibration, stack), terms=terms)

    def solved() -> NormalMap:
        gathered = masked.level(FACTOR, pixel_solution.noise_sample(int(np.count_nonzero(cushion.mask))), None)
        return final_solve.solve(masked, gathered, refined(gathered, known.noise, received), known, (SIZE, SIZE))

    together = solved()
    assert np.count_nonzero(together.flags == LIT) < 0.95 * len(LIGHTS) * np.count_nonzero(cushion.mask)  # shadows
    monkeypatch.setattr(pyramid, "BLOCK_VALUES", 1)
    monkeypatch.setattr(pyramid, "MIN_BLOCK_ROWS", 5)
    assert len(list(masked.blocks())) > 15
    same(together, solved())


def test_solve_streamed_images_equals_solve_in_memory(cushion: scenes.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """From frames, with silhouette, alternation and table: in blocks from files, and at once from memory."""
    observations, table = scenes.capture(cushion, LIGHTS, seed=1), np.full((SIZE, SIZE), scenes.TABLE_DEPTH, np.float32)

    def solved() -> NormalMap:
        return normals.solve(
            observations,
            cushion.calibration,
            SolveSettings(depth_rounds=1),
            normals.ObjectPlace(0.86, table_depth_m=table),
        )

    together = solved()
    monkeypatch.setattr(pyramid, "BLOCK_VALUES", 1)
    monkeypatch.setattr(pyramid, "MIN_BLOCK_ROWS", 20)
    monkeypatch.setattr(normalised_images, "MAX_HELD_BYTES", 0)
    assert images(cushion).read(0, 1).values.base is None  # no view of a stack in memory
    same(together, solved())


def test_level_in_blocks_of_rows_equals_level_in_one(cushion: scenes.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    stack = images(cushion)
    masked = MaskedImages(stack, cushion.mask, photometry.rays(cushion.calibration, slice(0, SIZE), slice(0, SIZE)))
    chosen = pixel_solution.noise_sample(int(np.count_nonzero(cushion.mask)))
    table = scenes.TABLE_DEPTH + np.random.default_rng(0).random((SIZE, SIZE), np.float32)
    full = masked.level(7, chosen, table)
    monkeypatch.setattr(pyramid, "BLOCK_VALUES", 1)
    monkeypatch.setattr(pyramid, "MIN_BLOCK_ROWS", 10)
    parts = masked.level(7, chosen, table)
    assert len(parts.parts) > len(full.parts)
    for one, two in ((full.coarse, parts.coarse), (full.sample, parts.sample)):
        assert one.shape == two.shape
        for name in ("index", "ray", "values", "clipped"):
            np.testing.assert_array_equal(getattr(one, name), getattr(two, name), name)
    assert full.table is not None
    assert parts.table is not None
    # Means of 49 positive values, at worst 49 u = 3e-6 off by their order.
    np.testing.assert_allclose(full.table.values, parts.table.values, rtol=1e-5)
    depth = full.coarse.index.astype(np.float32)
    np.testing.assert_allclose(full.interpolate_sample(depth), parts.interpolate_sample(depth), rtol=1e-5)
    few = masked.pixels(slice(0, SIZE)).subset(chosen)
    np.testing.assert_array_equal(few.values, full.sample.values)
    np.testing.assert_array_equal(few.index, parts.sample.index)


def test_flags_predicted_indirect_light_is_no_highlight(cushion: scenes.Scene) -> None:
    """Light that reaches all pixels under one of eight lights alone stands out as a highlight would."""
    stack, all_pixels = images(cushion), slice(0, SIZE)
    falling = np.where(np.arange(len(LIGHTS)) == 0, 0.3, 0).astype(np.float32)
    lit = scenes.with_values(stack, stack.whole.values + (0.5 * falling)[:, None, None])
    masked = MaskedImages(lit, cushion.mask, photometry.rays(cushion.calibration, all_pixels, all_pixels))
    gathered = masked.level(FACTOR, pixel_solution.noise_sample(int(np.count_nonzero(cushion.mask))), None)
    known = model(cushion.calibration, lit)
    result = replace(refined(gathered, known.noise, 0.0), shared=SharedParameters.nominal(len(LIGHTS)))
    received = np.repeat(falling[:, None], gathered.coarse.values.shape[1], axis=1)
    shares = [
        np.mean(
            final_solve.solve(masked, gathered, replace(result, indirect_irradiance=one), known, (SIZE, SIZE)).flags[
                0, cushion.graded
            ]
            & HIGHLIGHT
            > 0
        )
        for one in (None, received)
    ]
    assert shares[0] > 0.3
    assert shares[1] < 0.03


def test_solve_pixels_with_two_lights_are_smoothed(cushion: scenes.Scene) -> None:
    stack, all_pixels = images(cushion), slice(0, SIZE)
    lone = np.zeros((SIZE, SIZE), np.bool_)
    lone[2::6, 2::6] = cushion.graded[2::6, 2::6]
    values = stack.whole.values.copy()
    values[2:, lone] = 0
    masked = MaskedImages(
        scenes.with_values(stack, values), cushion.mask, photometry.rays(cushion.calibration, all_pixels, all_pixels)
    )
    gathered = masked.level(FACTOR, pixel_solution.noise_sample(int(np.count_nonzero(cushion.mask))), None)
    known = model(cushion.calibration, stack)
    start = replace(refined(gathered, known.noise, 0.0), shared=SharedParameters.nominal(len(LIGHTS)))
    result = final_solve.solve(masked, gathered, start, known, (SIZE, SIZE))
    assert np.min(result.sigma_deg[lone]) > 15  # smoothing claims nothing: two lights are two lights
    assert np.mean(cushion.error_deg(result.normals)[lone[cushion.graded]]) < 4


def test_solve_uncertainty_of_the_whole_capture_smooths_no_pixel(cushion: scenes.Scene) -> None:
    """All pixels share it, so that neighbours are no surer of a normal than the pixel's own images."""
    stack, all_pixels = images(cushion), slice(0, SIZE)
    masked = MaskedImages(stack, cushion.mask, photometry.rays(cushion.calibration, all_pixels, all_pixels))
    gathered = masked.level(FACTOR, pixel_solution.noise_sample(int(np.count_nonzero(cushion.mask))), None)
    known = model(cushion.calibration, stack)
    known = replace(known, noise=replace(known.noise, intensity=0.05))
    start = replace(refined(gathered, known.noise, 0.0), shared=SharedParameters.nominal(len(LIGHTS)))
    sound, doubted = (
        final_solve.solve(masked, gathered, start, known, (SIZE, SIZE), capture_sigma_deg=sigma_deg)
        for sigma_deg in (0.0, 8.0)
    )
    assert np.all(doubted.sigma_deg[cushion.mask] > sound.sigma_deg[cushion.mask])
    assert np.mean(np.sum(sound.normals * doubted.normals, axis=-1)[cushion.mask]) > np.cos(np.radians(0.1))


def test_solve_integrability_lowers_median_error(cushion: scenes.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    stack, all_pixels = images(cushion), slice(0, SIZE)
    masked = MaskedImages(stack, cushion.mask, photometry.rays(cushion.calibration, all_pixels, all_pixels))
    gathered = masked.level(FACTOR, pixel_solution.noise_sample(int(np.count_nonzero(cushion.mask))), None)
    known = model(cushion.calibration, stack)
    start = replace(refined(gathered, known.noise, 0.0), shared=SharedParameters.nominal(len(LIGHTS)))

    def median_deg() -> float:
        result = final_solve.solve(masked, gathered, start, known, (SIZE, SIZE))
        return float(np.median(cushion.error_deg(result.normals)))

    projected = median_deg()
    monkeypatch.setattr(integrability, "ITERATIONS", 0)
    single = median_deg()
    assert projected < 0.95 * single


def test_solve_noise_beyond_what_is_stated_is_a_misfit(cushion: scenes.Scene) -> None:
    """Estimated noise whitens residuals of a wrong model to 1; against the stated one they stand out, and raise σ."""
    stack = images(cushion)
    all_pixels = slice(0, SIZE)
    masked = MaskedImages(stack, cushion.mask, photometry.rays(cushion.calibration, all_pixels, all_pixels))
    gathered = masked.level(FACTOR, pixel_solution.noise_sample(int(np.count_nonzero(cushion.mask))), None)
    scene = model(cushion.calibration, stack)
    estimated = replace(scene, noise=replace(scene.noise, intensity=0.02, direction=0.01))
    state = refined(gathered, estimated.noise, 0.0)

    def solved(stated: image_values.Noise) -> NormalMap:
        size = (SIZE, SIZE)
        return final_solve.solve(masked, gathered, state, replace(estimated, stated_noise=stated), size)

    as_estimated, less = solved(estimated.noise), solved(scene.noise)
    np.testing.assert_array_equal(less.normals, as_estimated.normals)
    assert less.noise["misfit"] > as_estimated.noise["misfit"]
    assert np.nanmean(less.sigma_deg) > 1.02 * np.nanmean(as_estimated.sigma_deg)
