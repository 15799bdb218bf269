"""Twelve distant lights: `auto` against least squares, L1 and sparse Bayesian regression; normals without seams."""

import numpy as np
import pytest

from acquisition.models.result import LIT
from acquisition.normals import distant
from acquisition.normals.images.image_set import DistantLights, ImageSet
from tests.acquisition.normals.distant import few_light_scenes
from tests.acquisition.normals.distant.few_light_scenes import Scene, directions
from tests.acquisition.normals.distant.gloss_scenes import Rows

FloatArray = np.ndarray


def weighted_least_squares(values: FloatArray, lights: FloatArray, weights: FloatArray) -> FloatArray:
    matrix = np.einsum("nf,fa,fb->nab", weights, lights, lights, optimize=True) + 1e-9 * np.eye(3)
    return np.linalg.solve(matrix, ((weights * values) @ lights)[..., None])[..., 0]


def least_absolute(values: FloatArray, lights: FloatArray) -> FloatArray:
    """L1 regression by IRLS, the floor of the residuals falling from step to step."""
    scaled = values @ np.linalg.pinv(lights).T
    size = np.linalg.norm(scaled, axis=1, keepdims=True) + 1e-12
    for step in range(60):
        residual = np.abs(values - scaled @ lights.T) / size
        scaled = weighted_least_squares(values, lights, 1 / np.maximum(residual, max(1e-4, 0.1 * 0.8**step)))
    return scaled


def sparse_bayesian(values: FloatArray, lights: FloatArray) -> FloatArray:
    """Sparse Bayesian regression (Ikehata et al., CVPR 2012): errors with a variance each, found by EM."""
    size = np.linalg.norm(values, axis=1, keepdims=True) / np.sqrt(values.shape[1]) + 1e-12
    normalised, variance = values / size, np.ones_like(values)
    base = 300.0**2 * lights @ lights.T + 1e-5 * np.eye(len(lights))
    for _ in range(60):
        inverse = np.linalg.inv(base + variance[:, :, None] * np.eye(len(lights)))
        error = variance * np.einsum("nfg,ng->nf", inverse, normalised)
        left = variance - variance * np.einsum("nff->nf", inverse) * variance
        variance = np.maximum(error**2 + np.maximum(left, 0), 1e-12)
    return weighted_least_squares(normalised, lights, 1 / (variance + 1e-5)) * size


def baseline_errors(scene: Scene, step: int) -> dict[str, float]:
    """Mean errors of the three baselines at every `step`-th pixel, all measurements used."""
    values, truth = scene.images[:, scene.mask].T[::step], scene.normals[scene.mask][::step]
    solutions = {
        "least squares": values @ np.linalg.pinv(scene.directions).T,
        "L1": least_absolute(values, scene.directions),
        "sparse Bayesian": sparse_bayesian(values, scene.directions),
    }
    errors: dict[str, float] = {}
    for name, scaled in solutions.items():
        unit = scaled / np.maximum(np.linalg.norm(scaled, axis=1, keepdims=True), 1e-12)
        errors[name] = float(np.degrees(np.arccos(np.clip(np.sum(unit * truth, axis=1), -1, 1))).mean())
    return errors


@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.parametrize("material", ["matt", "glossy", "shiny", "rough"])
@pytest.mark.parametrize("shape", ["rabbit", "wrinkled"])
def test_solve_twelve_lights_auto_is_not_behind_baselines(shape: str, material: str) -> None:
    scene = few_light_scenes.scene(shape, material, 12, 0, size=80)
    error = scene.errors_deg(distant.solve(scene.image_set()).normals).mean()
    baselines = baseline_errors(scene, 5)
    print(f"\n{shape} {material}: auto {error:.2f}", baselines)
    assert error < 1.05 * min(baselines.values())


def test_solve_rough_surface_twelve_lights_finds_roughness() -> None:
    scene = few_light_scenes.scene("rabbit", "rough", 12, 0, size=32, indirect=False)
    result = distant.solve(scene.image_set())
    assert [finding.kind for finding in result.findings if finding.corrected] == ["rough surface"]
    plain = distant.solve(scene.image_set(), "ls")
    assert scene.errors_deg(result.normals).mean() < 0.3 * scene.errors_deg(plain.normals).mean()


@pytest.mark.parametrize("gloss", [0.0, pytest.param(0.3, marks=pytest.mark.long)])
def test_solve_wrong_intensities_leave_no_seams(gloss: float) -> None:
    """Change of the normals' error between neighbours where the lights used change, over that elsewhere.

    A ball under lights that are 6 % off.
    """
    size, ratios = 48, []
    v, u = np.mgrid[:size, :size]
    x, y = (u - size / 2 + 0.5) / (size / 2), -(v - size / 2 + 0.5) / (size / 2)
    mask = np.hypot(x, y) < np.sin(np.radians(75))
    normals = np.stack([x, y, np.sqrt(np.maximum(1 - x**2 - y**2, 0))], axis=-1)
    for seed in range(2):
        lights = directions(12, seed, 65)
        half = lights + np.array([0.0, 0.0, 1.0])
        half /= np.linalg.norm(half, axis=1, keepdims=True)
        shading = np.maximum(np.einsum("hwc,fc->fhw", normals, lights), 0)
        lobe = np.clip(np.einsum("hwc,fc->fhw", normals, half), 0, 1) ** 30
        wrong = np.exp(0.06 * np.random.default_rng(seed).normal(size=12))[:, None, None]
        signal = (0.5 * shading + gloss * lobe * (shading > 0)) * wrong
        images = ImageSet(
            names=tuple(str(number) for number in range(12)), height=size, width=size, channels=1,
            rows=Rows(np.round(signal / signal.max() * 65_000).astype(np.uint16)), full_scale=65535,
            saturated_from=2.0, lights=DistantLights(lights, np.ones((12, 1))), mask=mask,
        )  # fmt: skip
        result = distant.solve(images)
        step = np.linalg.norm(np.diff(result.normals - normals, axis=1), axis=-1)
        used, both = result.flags & LIT > 0, mask[:, 1:] & mask[:, :-1]
        changed = np.any(used[:, :, 1:] != used[:, :, :-1], axis=0) & both
        ratios.append(np.median(step[changed]) / np.median(step[both & ~changed]))
    assert np.mean(ratios) < 4.5
