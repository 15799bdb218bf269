"""Asks `/health/live` again and again from a process of its own: `python -m tests.contract.liveness URL`.

Ends when its standard input does, and prints as one JSON object how many answers there were and how late: every request
over a connection of its own, as a supervisor sends it, so that the listener is measured too. How late the probe itself
wakes tells how long this machine keeps any process waiting, the service among them.
"""

import json
import sys
import threading
import time
from http.client import HTTPConnection
from urllib.parse import urlsplit

PERIOD_S = 0.05
WITHIN_S = 60.0


def main(url: str) -> dict[str, float]:
    """Measures until standard input ends."""
    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    target = urlsplit(url)
    took: list[float] = []
    late: list[float] = []
    bad = 0
    print("measuring", flush=True)
    asleep = time.perf_counter()
    while not ended.wait(PERIOD_S):
        begun = time.perf_counter()
        late.append(begun - asleep - PERIOD_S)
        connection = HTTPConnection(str(target.hostname), target.port, timeout=WITHIN_S)
        try:
            connection.request("GET", "/health/live")
            bad += connection.getresponse().status != 200
        except OSError:
            bad += 1
        finally:
            connection.close()
        asleep = time.perf_counter()
        took.append(asleep - begun)
    return {
        "count": len(took),
        "bad": bad,
        "p50_ms": 1e3 * quantile(took, 0.5),
        "p99_ms": 1e3 * quantile(took, 0.99),
        "max_ms": 1e3 * max(took),
        "probe_late_p99_ms": 1e3 * quantile(late, 0.99),
    }


def quantile(values: list[float], share: float) -> float:
    """The smallest value that this share of them does not exceed."""
    return sorted(values)[min(int(share * len(values)), len(values) - 1)]


if __name__ == "__main__":
    print(json.dumps(main(sys.argv[1])))
