"""The chaos schedules and the soak in the long suite, by seed: `LIGHTPOSE_CHAOS=0:25`, `LIGHTPOSE_SOAK_HOURS=2`.

`python -m tests.chaos` runs the same with results that a later run goes on from.
"""

import os
from collections.abc import Generator
from pathlib import Path

import pytest

from tests.chaos import fault_schedule, soak
from tests.chaos.fault_schedule import Scene
from tests.chaos.scene import scene
from tests.crash.crashing import cases

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Generator[Scene, None, None]:
    try:
        with scene(tmp_path_factory.mktemp("chaos"), "127.0.14.41") as running:
            yield running
    except OSError as error:
        pytest.skip(str(error))


@pytest.mark.parametrize("seed", cases("LIGHTPOSE_CHAOS", 100))
def test_combined_faults_end_in_a_state_that_is_understood(made: Scene, seed: int) -> None:
    print(f"\n{fault_schedule.run(made, seed)}")


def test_soak_of_a_simulated_day_leaves_nothing_behind(tmp_path: Path) -> None:
    assert soak.run(tmp_path, "127.0.14.50", float(os.environ.get("LIGHTPOSE_SOAK_HOURS", "24")), 1, print)
