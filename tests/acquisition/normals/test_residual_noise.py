"""Noise scales estimated from residuals, and the normals' variance by shared errors of the lamps."""

from dataclasses import replace

import numpy as np
import pytest

from acquisition.image_values import Noise
from acquisition.models.result import SolveSettings
from acquisition.normals import pixel_solve, residual_noise, self_calibration
from acquisition.normals.pixel_solve import Estimate
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


def test_normal_variance_lamp_errors_equals_monte_carlo() -> None:
    """The variance is that of many draws of errors that all pixels of one draw share."""
    made = measured(largest_slant=0.4)
    rng = np.random.default_rng(2)
    covariance = np.diag([0.01**2] * 8 + [0.001**2] * 24)
    quiet = Noise(np.full(8, 1e-6), np.full(8, 1e-7), 0.001, 0.001)
    moved = []
    for _ in range(60):
        factors = np.exp(rng.normal(0, 0.01, 8))[:, None]
        lamp = made.lamp + np.pad(rng.normal(0, 0.001, (8, 3)), ((0, 0), (0, 3))).astype(np.float32)
        solution = pixel_solve.solve(
            made.pixels,
            (made.values * factors).astype(np.float32),
            made.depth_m,
            replace(made.scene, lamps=lamp, noise=quiet, settings=SolveSettings(robust=False)),
        )
        moved.append(np.sum((solution.normals - made.normals) ** 2, axis=0))
    exact = pixel_solve.solve(
        made.pixels,
        made.values,
        made.depth_m,
        replace(made.scene, noise=quiet, settings=SolveSettings(robust=False)),
    )
    predicted = self_calibration.normal_variance(exact, made.lamp, covariance)
    assert np.median(np.mean(moved, axis=0) / predicted) == pytest.approx(1, abs=0.25)
