"""Terms beyond Lambert's: their derivatives, their effect on a solve, and the score tests that demand them."""

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from acquisition import photometry
from acquisition.normals import self_calibration
from acquisition.normals.alternatives import term_tests
from acquisition.normals.pixels import image_terms, pixel_solve
from acquisition.normals.pixels.image_terms import LAMBERTIAN, ImageTerms
from acquisition.normals.pixels.pixel_solve import Estimate, Scene
from acquisition.normals.self_calibration import Priors, SharedParameters
from hardware_sim.reflectance import Reflectance
from tests.acquisition.normals.shared_scene import MeasuredPixels, measured

TERMS = ImageTerms(roughness=0.3, ambient=0.05, offset=0.02)


def oren_nayar(made: MeasuredPixels, weight: float, albedo: float = 0.6) -> np.ndarray:
    """The azimuthal term in angles, as Oren and Nayar write it, times b ρ |s|."""
    size = np.linalg.norm(made.light, axis=1)
    view = -made.ray_direction / np.linalg.norm(made.ray_direction, axis=0)
    lamp = made.light / size[:, None]
    incident = np.arccos(np.clip(np.einsum("fcn,cn->fn", lamp, made.normals), -1, 1))
    reflected = np.arccos(np.clip(np.sum(view * made.normals, axis=0), -1, 1))[None]
    flat_lamp = lamp - np.cos(incident)[:, None] * made.normals
    flat_view = view - np.cos(reflected) * made.normals
    lengths = np.linalg.norm(flat_lamp, axis=1) * np.linalg.norm(flat_view, axis=0)
    apart = np.einsum("fcn,cn->fn", flat_lamp, flat_view) / np.maximum(lengths, 1e-12)
    larger, smaller = np.maximum(incident, reflected), np.minimum(incident, reflected)
    term = np.cos(incident) * np.maximum(apart, 0) * np.sin(larger) * np.tan(smaller)
    return weight * albedo * size * np.where(incident < np.pi / 2, term, 0)


def evaluated(made: MeasuredPixels, g: np.ndarray, terms: ImageTerms = TERMS) -> image_terms.TermValues:
    view = -made.ray_direction / np.linalg.norm(made.ray_direction, axis=0)
    usable = np.ones(made.values.shape, bool)
    return image_terms.evaluate(terms, g.astype(np.float32), made.light, usable, view.astype(np.float32))


def test_evaluate_equals_oren_nayar_and_ambient() -> None:
    made = measured()
    expected = oren_nayar(made, TERMS.roughness) + TERMS.ambient * 0.6 + TERMS.offset
    assert evaluated(made, 0.6 * made.normals).value == pytest.approx(expected, abs=1e-5)


def test_ambient_light_reaches_a_pixel_as_far_as_it_sees_the_sky() -> None:
    made, ambient = measured(), ImageTerms(ambient=0.05)
    g, view = (0.6 * made.normals).astype(np.float32), made.ray_direction
    usable, sky = np.ones(made.values.shape, bool), np.linspace(0, 1, made.values.shape[1], dtype=np.float32)
    found = image_terms.evaluate(ambient, g, made.light, usable, view, sky=sky)
    expected = np.broadcast_to(0.05 * 0.6 * sky, found.value.shape)
    assert found.value == pytest.approx(expected, abs=1e-6)
    assert np.einsum("fcn,cn->fn", found.by_g, g) == pytest.approx(expected, abs=1e-6)
    by_ambient = image_terms.by_parameter(ambient, g, made.light, usable, view, sky=sky)[:, 1]
    assert by_ambient == pytest.approx(expected / 0.05, abs=1e-5)


def test_evaluate_is_homogeneous_in_albedo_times_normal() -> None:
    """T(g) = ∂T/∂g · g, by which solves need no value of the terms."""
    made = measured()
    g = 0.6 * made.normals
    terms = evaluated(made, g)
    assert np.einsum("fcn,cn->fn", terms.by_g, g) == pytest.approx(terms.value - TERMS.offset, abs=1e-6)


def test_evaluate_derivative_equals_finite_differences() -> None:
    made = measured()
    g = 0.6 * made.normals
    turn = np.random.default_rng(2).normal(0, 0.002, g.shape)
    change = (evaluated(made, g + turn).value - evaluated(made, g - turn).value) / 2
    close = np.abs(np.einsum("fcn,cn->fn", evaluated(made, g).by_g, turn) - change) < 1e-4
    assert np.mean(close) > 0.99  # but where the lamp is as oblique as the camera, the term has a kink


@pytest.mark.parametrize("sigma", [0.1, 0.35, 0.6])
def test_roughness_rad_inverts_oren_nayar_weights(sigma: float) -> None:
    squared = sigma**2
    weight = 0.45 * squared / (squared + 0.09) / (1 - 0.5 * squared / (squared + 0.33))
    assert ImageTerms(roughness=weight).roughness_rad == pytest.approx(sigma, abs=0.005)


def glossy_values(made: MeasuredPixels, alpha: float, kind: Literal["ggx", "metal"] = "ggx") -> np.ndarray:
    """Values of a dielectric or metal of albedo 0.6, by the simulator's reflectance."""
    size = np.linalg.norm(made.light, axis=1)
    view = -made.ray_direction / np.linalg.norm(made.ray_direction, axis=0)
    lamp = np.moveaxis(made.light / size[:, None], 1, -1)
    return size * Reflectance(kind, alpha).value(made.normals.T[None], lamp, view.T[None], 0.6)


@pytest.mark.parametrize("alpha", [0.15, 0.4])
def test_evaluate_equals_glossy_dielectric(alpha: float) -> None:
    made = measured()
    g = 0.6 * made.normals
    terms = evaluated(made, g, ImageTerms(gloss=alpha))
    assert made.values + terms.value == pytest.approx(glossy_values(made, alpha), rel=1e-3, abs=1e-4)
    assert np.einsum("fcn,cn->fn", terms.by_g, g) == pytest.approx(terms.value - terms.constant, abs=1e-4)


def test_evaluate_equals_metal() -> None:
    made = measured()
    g = 0.6 * made.normals
    terms = evaluated(made, g, ImageTerms(metal=0.3))
    lambertian = np.einsum("fcn,cn->fn", made.light, g)
    assert lambertian + terms.value == pytest.approx(glossy_values(made, 0.3, "metal"), rel=1e-3, abs=1e-4)
    assert terms.nondiffuse == pytest.approx(lambertian + terms.value, abs=1e-4)
    assert np.einsum("fcn,cn->fn", terms.by_g, g) == pytest.approx(terms.value, abs=1e-4)


def test_solve_with_metal_recovers_normals() -> None:
    made = measured()
    values = glossy_values(made, 0.35, "metal")
    assert mean_error_deg(made, solved(made, values, None)) > 5.0
    assert mean_error_deg(made, solved(made, values, ImageTerms(metal=0.35))) < 1.0


def test_solve_with_gloss_recovers_normals() -> None:
    """At α = 0.15 a fifth of the pixels would stay beside a highlight if no start were at the half vectors."""
    made = measured()
    values = glossy_values(made, 0.15)
    assert mean_error_deg(made, solved(made, values, None)) > 2.0
    assert mean_error_deg(made, solved(made, values, ImageTerms(gloss=0.15))) < 0.2


def stepped_terms(
    made: MeasuredPixels, values: np.ndarray, start: ImageTerms, sigma: ImageTerms, *, steps: int
) -> ImageTerms:
    """The terms after Gauss–Newton steps of all shared parameters, `sigma` being 1 σ of their priors."""
    present = replace(SharedParameters.nominal(len(values)), terms=start)
    priors = Priors(0.01, 0.001, 0.03, sigma)
    for _ in range(steps):
        estimate = solved(made, values, present.terms)
        by_depth = pixel_solve.depth_derivative(estimate.light, estimate.point, made.ray_direction, made.lamp)
        step = self_calibration.gauss_newton_step(
            estimate, by_depth, values, made.lamp, present, priors, photometry.SETTINGS.depth_sigma_m
        )
        present = replace(present, terms=image_terms.stepped(present.terms, step.terms))
    return present.terms


def test_gauss_newton_steps_find_roughness_of_gloss() -> None:
    made = measured()
    values = glossy_values(made, 0.3).astype(np.float32)
    found = stepped_terms(made, values, ImageTerms(gloss=0.2), ImageTerms(gloss=1.0), steps=4)
    assert found.gloss == pytest.approx(0.3, abs=0.02)


def lobe_values(made: MeasuredPixels, terms: ImageTerms) -> np.ndarray:
    """Values of albedo 0.6 and, beside diffuse light that lacks nothing, the lobe of the simulator's reflectance."""
    size = np.linalg.norm(made.light, axis=1)
    view = -made.ray_direction / np.linalg.norm(made.ray_direction, axis=0)
    lamp = np.moveaxis(made.light / size[:, None], 1, -1)
    lobe = Reflectance("ggx", terms.gloss).specular(made.normals.T[None], lamp, view.T[None], np.float64(0.6))
    return made.values + terms.strength * size * lobe


@pytest.mark.parametrize("strength", [0.3, 1.0, 2.5])
def test_evaluate_with_strength_is_lobe_beside_lambertian_light(strength: float) -> None:
    made, terms = measured(), ImageTerms(gloss=0.25, strength=strength)
    g = 0.6 * made.normals
    found = evaluated(made, g, terms)
    assert made.values + found.value == pytest.approx(lobe_values(made, terms), rel=1e-3, abs=1e-4)
    assert np.einsum("fcn,cn->fn", found.by_g, g) == pytest.approx(0, abs=1e-4)


def test_derivative_by_strength_equals_finite_difference() -> None:
    made, terms = measured(), ImageTerms(gloss=0.25, strength=0.6)
    g, usable = (0.6 * made.normals).astype(np.float32), np.ones(made.values.shape, bool)
    view = (-made.ray_direction / np.linalg.norm(made.ray_direction, axis=0)).astype(np.float32)
    said = image_terms.by_parameter(terms, g, made.light, usable, view)[:, 5]
    stronger, weaker = (evaluated(made, g, replace(terms, strength=0.6 + by)).value for by in (0.05, -0.05))
    assert said == pytest.approx((stronger - weaker) / 0.1, abs=1e-4)
    assert np.max(said) > 0.1


@pytest.mark.parametrize(("count", "largest_slant"), [(8, 0.6), (5, 0.6), (12, 0.1)], ids=["curved", "few", "flat"])
@pytest.mark.parametrize("true", [ImageTerms(gloss=0.25, strength=0.4), ImageTerms(gloss=0.3, strength=2.0)])
def test_gauss_newton_steps_find_strength_of_gloss(count: int, largest_slant: float, true: ImageTerms) -> None:
    made = measured(count=count, largest_slant=largest_slant)
    noise = np.random.default_rng(0).normal(0, 0.003, made.values.shape)
    values = (lobe_values(made, true) + noise).astype(np.float32)
    sigma = ImageTerms(gloss=1.0, strength=1.0)
    found = stepped_terms(made, values, ImageTerms(gloss=0.2, strength=1.0), sigma, steps=8)
    assert found.strength == pytest.approx(true.strength, rel=0.1)
    assert found.gloss == pytest.approx(true.gloss, rel=0.1)


def test_stepped_keeps_terms_within_ranges() -> None:
    far = ImageTerms(roughness=9.0, ambient=-9.0, gloss=9.0)
    assert image_terms.stepped(LAMBERTIAN, far) == ImageTerms(roughness=image_terms.ROUGH_WEIGHTS[-1])
    assert image_terms.stepped(ImageTerms(gloss=0.5), far).gloss == image_terms.SETTINGS.gloss_range[1]


def solved(made: MeasuredPixels, values: np.ndarray, terms: ImageTerms | None) -> Estimate:
    scene = Scene(made.lamp, made.calibration, made.noise, terms=terms)
    return pixel_solve.solve(made.pixels, values.astype(np.float32), made.depth_m, scene)


def mean_error_deg(made: MeasuredPixels, estimate: Estimate) -> float:
    return float(np.degrees(np.mean(np.arccos(np.clip(np.sum(estimate.normals * made.normals, axis=0), -1, 1)))))


def test_solve_with_true_terms_recovers_normals() -> None:
    made = measured()
    values = made.values + oren_nayar(made, TERMS.roughness) + TERMS.ambient * 0.6 + TERMS.offset
    assert mean_error_deg(made, solved(made, values, None)) > 2.0
    assert mean_error_deg(made, solved(made, values, TERMS)) < 0.1


def scores(made: MeasuredPixels, values: np.ndarray) -> term_tests.TermScores:
    noisy = (values + np.random.default_rng(0).normal(0, 0.003, values.shape)).astype(np.float32)
    result = term_tests.scores(
        solved(made, noisy, None), noisy, made.scene, SharedParameters.nominal(len(values)),
        Priors(0.01, 0.001, 0.03),
    )  # fmt: skip
    assert result is not None
    return result


def test_scores_lambertian_images_demand_no_term() -> None:
    made = measured()
    result = scores(made, made.values)
    assert max(result.roughness.gain, result.ambient.gain, result.offset.gain, result.gloss.gain) < 3


def test_scores_rough_surface_demand_roughness_most() -> None:
    made = measured()
    result = scores(made, made.values + oren_nayar(made, 0.2))
    assert result.roughness.gain > 10
    assert result.roughness.step == pytest.approx(0.2, abs=0.1)


def test_scores_ambient_light_demand_ambient_light() -> None:
    made = measured()
    result = scores(made, made.values + 0.08 * 0.6)
    assert result.ambient.gain > 10
    assert result.ambient.step == pytest.approx(0.08, abs=0.04)


def test_scores_broad_gloss_demands_gloss() -> None:
    made = measured()
    result = scores(made, glossy_values(made, 0.4))
    assert result.gloss.gain > 10
    assert 0.2 < result.gloss.step < 1.5


def test_gauss_newton_step_estimates_terms_from_zero() -> None:
    made = measured()
    values = (made.values + oren_nayar(made, 0.2)).astype(np.float32)
    present = SharedParameters.nominal(len(values))
    estimate = solved(made, values, ImageTerms())
    by_depth = pixel_solve.depth_derivative(estimate.light, estimate.point, made.ray_direction, made.lamp)
    step = self_calibration.gauss_newton_step(
        estimate, by_depth, values, made.lamp, present, Priors(0.01, 0.001, 0.03, ImageTerms(0.3, 0.0)),
        photometry.SETTINGS.depth_sigma_m,
    )  # fmt: skip
    assert step.terms.roughness == pytest.approx(0.2, abs=0.1)
    assert step.terms.ambient == pytest.approx(0.0, abs=1e-6)
