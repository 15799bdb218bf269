"""Sessions and stops beside six processes that compute, and stops beside a crowd of connections, in parts.

The figures are printed: `pytest -m long -s tests/load/test_busy_machine.py`; fewer: `LIGHTPOSE_BUSY_SESSIONS=5`,
`LIGHTPOSE_BUSY_STOPS=10`. The commands `tests.load.busy_machine` and `tests.load.crowded_stop` run them in one.
"""

import os

import pytest

from tests.load import busy_machine, crowded_stop

BUSY = 6
SHARDS = 5
SESSIONS = int(os.environ.get("LIGHTPOSE_BUSY_SESSIONS", "50"))
STOPS = int(os.environ.get("LIGHTPOSE_BUSY_STOPS", "200"))
ADDRESS = "127.0.15.30"

pytestmark = pytest.mark.long


@pytest.mark.parametrize("shard", range(SHARDS))
def test_busy_machine_sessions_complete_and_stops_halt_in_time(shard: int) -> None:
    summary = busy_machine.run(SESSIONS // SHARDS, STOPS // SHARDS, BUSY, ADDRESS)
    print(f"\n{shard}: {summary}")
    assert not summary["unsafe"]
    if summary["driver_priority"] == "real-time":  # else what is not held has only to be safe
        assert len(summary["not_complete"]) <= 1
        assert summary["beyond_deceleration_p99_s"] <= busy_machine.STOP_S


@pytest.mark.parametrize("shard", range(SHARDS))
def test_crowd_of_connections_does_not_delay_a_stop(shard: int) -> None:
    summary = crowded_stop.run(STOPS // SHARDS, idle=5000, streams=500, posting=100)
    print(f"\n{shard}: {summary}")
    assert summary["beyond_deceleration_p99_s"] <= crowded_stop.STOP_S
    assert summary["log_bytes_per_min"] <= crowded_stop.LOG_BYTES_PER_MIN
