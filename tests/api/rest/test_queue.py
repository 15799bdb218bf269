"""The queue over HTTP: order, a person's word before another object, trouble, halts, and restarts of the service.

Runner, journal and service are the real ones; arm, camera and jobs answer at once (`tests.model.quick_rig`).
"""

import time
from collections.abc import Callable, Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest

from acquisition.models.errors import ErrorCode
from acquisition.models.recipe import Recipe
from acquisition.session_state import State, Trigger
from acquisition.store import folder
from acquisition.store.queue_table import EntryState, QueueState
from api import Client, ProblemError
from api.rest.keys import Role
from api.rest.queue import QueueResource
from tests.model.quick_rig import QuickArm, quick_service

HOST = "127.0.4.15"
QUICK = Recipe(pilot_lights=3, planned_lights=1)
REVIEWED = Recipe(pilot_lights=3, planned_lights=1, review_plan=True)


@dataclass(frozen=True)
class Bench:
    """A service over a quick rig."""

    client: Client
    service: Any
    arm: QuickArm
    secrets: dict[Role, str]
    url: str

    def until(self, wanted: Callable[[QueueResource], bool]) -> QueueResource:
        """The queue once it is as wanted."""
        deadline = time.monotonic() + 60
        while not wanted(queue := self.client.queue()):
            assert time.monotonic() < deadline, queue
            time.sleep(0.01)
        return queue

    def stopped(self) -> QueueResource:
        """The queue once it has stopped."""
        return self.until(lambda queue: queue.state is QueueState.STOPPED)

    def in_review(self) -> str:
        """The session that waits for the review of its plan, once there is one."""
        deadline = time.monotonic() + 60
        while True:
            for session in self.client.sessions(state="paused"):
                if session.reason is not None and session.reason.code is ErrorCode.PLAN_TO_REVIEW:
                    return session.id
            assert time.monotonic() < deadline
            time.sleep(0.01)


@pytest.fixture
def bench(tmp_path: Path) -> Generator[Bench]:
    with quick_service(tmp_path, HOST, with_keys=False) as (server, arm, url, secrets), Client(url) as client:
        yield Bench(client, server.service, arm, secrets, url)


def states(queue: QueueResource) -> list[EntryState]:
    return [entry.state for entry in queue.entries]


def reason_of(queue: QueueResource) -> ErrorCode | None:
    return None if queue.reason is None else queue.reason.code


def test_queue_same_object_runs_sessions_one_after_another(bench: Bench) -> None:
    for recipe in (QUICK, Recipe(pilot_lights=3, planned_lights=2, label="own label")):
        bench.client.enqueue("coin", recipe)
    assert states(bench.client.queue()) == [EntryState.WAITING] * 2
    assert not bench.arm.moves  # adding begins nothing

    bench.client.act_on_queue("resume")
    queue = bench.stopped()

    assert queue.reason is None  # it is empty
    assert states(queue) == [EntryState.DONE] * 2
    sessions = [bench.client.session(entry.session_id or "") for entry in queue.entries]
    assert [session.state for session in sessions] == [State.COMPLETED] * 2
    assert [session.label for session in sessions] == ["coin", "own label"]
    assert sessions[0].ended is not None
    assert sessions[1].started is not None
    assert sessions[0].ended <= sessions[1].started


def test_queue_other_object_waits_for_a_person(bench: Bench) -> None:
    for name in ("coin", "vase"):
        bench.client.enqueue(name, QUICK)

    bench.client.act_on_queue("resume")
    queue = bench.until(lambda queue: reason_of(queue) is ErrorCode.QUEUE_OBJECT_TO_PLACE)
    moves = len(bench.arm.moves)
    time.sleep(0.6)  # longer than the queue's period: nothing begins by itself

    assert states(queue) == [EntryState.DONE, EntryState.WAITING]
    assert queue.next_object == "vase"
    assert queue.reason is not None
    assert "vase" in queue.reason.detail
    assert len(bench.arm.moves) == moves
    bench.client.act_on_queue("resume")
    assert states(bench.stopped()) == [EntryState.DONE] * 2


def test_queue_unattended_entry_begins_without_a_person(bench: Bench) -> None:
    bench.client.enqueue("coin", QUICK)
    bench.client.enqueue("vase", QUICK, unattended=True)

    bench.client.act_on_queue("resume")

    assert states(bench.stopped()) == [EntryState.DONE] * 2


def test_queue_review_of_plan_is_no_trouble(bench: Bench) -> None:
    for _ in range(2):
        bench.client.enqueue("coin", REVIEWED)
    bench.client.act_on_queue("resume")
    for _ in range(2):
        session_id = bench.in_review()
        assert bench.client.queue().state is QueueState.RUNNING
        bench.client.resume(session_id)
        bench.client.wait(session_id)

    assert states(bench.stopped()) == [EntryState.DONE] * 2


def test_queue_stopped_session_stops_queue_with_reason(bench: Bench) -> None:
    for _ in range(2):
        bench.client.enqueue("coin", REVIEWED)
    bench.client.act_on_queue("resume")
    first = bench.in_review()

    bench.client.stop(first)
    queue = bench.stopped()

    assert reason_of(queue) is ErrorCode.QUEUE_SESSION_ENDED
    assert queue.reason is not None
    assert first in queue.reason.detail
    assert states(queue) == [EntryState.FAILED, EntryState.WAITING]
    bench.client.act_on_queue("resume")
    assert bench.in_review() != first


def test_queue_protective_stop_stops_queue_until_resolved(bench: Bench) -> None:
    for _ in range(2):
        bench.client.enqueue("coin", REVIEWED)
    bench.client.act_on_queue("resume")
    session_id = bench.in_review()

    bench.arm.stop_protectively()
    queue = bench.stopped()

    assert reason_of(queue) is ErrorCode.ARM_PROTECTIVE_STOP
    assert states(queue) == [EntryState.RUNNING, EntryState.WAITING]
    with pytest.raises(ProblemError) as busy:
        bench.client.act_on_queue("resume")
    assert busy.value.code is ErrorCode.RIG_BUSY
    bench.arm.unlock()
    bench.client.acknowledge()
    bench.client.resume(session_id)
    while bench.client.session(session_id).state is not State.PAUSED:
        time.sleep(0.01)
    bench.client.resume(session_id)
    bench.client.wait(session_id)
    queue = bench.until(lambda queue: states(queue) == [EntryState.DONE, EntryState.WAITING])
    assert queue.state is QueueState.STOPPED  # resuming a session is no word about the queue
    bench.client.act_on_queue("resume")
    assert bench.in_review() != session_id


def test_queue_latched_fault_refuses_resume(bench: Bench) -> None:
    bench.client.enqueue("coin", QUICK)
    bench.arm.stop_protectively()
    while bench.client.safety().clear:
        time.sleep(0.01)
    bench.arm.unlock()

    with pytest.raises(ProblemError) as refused:
        bench.client.act_on_queue("resume")

    assert refused.value.code is ErrorCode.SAFETY_NOT_ACKNOWLEDGED
    assert bench.client.queue().state is QueueState.STOPPED
    assert not bench.arm.moves


def test_queue_halt_of_cell_stops_queue(bench: Bench) -> None:
    for _ in range(2):
        bench.client.enqueue("coin", REVIEWED)
    bench.client.act_on_queue("resume")
    first = bench.in_review()

    bench.client.halt()
    queue = bench.stopped()
    bench.until(lambda queue: states(queue) == [EntryState.FAILED, EntryState.WAITING])
    moves = len(bench.arm.moves)
    time.sleep(0.6)

    assert queue.reason is not None
    assert bench.client.session(first).state is State.STOPPED
    assert len(bench.arm.moves) == moves


def test_act_decided_before_a_halt_stops_again(bench: Bench) -> None:
    runner = bench.service.runner
    session = bench.client.create(QUICK)
    before = runner.halts
    bench.client.halt()
    bench.client.acknowledge()

    runner.act(session.id, Trigger.START, "queue", unless_halted_since=before)

    assert bench.client.wait(session.id).state is State.STOPPED
    assert not bench.service.store.journal.shots(session.id)


def test_queue_held_rig_stops_queue_and_keeps_entry(bench: Bench) -> None:
    other = bench.client.create(REVIEWED)
    bench.client.start(other.id)
    bench.in_review()
    bench.client.enqueue("coin", QUICK)

    bench.client.act_on_queue("resume")
    queue = bench.stopped()
    bench.client.stop(other.id)
    bench.client.act_on_queue("resume")

    assert reason_of(queue) is ErrorCode.RIG_BUSY
    assert states(queue) == [EntryState.WAITING]
    assert states(bench.stopped()) == [EntryState.DONE]


def test_queue_full_disk_stops_queue_and_leaves_no_session(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    bench.client.enqueue("coin", QUICK)
    with monkeypatch.context() as full:
        full.setattr(folder, "RESERVED_BYTES", 1 << 60)
        bench.client.act_on_queue("resume")
        stopped = bench.until(lambda queue: queue.reason is not None)
    assert reason_of(stopped) is ErrorCode.STORE_DISK_FULL
    assert states(stopped) == [EntryState.WAITING]
    assert list(bench.client.sessions()) == []

    bench.client.act_on_queue("resume")

    assert states(bench.until(lambda queue: states(queue) != [EntryState.WAITING]))[0] is not EntryState.FAILED
    assert states(bench.stopped()) == [EntryState.DONE]


def test_queue_paused_begins_no_further_session(bench: Bench) -> None:
    for _ in range(2):
        bench.client.enqueue("coin", REVIEWED)
    bench.client.act_on_queue("resume")
    session_id = bench.in_review()

    paused = bench.client.act_on_queue("pause")
    bench.client.resume(session_id)
    bench.client.wait(session_id)
    queue = bench.until(lambda queue: states(queue)[0] is EntryState.DONE)

    assert (paused.state, paused.reason) == (QueueState.STOPPED, None)
    assert states(queue) == [EntryState.DONE, EntryState.WAITING]


def test_queue_survives_restart_and_waits_for_a_person(tmp_path: Path) -> None:
    with quick_service(tmp_path, HOST, with_keys=False) as (server, arm, url, secrets), Client(url) as client:
        bench = Bench(client, server.service, arm, secrets, url)
        for name in ("coin", "coin", "vase"):
            client.enqueue(name, REVIEWED)
        client.act_on_queue("resume")
        session_id = bench.in_review()
    with quick_service(tmp_path, HOST, with_keys=False) as (server, arm, url, secrets), Client(url) as client:
        bench = Bench(client, server.service, arm, secrets, url)
        queue = client.queue()
        time.sleep(0.6)

        assert (queue.state, reason_of(queue)) == (QueueState.STOPPED, ErrorCode.SERVICE_RESTARTED)
        assert [(entry.object_name, entry.state) for entry in queue.entries] == [
            ("coin", EntryState.RUNNING), ("coin", EntryState.WAITING), ("vase", EntryState.WAITING),
        ]  # fmt: skip
        assert client.session(session_id).state is State.INTERRUPTED
        assert not arm.moves  # nothing has begun by itself
        with pytest.raises(ProblemError) as busy:
            client.act_on_queue("resume")
        assert busy.value.code is ErrorCode.RIG_BUSY
        client.stop(session_id)
        client.act_on_queue("resume")
        assert bench.in_review() != session_id


def test_queue_crash_before_start_begins_the_same_session(tmp_path: Path) -> None:
    """The entry says that its session has begun, and the session says that it has not."""
    with quick_service(tmp_path, HOST, with_keys=False) as (server, _, url, _), Client(url) as client:
        entry_id = client.enqueue("coin", QUICK).id
        journal = server.service.store.journal
        row, _ = server.service.runner.create(QUICK, f"lightpose-queue-{entry_id}")
        journal.set_queue_entry(journal.queue_entry(entry_id), EntryState.RUNNING, row.id)
    with quick_service(tmp_path, HOST, with_keys=False) as (server, arm, url, secrets), Client(url) as client:
        bench = Bench(client, server.service, arm, secrets, url)
        time.sleep(0.6)
        assert client.session(row.id).state is State.CREATED
        client.act_on_queue("resume")
        queue = bench.stopped()

        assert states(queue) == [EntryState.DONE]
        assert queue.entries[0].session_id == row.id
        assert len(list(client.sessions())) == 1


def test_queue_session_pruned_while_service_was_away_is_not_repeated(tmp_path: Path) -> None:
    with quick_service(tmp_path, HOST, with_keys=False) as (server, _, url, _), Client(url) as client:
        for name in ("coin", "coin"):
            client.enqueue(name, QUICK)
        journal = server.service.store.journal
        first = client.queue().entries[0].id
        row, _ = server.service.runner.create(QUICK)
        server.service.queue.close()  # the service ends before it sees that the session is over
        journal.set_queue_entry(journal.queue_entry(first), EntryState.RUNNING, row.id)
        journal.delete_session(row.id)
    with quick_service(tmp_path, HOST, with_keys=False) as (server, arm, url, secrets), Client(url) as client:
        bench = Bench(client, server.service, arm, secrets, url)
        queue = bench.until(lambda queue: states(queue)[0] is EntryState.FAILED)

        assert states(queue) == [EntryState.FAILED, EntryState.WAITING]
        assert not arm.moves
        client.act_on_queue("resume")
        assert states(bench.stopped()) == [EntryState.FAILED, EntryState.DONE]


def test_queue_entries_are_ordered_removed_and_idempotent(bench: Bench) -> None:
    http = httpx.Client(base_url=bench.url)
    made = [bench.client.enqueue(name, QUICK).id for name in ("a", "b", "c")]
    body = {"object_name": "d"}
    keyed = [http.post("/v1/queue/entries", json=body, headers={"Idempotency-Key": "k"}) for _ in range(2)]
    other = http.post("/v1/queue/entries", json={"object_name": "e"}, headers={"Idempotency-Key": "k"})
    fourth = keyed[0].json()["id"]

    assert [answer.status_code for answer in keyed] == [201, 200]
    assert keyed[1].json()["id"] == fourth
    assert keyed[0].headers["location"] == f"/v1/queue/entries/{fourth}"
    assert other.status_code == 422
    order = [fourth, *reversed(made)]
    answer = http.put("/v1/queue/order", json={"entries": order})
    assert [entry["object_name"] for entry in answer.json()["entries"]] == ["d", "c", "b", "a"]
    for wrong in ([], made, [*order, 99], [*order, fourth]):
        assert http.put("/v1/queue/order", json={"entries": wrong}).status_code == 422
    assert http.delete(f"/v1/queue/entries/{made[1]}").status_code == 204
    assert http.get(f"/v1/queue/entries/{made[1]}").status_code == 404
    assert [entry.object_name for entry in bench.client.queue().entries] == ["d", "c", "a"]
    for invalid in ({}, {"object_name": ""}, {"object_name": "x", "recipe": {"kind": "other"}}, {"name": "x"}):
        assert http.post("/v1/queue/entries", json=invalid).status_code == 422
    http.close()


def test_queue_running_entry_is_not_removed(bench: Bench) -> None:
    entry = bench.client.enqueue("coin", REVIEWED)
    bench.client.act_on_queue("resume")
    session_id = bench.in_review()

    refused = httpx.delete(f"{bench.url}/v1/queue/entries/{entry.id}")

    assert (refused.status_code, refused.json()["code"]) == (409, ErrorCode.QUEUE_ENTRY_BEGUN)
    bench.client.stop(session_id)
    bench.stopped()
    assert httpx.delete(f"{bench.url}/v1/queue/entries/{entry.id}").status_code == 204
    assert bench.client.session(session_id).state is State.STOPPED  # the session is kept


def test_queue_resumed_for_entry_that_is_not_next_is_refused(bench: Bench) -> None:
    coin, vase = (bench.client.enqueue(name, QUICK).id for name in ("coin", "vase"))
    with httpx.Client(base_url=bench.url) as http:
        http.put("/v1/queue/order", json={"entries": [vase, coin]})  # by somebody else, meanwhile
        refused = http.post("/v1/queue/actions", json={"action": "resume", "entry": coin})
        assert (refused.status_code, refused.json()["code"]) == (409, ErrorCode.QUEUE_OBJECT_TO_PLACE)
        assert refused.json()["object_name"] == "vase"
        assert not bench.arm.moves
        assert http.post("/v1/queue/actions", json={"action": "resume", "entry": vase}).status_code == 202

    assert states(bench.stopped()) == [EntryState.DONE, EntryState.WAITING]


def test_queue_empty_is_not_resumed(bench: Bench) -> None:
    with pytest.raises(ProblemError) as refused:
        bench.client.act_on_queue("resume")
    assert refused.value.code is ErrorCode.REQUEST_INVALID
    assert "detail" in refused.value.problem.remedy  # there is no field to correct
    assert bench.client.queue().changed is None
    bench.client.enqueue("coin", QUICK)
    assert bench.client.act_on_queue("resume").changed is not None


def test_queue_roles_operator_changes_viewer_looks(tmp_path: Path) -> None:
    with quick_service(tmp_path, HOST) as (_, _, url, secrets):
        clients = {
            role: httpx.Client(base_url=url, headers={"Authorization": f"Bearer {secrets[role]}"}) for role in Role
        }
        body = {"object_name": "coin"}
        assert clients[Role.VIEWER].post("/v1/queue/entries", json=body).status_code == 403
        made = clients[Role.OPERATOR].post("/v1/queue/entries", json=body)
        assert made.status_code == 201
        assert clients[Role.VIEWER].get("/v1/queue").json()["next_object"] == "coin"
        address = f"/v1/queue/entries/{made.json()['id']}"
        assert clients[Role.VIEWER].delete(address).status_code == 403
        assert clients[Role.VIEWER].post("/v1/queue/actions", json={"action": "resume"}).status_code == 403
        assert clients[Role.OPERATOR].delete(address).status_code == 204
        for client in clients.values():
            client.close()
