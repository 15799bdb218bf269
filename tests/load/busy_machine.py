"""Sessions and stops beside other busy programs; measures the lateness of the lease and of the driver's wake-ups.

    python -m tests.load.busy_machine [--sessions 50] [--stops 40] [--busy 6] [--rights real-time|niceness|none]

starts that many processes that do nothing but compute, at normal priority and each in a scheduling group of its own
(as terminals are), a simulated cell whose arm moves at five times life speed, and its service; runs sessions, then
stops at random moments of moves at life speed. `--rights none` takes CAP_SYS_NICE away first, `--rights niceness`
forgoes the real-time class (LIGHTPOSE_REAL_TIME=no). Prints one line a session and stop, and a JSON object; ends with
status 1 when more than one session in 25 did not complete or anything was unsafe.

Unsafe is, by the simulated controller's own record: a collision or violated limit, an arm that moves or a lamp that is
lit after a session has ended or was interrupted, a move begun while no session ran.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from acquisition.models.recipe import Recipe
from acquisition.session_state import State
from hardware_sim.controller.control import ControlClient
from tests.load.loaded_cell import (
    AT_REST_RAD_S,
    Loaded,
    Stopped,
    acknowledge_what_is_latched,
    figure,
    loaded_cell,
    stop_a_moving_arm,
    wakeup_lateness,
)

RECIPE = Recipe(pilot_lights=3, planned_lights=1)
LONG_PATH = Recipe(method="two-rings", pilot_lights=4, planned_lights=4)
COMPLETE = 0.96
STOP_S = 0.3
TRIES = 2
"""Tries for each stop that is wanted: the arm may be between two moves."""
WITHOUT_RIGHTS = ["prlimit", "--nice=0:0", "--rtprio=0:0", "setpriv", "--bounding-set=-sys_nice"]


@contextmanager
def busy(count: int) -> Generator[None]:
    """So many processes that only compute, each in a session, hence a scheduling group, of its own."""
    code = "import os\nparent = os.getppid()\nwhile os.getppid() == parent: sum(range(20000))"
    running = [subprocess.Popen([sys.executable, "-c", code], start_new_session=True) for _ in range(count)]
    try:
        yield
    finally:
        for process in running:
            process.kill()
            process.wait()


def rests(control: ControlClient) -> list[str]:
    """What is unsafe about a cell in which no session runs; empty as it should be."""
    deadline = time.monotonic() + 60
    while max(map(abs, (before := control.state())["joint_speeds"])) > AT_REST_RAD_S:
        if time.monotonic() > deadline:
            return ["the arm did not come to rest"]
        time.sleep(0.01)
    time.sleep(0.3)
    after = control.state()
    unsafe: list[str] = []
    if after["moves_started"] != before["moves_started"] or max(map(abs, after["joint_speeds"])) > AT_REST_RAD_S:
        unsafe.append("the arm moved unasked")
    if after["digital_outputs"]:
        unsafe.append("the lamp is lit")
    if after["safety_mode"] != 1:
        unsafe.append(f"safety mode {after['safety_mode']}")
    return unsafe


def run_sessions(cell: Loaded, control: ControlClient, count: int) -> dict[str, Any]:
    """Runs sessions one after another; how many completed without a hand, why the others did not, what was unsafe."""
    complete, reasons, unsafe = 0, list[str](), list[str]()
    for number in range(count):
        acknowledge_what_is_latched(cell.client)
        begun, session_id = time.monotonic(), cell.client.create(RECIPE).id
        cell.client.start(session_id)
        session = cell.client.wait(session_id)
        reason = f"{session.reason.code}: {session.reason.detail}" if session.reason else ""
        print(f"{number} {session.state} {time.monotonic() - begun:.1f} s {reason}", flush=True)
        unsafe += rests(control)
        if session.state is State.COMPLETED:
            complete += 1
        else:
            reasons.append(reason)
            cell.client.stop(session_id)
    return {"sessions": count, "complete": complete, "not_complete": reasons, "unsafe": unsafe}


def lateness(cell: Loaded) -> dict[str, Any]:
    """Lateness of the lease's renewals and of the driver's wake-ups."""
    counts = wakeup_lateness(cell.service)
    total = max(counts.values(), default=0)

    def below(share: float) -> float:
        return next((1e3 * bound for bound, count in counts.items() if count >= share * total), float("inf"))

    return {
        "load_average": os.getloadavg()[0],
        "driver_priority": cell.client.rig().driver_priority,
        "lease_renewals": figure(cell.service, "lightpose_lease_renewals"),
        "lease_p99_ms": 1e3 * figure(cell.service, 'lightpose_lease_lateness_seconds{quantile="0.99"}'),
        "lease_most_ms": 1e3 * figure(cell.service, 'lightpose_lease_lateness_seconds{quantile="1.0"}'),
        "driver_wakeups": total,
        "driver_p99_below_ms": below(0.99),
        "driver_p999_below_ms": below(0.999),
        "driver_most_below_ms": below(1.0),
    }


def run_stops(cell: Loaded, control: ControlClient, count: int) -> dict[str, Any]:
    """Stops the arm in its moves, so many times; from request to rest beyond the deceleration, s."""
    stops: list[Stopped] = []
    for trial in range(TRIES * count):
        if len(stops) < count and (stopped := stop_a_moving_arm(cell, control, LONG_PATH, trial)) is not None:
            stops.append(stopped)
            print(f"stop {len(stops)}: {stopped.margin_s:.3f} s beyond the deceleration", flush=True)
    assert len(stops) >= count / 2, f"the arm was moving in {len(stops)} of {TRIES * count} tries"
    margins = [stopped.margin_s for stopped in stops]
    return {
        "load_average": os.getloadavg()[0],
        "stops": len(stops),
        "to_rest_p50_s": float(np.median([stopped.took_s for stopped in stops])),
        "beyond_deceleration_p50_s": float(np.median(margins)),
        "beyond_deceleration_p99_s": float(np.quantile(margins, 0.99, method="higher")),
    }


def run(sessions: int, stops: int, count: int, address: str) -> dict[str, Any]:
    """The whole run; its summary."""
    summary: dict[str, Any] = {"busy": count}
    with tempfile.TemporaryDirectory() as folder:
        if sessions:
            with (
                loaded_cell(Path(folder) / "sessions", address, 5.0) as cell,
                ControlClient(address) as control,
                busy(count),
            ):
                summary |= run_sessions(cell, control, sessions) | lateness(cell)
        if stops:
            with (
                loaded_cell(Path(folder) / "stops", address, 1.0) as cell,
                ControlClient(address) as control,
                busy(count),
            ):
                summary |= run_stops(cell, control, stops)
    return summary


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m tests.load.busy_machine", description=__doc__)
    parser.add_argument("--sessions", type=int, default=50)
    parser.add_argument("--stops", type=int, default=40)
    parser.add_argument("--busy", type=int, default=6)
    parser.add_argument("--rights", choices=("real-time", "niceness", "none"), default="real-time")
    parser.add_argument("--address", default="127.0.15.30", help="loopback address of the cell; two need two")
    options = parser.parse_args()
    if options.rights == "niceness":
        os.environ["LIGHTPOSE_REAL_TIME"] = "no"
    if options.rights == "none":
        numbers = [f"--{name}={getattr(options, name)}" for name in ("sessions", "stops", "busy", "address")]
        command = [*WITHOUT_RIGHTS, sys.executable, "-m", "tests.load.busy_machine", *numbers]
        return subprocess.run(command, check=False).returncode
    summary = run(options.sessions, options.stops, options.busy, options.address)
    print(json.dumps(summary, indent=2))
    failed = summary.get("complete", 0) < COMPLETE * summary.get("sessions", 0)
    late = summary.get("beyond_deceleration_p99_s", 0.0) > STOP_S
    return int(failed or late or bool(summary.get("unsafe")))


if __name__ == "__main__":
    sys.exit(main())
