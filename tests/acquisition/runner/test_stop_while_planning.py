"""Stops that come while a move is planned, or before the request for it: nothing moves by what was decided before."""

import sqlite3
import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.jog import JogMotion
from acquisition.models.recipe import Recipe
from acquisition.runner.compute import Compute
from acquisition.runner.runner import Runner
from acquisition.session_state import State, Trigger
from acquisition.store import Store
from tests.model.quick_rig import QuickArm, quick_service

ADDRESS = "127.0.6.44"
MOTION = JogMotion(joint=0, direction=1)
Quick = tuple[Runner, Store, QuickArm]


@pytest.fixture
def quick(tmp_path: Path) -> Generator[Quick]:
    with quick_service(tmp_path, ADDRESS, with_keys=False) as (server, arm, _, _):
        yield server.service.runner, server.service.store, arm


def wait_for(condition: Callable[[], Any]) -> None:
    """Waits for what must come."""
    deadline = time.monotonic() + 90
    while not condition():
        assert time.monotonic() < deadline, "it did not happen"
        time.sleep(0.005)


def parkings(store: Store) -> list[str]:
    """Outcomes of the ways home so far."""
    return [event.body["outcome"] for event in store.journal.events(0, types=("rig.parked",))]


@contextmanager
def parking_that_plans(runner: Runner, monkeypatch: pytest.MonkeyPatch) -> Generator[None]:
    """The way home is being planned; at the end its path is there."""
    planning, planned = threading.Event(), threading.Event()
    compute: Any = runner._compute  # pyright: ignore[reportPrivateUsage]
    plan_retreat = compute._plan_retreat

    def waits(*known: Any) -> Any:
        planning.set()
        assert planned.wait(60)
        return plan_retreat(*known)

    monkeypatch.setattr(compute, "_plan_retreat", waits)
    thread = threading.Thread(target=lambda: runner.moves.park("a"))
    thread.start()
    assert planning.wait(60)
    yield
    planned.set()
    thread.join(60)


def test_stop_while_the_way_home_is_planned_outlives_the_plan(quick: Quick, monkeypatch: pytest.MonkeyPatch) -> None:
    runner, store, arm = quick
    with parking_that_plans(runner, monkeypatch):
        runner.halt("b")
    wait_for(lambda: parkings(store))
    assert parkings(store) != ["at home"]
    assert not arm.moves


def test_fault_while_the_way_home_is_planned_ends_it_acknowledged_or_not(
    quick: Quick, monkeypatch: pytest.MonkeyPatch
) -> None:
    runner, store, arm = quick
    with parking_that_plans(runner, monkeypatch):
        arm.stop_protectively()
        wait_for(lambda: runner.status().latched is not None)
        arm.unlock()
        runner.acknowledge("b")
    wait_for(lambda: parkings(store))
    assert parkings(store) == ["halted"]
    assert not arm.moves


def test_tool_stated_while_the_way_home_is_planned_ends_it(quick: Quick, monkeypatch: pytest.MonkeyPatch) -> None:
    """The path is certified for the tool of before, and somebody stands at the arm who has just mounted another."""
    runner, store, arm = quick
    with parking_that_plans(runner, monkeypatch):
        runner.state_tool("board", "b")
    wait_for(lambda: parkings(store))
    assert parkings(store)[0].startswith("rig.changed")
    assert not arm.moves

    runner.moves.park("a")
    wait_for(lambda: len(parkings(store)) == 2)
    assert parkings(store)[1] == "at home"


def test_jog_whose_release_came_first_moves_nothing(quick: Quick) -> None:
    runner, _, arm = quick
    runner.moves.release("press-0001")
    with pytest.raises(RigError) as refused:
        runner.moves.jog("press-0001", MOTION, "a", once=False)
    assert refused.value.code is ErrorCode.ARM_JOG_ENDED
    assert not arm.moves


@contextmanager
def held_journal(folder: Path) -> Generator[None]:
    """Another program, such as a backup, holds the journal, and a request waits for it."""
    other = sqlite3.connect(folder / "rig.db", isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    yield
    other.execute("ROLLBACK")
    other.close()


def test_stop_of_a_session_halts_before_it_waits_for_the_journal(
    quick: Quick, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    runner, store, arm = quick
    session_id = runner.create(Recipe(pilot_lights=3, planned_lights=1, review_plan=True))[0].id
    runner.act(session_id, Trigger.START, "a")
    wait_for(lambda: store.journal.session(session_id).state is State.PAUSED)
    halted = threading.Event()
    monkeypatch.setattr(arm, "halt", halted.set)
    with held_journal(tmp_path / "data"):
        entry = threading.Thread(target=lambda: store.journal.announce(None, "filler", {}))
        entry.start()
        stop = threading.Thread(target=lambda: runner.act(session_id, Trigger.STOP, "a"))
        stop.start()
        assert halted.wait(60)
        assert stop.is_alive()
    entry.join(60)
    stop.join(60)
    wait_for(lambda: store.journal.session(session_id).state is State.STOPPED)


def test_journal_held_by_another_program_ends_no_thread(
    quick: Quick, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    runner, store, arm = quick
    connection: sqlite3.Connection = store.journal._connection  # pyright: ignore[reportPrivateUsage]
    connection.execute("PRAGMA busy_timeout = 100")
    with held_journal(tmp_path / "data"):
        arm.stop_protectively()
        wait_for(lambda: runner.status().latched is not None)
        with pytest.raises(RigError) as refused:
            store.journal.announce(None, "filler", {})
        assert refused.value.code is ErrorCode.STORE_UNWRITABLE
        arm.unlock()
        with pytest.raises(RigError) as refused:
            runner.acknowledge("a")
        assert refused.value.code is ErrorCode.STORE_UNWRITABLE
        assert runner.status().latched is not None
    wait_for(lambda: store.journal.unacknowledged_faults() != [])
    runner.acknowledge("a")
    assert runner.status().latched is None
    halted = threading.Event()
    monkeypatch.setattr(arm, "halt", halted.set)
    arm.stop_protectively()
    assert halted.wait(60)
    wait_for(lambda: runner.status().latched is not None)


def test_stop_that_waits_for_its_entry_is_entered_as_the_service_ends(tmp_path: Path) -> None:
    with quick_service(tmp_path, ADDRESS, with_keys=False) as (server, _, _, _):
        runner = server.service.runner
        busy, goes_on = threading.Event(), threading.Event()

        def work() -> None:
            busy.set()
            assert goes_on.wait(60)

        runner._requests.put(work)  # pyright: ignore[reportPrivateUsage]
        assert busy.wait(60)
        runner.halt("a")
        runner.begin_shutdown()
        goes_on.set()
    (fault,) = Store(tmp_path / "data").journal.unacknowledged_faults()
    assert fault["code"] == "safety.software_stop"


def test_resume_of_a_session_that_has_just_come_to_rest_runs_it(quick: Quick, monkeypatch: pytest.MonkeyPatch) -> None:
    runner, store, _ = quick
    session_id = runner.create(Recipe(pilot_lights=3, planned_lights=1, review_plan=True))[0].id
    runner.act(session_id, Trigger.START, "a")
    wait_for(lambda: store.journal.session(session_id).state is State.PAUSED)
    read = store.journal.session
    stale = [replace(read(session_id), state=State.PAUSING)]
    monkeypatch.setattr(store.journal, "session", lambda one: stale.pop() if stale else read(one))
    runner.act(session_id, Trigger.RESUME, "a")
    wait_for(lambda: read(session_id).state is State.COMPLETED)


def test_stop_of_a_session_behind_another_ones_job_is_entered_at_once(tmp_path: Path) -> None:
    """Somebody has asked for the reach, which takes a minute, and the session waits for its lights meanwhile."""
    with quick_service(tmp_path, ADDRESS, with_keys=False, compute=Compute()) as (server, _, _, _):
        runner, store = server.service.runner, server.service.store
        with runner._compute._busy:  # pyright: ignore[reportPrivateUsage]
            session_id = runner.create(Recipe())[0].id
            runner.act(session_id, Trigger.START, "a")
            runner.act(session_id, Trigger.STOP, "a")
            wait_for(lambda: store.journal.session(session_id).state is State.STOPPED)


def test_stop_that_is_slow_does_not_stop_the_next_session(quick: Quick, monkeypatch: pytest.MonkeyPatch) -> None:
    """The thread that stops a session is delayed after its entry, until the session has ended and another one runs."""
    runner, store, _ = quick
    first, second = (runner.create(Recipe(pilot_lights=3, planned_lights=1, review_plan=True))[0].id for _ in range(2))
    trigger, entered, goes_on = store.journal.trigger, threading.Event(), threading.Event()

    def delayed(session_id: str, what: Trigger, *others: Any, **more: Any) -> Any:
        states = trigger(session_id, what, *others, **more)
        if what is Trigger.STOP:
            entered.set()
            assert goes_on.wait(60)
        return states

    compute: Any = runner._compute  # pyright: ignore[reportPrivateUsage]
    plan_route, planned = compute._plan_route, threading.Event()

    def waits(*known: Any) -> Any:
        assert planned.wait(60)
        return plan_route(*known)

    monkeypatch.setattr(compute, "_plan_route", waits)
    runner.act(first, Trigger.START, "a")
    monkeypatch.setattr(store.journal, "trigger", delayed)
    stop = threading.Thread(target=lambda: runner.act(first, Trigger.STOP, "a"))
    stop.start()
    assert entered.wait(60)
    planned.set()
    wait_for(lambda: store.journal.session(first).state is State.STOPPED)
    planned.clear()
    runner.act(second, Trigger.START, "b")
    goes_on.set()
    stop.join(60)
    planned.set()
    wait_for(lambda: store.journal.session(second).state is State.PAUSED)  # for its review
