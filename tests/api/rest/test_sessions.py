"""Sessions without a cell: created, listed, refused, deleted; the journal is the real one."""

import shutil
import signal
import socket
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import httpx
import pytest

from acquisition.devices.ur import tcp
from acquisition.models.errors import ErrorCode
from acquisition.models.recipe import Recipe
from acquisition.session_state import State, Trigger
from acquisition.store import folder as stored_folder
from api import ProblemError


def test_create_empty_body_or_object_uses_defaults(shared: Any) -> None:
    for content, headers in ((b"", {}), (b"{}", {"Content-Type": "application/json; charset=utf-8"})):
        answer = shared.http.post("/v1/sessions", content=content, headers=headers)

        assert answer.status_code == 201
        made = answer.json()
        assert answer.headers["location"] == made["links"]["self"] == f"/v1/sessions/{made['id']}"
        assert made["state"] == "created"
        assert made["stage"] == "pilot"
        assert made["progress"] == 0.0
        assert made["allowed_actions"] == ["start", "stop"]
        assert made["recipe"] == Recipe().model_dump(mode="json")
        assert made["answer"] is None
        assert made["arm"] == "This session does not use the arm."
        assert all(shared.http.get(link).status_code == 200 for name, link in made["links"].items() if name != "events")


def test_create_stores_recipe_as_requested(shared: Any) -> None:
    recipe = Recipe(
        method="user", user_lights=[(0.1, 0.2, 0.5), (0.0, 0.1, 0.5), (0.2, 0.0, 0.5)], label="Münze", retakes=0
    )

    made = shared.client.create(recipe)

    assert made.recipe == recipe
    assert shared.client.session(made.id).recipe == recipe


def test_create_same_idempotency_key_creates_one_session(own: Any) -> None:
    with ThreadPoolExecutor(4) as pool:
        made = [future.result() for future in [pool.submit(own.client.create, Recipe(), "key-1") for _ in range(8)]]

    assert len({item.id for item in made}) == 1
    again = own.http.post("/v1/sessions", headers={"Idempotency-Key": "key-1"})
    assert again.status_code == 200
    assert again.headers["location"] == f"/v1/sessions/{made[0].id}"
    with pytest.raises(ProblemError) as refused:
        own.client.create(Recipe(seed=1), "key-1")
    assert refused.value.code is ErrorCode.REQUEST_INVALID
    assert refused.value.context["session_id"] == made[0].id
    assert refused.value.context["errors"][0]["field"] == "Idempotency-Key"
    assert len(list(own.client.sessions())) == 1


def test_create_on_a_full_disk_leaves_nothing_and_the_key_unused(own: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as full:
        full.setattr(stored_folder, "RESERVED_BYTES", 1 << 60)
        refused = own.http.post("/v1/sessions", headers={"Idempotency-Key": "key-1"})

    assert (refused.status_code, refused.json()["code"]) == (507, ErrorCode.STORE_DISK_FULL)
    assert list(own.client.sessions()) == []
    assert list((own.service.store.data / "sessions").iterdir()) == []
    made = own.client.create(Recipe(), "key-1")
    assert (own.service.store.folder(made.id) / "recipe.json").is_file()
    assert own.client.create(Recipe(), "key-1").id == made.id


def test_action_on_an_ended_session_has_a_remedy_although_none_is_allowed(own: Any) -> None:
    made = own.client.create()
    own.client.stop(made.id)

    refused = own.http.post(f"/v1/sessions/{made.id}/actions", json={"action": "start"}).json()

    assert (refused["code"], refused["allowed"]) == (ErrorCode.SESSION_ACTION_NOT_ALLOWED, [])
    assert "allows nothing" in refused["detail"]
    assert "if not, " in refused["remedy"]


def test_create_unknown_kind_names_all_there_are(shared: Any) -> None:
    refused = shared.http.post("/v1/sessions", json={"kind": "foo"})

    assert refused.status_code == 422
    for kind in ("capture", "camera", "hand-eye", "lamp", "response", "check"):
        assert kind in refused.json()["detail"]
    assert shared.http.post("/v1/sessions", json={"kind": "capture"}).status_code == 201


def test_rig_states_version_of_software(shared: Any) -> None:
    assert shared.client.rig().version == shared.http.get("/openapi.json").json()["info"]["version"]


def test_sessions_list_is_paged(own: Any) -> None:
    made = [own.client.create(Recipe(seed=seed)) for seed in range(7)]

    first = own.http.get("/v1/sessions?limit=3").json()
    second = own.http.get(first["next"]).json()
    third = own.http.get(second["next"]).json()

    assert [item["id"] for page in (first, second, third) for item in page["items"]] == [x.id for x in reversed(made)]
    assert third["next"] is None
    assert own.http.get("/v1/sessions?limit=7").json()["next"] is None


def test_start_without_devices_is_refused_and_moves_nothing(shared: Any) -> None:
    made = shared.client.create()

    with pytest.raises(ProblemError) as refused:
        shared.client.start(made.id)

    assert refused.value.code is ErrorCode.ARM_UNREACHABLE
    assert refused.value.context["address"] == "127.0.4.1"
    assert shared.client.session(made.id).state is State.CREATED
    rig = shared.client.rig()
    assert not rig.may_start
    assert not rig.connected
    assert rig.arm is None
    assert rig.reading is None
    assert rig.reasons[0].code == ErrorCode.ARM_UNREACHABLE


def test_rig_names_each_absent_device(shared: Any) -> None:
    deadline = time.monotonic() + 60
    while (codes := {reason.code for reason in shared.client.rig().reasons}) != {
        ErrorCode.ARM_UNREACHABLE,
        ErrorCode.CAMERA_UNREACHABLE,
    }:
        assert time.monotonic() < deadline, codes
        time.sleep(0.1)


def test_health_ready_names_absent_device(shared: Any) -> None:
    assert shared.http.get("/health/live").json() == {"status": "ok"}

    answer = shared.http.get("/health/ready")

    assert answer.status_code == 503
    assert answer.json()["code"] == ErrorCode.RIG_NOT_READY
    assert answer.json()["reasons"]


@pytest.mark.parametrize("action", ["start", "pause", "resume"])
def test_action_on_ended_session_is_refused(shared: Any, action: str) -> None:
    made = shared.client.create()
    assert shared.client.stop(made.id) is State.STOPPED
    assert shared.client.stop(made.id) is State.STOPPED  # asking again is no error

    with pytest.raises(ProblemError) as refused:
        shared.client.act(made.id, action)

    assert refused.value.code is ErrorCode.SESSION_ACTION_NOT_ALLOWED
    assert refused.value.problem.status == 409
    assert refused.value.context["allowed"] == []
    assert shared.client.session(made.id).ended is not None


@pytest.mark.parametrize("body", [b"{}", b'{"action": "finish"}', b'{"action": "start", "force": true}', b""])
def test_action_unknown_is_refused(shared: Any, body: bytes) -> None:
    made = shared.client.create()

    answer = shared.http.post(made.links["actions"], content=body, headers={"Content-Type": "application/json"})

    assert answer.status_code == 422
    assert answer.json()["code"] == ErrorCode.REQUEST_INVALID
    assert shared.client.session(made.id).state is State.CREATED


def test_start_while_other_session_holds_rig_is_refused(administered: Any) -> None:
    first, second = administered.client.create(), administered.client.create()
    administered.service.store.journal.trigger(first.id, Trigger.START, "test")

    with pytest.raises(ProblemError) as refused:
        administered.client.start(second.id)

    assert refused.value.code is ErrorCode.RIG_BUSY
    assert refused.value.context["holder"] == first.id
    rig = administered.client.rig()
    assert rig.holder == first.id
    assert not rig.may_start
    with pytest.raises(ProblemError) as kept:
        administered.client.delete(first.id)
    assert kept.value.code is ErrorCode.SESSION_ACTION_NOT_ALLOWED


def test_result_before_solve_is_not_ready(shared: Any) -> None:
    made = shared.client.create()

    for path in ("results/0", "results/1", "results/1/normals.png"):
        answer = shared.http.get(f"/v1/sessions/{made.id}/{path}")
        assert answer.status_code == 409
        assert answer.json()["code"] == ErrorCode.RESULT_NOT_READY
        assert answer.json()["state"] == "created"
    assert shared.client.results(made.id) == []
    assert shared.client.passes(made.id) == []
    assert shared.http.get(f"/v1/sessions/{made.id}/results/2").status_code == 404  # there will be two at most
    shared.client.stop(made.id)
    assert shared.http.get(f"/v1/sessions/{made.id}/results/0").status_code == 404  # it will never come


def test_passes_and_shots_before_capture_are_not_found(shared: Any) -> None:
    made = shared.client.create()

    for path in ("passes/0", "passes/0/shots/0/image"):
        answer = shared.http.get(f"/v1/sessions/{made.id}/{path}")
        assert (answer.status_code, answer.json()["code"]) == (404, ErrorCode.REQUEST_NOT_FOUND)


def test_delete_removes_session_files(administered: Any) -> None:
    made = administered.client.create()
    folder = administered.service.store.folder(made.id)
    assert (folder / "recipe.json").is_file()

    administered.client.delete(made.id)

    assert not folder.exists()
    with pytest.raises(ProblemError) as gone:
        administered.client.session(made.id)
    assert gone.value.code is ErrorCode.SESSION_NOT_FOUND


def test_delete_ends_the_wait_for_a_session(administered: Any) -> None:
    made = administered.client.create()
    heard, gone = threading.Event(), threading.Event()

    def wait() -> None:
        with pytest.raises(ProblemError) as raised:
            administered.client.wait(made.id, lambda _: heard.set())
        assert raised.value.code is ErrorCode.SESSION_NOT_FOUND
        gone.set()

    waiting = threading.Thread(target=wait)
    waiting.start()
    assert heard.wait(60)
    administered.http.delete(f"/v1/sessions/{made.id}")
    waiting.join(60)
    assert gone.is_set()


def test_delete_session_with_missing_folder_succeeds(administered: Any) -> None:
    made = administered.client.create()
    shutil.rmtree(administered.service.store.folder(made.id))

    administered.client.delete(made.id)

    assert list(administered.client.sessions()) == []


def test_actions_list_actor_and_outcome(shared: Any) -> None:
    made = shared.client.create()
    shared.client.stop(made.id)
    with pytest.raises(ProblemError):
        shared.client.resume(made.id)

    answer = shared.http.get(made.links["actions"]).json()
    short = shared.http.get(f"{made.links['actions']}?limit=1").json()

    assert [(item["action"], item["outcome"]) for item in answer["items"]] == [
        ("stop", "stopped"),
        ("resume", "refused"),
    ]
    assert all(item["actor"].startswith("operator@127.") for item in answer["items"])
    assert shared.http.get(short["next"]).json()["items"] == answer["items"][1:]


def test_stop_at_rest_is_latched_until_acknowledged(shared: Any) -> None:
    assert shared.http.post("/v1/rig/stop").status_code == 202
    assert shared.http.post("/v1/rig/stop", json={"why": "because"}).status_code == 202
    safety = shared.client.safety()
    made = shared.client.create()
    refused = [
        shared.http.post(f"/v1/sessions/{made.id}/actions", json={"action": "start"}).json()["code"],
        shared.http.post("/v1/rig/park").json()["code"],
    ]

    assert [fault.code for fault in safety.faults] == [ErrorCode.SAFETY_SOFTWARE_STOP]
    assert "operator@127." in safety.faults[0].detail
    assert refused == [ErrorCode.SAFETY_NOT_ACKNOWLEDGED] * 2
    assert shared.client.acknowledge().faults == []
    assert shared.client.safety().faults == []


def test_acknowledgement_without_an_arm_says_not_that_it_is_clear(shared: Any) -> None:
    """Nobody is at the arm's address, so that a protective stop of the controller would not be known."""
    shared.client.halt()
    acknowledged = shared.client.acknowledge()

    assert (acknowledged.faults, acknowledged.connected, acknowledged.clear) == ([], False, False)
    assert shared.client.safety() == acknowledged


def test_stop_latch_outlives_the_service_until_acknowledged(start: Any) -> None:
    with start() as service:
        service.client.halt()
        service.client.acknowledge()
        service.client.halt()
    with start() as service:
        left = service.client.safety()
        service.client.acknowledge()
    with start() as service:
        cleared = service.client.safety()

    assert [fault.code for fault in left.faults] == [ErrorCode.SAFETY_SOFTWARE_STOP]
    assert cleared.faults == []


def test_stop_of_one_session_sets_no_latch(shared: Any) -> None:
    made = shared.client.create()
    assert shared.client.stop(made.id) is State.STOPPED
    assert shared.client.safety().faults == []


def test_safety_latched_fault_waits_for_acknowledgement(start: Any) -> None:
    with start() as service:
        service.service.store.journal.record_fault(ErrorCode.ARM_PROTECTIVE_STOP, "The arm hit something.")
    with start() as service:  # the latch outlives the service
        made = service.client.create()
        safety = service.client.safety()
        with pytest.raises(ProblemError) as refused:
            service.client.start(made.id)
        acknowledged = service.client.acknowledge()

    assert not safety.clear
    assert safety.faults[0].code is ErrorCode.ARM_PROTECTIVE_STOP
    assert safety.faults[0].remedy
    assert refused.value.code is ErrorCode.SAFETY_NOT_ACKNOWLEDGED
    assert refused.value.problem.status == 423
    assert acknowledged.faults == []


def test_service_answers_while_arm_is_silent(start: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """An address that accepts connections and never says a word, and more waiting starts than there are threads."""
    patience_s = tcp.PROBE_S
    monkeypatch.setattr(tcp, "PROBE_S", 60.0)  # until the other requests are answered, however busy the machine
    with socket.create_server(("127.0.4.3", 30004), backlog=50) as silent, ThreadPoolExecutor(12) as pool:
        silent.settimeout(60)
        with start(address="127.0.4.3") as service:
            made = service.client.create()
            waiting = [pool.submit(_start, service.url, made.id) for _ in range(10)]
            held = silent.accept()[0]  # a request for the devices is under way
            first = service.http.get("/v1/rig").status_code
            halted = service.http.post("/v1/rig/stop").status_code
            stopped = service.client.stop(made.id)
            # A start that comes after the stop is refused at once.
            answered_meanwhile = not all(future.done() for future in waiting)
            monkeypatch.setattr(tcp, "PROBE_S", patience_s)
            held.close()
            codes = {future.result(60) for future in waiting}

    assert (first, halted, stopped) == (200, 202, State.STOPPED)
    assert answered_meanwhile
    assert codes <= {
        ErrorCode.ARM_UNREACHABLE, ErrorCode.SESSION_ACTION_NOT_ALLOWED, ErrorCode.RIG_NOT_READY,
        ErrorCode.SAFETY_NOT_ACKNOWLEDGED,
    }  # fmt: skip


def test_start_waiting_for_devices_is_refused_at_shutdown(start: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    patience_s = tcp.PROBE_S
    monkeypatch.setattr(tcp, "PROBE_S", 60.0)  # the starts wait when the service ends, however busy the machine
    with (
        socket.create_server(("127.0.4.3", 30004), backlog=50) as silent,
        ThreadPoolExecutor(6) as pool,
        start(address="127.0.4.3") as service,
    ):
        made = service.client.create()
        waiting = [pool.submit(_post_start, service.url, made.id) for _ in range(4)]
        while len(service.server.server_state.tasks) < len(waiting):  # requests that are being served
            threading.Event().wait(0.01)
        held = silent.accept()[0]  # one asks for the devices, the others wait for it
        service.server.handle_exit(signal.SIGTERM, None)
        monkeypatch.setattr(tcp, "PROBE_S", patience_s)
        held.close()
        answers = [future.result(60).json() for future in waiting]

    assert {item["code"] for item in answers} <= {ErrorCode.RIG_NOT_READY, ErrorCode.ARM_UNREACHABLE}
    assert "The service is ending" in [item["detail"] for item in answers]


def test_stop_with_blocked_journal_halts_the_arm(own: Any) -> None:
    """A disk that hangs: the journal's lock is held for as long as the stop is tried."""
    journal, stuck, done = own.service.store.journal, threading.Event(), threading.Event()

    def hold() -> None:
        with journal._lock:
            stuck.set()
            done.wait(90)

    thread = threading.Thread(target=hold)
    thread.start()
    try:
        assert stuck.wait(60)
        answer = own.http.post("/v1/rig/stop", timeout=60)
        halted = own.service.runner._token.is_set()
    finally:
        done.set()
        thread.join()

    assert answer.status_code == 202
    assert halted


def _start(url: str, session_id: str) -> str:
    return _post_start(url, session_id).json()["code"]


def _post_start(url: str, session_id: str) -> httpx.Response:
    return httpx.post(f"{url}/v1/sessions/{session_id}/actions", json={"action": "start"}, timeout=60)
