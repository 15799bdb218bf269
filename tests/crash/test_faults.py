"""Faults of controller, links, lamp, camera and scene at a random moment of a session, corrected before a resume.

Shards by `LIGHTPOSE_FAULTS=start:stop`; the number of a case is its seed and chooses the fault.
"""

import random
from collections.abc import Generator
from typing import Any

import pytest

from acquisition.session_state import State
from tests.crash.crashing import (
    Bench,
    announced,
    assert_equal_to_the_undisturbed,
    assert_rests,
    bench,
    cases,
    resume,
    wait_for_image,
)

pytestmark = pytest.mark.long

FAULTS: tuple[dict[str, Any], ...] = (
    {"kind": "protective_stop"},
    {"kind": "safeguard_stop"},
    {"kind": "emergency_stop"},
    {"kind": "violation"},
    {"kind": "power_off"},
    {"kind": "program_stop"},
    {"kind": "program_pause"},
    {"kind": "local_mode"},
    {"kind": "cut", "port": 30004},
    {"kind": "cut", "port": 29999},
    {"kind": "stall", "port": 30004, "seconds": 3.0},
    {"kind": "half_packet"},
    {"kind": "delay", "port": 30004, "latency_ms": 40, "jitter_ms": 20},
    {"kind": "output_stuck", "output": 0, "level": False},
    {"kind": "output_stuck", "output": 0, "level": True},
    {"kind": "lamp", "fraction": 0.0},
    {"kind": "dropped_frame"},
    {"kind": "dropped_frame", "count": 5},
    {"kind": "saturated_frame"},
    {"kind": "speed_slider", "fraction": 0.3},
    {"kind": "nudged_object", "shift_m": [0.006, 0.0, 0.0]},
    {"kind": "restart"},
)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Generator[Bench, None, None]:
    with bench(tmp_path_factory.mktemp("faults"), "127.0.14.20") as running:
        yield running


@pytest.mark.parametrize("case", cases("LIGHTPOSE_FAULTS", 100))
def test_session_completes_after_a_corrected_fault(made: Bench, case: int) -> None:
    chance = random.Random(case)  # noqa: S311 - a test's seed
    fault = FAULTS[case % len(FAULTS)]
    number = chance.choice([2, 2, 6, *range(len(made.stage_begins) - 1)])  # while images are taken, most often
    with made.serve() as client:
        session_id = made.run_into(client, number, chance)
        if fault["kind"] == "nudged_object":
            wait_for_image(client, session_id)  # before the first one nobody knows where the object is
        made.control.fault(**fault)
        session = client.wait(session_id)
        kept = announced(made.data, session_id)
        if session.state is not State.COMPLETED:
            assert session.state in (State.INTERRUPTED, State.PAUSED), session.reason
            assert_rests(made, lamp_stuck=fault.get("level", False))
            mend(made, fault)
            session = resume(made, client, session_id)
        mend(made, fault)
    assert_equal_to_the_undisturbed(made, session, kept)


def mend(made: Bench, fault: dict[str, Any]) -> None:
    """A person puts everything right again."""
    made.control.fault("clear")
    if fault["kind"] == "nudged_object":
        x, y, z = made.control.state()["disturbances"]["object_shift_m"]
        if (x, y, z) != (0.0, 0.0, 0.0):
            made.control.fault("nudged_object", shift_m=[-x, -y, -z])
    if fault["kind"] == "local_mode":
        made.control.fault("remote_mode")
    if fault["kind"] == "delay":
        made.control.fault("delay", port=fault["port"], latency_ms=0, jitter_ms=0)
