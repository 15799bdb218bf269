"""What has stopped the cell while the disk was full: entered as soon as there is space, and no thread has ended."""

import sqlite3
import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.recipe import Recipe
from acquisition.session_state import ENDED, State, Trigger
from acquisition.store import Store
from tests.model.quick_rig import quick_service

ADDRESS = "127.0.6.40"
MOST_PAGES = 2**30


def announce_for_ever(store: Store, fill: str) -> None:
    """Writes events until that is refused."""
    while True:
        store.journal.announce(None, "filler", {"fill": fill})


@contextmanager
def full(store: Store) -> Generator[None]:
    """The journal may not grow, as on a full disk; SQLite itself says so."""
    connection: sqlite3.Connection = store.journal._connection  # pyright: ignore[reportPrivateUsage]
    connection.execute("PRAGMA max_page_count = 1")  # as many as there are
    for size in (3000, 300, 30, 1):
        with pytest.raises(RigError, match=str(ErrorCode.STORE_DISK_FULL)):
            announce_for_ever(store, "x" * size)
    yield
    connection.execute(f"PRAGMA max_page_count = {MOST_PAGES}")


def wait_for(condition: Callable[[], bool]) -> None:
    """Waits for what must come."""
    deadline = time.monotonic() + 90
    while not condition():
        assert time.monotonic() < deadline, "it did not happen"
        time.sleep(0.005)


def test_fault_on_a_full_disk_interrupts_once_there_is_space(tmp_path: Path) -> None:
    with quick_service(tmp_path, ADDRESS, with_keys=False) as (server, arm, _, _):
        store, runner = server.service.store, server.service.runner
        recipe = Recipe(pilot_lights=3, planned_lights=1, review_plan=True)
        session_id = runner.create(recipe)[0].id
        runner.act(session_id, Trigger.START, "a")
        wait_for(lambda: store.journal.session(session_id).state is State.PAUSED)
        with full(store):
            arm.stop_protectively()
            wait_for(lambda: runner.status().latched is not None)
            time.sleep(0.1)
            assert store.journal.session(session_id).state is State.PAUSED
            assert store.journal.unacknowledged_faults() == []
        wait_for(lambda: store.journal.unacknowledged_faults() != [])
        row = store.journal.session(session_id)
        assert row.state is State.INTERRUPTED
        assert row.reason is not None
        assert row.reason["code"] == "arm.protective_stop"
        arm.unlock()
        runner.acknowledge("a")
        runner.act(session_id, Trigger.RESUME, "a")
        wait_for(lambda: store.journal.session(session_id).state in {State.PAUSED, *ENDED})
        if store.journal.session(session_id).state is State.PAUSED:  # for the review
            runner.act(session_id, Trigger.RESUME, "a")
        wait_for(lambda: store.journal.session(session_id).state in ENDED)
        assert store.journal.session(session_id).state is State.COMPLETED


def test_stop_on_a_full_disk_ends_the_session_once_there_is_space(tmp_path: Path) -> None:
    with quick_service(tmp_path, ADDRESS, with_keys=False) as (server, _, _, _):
        store, runner = server.service.store, server.service.runner
        session_id = runner.create(Recipe(pilot_lights=3, planned_lights=1, review_plan=True))[0].id
        runner.act(session_id, Trigger.START, "a")
        wait_for(lambda: store.journal.session(session_id).state is State.PAUSED)
        with full(store):
            runner.halt("a")
            time.sleep(0.1)
            assert store.journal.unacknowledged_faults() == []
        wait_for(lambda: store.journal.session(session_id).state is State.STOPPED)
        wait_for(lambda: store.journal.unacknowledged_faults() != [])
        assert store.journal.unacknowledged_faults()[0]["code"] == "safety.software_stop"


def test_stop_while_somebody_acknowledges_stays_latched(tmp_path: Path) -> None:
    """The journal delays the acknowledgement, and the cell is stopped meanwhile: nobody has looked since that stop."""
    with quick_service(tmp_path, ADDRESS, with_keys=False) as (server, _, _, _):
        store, runner = server.service.store, server.service.runner
        runner.halt("a")
        wait_for(lambda: store.journal.unacknowledged_faults() != [])
        other = sqlite3.connect(store.data / "rig.db", isolation_level=None)
        other.execute("BEGIN IMMEDIATE")
        acknowledging = threading.Thread(target=lambda: runner.acknowledge("b"))
        acknowledging.start()
        time.sleep(0.2)
        runner.halt("c")
        other.execute("ROLLBACK")
        other.close()
        acknowledging.join(60)

        latch = runner.status().latched
        assert latch is not None
        assert latch.detail.startswith("c stopped")
        session_id = runner.create(Recipe())[0].id
        with pytest.raises(RigError, match=str(ErrorCode.SAFETY_NOT_ACKNOWLEDGED)):
            runner.act(session_id, Trigger.START, "b")
        wait_for(lambda: [one["detail"] for one in store.journal.unacknowledged_faults()] == [latch.detail])

        runner.acknowledge("b")
        assert runner.status().latched is None
        assert store.journal.unacknowledged_faults() == []


def test_session_stopped_on_a_full_disk_ends_once_there_is_space(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its stop is refused, because it cannot be entered, but it has been halted: it must not count as running."""
    with quick_service(tmp_path, ADDRESS, with_keys=False) as (server, arm, _, _):
        store, runner = server.service.store, server.service.runner
        compute: Any = runner._compute  # pyright: ignore[reportPrivateUsage]
        plan_route, planning, planned = compute._plan_route, threading.Event(), threading.Event()

        def waits(*known: Any) -> Any:
            planning.set()
            assert planned.wait(60)
            return plan_route(*known)

        monkeypatch.setattr(compute, "_plan_route", waits)
        session_id = runner.create(Recipe(pilot_lights=3, planned_lights=1))[0].id
        runner.act(session_id, Trigger.START, "a")
        assert planning.wait(60)
        with full(store):
            with pytest.raises(RigError, match=str(ErrorCode.STORE_DISK_FULL)):
                runner.act(session_id, Trigger.STOP, "a")
            planned.set()
            time.sleep(0.1)
        wait_for(lambda: store.journal.session(session_id).state is State.STOPPED)
        assert not arm.moves
        assert runner.act(session_id, Trigger.STOP, "a") is State.STOPPED
