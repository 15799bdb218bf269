"""How planning time grows with the pilot's pixels, the candidates, the lights and the sample pixels.

Goals on two idle cores: one megapixel, 300 candidates: 8 lights ≤ 1 s, with the certificate ≤ 2 s; 20 lights ≤ 3 s.
"""

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from acquisition import pilot, plan
from acquisition.models.light_plan import ForecastPoint
from acquisition.models.recipe import Recipe
from acquisition.plan import design_problem
from acquisition.runner import jobs
from tests.acquisition import scenes
from tests.acquisition.plan import cases


@pytest.mark.parametrize(
    ("pixels", "candidates", "lights", "samples", "certify", "counts"),
    [
        (1000, 300, 8, 900, False, ()),
        (1000, 300, 8, 900, True, ()),
        (1000, 300, 8, 900, True, jobs.FORECAST_COUNTS),  # as a session asks
        (1000, 300, 20, 900, False, ()),
        (1000, 300, 20, 900, True, ()),
        (1000, 300, 4, 900, False, ()),
        (1000, 300, 16, 900, False, ()),
        (1000, 75, 8, 900, False, ()),
        (1000, 150, 8, 900, False, ()),
        (1000, 300, 8, 300, False, ()),
        (160, 300, 8, 900, False, ()),
        (500, 300, 8, 900, False, ()),
    ],
)
def test_plan_time(
    benchmark: BenchmarkFixture, monkeypatch: pytest.MonkeyPatch, pixels: int, candidates: int, lights: int,
    samples: int, certify: bool, counts: tuple[int, ...],
) -> None:  # fmt: skip
    true = scenes.scene(scenes.bumps, scenes.calibration(pixels))
    reach = scenes.Dome(refused=0, count=candidates)
    # Every so many pixels, so that as many as the solver keeps are informed of, 4000.
    step = max(1, int(np.count_nonzero(true.graded) // 4000))
    normal_map = cases.known_map(true, pilot.pattern(Recipe(), reach), step=step)
    monkeypatch.setattr(design_problem, "SAMPLE_PIXELS", samples)

    def choose() -> float | None:
        problem = plan.DesignProblem.of(normal_map, cases.NO_OBSERVATIONS, Recipe(), reach, true.calibration)
        return plan.choose(problem, lights, certify=certify, forecast_counts=counts).predicted_sigma_deg

    predicted = benchmark.pedantic(choose, rounds=3, warmup_rounds=1)
    benchmark.extra_info["predicted mean σ in degrees"] = round(predicted or np.nan, 3)
    assert predicted is not None


@pytest.mark.parametrize("counts", [(4,), (1, 2, 4, 8, 16)])
def test_forecast_time(benchmark: BenchmarkFixture, counts: tuple[int, ...]) -> None:
    true = scenes.scene(scenes.bumps, scenes.calibration(160))
    reach = scenes.Dome(refused=0)
    normal_map = cases.known_map(true, pilot.pattern(Recipe(), reach), step=1)

    def forecast() -> list[ForecastPoint]:
        return plan.forecast(
            plan.DesignProblem.of(normal_map, cases.NO_OBSERVATIONS, Recipe(), reach, true.calibration), counts
        )

    points = benchmark.pedantic(forecast, rounds=3, warmup_rounds=1)
    assert len(points) == len(counts)
