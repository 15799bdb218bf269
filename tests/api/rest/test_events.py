"""The event stream: replay, live events, reconnection, without lost events."""

import json
import re
import socket
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from itertools import islice
from pathlib import Path
from typing import Any, get_args

import pytest

from acquisition.models.errors import ErrorCode
from api import ProblemError
from api.rest import events as events_module
from api.rest.joint_readings import EVENT_TYPE


def ids(events: list[Any]) -> list[int]:
    return [event.id for event in events]


def announce(service: Any, count: int, session_id: str | None = None) -> None:
    for number in range(count):
        service.service.store.journal.announce(session_id, "shot.retaken", {"number": number})


def test_events_replay_begins_after_given_id(own: Any) -> None:
    announce(own, 5)

    assert ids(list(islice(own.client.events(after=0), 5))) == [1, 2, 3, 4, 5]
    assert ids(list(islice(own.client.events(after=3), 2))) == [4, 5]


def test_events_header_takes_precedence_over_query(own: Any) -> None:
    announce(own, 5)

    answer = own.http.get("/v1/events?after=1&follow=false", headers={"Last-Event-ID": "4"})

    assert answer.headers["content-type"].startswith("text/event-stream")
    lines = answer.text.splitlines()
    assert lines[:3] == ["retry: 1000", "id: 4", ""]
    assert lines[3:5] == ["id: 5", "event: shot.retaken"]
    data = json.loads(lines[5].removeprefix("data: "))
    assert data["id"] == 5
    assert data["body"] == {"number": 4}


def test_events_without_id_begin_now(own: Any) -> None:
    announce(own, 3)
    stream = own.client.events()
    with ThreadPoolExecutor(1) as pool:
        first = pool.submit(next, stream)
        while own.server._feed.listeners == 0:
            threading.Event().wait(0.01)
        announce(own, 1)
        assert first.result(60).id == 4


def test_events_filter_by_session_and_type(own: Any) -> None:
    one, other = own.client.create(), own.client.create()
    announce(own, 2, one.id)
    own.client.stop(other.id)

    assert [event.type for event in own.client.past_events(one.id)] == [
        "session.created",
        "shot.retaken",
        "shot.retaken",
    ]
    chosen = own.http.get("/v1/events?after=0&follow=false&type=session.state&type=shot.retaken").text
    assert chosen.count("event: shot.retaken") == 2
    assert chosen.count("event: session.state") == 1
    assert "session.created" not in chosen


def test_events_of_unknown_type_are_refused_naming_all_there_are(own: Any) -> None:
    """An empty stream would look like a rig where nothing happens."""
    refused = own.http.get("/v1/events?follow=false&type=session.state&type=session.stat")

    assert (refused.status_code, refused.json()["code"]) == (422, ErrorCode.REQUEST_INVALID)
    assert all(f"'{name}'" in refused.json()["detail"] for name in get_args(events_module.StreamType))
    every = "&".join(f"type={name}" for name in get_args(events_module.StreamType)[:20])
    assert own.http.get(f"/v1/events?follow=false&{every}").status_code == 200
    assert own.http.get("/v1/events?follow=false&type=arm.joints&joints=true").status_code == 200


def test_event_types_are_all_documented() -> None:
    page = (Path(__file__).parents[3] / "docs/reference/rest.md").read_text(encoding="utf-8")
    rows = page.partition("| type | meaning |\n")[2].partition("\n\n")[0].splitlines()
    documented = {name for row in rows for name in re.findall(r"`([a-z]+\.[a-z_]+)`", row.split("|")[1])}

    assert documented == set(get_args(events_module.StreamType)) - {EVENT_TYPE}


def test_events_of_unknown_session_are_refused_and_of_a_deleted_one_replayed(own: Any) -> None:
    made = own.client.create()
    own.service.store.journal.delete_session(made.id)

    assert [event.type for event in own.client.past_events(made.id)][-1] == "session.deleted"
    refused = own.http.get("/v1/events?follow=false&session_id=20261121-101500-ffffff")
    assert (refused.status_code, refused.json()["code"]) == (404, ErrorCode.SESSION_NOT_FOUND)
    with pytest.raises(ProblemError, match="20261121-101500-ffffff"):
        next(own.client.events("20261121-101500-ffffff"))
    for follow in (lambda: next(own.client.events(made.id + "a", after=1000)), lambda: own.client.wait(made.id + "a")):
        with pytest.raises(ProblemError) as lost:  # an id of another journal makes no difference
            follow()
        assert lost.value.code is ErrorCode.SESSION_NOT_FOUND


def test_events_more_than_a_batch_are_all_sent(own: Any) -> None:
    count = 2 * events_module.BATCH + 7
    announce(own, count)

    assert ids(list(islice(own.client.events(after=0), count))) == list(range(1, count + 1))


def test_events_of_session_are_followed_past_those_of_others(own: Any) -> None:
    made = own.client.create()
    stream = own.client.events(made.id, after=0)
    assert next(stream).type == "session.created"
    announce(own, 300)

    own.client.stop(made.id)

    assert next(stream).body["state"] == "stopped"


def test_events_quiet_stream_sends_keep_alive(own: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(events_module, "KEEP_ALIVE_S", 0.05)
    with own.http.stream("GET", "/v1/events") as answer:
        text = ""
        for part in answer.iter_text():
            text += part
            if text.count(": keep-alive\n\n") >= 2:
                break

    assert text.count(": keep-alive") >= 2


def test_events_concurrent_writers_and_stall_lose_none(own: Any) -> None:
    writers, each, listeners = 3, 60, 20
    host, port = own.url.removeprefix("http://").split(":")
    with socket.create_connection((host, int(port))) as stalled, ThreadPoolExecutor(listeners + writers) as pool:
        stalled.sendall(f"GET /v1/events?after=0 HTTP/1.1\r\nHost: {host}:{port}\r\n\r\n".encode())  # and never reads
        heard = [
            pool.submit(lambda: ids(list(islice(own.client.events(after=0), writers * each)))) for _ in range(listeners)
        ]
        for future in [pool.submit(announce, own, each) for _ in range(writers)]:
            future.result(30)
        assert all(future.result(30) == list(range(1, writers * each + 1)) for future in heard)


@pytest.mark.parametrize("query", ["type=arm.joints", "type=arm.joints&type=session.created", "joints=true"])
def test_events_of_type_joints_carry_readings(own: Any, query: str) -> None:
    own.client.create()
    ended = own.http.get(f"/v1/events?follow=false&after=0&{query}").text
    with own.http.stream("GET", f"/v1/events?{query}") as answer:
        text = ""
        for part in answer.iter_text():  # two, so that they come again and again
            text += part
            if text.count("event: arm.joints") == 2:
                break

    assert ended.count("event: arm.joints") == 1
    assert ("event: session.created" in ended) == (query != "type=arm.joints")


def test_client_events_resume_after_service_restart(start: Any) -> None:
    """The stream ends in good order when the service does; the generator connects again to the next one."""
    heard: list[int] = []
    three, five = threading.Event(), threading.Event()

    def listen(client: Any) -> None:
        for event in client.events(after=0):
            heard.append(event.id)
            if len(heard) == 3:
                three.set()
            if len(heard) == 5:
                five.set()
                return

    with start() as service:
        port = int(service.url.rsplit(":", 1)[1])
        client = type(service.client)(service.url)
        thread = threading.Thread(target=listen, args=(client,))
        thread.start()
        announce(service, 3)
        assert three.wait(60)
    with start(port=port) as service:
        announce(service, 2)
        assert five.wait(60)
    thread.join(60)
    client.close()

    assert heard == [1, 2, 3, 4, 5]


def test_events_disconnected_listeners_are_removed(own: Any) -> None:
    for _ in range(5):
        with own.http.stream("GET", "/v1/events?after=0") as answer:
            next(answer.iter_text())
    deadline = time.monotonic() + 60
    while own.server._feed.listeners:
        assert time.monotonic() < deadline
        announce(own, 1)
        time.sleep(0.02)


def test_events_stalled_client_delays_nobody_and_misses_none(own: Any) -> None:
    count, journal = 60, own.service.store.journal
    for number in range(count):
        journal.announce(None, "test.large", {"number": number, "filling": "x" * 100_000})
    host, port = own.url.removeprefix("http://").split(":")
    with socket.socket() as stalled:
        stalled.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        stalled.settimeout(60)
        stalled.connect((host, int(port)))
        stalled.sendall(f"GET /v1/events?after=0 HTTP/1.1\r\nHost: {host}:{port}\r\n\r\n".encode())
        for _ in range(20):  # others read and write meanwhile
            made = own.client.create()
            assert next(own.client.events(made.id, after=0)).type == "session.created"
        text = b""
        while text.count(b"event: session.created") < 20:
            part = stalled.recv(1 << 16)
            assert part
            text += part

    heard = [int(line.split()[1]) for line in text.decode().splitlines() if line.startswith("id: ")]
    assert heard == list(range(count + 21))  # the first says where the stream begins


def test_events_id_from_the_future_gets_a_reset(own: Any) -> None:
    announce(own, 3)

    answer = own.http.get("/v1/events?follow=false", headers={"Last-Event-ID": "1000"})
    blocks = answer.text.strip().split("\n\n")
    reset = dict(line.split(": ", 1) for line in blocks[0].splitlines())
    data = json.loads(reset["data"])
    stream = own.client.events(after=1000)
    first = next(stream)
    with ThreadPoolExecutor(1) as pool:
        following = pool.submit(next, stream)
        announce(own, 1)
        heard = following.result(60)

    assert (reset["id"], reset["event"]) == ("3", events_module.STREAM_RESET)
    assert (data["id"], data["session_id"], data["body"]) == (3, None, {"last_event_id": 1000})
    assert blocks[1:] == ["retry: 1000\nid: 3"]
    assert (first.type, first.id) == (events_module.STREAM_RESET, 3)
    assert heard.id == 4


def test_client_wait_with_reset_asks_the_session_itself(own: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    made = own.client.create()
    own.client.stop(made.id)
    stream = own.client.events
    monkeypatch.setattr(own.client, "events", lambda session_id, after: stream(session_id, 1000))

    assert own.client.wait(made.id).state == "stopped"
