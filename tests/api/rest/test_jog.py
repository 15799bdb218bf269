"""Jogging over HTTP: who may, when it is refused, and what a press and its renewals do (`tests.model.quick_rig`)."""

import threading
import time
from collections.abc import Callable, Generator
from concurrent.futures import ThreadPoolExecutor
from itertools import count
from pathlib import Path
from typing import Any

import httpx
import pytest

from acquisition.models.recipe import Recipe
from acquisition.session_state import State, Trigger
from acquisition.store.queue_table import QueueState
from api import Client
from api.rest.keys import Role
from tests.model.quick_rig import JOG_WALL, quick_service

HOST = "127.0.4.16"
PRESSES = count()


class Bench:
    """A service over a quick rig, and an operator."""

    def __init__(self, server: Any, arm: Any, url: str, secrets: dict[Role, str]) -> None:
        self.service, self.arm, self.url, self.secrets = server.service, arm, url, secrets
        self.client = Client(url, key=secrets[Role.OPERATOR])

    def post(self, path: str, role: Role = Role.OPERATOR, **body: Any) -> httpx.Response:
        return httpx.post(
            self.url + path, json=body or None, headers={"Authorization": f"Bearer {self.secrets[role]}"}, timeout=60
        )

    def jog(self, hold: str | None = None, role: Role = Role.OPERATOR, **motion: Any) -> httpx.Response:
        body = {"hold": hold or press(), "joint": 0, "direction": 1, **motion}
        return self.post("/v1/rig/jog", role, **body)

    @property
    def turned(self) -> float:
        """How far the first joint is from home, rad."""
        return float(self.arm.reading.joints[0] - self.service.cell.arm.home[0])

    def outcomes(self, count: int) -> list[str]:
        """Outcomes of the jogs so far, once there are so many."""
        until(lambda: len(self.service.store.journal.events(0, types=("rig.jogged",))) >= count)
        return [event.body["outcome"] for event in self.service.store.journal.events(0, types=("rig.jogged",))]


def press() -> str:
    return f"press-{next(PRESSES):05}"


def until(wanted: Callable[[], Any]) -> None:
    deadline = time.monotonic() + 60
    while not wanted():
        assert time.monotonic() < deadline
        time.sleep(0.005)


@pytest.fixture
def bench(tmp_path: Path) -> Generator[Bench]:
    with quick_service(tmp_path, HOST) as (server, arm, url, secrets):
        made = Bench(server, arm, url, secrets)
        until(lambda: made.client.rig().may_start)
        yield made
        made.client.close()


def code(answer: httpx.Response) -> str:
    return f"{answer.status_code} {answer.json()['code']}"


def test_jog_renewed_goes_on_and_ends_without_renewal(bench: Bench) -> None:
    hold = press()
    answer = bench.jog(hold)
    assert answer.status_code == 202
    assert answer.json()["hold_s"] > 0
    until(lambda: bench.jog(hold).status_code != 202 or bench.turned > 0.01)  # ten steps and more

    assert bench.outcomes(1) in (["released"], ["waypoints.collision: the way is blocked by the wall"])
    rest = bench.turned
    assert rest > 0
    assert code(bench.jog(hold)).startswith(("409", "422"))
    assert bench.turned == rest
    event = bench.service.store.journal.events(0, types=("rig.jogged",))[-1]
    assert event.body["by"].startswith("operator@")
    assert event.body["joints"][0] == pytest.approx(bench.arm.reading.joints[0])


def test_jog_once_is_one_step_and_release_is_harmless(bench: Bench) -> None:
    assert bench.post("/v1/rig/jog/release").json()["moving"] is False
    assert bench.jog(once=True, direction=-1).status_code == 202
    assert bench.outcomes(1) == ["one step"]
    assert bench.turned == pytest.approx(-0.001)
    assert bench.post("/v1/rig/jog/release").status_code == 202


def test_jog_blocked_names_obstacle_and_ends_its_hold(bench: Bench) -> None:
    until(lambda: code(answer) == "422 waypoints.collision" if (answer := bench.jog(press())).is_error else False)

    hold = press()
    first, again = bench.jog(hold), bench.jog(hold)

    assert code(first) == code(again) == "422 waypoints.collision"
    assert "wall" in first.json()["detail"]
    assert bench.arm.reading.joints[0] <= JOG_WALL
    assert bench.jog(direction=-1, once=True).status_code == 202  # away from it


def test_jog_is_refused_while_session_holds_rig(bench: Bench) -> None:
    session = bench.client.create(Recipe(pilot_lights=3, planned_lights=1, review_plan=True))
    bench.client.start(session.id)
    until(lambda: bench.client.session(session.id).state is State.PAUSED)
    moves = len(bench.arm.moves)

    refused = bench.jog()

    assert code(refused) == "409 rig.busy"
    assert refused.json()["holder"] == session.id
    assert len(bench.arm.moves) == moves


def test_jog_is_refused_while_queue_runs(bench: Bench) -> None:
    bench.service.queue.close()  # else it would stop at once, since it is empty
    bench.service.store.journal.set_queue_status(QueueState.RUNNING, "test")

    refused = bench.jog()

    assert code(refused) == "409 rig.busy"
    assert "queue" in refused.json()["detail"]
    assert not bench.arm.moves


def test_jog_is_refused_until_fault_is_acknowledged(bench: Bench) -> None:
    bench.arm.stop_protectively()
    until(lambda: not bench.client.safety().clear)
    assert bench.jog().status_code == 423
    bench.arm.unlock()
    assert code(bench.jog()) == "423 safety.not_acknowledged"
    assert not bench.arm.moves
    bench.client.acknowledge()
    assert bench.jog(once=True, direction=-1).status_code == 202


def test_jog_after_stop_needs_another_press(bench: Bench) -> None:
    hold = press()
    bench.jog(hold, direction=-1)
    assert bench.post("/v1/rig/stop", Role.VIEWER).status_code == 202
    until(bench.service.runner.moves._jog.ended.is_set)
    rest = bench.turned

    assert [code(bench.jog(again, direction=-1)) for again in (hold, press())] == ["423 safety.not_acknowledged"] * 2
    bench.client.acknowledge()
    assert [code(bench.jog(hold, direction=-1)) for _ in range(3)] == ["409 arm.jog_ended"] * 3
    assert bench.turned == rest


def test_session_start_is_refused_while_somebody_jogs(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("acquisition.runner.operator_moves.HOLD_S", 30.0)  # the button is held
    session = bench.client.create(Recipe(pilot_lights=3, planned_lights=1))
    hold = press()
    assert bench.jog(hold, direction=-1).json()["moving"]

    start = bench.post(f"/v1/sessions/{session.id}/actions", action="start")
    park = bench.post("/v1/rig/park")
    viewer = bench.jog(hold, Role.VIEWER, direction=-1)
    other = bench.jog(press(), Role.ADMIN, direction=-1)
    released = bench.post("/v1/rig/jog/release")

    assert code(start) == code(park) == code(other) == "409 rig.busy"
    assert viewer.status_code == 403
    assert released.json()["moving"] is False
    assert bench.outcomes(1) == ["released"]
    assert bench.client.start(session.id) is State.RUNNING


def test_stop_and_release_do_not_wait_for_pauses(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pauses wait for a busy journal; a stop of a session halts the arm before it does."""
    session, limits, busy = bench.client.create(Recipe()), bench.service.limits, threading.Event()
    begun = list[Trigger]()

    def act(_: str, trigger: Trigger, actor: str, *, from_here: bool) -> State:
        begun.append(trigger)
        if trigger is Trigger.PAUSE:
            busy.wait(120)
        return State.STOPPED

    monkeypatch.setattr(bench.service.runner, "act", act)
    address = f"/v1/sessions/{session.id}/actions"
    with ThreadPoolExecutor(10) as pressed:
        pauses = [pressed.submit(bench.post, address, action="pause") for _ in range(9)]
        until(lambda: limits.stop.statistics().tasks_waiting or limits.pause.statistics().tasks_waiting)
        stop = pressed.submit(bench.post, address, action="stop")
        try:
            until(lambda: Trigger.STOP in begun)
            assert bench.post("/v1/rig/jog/release").status_code == 202
        finally:
            busy.set()
    assert {one.result().status_code for one in (*pauses, stop)} == {202}


@pytest.mark.parametrize(
    "wrong",
    [
        {"joint": 9},
        {"axis": "x"},
        {"joint": None},
        {"direction": 0},
        {"hold": "short"},
        {"step_rad": 0.5},
        {"speed": 3},
    ],
)
def test_jog_invalid_request_moves_nothing(bench: Bench, wrong: dict[str, Any]) -> None:
    body = {"hold": press(), "joint": 0, "direction": 1, **wrong}
    assert bench.post("/v1/rig/jog", **body).status_code == 422
    assert not bench.arm.moves
