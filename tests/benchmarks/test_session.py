"""Time (s) of one complete session in the tests' cell, from the start request over HTTP to its end.

`pytest tests/benchmarks/test_session.py --benchmark-enable --benchmark-only`
"""

from collections.abc import Generator

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from tests.crash.crashing import Bench, bench, undisturbed


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Generator[Bench, None, None]:
    with bench(tmp_path_factory.mktemp("session"), "127.0.24.30") as running:
        yield running


def test_session_three_pilot_lights_and_one_planned_time(made: Bench, benchmark: BenchmarkFixture) -> None:
    with made.serve() as client:
        course = benchmark.pedantic(undisturbed, (made, client), rounds=5, warmup_rounds=1)
    benchmark.extra_info["stages_begin_s"] = [round(begins, 2) for begins in course.stages]
    assert (made.data / "sessions" / course.session_id / "results" / "1").exists()
