"""The simulated cell and the service as processes of their own, as a user starts them."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from acquisition.models.errors import ErrorCode
from api import Client
from hardware_sim.cell import Cell
from hardware_sim.controller.control import ControlClient

READY_WITHIN_S = 180.0


@dataclass
class Service:
    """A running `lightpose serve`."""

    process: "subprocess.Popen[bytes]"
    url: str
    data: Path

    def kill(self) -> None:
        """SIGKILL."""
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()


@contextmanager
def serving(
    cell: Cell,
    data: Path,
    environment: Mapping[str, str] = {},
    prefix: Sequence[str] = (),
) -> Generator[Service, None, None]:
    """The service for a cell; ended by SIGTERM unless the test has killed it.

    `environment` is added to ours; `prefix` is the command, such as one that sets limits, which starts the service.
    """
    data.mkdir(parents=True, exist_ok=True)
    log = data / f"serve-{time.monotonic_ns()}.log"
    arguments = ["serve", "--cell", str(cell.cell_file), "--data", str(data), "--port", "0"]
    with log.open("wb") as file:
        process = subprocess.Popen(
            [*prefix, sys.executable, "-m", "api.cli", *arguments],
            stdout=file,
            stderr=file,
            env={**os.environ, **environment},
        )
    try:
        yield Service(process, _address(process, log), data)
    finally:
        process.terminate()
        process.wait(60)


@contextmanager
def client_of(service: Service) -> Generator[Client, None, None]:
    """A client of a service whose rig is ready."""
    with Client(service.url) as client:
        client.wait_ready(60)
        yield client


def resume(client: Client, session_id: str, within_s: float = 60.0) -> None:
    """Acknowledges a restart and resumes the session that it interrupted, once nothing else is in the way."""
    client.acknowledge()
    deadline = time.monotonic() + within_s
    while others := [reason for reason in client.rig().reasons if reason.code is not ErrorCode.RIG_BUSY]:
        assert time.monotonic() < deadline, others
        time.sleep(0.05)
    client.resume(session_id)


def fastest_joint(control: ControlClient) -> float:
    """The simulator's own fastest joint, rad/s."""
    return max(abs(speed) for speed in control.state()["joint_speeds"])


def wait_until_moving(control: ControlClient, within_s: float = 60.0) -> None:
    """Returns when the arm moves at more than 0.1 rad/s."""
    deadline = time.monotonic() + within_s
    while fastest_joint(control) < 0.1:
        assert time.monotonic() < deadline, "the arm does not move"
        time.sleep(0.005)


def rests_after(control: ControlClient, within_s: float = 60.0) -> float:
    """Seconds from now until the arm was last seen moving (above 0.01 rad/s) before it rested for 0.3 s.

    By the controller's clock, so that it does not count how long a busy machine keeps this process waiting.
    """
    deadline = time.monotonic() + within_s
    begun = moved = control.state()["timestamp"]
    while time.monotonic() < deadline:
        state = control.state()
        if max(map(abs, state["joint_speeds"])) > 0.01:
            moved = state["timestamp"]
        elif state["timestamp"] > moved + 0.3:
            return moved - begun
        time.sleep(0.004)
    raise AssertionError(f"the arm still moves after {within_s} s")


def _address(process: "subprocess.Popen[bytes]", log: Path) -> str:
    deadline = time.monotonic() + READY_WITHIN_S
    while time.monotonic() < deadline:
        text = log.read_text(encoding="utf-8", errors="replace")
        match = re.search(r"ready (http://[\d.]+:\d+)\n", text)
        if match is not None:
            return match.group(1)
        assert process.poll() is None, text
        time.sleep(0.05)
    raise AssertionError(f"the service is not ready: {log.read_text(encoding='utf-8')}")
