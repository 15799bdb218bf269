"""Time of a near-light solve."""

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from acquisition import normals
from acquisition.models.result import SolveSettings
from tests.acquisition import scenes


@pytest.mark.parametrize("count", [4, 8, 12])
def test_solve_quarter_megapixel_time(benchmark: BenchmarkFixture, count: int) -> None:
    true = scenes.scene(scenes.bumps, scenes.calibration(500))
    observations = scenes.capture(true, scenes.ring(count, 40.0))
    benchmark.extra_info["object pixels"] = int(np.count_nonzero(true.mask))
    result = benchmark.pedantic(
        lambda: normals.solve(
            observations, true.calibration, SolveSettings(), normals.ObjectPlace(scenes.TABLE_DEPTH - 0.04)
        ),
        rounds=1,
        warmup_rounds=1,
    )
    assert np.count_nonzero(result.mask) > 0.9 * np.count_nonzero(true.mask)
