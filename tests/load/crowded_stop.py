"""From a stop request to rest of a moving arm, beside idle connections, event streams and posting clients.

    python -m tests.load.crowded_stop [--stops 200] [--idle 5000] [--streams 500] [--posting 100]

The service may open 1,024 descriptors, as one without LimitNOFILE. The arm moves at life speed: by hand it is put
aside, it parks, and is stopped at a random moment of its way. Every stop is a request over a new connection; when the
arm rests is read from the controller's record of every tick. Prints a JSON object; ends with status 1 when the 99th
percentile is more than 0.3 s beyond the deceleration, or the log grows by more than 1 MB a minute.
"""

import argparse
import json
import os
import random
import resource
import socket
import sys
import tempfile
import time
from collections.abc import Generator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import httpx
import numpy as np

from api import Client, ProblemError
from api.rest import keys
from api.rest.keys import Role
from hardware_sim.cell import Cell, CellOptions
from hardware_sim.controller.control import ControlClient
from tests.end_to_end.processes import serving
from tests.load import posters
from tests.load.loaded_cell import CELL_FILE, Loaded, Stopped, came_to_rest

ADDRESS = "127.0.15.50"
CROWD = "127.0.4.9"
"""Where the crowd's connections come from: an address has its share of them all."""
DESCRIPTORS = 1024
ASIDE_RAD = 1.2
"""By how much the first joint is turned by hand before each move, rad."""
FAST_RAD_S = 0.5
STOP_S, LOG_BYTES_PER_MIN = 0.3, 1e6
REQUEST = "{method} {path} HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {key}\r\n\r\n"


@contextmanager
def guarded_cell(folder: Path) -> Generator[tuple[Loaded, str, str]]:
    """A cell at life speed, its service with few descriptors, an operator's key and a viewer's."""
    folder.mkdir(parents=True, exist_ok=True)
    record, data = folder / "ticks.bin", folder / "data"
    operator = keys.add(keys.path_in(data), "an-operator", Role.OPERATOR)
    viewer = keys.add(keys.path_in(data), "a-viewer", Role.VIEWER)
    options = CellOptions(ADDRESS, "sphere", 1, "ideal", 1.0, pixels=96, cell_file=CELL_FILE, record=record)
    with ExitStack() as stack:
        cell = stack.enter_context(Cell(options, folder / "cell"))
        limit = ["sh", "-c", f'ulimit -n {DESCRIPTORS}; exec "$@"', "sh"]
        service = stack.enter_context(serving(cell, data, prefix=limit))
        client = stack.enter_context(Client(service.url, key=operator))
        client.wait_ready(90)
        arm = cell.config.arm
        yield Loaded(service, client, record, ADDRESS, arm.stop_deceleration_rad_s2, arm.home), operator, viewer


@contextmanager
def crowd(port: int, key: str, idle: int, streams: int, posting: int) -> Generator[None]:
    """So many idle connections, event streams and clients that post; the service may refuse or end what it likes."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    with ExitStack() as stack:
        stack.callback(resource.setrlimit, resource.RLIMIT_NOFILE, (soft, hard))
        for number in range(idle + streams):
            opened = stack.enter_context(connected(port, CROWD))
            if number >= idle:
                opened.sendall(REQUEST.format(method="GET", path="/v1/events?after=0", key=key).encode())
        if posting:
            stack.enter_context(posters.posting(port, key, posting))
        yield


def connected(port: int, source: str) -> socket.socket:
    """A connection from an address."""
    opened = socket.socket()
    opened.bind((source, 0))
    opened.settimeout(60)
    opened.connect(("127.0.0.1", port))
    return opened


def stop(
    cell: Loaded, control: ControlClient, port: int, key: str, chance: random.Random
) -> tuple[float, Stopped] | None:
    """Stops the arm on its way home: s to the answer, and to rest. None where it was no longer fast."""
    control.fault("hand_move", joints=[cell.home[0] - ASIDE_RAD, *cell.home[1:]], seconds=0)
    control.fault("clear")  # which that has stopped
    parks(cell.client, control)
    time.sleep(chance.uniform(0.0, 0.6))
    state, begun = control.state(), time.monotonic()
    with connected(port, "127.0.0.1") as opened:
        opened.sendall(REQUEST.format(method="POST", path="/v1/rig/stop", key=key).encode())
        answer = opened.recv(4096)
    answered_s = time.monotonic() - begun
    assert answer.startswith(b"HTTP/1.1 202 "), answer
    time.sleep(0.8)
    speed = max(map(abs, state["joint_speeds"]))
    if speed < FAST_RAD_S / 2:
        return None
    took_s = came_to_rest(cell.record, state["timestamp"]) - state["timestamp"]
    return answered_s, Stopped(took_s, speed / cell.deceleration)


def parks(client: Client, control: ControlClient) -> None:
    """Returns when the arm is fast on its way home; asks as often as the crowd, or a stop before, makes necessary."""
    deadline = time.monotonic() + 180
    while max(map(abs, control.state()["joint_speeds"])) < FAST_RAD_S:
        assert time.monotonic() < deadline, "the arm does not park"
        with suppress(ProblemError, httpx.TransportError):
            if not client.rig().may_start:
                client.acknowledge()
                time.sleep(0.1)
                continue
            client.park()
            until = time.monotonic() + 8
            while time.monotonic() < until and max(map(abs, control.state()["joint_speeds"])) < FAST_RAD_S:
                time.sleep(0.005)


def run(stops: int, idle: int, streams: int, posting: int) -> dict[str, Any]:
    """The whole run; its summary."""
    chance = random.Random(1)  # noqa: S311 - a test's seed
    with tempfile.TemporaryDirectory() as folder, guarded_cell(Path(folder)) as (cell, operator, viewer):
        port = int(cell.service.url.rpartition(":")[2])
        log = next(cell.service.data.glob("serve-*.log"))
        with crowd(port, viewer, idle, streams, posting), ControlClient(cell.address) as control:
            time.sleep(10)  # the log's burst is over
            begun, size = time.monotonic(), log.stat().st_size
            tried = [stop(cell, control, port, operator, chance) for _ in range(stops)]
            rate = (log.stat().st_size - size) / (time.monotonic() - begun) * 60
    made = [one for one in tried if one is not None]
    assert len(made) >= stops / 2, f"the arm was moving in {len(made)} of {stops} tries"
    margins = [stopped.margin_s for _, stopped in made]
    return {
        "load_average": os.getloadavg()[0],
        "stops": len(made),
        "answer_p50_s": float(np.median([answered for answered, _ in made])),
        "answer_p99_s": float(np.quantile([answered for answered, _ in made], 0.99, method="higher")),
        "to_rest_p50_s": float(np.median([stopped.took_s for _, stopped in made])),
        "beyond_deceleration_p50_s": float(np.median(margins)),
        "beyond_deceleration_p99_s": float(np.quantile(margins, 0.99, method="higher")),
        "log_bytes_per_min": rate,
    }


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m tests.load.crowded_stop", description=__doc__)
    for name, default in {"stops": 200, "idle": 5000, "streams": 500, "posting": 100}.items():
        parser.add_argument(f"--{name}", type=int, default=default)
    options = parser.parse_args()
    summary = run(options.stops, options.idle, options.streams, options.posting)
    print(json.dumps(summary, indent=2))
    return int(summary["beyond_deceleration_p99_s"] > STOP_S or summary["log_bytes_per_min"] > LOG_BYTES_PER_MIN)


if __name__ == "__main__":
    sys.exit(main())
