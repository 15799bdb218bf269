"""Solvers against the time of copying the stack, measured in the same run; integration; peak memory."""

import resource
import time

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from acquisition.normals import distant
from acquisition.normals.images.image_set import DistantLights, ImageSet
from acquisition.normals.surface import integration
from tests.acquisition.normals.distant.gloss_scenes import Rows

HEIGHT, WIDTH, COUNT = 3000, 4000, 8


def directions() -> np.ndarray:
    angle = 2 * np.pi * np.arange(COUNT) / COUNT
    slant = np.radians(np.where(np.arange(COUNT) % 2, 25, 45))
    return np.stack([np.sin(slant) * np.cos(angle), np.sin(slant) * np.sin(angle), np.cos(slant)], axis=-1)


@pytest.fixture(scope="module")
def stack() -> np.ndarray:
    """Twelve megapixels of a wavy matt surface under eight lights, with some cast shadow and noise."""
    rng = np.random.default_rng(0)
    v, u = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32) / 300
    normals = np.stack([np.sin(u) * 0.5, np.cos(v) * 0.5, np.ones_like(u)])
    normals /= np.linalg.norm(normals, axis=0)
    out = np.empty((COUNT, HEIGHT * WIDTH), np.uint16)
    for image, light in enumerate(directions()):
        value = np.clip(np.tensordot(light.astype(np.float32), normals, 1), 0, 1).ravel() * 40_000
        value[rng.integers(0, value.size, value.size // 20)] *= 0.01
        out[image] = value + rng.integers(0, 200, value.size, dtype=np.uint16)
    return out


def copying(stack: np.ndarray) -> float:
    """Seconds to copy the stack, the best of seven."""
    target, times = np.empty_like(stack), []
    for _ in range(7):
        begun = time.perf_counter()
        np.copyto(target, stack)
        times.append(time.perf_counter() - begun)
    return min(times)


def record_size(benchmark: BenchmarkFixture, stack: np.ndarray) -> None:
    copied = copying(stack)
    benchmark.extra_info["seconds to copy"] = round(copied, 4)
    if benchmark.enabled:
        benchmark.extra_info["times the copying"] = round(benchmark.stats["min"] / copied, 2)


@pytest.mark.parametrize("solver", ["ls", "auto"])
def test_solve_twelve_megapixels_time_and_memory(
    benchmark: BenchmarkFixture, stack: np.ndarray, solver: distant.Solver
) -> None:
    """With flags, σ and residuals; at most 1 GB beside the stack."""
    images = ImageSet(
        names=tuple(str(n) for n in range(COUNT)), height=HEIGHT, width=WIDTH, channels=1,
        rows=Rows(stack.reshape(COUNT, HEIGHT, WIDTH)), full_scale=65535, saturated_from=0.99,
        lights=DistantLights(directions(), np.ones((COUNT, 1))), mask=np.ones((HEIGHT, WIDTH), np.bool_),
    )  # fmt: skip
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    benchmark.pedantic(distant.solve, args=(images, solver), rounds=1)
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    benchmark.extra_info["growth of the peak memory in GB"] = round(grown / 1e6, 2)
    record_size(benchmark, stack)


@pytest.mark.parametrize(("height", "width"), [(1100, 1300), (3400, 4700)])
def test_integration_masked_time(benchmark: BenchmarkFixture, height: int, width: int) -> None:
    """One megapixel in at most 1.5 s, twelve in at most 30 s."""
    v, u = np.mgrid[:height, :width]
    x, y = (u - width / 2) / height, -(v - height / 2) / height
    slope = [0.45 * np.cos(9 * x) * np.cos(7 * y), -0.35 * np.sin(9 * x) * np.sin(7 * y)]
    normals = np.stack([-slope[0], -slope[1], np.ones_like(x)])
    normals = (normals / np.linalg.norm(normals, axis=0)).astype(np.float32)
    mask = (np.hypot(x / 1.2, y) < 0.46 + 0.03 * np.sin(7 * np.arctan2(y, x))) & (np.hypot(x - 0.1, y) > 0.06)
    arguments = (normals, mask, np.ones(mask.shape, np.float32))
    depth = benchmark.pedantic(integration.orthographic_depth, args=arguments, rounds=3, warmup_rounds=1)
    true = -(0.05 * np.sin(9 * x) * np.cos(7 * y))[mask] * height
    benchmark.extra_info["megapixels in the mask"] = round(np.count_nonzero(mask) / 1e6, 2)
    benchmark.extra_info["rms error in pixels"] = round(float(np.std(depth[mask] - true)), 4)
