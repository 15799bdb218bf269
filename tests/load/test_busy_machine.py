"""Sessions and stops beside six processes that compute: `tests.load.busy_machine` in parts, and its plainest case.

The figures are printed: `pytest -m long -s tests/load/test_busy_machine.py`; fewer: `LIGHTPOSE_BUSY_SESSIONS=5`,
`LIGHTPOSE_BUSY_STOPS=10`.
"""

import os

import pytest

from tests.load import busy_machine

BUSY = 6
SHARDS = 5
SESSIONS = int(os.environ.get("LIGHTPOSE_BUSY_SESSIONS", "50"))
STOPS = int(os.environ.get("LIGHTPOSE_BUSY_STOPS", "200"))
ADDRESS = "127.0.15.30"


@pytest.mark.long
@pytest.mark.parametrize("shard", range(SHARDS))
def test_busy_machine_sessions_complete_and_stops_halt_in_time(shard: int) -> None:
    summary = busy_machine.run(SESSIONS // SHARDS, STOPS // SHARDS, BUSY, ADDRESS)
    print(f"\n{shard}: {summary}")
    assert not summary["unsafe"]
    if summary["driver_priority"] == "real-time":  # else what is not held has only to be safe
        assert len(summary["not_complete"]) <= 1
        assert summary["beyond_deceleration_p99_s"] <= busy_machine.STOP_S
