"""How planning time grows with candidates, lights and sample pixels, and how long a solve takes."""

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from acquisition import normals, pilot, plan
from acquisition.plan import selection
from acquisition.types import Recipe, SolveSettings
from tests.acquisition import scenes
from tests.acquisition.plan import cases


@pytest.mark.parametrize(
    ("candidates", "lights", "pixels"),
    [(300, 4, 900), (300, 8, 900), (300, 16, 900), (75, 8, 900), (150, 8, 900), (300, 8, 300), (300, 8, 600)],
)
def test_plan(
    benchmark: BenchmarkFixture, monkeypatch: pytest.MonkeyPatch, candidates: int, lights: int, pixels: int
) -> None:
    true = scenes.scene(scenes.bumps, scenes.calibration(160))
    reach = scenes.Dome(refused=0, count=candidates)
    normal_map = cases.known_map(true, pilot.pattern(Recipe(), reach), step=1)
    monkeypatch.setattr(selection, "SAMPLE_PIXELS", pixels)
    arguments = (normal_map, cases.NOTHING_TAKEN, Recipe(), reach, true.calibration, lights)
    chosen = benchmark.pedantic(plan.choose, args=arguments, rounds=3, warmup_rounds=1)
    benchmark.extra_info["predicted mean σ in degrees"] = round(chosen.predicted_sigma_deg or np.nan, 3)
    assert len(chosen.lights) == lights


@pytest.mark.parametrize("count", [4, 8, 12])
def test_solve_a_quarter_of_a_megapixel(benchmark: BenchmarkFixture, count: int) -> None:
    true = scenes.scene(scenes.bumps, scenes.calibration(500))
    taken = scenes.capture(true, scenes.ring(count, 40.0))
    benchmark.extra_info["object pixels"] = int(np.count_nonzero(true.mask))
    found = benchmark.pedantic(
        lambda: normals.solve(taken, true.calibration, SolveSettings(), initial_depth_m=scenes.TABLE_DEPTH - 0.04),
        rounds=1,
        warmup_rounds=1,
    )
    assert np.count_nonzero(found.mask) > 0.9 * np.count_nonzero(true.mask)
