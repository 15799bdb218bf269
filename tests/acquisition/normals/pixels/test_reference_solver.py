"""The product's solve of pixels against the reference: the same minimum of the same energy on random draws."""

import numpy as np
import pytest

from acquisition.normals.pixels import pixel_solve
from acquisition.normals.pixels.estimate import Estimate
from acquisition.normals.pixels.pixel_solve import Pixels
from tests.acquisition.normals.pixels.reference_solver import NoiseModel, Pixel, PixelEnergy
from tests.acquisition.normals.shared_scene import DEPTH_M, MeasuredPixels, measured

THRESHOLD = 0.08
PIXELS = 30


def drawn(count: int, outliers: float) -> tuple[MeasuredPixels, Pixels]:
    """Noisy measurements at pixels that are no neighbours, so that no penumbra's variance is added; of a share of them
    one measurement has another value, between none and half as much again."""
    made = measured(count=count, largest_slant=1.2)
    random = np.random.default_rng(count)
    rows, columns = np.divmod(made.pixels.index, made.pixels.shape[1])
    apart = np.flatnonzero((rows % 2 == 0) & (columns % 2 == 0))
    pixels = made.pixels.subset(np.sort(random.permutation(apart)[:PIXELS]))
    strength = np.linalg.norm(made.light[:, :, pixels.index], axis=1) * 0.6
    sigma = np.sqrt(made.noise.variance(pixels.values, strength))
    values = pixels.values + sigma * random.normal(size=sigma.shape)
    wrong = np.flatnonzero(random.random(PIXELS) < outliers)
    values[random.integers(0, count, len(wrong)), wrong] *= random.uniform(0, 1.5, len(wrong))
    pixels.values[:] = values
    return made, pixels


def solved(made: MeasuredPixels, pixels: Pixels) -> Estimate:
    depth = np.full(len(pixels.index), DEPTH_M, np.float32)
    return pixel_solve.solve(pixels, pixels.values, depth, made.scene)


def energies(made: MeasuredPixels, pixels: Pixels, estimate: Estimate) -> list[PixelEnergy]:
    ray_direction = made.ray_direction[:, pixels.index]
    view = -ray_direction / np.linalg.norm(ray_direction, axis=0)
    scale = made.scene.cauchy_scale
    assert scale is not None
    peak = np.max(pixels.values / np.linalg.norm(estimate.light, axis=1), axis=0)
    noise = NoiseModel(
        made.noise.shot, made.noise.floor, made.noise.intensity, made.noise.direction, scale, THRESHOLD,
        float(np.median(peak)),
    )  # fmt: skip
    every = (values.astype(float) for values in (pixels.values, estimate.light, view))
    y, light, to_camera = every
    return [PixelEnergy(Pixel(y[:, n], light[:, :, n], to_camera[:, n]), noise) for n in range(y.shape[1])]


@pytest.mark.parametrize(
    ("count", "outliers", "share"),
    [(5, 0.0, 1.0), (8, 0.0, 1.0), (8, 0.5, 0.9), pytest.param(12, 0.5, 0.9, marks=pytest.mark.long)],
)
def test_solve_reaches_the_lowest_minimum_of_the_energy(count: int, outliers: float, share: float) -> None:
    made, pixels = drawn(count, outliers)
    estimate = solved(made, pixels)
    excess, angle = np.empty(PIXELS), np.empty(PIXELS)
    for n, energy in enumerate(energies(made, pixels, estimate)):
        lowest = energy.minimum()
        albedo = float(np.linalg.norm(lowest))
        state = estimate.g[:, n].astype(float)
        excess[n] = energy.value(state, albedo) / energy.value(lowest, albedo) - 1
        cosine = state @ lowest / (np.linalg.norm(state) * albedo)
        angle[n] = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    same = (excess < 0.01) & (angle < 0.1)
    assert np.mean(same) >= share
