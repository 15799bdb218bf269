"""Time of one work item of the study: one draw of one object at the image counts of the bounds.

The whole study is six such draws of six objects, and once all other numbers: about fifty times as much.
"""

import time

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from api.cli.study import error_curves, run
from api.cli.study.error_curves import Draws, Sample, WorkItem


@pytest.mark.parametrize("shape", ["part", "figure"])
def test_work_item_of_one_object_time(benchmark: BenchmarkFixture, shape: str) -> None:
    error_curves.run_item(
        WorkItem("sphere", 0, 0, run.SMALL_PIXELS, Draws({3: 1}, {3: 1}, {3: 1}), None)
    )  # kernels are loaded
    (item,) = (one for one in error_curves.work_items(1, run.FULL) if (one.shape, one.draw) == (shape, 1))

    def work() -> list[Sample]:
        begun = time.process_time()
        samples = error_curves.run_item(item)
        benchmark.extra_info["processor seconds"] = time.process_time() - begun
        benchmark.extra_info["sessions"] = len(samples)
        return samples

    samples = benchmark.pedantic(work, rounds=1)
    assert len(samples) > 10
