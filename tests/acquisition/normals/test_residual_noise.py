"""Noise read off residuals, and what shared errors of the lamps do to normals."""

from dataclasses import replace

import numpy as np
import pytest

from acquisition.normals import pixel_solve, residual_noise, self_calibration
from acquisition.normals.pixel_solve import Estimate
from acquisition.photometry import Noise
from tests.acquisition.normals.shared_scene import Measured, measured

OFFSET_M = 0.003


def solved(scene: Measured, values: np.ndarray, assumed: Noise) -> Estimate:
    return pixel_solve.solve(
        scene.pixels, values, scene.depth_m, scene.lamp, scene.calibration, assumed, threshold=0.08,
        offset_sigma_m=OFFSET_M,
    )  # fmt: skip


@pytest.mark.parametrize("true", [0.005, 0.01, 0.03])
@pytest.mark.parametrize("assumed", [0.003, 0.03])
def test_the_share_of_intensity_errors_is_found(true: float, assumed: float) -> None:
    scene = measured(count=12, largest_slant=0.4)
    rng = np.random.default_rng(1)
    values = (scene.values * (1 + rng.normal(0, true, scene.values.shape))).astype(np.float32)
    values += rng.normal(0, np.sqrt(1e-6 * np.maximum(values, 0) + 1e-7)).astype(np.float32)
    model = stated = Noise(scene.noise.shot, scene.noise.floor, assumed, 0.001)
    for _ in range(3):
        found = solved(scene, values, model)
        model = residual_noise.estimate(
            found, values, model, stated, scene.along, scene.lamp, OFFSET_M, np.zeros_like(values)
        )
    assert model.intensity == pytest.approx(true, rel=0.2)


def test_what_too_few_lights_tell_is_not_believed() -> None:
    scene = measured(count=4)
    found = solved(scene, scene.values, scene.noise)
    before = replace(scene.noise, intensity=0.02, direction=0.04)
    told = residual_noise.estimate(
        found, scene.values, before, scene.noise, scene.along, scene.lamp, OFFSET_M, np.zeros_like(scene.values)
    )
    assert told == scene.noise


@pytest.mark.parametrize(("largest_slant", "believed"), [(0.13, False), (0.6, True)])
def test_directions_are_not_judged_by_the_few_pixels_that_light_grazes(largest_slant: float, believed: bool) -> None:
    scene = measured(count=12, size=100, largest_slant=largest_slant)
    wrong = 0.03 * 0.6 * np.linalg.norm(scene.light, axis=1)
    values = scene.values + (wrong * np.random.default_rng(3).normal(size=wrong.shape)).astype(np.float32)
    told = scene.noise
    for _ in range(3):
        found = solved(scene, values, told)
        told = residual_noise.estimate(
            found, values, told, scene.noise, scene.along, scene.lamp, OFFSET_M, np.zeros_like(values)
        )
    if believed:
        assert told.direction == pytest.approx(0.03, rel=0.25)
    else:
        assert told.direction == scene.noise.direction


def test_errors_of_lamps_move_normals_as_predicted() -> None:
    """The variance is that of many draws of errors that all pixels of one draw share."""
    scene = measured(largest_slant=0.4)
    rng = np.random.default_rng(2)
    covariance = np.diag([0.01**2] * 8 + [0.001**2] * 24)
    quiet = Noise(np.full(8, 1e-6), np.full(8, 1e-7), 0.001, 0.001)
    moved = []
    for _ in range(60):
        factors = np.exp(rng.normal(0, 0.01, 8))[:, None]
        lamp = scene.lamp + np.pad(rng.normal(0, 0.001, (8, 3)), ((0, 0), (0, 3))).astype(np.float32)
        found = pixel_solve.solve(
            scene.pixels, (scene.values * factors).astype(np.float32), scene.depth_m, lamp, scene.calibration,
            quiet, threshold=0.08, cauchy_scale=None,
        )  # fmt: skip
        moved.append(np.sum((found.normals - scene.normals) ** 2, axis=0))
    exact = pixel_solve.solve(
        scene.pixels, scene.values, scene.depth_m, scene.lamp, scene.calibration, quiet, threshold=0.08,
        cauchy_scale=None,
    )  # fmt: skip
    predicted = self_calibration.normal_variance(exact, scene.lamp, covariance)
    assert np.median(np.mean(moved, axis=0) / predicted) == pytest.approx(1, abs=0.25)
