"""Robust solves from two starts: highlights that are many times as bright as the surface they lie on."""

from dataclasses import replace

import numpy as np
import pytest

from acquisition.normals.pixels import pixel_solve, robust_solve
from acquisition.normals.pixels.image_terms import ImageTerms
from acquisition.normals.pixels.pixel_solve import Estimate, Lighting, Scene
from acquisition.normals.surface.discontinuity import ShadowImages
from tests.acquisition.normals.shared_scene import MeasuredPixels, measured

DARK = 0.03
THRESHOLD = 0.08


def with_highlight(made: MeasuredPixels, times: float, share: float = 0.3) -> tuple[np.ndarray, np.ndarray]:
    """Noisy values of which one of each pixel of a random share is `times` as bright, and these pixels."""
    random = np.random.default_rng(2)
    values = made.values * (1 + random.normal(0, 0.005, made.values.shape))
    glossy = random.random(values.shape[1]) < share
    image = random.integers(0, len(values), values.shape[1])
    lit = made.values[image, np.arange(values.shape[1])] > 0.5 * np.max(made.values, axis=0)
    glossy &= lit
    values[image[glossy], np.flatnonzero(glossy)] *= times
    return values.astype(np.float32), glossy


def solved(made: MeasuredPixels, values: np.ndarray, scene: Scene) -> Estimate:
    return pixel_solve.solve(made.pixels, values, made.depth_m, scene)


def error_deg(estimate: Estimate, made: MeasuredPixels) -> np.ndarray:
    return np.degrees(np.arccos(np.clip(np.sum(estimate.normals * made.normals, axis=0), -1, 1)))


@pytest.mark.parametrize("times", [5.0, 20.0])
@pytest.mark.parametrize("count", [6, 8, 12])
def test_solve_dark_pixels_with_one_highlight_gives_normals_of_the_others(count: int, times: float) -> None:
    made = measured(count=count, albedo=DARK)
    values, glossy = with_highlight(made, times)
    error = error_deg(solved(made, values, made.scene), made)
    assert np.count_nonzero(glossy) > 100
    assert np.mean(error[glossy]) < 2 * np.mean(error[~glossy])
    assert np.quantile(error[glossy], 0.98) < 3


@pytest.mark.parametrize("strength", [0.0, 1e-16])
def test_solve_lamp_that_does_not_reach_a_pixel_is_not_used(strength: float) -> None:
    """Its lobe ends before the pixel, but the image shows light of another origin. Albedo and normal were NaN."""
    made = measured(count=6)
    lighting, values = Lighting.at(made.pixels, made.depth_m, made.scene), made.values.astype(np.float32)
    dark = np.arange(values.shape[1]) % 7 == 0
    lighting.light[:2, :, dark] = np.float32(strength)
    values[:2, dark] = 0.4
    estimate = pixel_solve.solve_lit(made.pixels, values, lighting, made.scene)
    assert np.all(np.isfinite(estimate.g))
    assert not np.any(estimate.usable[:2, dark])
    assert np.median(error_deg(estimate, made)[dark]) < 1


@pytest.mark.parametrize(
    "terms", [None, ImageTerms(roughness=0.2), ImageTerms(gloss=0.3), ImageTerms(metal=0.3)], ids=str
)
def test_image_of_a_lamp_that_does_not_reach_a_pixel_changes_nothing_there(terms: ImageTerms | None) -> None:
    """Neither the solution, whose starts with terms follow from y/|s|, nor where the other images are in shadow."""
    made = measured(count=6)
    lighting, scene = Lighting.at(made.pixels, made.depth_m, made.scene), replace(made.scene, terms=terms)
    lighting.light[:2] = 0

    def found(value: float) -> tuple[np.ndarray, np.ndarray]:
        values = made.values.astype(np.float32)
        values[:2] = value
        estimate = pixel_solve.solve_lit(made.pixels, values, lighting, scene)
        shadows = ShadowImages(made.pixels, values, np.zeros_like(values), estimate, made.lamp)
        return estimate.g, shadows.lit_share(THRESHOLD)[2:]

    for bright, black in zip(found(0.4), found(0.0), strict=True):
        np.testing.assert_array_equal(bright, black)


def test_solve_highlight_counts_with_the_weight_of_its_residual() -> None:
    made = measured(albedo=DARK)
    values, glossy = with_highlight(made, 20.0)
    estimate = solved(made, values, made.scene)
    changed = np.argmax(values / np.maximum(made.values, 1e-9), axis=0)[glossy]
    assert np.all(estimate.usable[changed, np.flatnonzero(glossy)])
    weights = estimate.weights[:, glossy]
    largest = np.max(weights, axis=0)
    assert np.median(weights[changed, np.arange(len(changed))] / largest) < 0.01


def test_solve_second_start_never_has_more_loss(monkeypatch: pytest.MonkeyPatch) -> None:
    made = measured(albedo=DARK)
    values, _ = with_highlight(made, 5.0)
    values += np.random.default_rng(4).normal(0, 0.05 * DARK, values.shape).astype(np.float32)
    both = solved(made, values, made.scene)
    never = replace(robust_solve.SETTINGS, highlight_ratio=np.inf)
    monkeypatch.setattr(robust_solve, "SETTINGS", never)
    one = solved(made, values, made.scene)
    scale = made.scene.cauchy_scale
    assert scale is not None

    def loss(estimate: Estimate) -> np.ndarray:
        residual = values - np.einsum("fck,ck->fk", estimate.light, estimate.g)
        strength = estimate.albedo * np.linalg.norm(estimate.light, axis=1)
        terms = np.log1p(residual**2 / made.noise.variance(values, strength) / scale**2)
        return np.sum(np.where(one.usable & both.usable, terms, 0), axis=0)

    changed = np.any(both.g != one.g, axis=0)
    same = np.all(one.usable == both.usable, axis=0)
    assert np.count_nonzero(changed & same) > 50
    assert np.all(loss(both)[changed & same] <= loss(one)[changed & same] + 1e-3)


def test_solve_without_highlight_is_that_of_one_start(monkeypatch: pytest.MonkeyPatch) -> None:
    made = measured(albedo=DARK)
    values, _ = with_highlight(made, 1.0)
    both = solved(made, values, made.scene)
    monkeypatch.setattr(robust_solve, "SETTINGS", replace(robust_solve.SETTINGS, highlight_ratio=np.inf))
    assert np.array_equal(both.g, solved(made, values, made.scene).g)


def test_solve_least_squares_has_one_start() -> None:
    made = measured(albedo=DARK)
    values, glossy = with_highlight(made, 20.0)
    plain = replace(made.scene, settings=made.scene.settings.model_copy(update={"robust": False}))
    error = error_deg(solved(made, values, plain), made)
    assert np.mean(error[glossy]) > 10
