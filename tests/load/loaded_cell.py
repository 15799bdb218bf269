"""A simulated cell whose ticks are recorded, its service, and what is asked of both under load."""

import os
import re
import time
from collections.abc import Generator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import httpx
import numpy as np

from acquisition.models.recipe import Recipe
from acquisition.session_state import State
from api import Client, ProblemError
from hardware_sim.cell import Cell, CellOptions
from hardware_sim.controller.control import ControlClient
from hardware_sim.controller.trace import MAGIC
from tests.end_to_end.processes import Service, serving

CELL_FILE = Path(__file__).parents[2] / "tests" / "data" / "cell.test.toml"
AT_REST_RAD_S = 0.01
MOVES_WITHIN_S = 180.0
"""Time within which a session's first move begins, s: its plan and route wait for cores beside other programs."""
ROW = np.dtype([("time", "<f8"), ("joints", "<f8", 6), ("rest", "V32")])
NEWEST_ROWS = 10_000  # 20 s


@dataclass(frozen=True)
class Loaded:
    """A cell with its service."""

    service: Service
    client: Client
    record: Path
    address: str
    deceleration: float
    home: tuple[float, ...]


@contextmanager
def loaded_cell(folder: Path, address: str, speed: float) -> Generator[Loaded]:
    """A cell whose ticks are recorded, and its service."""
    record = folder / "ticks.bin"
    with ExitStack() as stack:
        cell = stack.enter_context(
            Cell(
                CellOptions(address, "sphere", 1, "ideal", speed, pixels=128, cell_file=CELL_FILE, record=record),
                folder / "cell",
            )
        )
        service = stack.enter_context(serving(cell, folder / "data"))
        client = stack.enter_context(Client(service.url))
        client.wait_ready(90)
        arm = cell.config.arm
        yield Loaded(service, client, record, address, arm.stop_deceleration_rad_s2, arm.home)


def figure(service: Service, name: str) -> float:
    """One of the service's figures for monitoring."""
    text = httpx.get(f"{service.url}/metrics", timeout=60, trust_env=False).text
    match = re.search(rf"^{re.escape(name)} (\S+)$", text, re.MULTILINE)
    assert match is not None, name
    return float(match[1])


def last_event(service: Service) -> int:
    """Number of the newest event."""
    return int(figure(service, "lightpose_events_total"))


def wakeup_lateness(service: Service) -> dict[float, int]:
    """Wake-ups of the arm's driver by upper bound of their lateness, s: so many were late by at most this."""
    text = httpx.get(f"{service.url}/metrics", timeout=60, trust_env=False).text
    found = re.findall(r'^lightpose_driver_lateness_seconds_bucket\{le="(\S+)"\} (\S+)$', text, re.MULTILINE)
    return {float(bound): int(float(count)) for bound, count in found}


def completed(client: Client, recipe: Recipe) -> int:
    """Runs a session to its end, resuming where a busy machine has interrupted it; returns how often that was."""
    session_id, interruptions = client.create(recipe).id, 0
    client.start(session_id)
    while (session := client.wait(session_id)).state is not State.COMPLETED:
        assert session.state is State.INTERRUPTED, session.reason
        interruptions += 1
        client.acknowledge()
        client.resume(session_id)
    return interruptions


def acknowledge_what_is_latched(client: Client) -> int:
    """Does what an operator does after a stop that has cost the link to the arm; returns how often that was needed."""
    if client.rig().may_start:
        return 0
    deadline = time.monotonic() + 60
    while not client.rig().may_start:
        assert time.monotonic() < deadline, client.rig().reasons
        with suppress(ProblemError):  # refused as long as the link is away
            client.acknowledge()
        time.sleep(0.2)
    return 1


def becomes_fast(control: ControlClient, client: Client, session_id: str) -> bool:
    """Returns True when the arm moves in earnest; False when the session has been interrupted before."""
    deadline, look_at = time.monotonic() + MOVES_WITHIN_S, time.monotonic() + 1
    while max(map(abs, control.state()["joint_speeds"])) < 0.3:
        if time.monotonic() > look_at:
            session, look_at = client.session(session_id), time.monotonic() + 1
            if session.state is State.INTERRUPTED:
                return False
            assert time.monotonic() < deadline, f"the arm does not move: {session.state}, {session.reason}"
        time.sleep(0.005)
    return True


def came_to_rest(record: Path, since: float) -> float:
    """The controller's time (s) of the last tick after `since` with a joint faster than AT_REST_RAD_S."""
    with record.open("rb") as file:
        count = (file.seek(0, os.SEEK_END) - len(MAGIC)) // ROW.itemsize
        file.seek(len(MAGIC) + max(count - NEWEST_ROWS, 0) * ROW.itemsize)
        rows = np.frombuffer(file.read(min(count, NEWEST_ROWS) * ROW.itemsize), dtype=ROW)
    rows = rows[rows["time"] >= since]
    speeds = np.abs(np.diff(rows["joints"], axis=0)).max(axis=1) / np.diff(rows["time"])
    moving = np.flatnonzero(speeds > AT_REST_RAD_S)
    return float(rows["time"][moving[-1] + 1]) if len(moving) else since


@dataclass(frozen=True)
class Stopped:
    """One stop of a moving arm, by the controller's clock: from the request to rest, and how much of it the
    deceleration itself takes; s."""

    took_s: float
    decelerating_s: float

    @property
    def margin_s(self) -> float:
        """Time beyond the deceleration, s."""
        return self.took_s - self.decelerating_s


def stop_a_moving_arm(cell: Loaded, control: ControlClient, recipe: Recipe, trial: int) -> Stopped | None:
    """Starts a session, stops the cell in one of its moves.

    None where the arm was between two moves, or where the session was interrupted before its first one.
    """
    client = cell.client
    acknowledge_what_is_latched(client)
    session_id = client.create(recipe).id
    client.start(session_id)
    if not becomes_fast(control, client, session_id):
        client.stop(session_id)
        return None
    time.sleep(0.01 * (trial % 20))  # anywhere in a move
    state = control.state()
    client.halt()
    while client.session(session_id).state in (State.RUNNING, State.STOPPING, State.PAUSING):
        time.sleep(0.05)
    if client.session(session_id).state is State.INTERRUPTED:
        client.stop(session_id)
    time.sleep(0.2)
    speed = max(map(abs, state["joint_speeds"]))
    if speed < AT_REST_RAD_S:
        return None
    return Stopped(came_to_rest(cell.record, state["timestamp"]) - state["timestamp"], speed / cell.deceleration)
