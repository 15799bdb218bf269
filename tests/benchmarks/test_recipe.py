"""Time of the full near-light solve on path-traced images with interreflections.

Direct light with its shadows is rendered at full resolution, light from other surfaces at 64 pixels and enlarged: it is
smooth. Enlarged as a whole, images would be out of focus, and be solved as those of a translucent surface.

Goal: one megapixel under eight lights in at most 3.0 s on two idle cores.
"""

import cv2
import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from acquisition import normals
from acquisition.models.result import SolveSettings
from tests.path_traced import bench, captures, objects

SMALL = 64


def sharp_images(name: str, lights: np.ndarray, pixels: int) -> np.ndarray:
    """Noise-free y (F, pixels, pixels) of an object with interreflections."""
    both, direct = (bench.render(name, lights, pixels=SMALL, bounces=bounces, samples=100) for bounces in (True, False))
    indirect = np.maximum(both - direct, 0)
    enlarged = [cv2.resize(one, (pixels, pixels), interpolation=cv2.INTER_LINEAR) for one in indirect]
    return bench.render(name, lights, pixels=pixels, bounces=False, samples=4) + np.stack(enlarged)


@pytest.mark.parametrize("name", objects.NAMES)
def test_solve_eight_images_of_a_megapixel_time(benchmark: BenchmarkFixture, name: str) -> None:
    lights, pixels = bench.two_rings(8), 1000
    true = bench.truth(name, pixels)
    captured = captures.capture(sharp_images(name, lights, pixels), lights, 0)
    benchmark.extra_info["object pixels"] = int(np.count_nonzero(true.mask))

    result = benchmark.pedantic(
        lambda: normals.solve_stack(
            captured.stack, captured.calibration, SolveSettings(), normals.ObjectPlace(0.9, silhouette=true.mask)
        ),
        rounds=3,
        warmup_rounds=1,
    )
    benchmark.extra_info["findings"] = [one.kind for one in result.findings]
    assert np.count_nonzero(result.mask) > 0.95 * np.count_nonzero(true.mask)
