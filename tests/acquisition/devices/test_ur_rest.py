"""Stopping time when a process or link fails during a move, from the simulator's record of every tick.

At rest within 0.6 s, and nothing moves again: neither when what was stopped goes on, nor when the link comes back. The
times are told; run it alone (`pytest -m long -s tests/acquisition/devices/test_ur_rest.py`).
"""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from acquisition.devices.ur.arm import UrArm
from acquisition.devices.ur.lamp import UrLamp
from hardware_sim.controller.control import ControlClient
from hardware_sim.controller.trace import read_trace
from tests.acquisition.devices.arm_scenes import (
    CELL,
    FAR,
    SERVICE_CODE,
    arm_config,
    connected,
    controller,
    moved,
    under_way,
    wait_until_moving,
)

pytestmark = pytest.mark.long

ADDRESS = "127.0.13.30"
AT_REST_WITHIN_S = 0.6
STOPPED = 1
LINK_PORT = 30004


@contextmanager
def moving_service(control: ControlClient) -> Iterator[subprocess.Popen[bytes]]:
    """A process of its own that moves the arm."""
    code = SERVICE_CODE.format(address=ADDRESS)
    process = subprocess.Popen([sys.executable, "-c", code], cwd=Path(__file__).parents[3], stderr=subprocess.DEVNULL)
    try:
        wait_until_moving(control)
        yield process
    finally:
        process.kill()
        process.wait()


@contextmanager
def moving_arm(control: ControlClient) -> Iterator[UrArm]:
    """The arm under way, moved by this process."""
    with connected(UrArm(arm_config(ADDRESS), CELL.lamp.output)) as arm:
        moved(arm)
        UrLamp(arm, CELL.lamp).set(True)
        journey, _ = under_way(arm, control)
        yield arm
        journey.end()


def rest(record: Path, since: float) -> float:
    """Seconds from a time stamp until the arm stands; it stands for two seconds at least, to the record's end."""
    trace = read_trace(record)
    last_moved = trace.times[1:][np.abs(np.diff(trace.joints, axis=0)).max(axis=1) > 0.0].max()
    assert last_moved > since, "it was not moving"
    assert trace.times[-1] - last_moved > 2.0
    assert trace.outputs[-1] & 1 << CELL.lamp.output == 0, "the lamp is out"
    assert abs(trace.joints[-1, 0] - FAR[0]) > 0.1, "the move ran to its end"
    return float(last_moved - since)


@pytest.mark.parametrize("name", ["SIGKILL", "SIGSTOP"])
def test_rest_times_service_halt(tmp_path: Path, name: str) -> None:
    record = tmp_path / "ticks.bin"
    with controller(ADDRESS, record) as control, moving_service(control) as process:
        since = control.state()["timestamp"]
        process.send_signal(signal.Signals[name])
        time.sleep(1.5)
        process.send_signal(signal.SIGCONT)
        time.sleep(2.0)
    judge(f"service {name}", rest(record, since))


@pytest.mark.parametrize("name", ["SIGKILL", "SIGSTOP", "SIGTERM"])
def test_rest_times_driver_loss(tmp_path: Path, name: str) -> None:
    record = tmp_path / "ticks.bin"
    with controller(ADDRESS, record) as control, moving_arm(control) as arm:
        driver = arm.driver_pid
        assert driver is not None
        since = control.state()["timestamp"]
        os.kill(driver, signal.Signals[name])
        time.sleep(3.5)
    judge(f"driver {name}", rest(record, since))


@pytest.mark.parametrize(
    ("what", "fault"),
    [
        ("link cut", {"kind": "cut"}),
        ("link stalled", {"kind": "stall", "seconds": 2.0}),
        ("link half open", {"kind": "delay", "latency_ms": 10_000}),
        ("half a packet", {"kind": "half_packet"}),
    ],
)
def test_rest_times_link_loss(tmp_path: Path, what: str, fault: dict[str, object]) -> None:
    record = tmp_path / "ticks.bin"
    with controller(ADDRESS, record) as control, moving_arm(control):
        since = control.state()["timestamp"]
        more = {} if fault["kind"] == "half_packet" else {"port": LINK_PORT}
        control.fault(**fault, **more)
        time.sleep(4.5)
        assert control.state()["runtime_state"] == STOPPED, "only a person makes it run again"
    judge(what, rest(record, since))


@pytest.mark.parametrize("fault", ["protective_stop", "emergency_stop", "safeguard_stop", "program_stop"])
def test_rest_times_stop_at_the_cell(tmp_path: Path, fault: str) -> None:
    record = tmp_path / "ticks.bin"
    with controller(ADDRESS, record) as control, moving_arm(control):
        since = control.state()["timestamp"]
        control.fault(fault)
        time.sleep(3.5)
    judge(fault, rest(record, since))


def judge(what: str, seconds: float) -> None:
    """Tells the time and judges it."""
    print(f"\n{what}: at rest after {seconds:.3f} s")
    assert seconds <= AT_REST_WITHIN_S
