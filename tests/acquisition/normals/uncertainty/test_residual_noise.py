"""Noise scales estimated from residuals, and the normals' variance by shared errors of the lamps."""

from dataclasses import replace

import numpy as np
import pytest

from acquisition.image_values import Noise
from acquisition.models.result import SolveSettings
from acquisition.normals import self_calibration
from acquisition.normals.pixels import pixel_solve
from acquisition.normals.pixels.image_terms import ImageTerms
from acquisition.normals.pixels.pixel_solve import Estimate
from acquisition.normals.self_calibration import SharedParameters
from acquisition.normals.uncertainty import residual_noise
from tests.acquisition.normals.shared_scene import MeasuredPixels, measured


def solved(made: MeasuredPixels, values: np.ndarray, assumed: Noise) -> Estimate:
    return pixel_solve.solve(
        made.pixels,
        values,
        made.depth_m,
        replace(made.scene, noise=assumed),
    )


@pytest.mark.parametrize("true", [0.005, 0.01, 0.03])
@pytest.mark.parametrize("assumed", [0.003, 0.03])
def test_estimate_intensity_errors_recovers_share(true: float, assumed: float) -> None:
    made = measured(count=12, largest_slant=0.4)
    rng = np.random.default_rng(1)
    values = (made.values * (1 + rng.normal(0, true, made.values.shape))).astype(np.float32)
    values += rng.normal(0, np.sqrt(1e-6 * np.maximum(values, 0) + 1e-7)).astype(np.float32)
    model = stated = Noise(made.noise.shot, made.noise.floor, assumed, 0.001)
    for _ in range(3):
        solution = solved(made, values, model)
        model = residual_noise.estimate(solution, values, model, stated, np.zeros_like(values))
    assert model.intensity == pytest.approx(true, rel=0.2)


def test_estimate_too_few_lights_keeps_stated_noise() -> None:
    made = measured(count=4)
    solution = solved(made, made.values, made.noise)
    before = replace(made.noise, intensity=0.02, direction=0.04)
    estimated = residual_noise.estimate(solution, made.values, before, made.noise, np.zeros_like(made.values))
    assert estimated == made.noise


@pytest.mark.parametrize(("largest_slant", "believed"), [(0.13, False), (0.6, True)])
def test_estimate_few_grazing_pixels_keep_stated_direction(largest_slant: float, believed: bool) -> None:
    made = measured(count=12, size=100, largest_slant=largest_slant)
    wrong = 0.03 * 0.6 * np.linalg.norm(made.light, axis=1)
    values = made.values + (wrong * np.random.default_rng(3).normal(size=wrong.shape)).astype(np.float32)
    estimated = made.noise
    for _ in range(3):
        solution = solved(made, values, estimated)
        estimated = residual_noise.estimate(solution, values, estimated, made.noise, np.zeros_like(values))
    if believed:
        assert estimated.direction == pytest.approx(0.03, rel=0.25)
    else:
        assert estimated.direction == made.noise.direction


def test_normal_variance_shared_errors_equals_monte_carlo() -> None:
    """The variance is that of many draws of errors that all pixels of one draw share: of lamps, depth and roughness."""
    made = measured(largest_slant=0.4)
    rng = np.random.default_rng(2)
    shared, rough = SharedParameters.nominal(8), ImageTerms(roughness=0.2)
    shared = replace(shared, terms=rough)
    shared.covariance[:34, :34] = np.diag([0.01**2] * 8 + [0.001**2] * 24 + [0.005**2, 0.05**2])
    quiet = Noise(np.full(8, 1e-6), np.full(8, 1e-7), 0.001, 0.001)
    scene = replace(made.scene, noise=quiet, settings=SolveSettings(robust=False), terms=rough)
    exact = pixel_solve.solve(made.pixels, made.values, made.depth_m, scene)
    assert exact.terms is not None
    values = np.einsum("fcn,cn->fn", exact.light, exact.g) + exact.terms.value
    exact, moved = pixel_solve.solve(made.pixels, values, made.depth_m, scene), []
    for _ in range(60):
        factors = np.exp(rng.normal(0, 0.01, 8))[:, None]
        lamp = made.lamp + np.pad(rng.normal(0, 0.001, (8, 3)), ((0, 0), (0, 3))).astype(np.float32)
        depth_m = made.depth_m + np.float32(rng.normal(0, 0.005))
        wrong = replace(scene, lamps=lamp, terms=ImageTerms(roughness=rng.normal(0.2, 0.05)))
        solution = pixel_solve.solve(made.pixels, (values * factors).astype(np.float32), depth_m, wrong)
        moved.append(np.sum((solution.normals - exact.normals) ** 2, axis=0))
    change = pixel_solve.depth_derivative(exact.light, exact.point, made.ray_direction, made.lamp)
    predicted = self_calibration.normal_variance(exact, change, made.lamp, shared)
    assert np.median(np.mean(moved, axis=0) / predicted) == pytest.approx(1, abs=0.25)
