"""The criterion against plain linear algebra, and its model of shadows, exposure and depth."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acquisition import geometry, photometry
from acquisition.models.base import FloatArray
from acquisition.models.light_plan import Light
from acquisition.models.recipe import Exposure, Recipe
from acquisition.plan import planned_images, sample_pixels, visibility
from acquisition.plan.criterion import Candidates
from tests.acquisition import scenes
from tests.acquisition.plan import cases


def variance_by_hand(lights: Candidates, chosen: list[int]) -> FloatArray:
    """Angular variance (P,), one pixel at a time."""
    sample = lights.sample
    out = np.empty(len(sample.albedo))
    for p in range(len(out)):
        fisher = sample.information[..., p].copy()
        for k in chosen:
            row = lights.row[k, :, p].astype(float)
            fisher += np.outer(row, row)
        n = sample.normal[:, p].astype(float)
        across = np.eye(3) - np.outer(n, n)
        covariance = np.linalg.inv(fisher)[:3, :3]
        out[p] = np.trace(across @ covariance @ across) / float(sample.albedo[p]) ** 2
    return out


def objective_by_hand(variance: FloatArray) -> float:
    return float(np.mean(np.sqrt(variance)))


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**31 - 1), st.integers(0, 6))
def test_posterior_variance_equals_inverted_information(seed: int, count: int) -> None:
    lights = cases.random_case(seed)
    chosen = list(range(count))
    expected = variance_by_hand(lights, chosen)
    posterior = lights.posterior(chosen)
    np.testing.assert_allclose(posterior.variance, expected, rtol=1e-4)
    assert posterior.loss == pytest.approx(objective_by_hand(expected), rel=1e-4)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**31 - 1), st.integers(0, 5))
def test_scan_candidate_equals_adding_it(seed: int, count: int) -> None:
    lights = cases.random_case(seed)
    chosen = list(range(count))
    scanned = lights.scan(lights.posterior(chosen))
    for k in range(len(lights.row)):
        added = objective_by_hand(variance_by_hand(lights, [*chosen, k]))
        assert scanned[k] == pytest.approx(added, rel=2e-3)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**31 - 1))
def test_posterior_added_light_never_raises_variance(seed: int) -> None:
    lights = cases.random_case(seed)
    without, with_it = (lights.posterior(range(n)).variance for n in (3, 4))
    assert np.all(with_it <= without * (1 + 1e-9))


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**31 - 1))
def test_scan_hidden_light_gains_nothing(seed: int) -> None:
    lights = cases.random_case(seed)
    before = lights.posterior([])
    hidden = replace(lights, row=np.zeros_like(lights.row))
    np.testing.assert_allclose(hidden.scan(before), before.loss, rtol=1e-5)
    assert not np.any(hidden.visible)


def test_shadow_margins_are_of_three_kinds() -> None:
    margins = sample_pixels.shadow_margins(np.full(6, 0.05 * np.sqrt(2.0)))
    np.testing.assert_allclose(margins, np.tile([-0.05, 0.0, 0.05], 2))


# ------------------------------------------------------------------------------------------------ from a normal map


@pytest.fixture(scope="module")
def cushion() -> scenes.Scene:
    return scenes.scene(scenes.bumps, scenes.calibration(128))


def test_candidates_rows_are_whitened_light_vectors_and_depth_slopes(cushion: scenes.Scene) -> None:
    light = scenes.ring(1, 30.0, turn=0.7)[0]
    normal_map = cases.known_map(cushion, [])
    chosen = np.arange(0, len(normal_map.information.rows), 7)
    sample = sample_pixels.samples(normal_map, cushion.calibration, chosen)
    recipe = Recipe(exposure=Exposure(seconds=0.03))
    lights = cases.design_rows(sample, [light], normal_map, cushion.calibration, recipe)
    row = lights.row[0]

    rows, columns = normal_map.information.rows[chosen], normal_map.information.columns[chosen]
    n, albedo = cushion.normals[rows, columns].T, cushion.albedo[rows, columns]
    s = cases.vectors_by_hand(cushion, light, rows, columns)
    strength = np.linalg.norm(s, axis=0)
    lit = (np.sum(n * s, axis=0) > 0.1 * strength) & lights.visible[0]
    assert np.mean(lit) > 0.7
    distance = np.linalg.norm(np.array(light.position) - cushion.points[:, rows, columns].T, axis=1)
    level = 0.03 * cushion.calibration.lamp_intensity
    value = albedo * np.sum(n * s, axis=0)
    deviation = np.sqrt(
        cases.noise_by_hand(cushion, level, value, value / (albedo * strength), albedo * strength, distance)
    )
    np.testing.assert_allclose(row[:3, lit], (s / deviation)[:, lit], rtol=2e-3, atol=1e-3)

    # Depth moves a point along its ray; the model omits the change of the lamp's lobe over millimetres.
    e = 1e-4
    x = cushion.points[:, rows, columns]
    position = np.array(light.position)[:, None]
    nearer, farther = (
        offset / np.linalg.norm(offset, axis=0) ** 3 for offset in (position - x * (1 - e), position - x * (1 + e))
    )
    lobe = strength * np.sum((position - x) ** 2, axis=0)
    slope = albedo * np.sum(n * (farther - nearer), axis=0) * lobe / (2 * e * cushion.depth[rows, columns])
    expected = slope * photometry.SETTINGS.depth_sigma_m / deviation
    np.testing.assert_allclose(row[3, lit], expected[lit], rtol=0.02, atol=0.02 * np.abs(expected).max())


def wall(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A plate with a wall of 30 mm along y in its middle."""
    plate = np.where(np.maximum(np.abs(x), np.abs(y)) < 0.06, 0.01, 0.0)
    return np.where((np.abs(x) < 0.004) & (np.abs(y) < 0.06), 0.04, plate)


def test_candidates_light_behind_wall_is_invisible() -> None:
    true = scenes.scene(wall, scenes.calibration(128))
    normal_map = cases.known_map(true, [], step=1)
    rows, columns = normal_map.information.rows, normal_map.information.columns
    x, z = true.points[0, rows, columns], true.points[2, rows, columns]
    left = np.flatnonzero((x < -0.008) & (x > -0.024) & (z < -0.885))
    right = np.flatnonzero((x > 0.008) & (x < 0.024) & (z < -0.885))
    assert min(len(left), len(right)) > 100
    light = scenes.ring(1, 55.0)[0]  # towards +x: the wall's shadow is 43 mm long
    sides = {}
    for name, chosen in (("left", left), ("right", right)):
        sample = sample_pixels.samples(normal_map, true.calibration, chosen)
        lights = cases.design_rows(sample, [light], normal_map, true.calibration)
        before = lights.posterior([])
        sides[name] = lights.visible, before.loss - lights.scan(before)[0]
    assert np.mean(sides["left"][0]) < 0.03
    assert np.mean(sides["right"][0]) > 0.97
    assert sides["left"][1] < 0.02 * sides["right"][1]
    shaded = visibility.shaded(normal_map, [light], true.calibration, (rows, columns))[0]
    assert np.mean(shaded[left]) > 0.97
    assert np.mean(shaded[right]) < 0.03


def test_candidates_surface_turned_away_is_invisible(cushion: scenes.Scene) -> None:
    normal_map = cases.known_map(cushion, [])
    sample = sample_pixels.samples(normal_map, cushion.calibration, np.arange(len(normal_map.information.rows)))
    light = scenes.ring(1, 70.0)[0]
    visible = cases.design_rows(sample, [light], normal_map, cushion.calibration).visible[0]
    toward = np.array(light.position)[:, None] - sample.point
    cosine = np.sum(toward * sample.normal, axis=0) / np.linalg.norm(toward, axis=0)
    assert np.sum(cosine < -0.1) > 20
    assert not np.any(visible[cosine < -0.1])


def test_candidates_certain_map_has_visibility_of_scene(cushion: scenes.Scene) -> None:
    normal_map = cases.known_map(cushion, [], sigma_deg=0.2)
    sample = sample_pixels.samples(normal_map, cushion.calibration, np.arange(len(normal_map.information.rows)))
    lights = scenes.ring(5, 60.0, turn=0.2)
    visible = cases.design_rows(sample, lights, normal_map, cushion.calibration).visible
    rows, columns = normal_map.information.rows, normal_map.information.columns
    brightest = [cases.vectors_by_hand(cushion, light, rows, columns) for light in lights]
    least = planned_images.MIN_COSINE * sample.albedo * np.linalg.norm(brightest, axis=1)  # rejected below
    lit = np.stack([scenes.lit(cushion, light)[rows, columns] for light in lights]) > least
    assert np.mean(visible == lit) > 0.95


def test_candidates_clipping_exposure_gives_no_information(cushion: scenes.Scene) -> None:
    normal_map = cases.known_map(cushion, [])
    sample = sample_pixels.samples(normal_map, cushion.calibration, np.arange(len(normal_map.information.rows)))
    light = scenes.ring(1, 20.0)
    seconds = 1.0 / (0.5 * cushion.calibration.lamp_intensity)  # y = 0.5 · 1.0 saturates the converter
    for factor, expected in ((0.5, 0.0), (8.0, 1.0)):
        recipe = Recipe(exposure=Exposure(seconds=factor * seconds))
        visible = cases.design_rows(sample, light, normal_map, cushion.calibration, recipe).visible
        assert np.mean(~visible) == pytest.approx(expected, abs=0.08)


def test_usable_pixels_grazing_or_not_finite_are_left_out(cushion: scenes.Scene) -> None:
    normal_map = cases.known_map(cushion, scenes.ring(4, 40.0))
    all_pixels = sample_pixels.usable(normal_map, cushion.calibration)
    assert len(all_pixels) > 0.98 * len(normal_map.information.rows)
    rows, columns = normal_map.information.rows, normal_map.information.columns
    normal_map.normals[rows[0], columns[0]] = np.nan
    normal_map.depth[rows[1], columns[1]] = np.inf
    normal_map.albedo[rows[2], columns[2]] = np.nan
    normal_map.information.matrices[3, 0, 0] = np.nan
    normal_map.normals[rows[4], columns[4]] = geometry.direction(np.radians(89.0), 0.3)
    kept = sample_pixels.usable(normal_map, cushion.calibration)
    assert set(all_pixels) - set(kept) == {0, 1, 2, 3, 4} & set(all_pixels)


def test_posterior_unlit_pixels_keep_prior_of_40_degrees(cushion: scenes.Scene) -> None:
    normal_map = cases.known_map(cushion, [])
    sample = sample_pixels.samples(normal_map, cushion.calibration, np.arange(50))
    nothing = cases.design_rows(sample, [], normal_map, cushion.calibration)
    assert nothing.posterior().loss == pytest.approx(np.sqrt(0.5), rel=1e-3)


def test_posterior_more_lights_lowers_sigma_by_count(cushion: scenes.Scene) -> None:
    """Twice as many independent images halve the variance of well-lit pixels."""
    lights: list[Light] = scenes.ring(8, 35.0)
    few, many = (cases.known_map(cushion, lights[::2]), cases.known_map(cushion, lights))
    chosen = np.arange(len(few.information.rows))
    spread = []
    for normal_map in (few, many):
        sample = sample_pixels.samples(normal_map, cushion.calibration, chosen)
        nothing = cases.design_rows(sample, [], normal_map, cushion.calibration)
        spread.append(np.median(nothing.posterior().variance))
    assert spread[0] / spread[1] == pytest.approx(2.0, rel=0.15)
