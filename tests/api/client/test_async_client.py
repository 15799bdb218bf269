"""The asynchronous client: a session from creation to deletion, and concurrent event listeners."""

import asyncio
import json
import socket
import struct
import threading
import time
from collections.abc import Callable, Generator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager, suppress
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx
import pytest

from acquisition.models.errors import ErrorCode
from acquisition.models.problem_table import problem
from acquisition.models.recipe import Recipe
from acquisition.session_state import Actor, State, Trigger
from api import AsyncClient, Client, ProblemError
from api.client.transport import TIMEOUT_S
from api.rest.schemas import Problem


def test_async_client_session_from_creation_to_deletion(administered: Any) -> None:
    async def script() -> None:
        async with AsyncClient(administered.url, administered.key) as client:
            assert not (await client.rig()).may_start
            made = await client.create(Recipe(label="awaited"), idempotency_key="one")
            assert (await client.create(Recipe(label="awaited"), idempotency_key="one")).id == made.id
            assert [item.id async for item in client.sessions()] == [made.id]
            assert await client.stop(made.id) is State.STOPPED
            assert (await client.wait(made.id)).state is State.STOPPED
            assert [event.type for event in await client.past_events(made.id)] == ["session.created", "session.state"]
            assert await client.passes(made.id) == []
            assert await client.results(made.id) == []
            await client.halt()
            assert (await client.acknowledge()).faults == []
            await client.delete(made.id)
            with pytest.raises(ProblemError) as gone:
                await client.session(made.id)
            assert gone.value.code is ErrorCode.SESSION_NOT_FOUND

    asyncio.run(script())


def test_wait_ready_absent_rig_raises_reasons(shared: Any) -> None:
    async def script() -> None:
        async with AsyncClient(shared.url) as client:
            with pytest.raises(ProblemError) as missing:
                await client.wait_ready(timeout_s=0)
            assert missing.value.code is ErrorCode.RIG_NOT_READY

    asyncio.run(script())


def test_capture_stopped_by_somebody_raises_session_stopped(own: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Somebody stops the session between its start, which needs no arm here, and its end."""
    monkeypatch.setattr(own.client, "start", own.client.stop)

    with pytest.raises(ProblemError, match=r"operator@127.0\S+ stopped session \S+\. Look at the cell") as refused:
        own.client.capture(progress=False)

    assert refused.value.code is ErrorCode.SESSION_STOPPED
    (stopped,) = [event for event in own.client.past_events(one(own)) if event.type == "session.state"]
    assert stopped.body["by"]  # where the remedy says that it is


def test_capture_stopped_after_an_interruption_names_its_cause(own: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """As where the connection was away meanwhile: the session is already stopped when its events are read."""
    journal = own.service.store.journal

    def interrupted_then_stopped(session_id: str) -> None:
        journal.trigger(session_id, Trigger.START, "a")
        reason = problem(ErrorCode.ARM_PROTECTIVE_STOP, "The arm is in a protective stop")
        journal.trigger(session_id, Trigger.INTERRUPT, Actor.SERVICE, reason)
        journal.trigger(session_id, Trigger.STOP, "anna")

    monkeypatch.setattr(own.client, "start", interrupted_then_stopped)
    said = "anna stopped session .*, which was interrupted: arm.protective_stop: The arm is in a protective stop"
    with pytest.raises(ProblemError, match=said) as refused:
        own.client.capture(progress=False)
    assert refused.value.code is ErrorCode.SESSION_STOPPED


def one(service: Any) -> str:
    """The service's only session."""
    (session,) = service.client.sessions()
    return str(session.id)


def free_port() -> int:
    """A port of loopback at which nobody listens."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        return int(listening.getsockname()[1])


def test_wait_ready_without_service_waits_until_its_deadline() -> None:
    url, begun = f"http://127.0.0.1:{free_port()}", time.monotonic()
    with Client(url) as client, pytest.raises(ProblemError, match=f"{url} does not answer") as refused:
        client.wait_ready(timeout_s=0.5)
    assert time.monotonic() - begun > 0.5
    assert refused.value.code is ErrorCode.SERVICE_UNREACHABLE
    assert "lightpose serve" in refused.value.remedy


def test_wait_ready_silent_service_is_given_up_near_the_deadline() -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        url, begun = f"http://127.0.0.1:{silent.getsockname()[1]}", time.monotonic()
        with Client(url) as client, pytest.raises(ProblemError, match="timed out") as refused:
            client.wait_ready(timeout_s=0)
    assert refused.value.code is ErrorCode.SERVICE_UNREACHABLE
    assert time.monotonic() - begun < TIMEOUT_S


def test_wait_ready_with_an_address_of_another_kind_raises_at_once() -> None:
    with Client("127.0.0.1:8000") as client, pytest.raises(httpx.UnsupportedProtocol):
        client.wait_ready()


def test_wait_ready_service_that_comes_later_is_waited_for(shared: Any) -> None:
    """A ready rig is answered for, as nobody is at the arm's address."""
    ready = json.dumps({**shared.http.get("/v1/rig").json(), "may_start": True, "reasons": []}).encode()

    class Ready(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Length", str(len(ready)))
            self.end_headers()
            self.wfile.write(ready)

        def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the base class's name
            """Says nothing."""

    port = free_port()
    with Client(f"http://127.0.0.1:{port}") as client, ThreadPoolExecutor(1) as pool:
        waiting = pool.submit(client.wait_ready)
        time.sleep(0.5)
        assert not waiting.done()
        with HTTPServer(("127.0.0.1", port), Ready) as late:
            late.timeout = 60
            late.handle_request()
        assert waiting.result(60).may_start


def test_events_concurrent_listeners_miss_none_over_restart(start: Callable[..., AbstractContextManager[Any]]) -> None:
    async def listen(client: AsyncClient, count: int) -> list[int]:
        received: list[int] = []
        async for event in client.events(after=0):
            received.append(event.id)
            if len(received) == count:
                return received
        raise AssertionError

    async def script() -> None:
        with start() as running:
            port = int(running.url.rsplit(":", 1)[1])
            async with AsyncClient(running.url) as client:
                listeners = [asyncio.create_task(listen(client, 4)) for _ in range(8)]
                made = await client.create(Recipe())
                await client.stop(made.id)
                await asyncio.sleep(0.3)
                await asyncio.to_thread(running.client.close)
                running.server.should_exit = True
                await asyncio.to_thread(running.thread.join, 60)
                with start(port=port) as again:
                    made = await asyncio.to_thread(again.client.create, Recipe())
                    await asyncio.to_thread(again.client.stop, made.id)
                    heard = await asyncio.wait_for(asyncio.gather(*listeners), 90)
                assert heard == [heard[0]] * 8
                assert heard[0] == sorted(set(heard[0]))

    asyncio.run(script())


@contextmanager
def closing_the_first(url: str, reset: bool = False) -> Generator[str]:
    """The address of a relay to a service, which closes or resets its first connection once a request has come."""
    target = urlsplit(url)
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def relay() -> None:
            first, _ = listening.accept()
            with first:
                first.recv(1 << 16)
                if reset:
                    first.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                else:  # a body may come after its headers, and closing a socket with unread bytes resets it
                    first.shutdown(socket.SHUT_WR)
                    while first.recv(1 << 16):
                        pass
            with suppress(OSError):  # the end of the test
                second, _ = listening.accept()
                with second, socket.create_connection((str(target.hostname), int(target.port or 0))) as service:
                    service.sendall(second.recv(1 << 16).replace(b"keep-alive", b"close"))
                    while block := service.recv(1 << 16):
                        second.sendall(block)

        thread = threading.Thread(target=relay)
        thread.start()
        yield f"http://127.0.0.1:{listening.getsockname()[1]}"
        listening.shutdown(socket.SHUT_RDWR)
        thread.join(60)


@pytest.mark.parametrize("reset", [False, True])
def test_client_asks_again_where_a_connection_was_closed_meanwhile(own: Any, reset: bool) -> None:
    made = own.client.create()
    with closing_the_first(own.url, reset) as url, Client(url) as client:
        assert client.session(made.id).id == made.id


def test_client_repeats_a_stop_whose_connection_was_closed_meanwhile(own: Any) -> None:
    with closing_the_first(own.url, reset=True) as url, Client(url) as client:
        client.halt()
    assert own.client.safety().faults


def test_client_never_repeats_what_is_no_mere_question(own: Any) -> None:
    with closing_the_first(own.url) as url, Client(url) as client, pytest.raises(httpx.RemoteProtocolError):
        client.create()
    assert list(own.client.sessions()) == []


@pytest.mark.parametrize("call", ["dry_run", "replace_plan", "forecast_plan", "download"])
def test_client_waits_longer_for_what_is_computed(tmp_path: Path, call: str) -> None:
    """The time limit of any other request, here 0.2 s, is shorter than the answer takes."""

    class Computes(BaseHTTPRequestHandler):
        def answer(self) -> None:
            computed = self.path.endswith(".exr") or not self.path.endswith("/results/0")
            time.sleep(1.0 if computed else 0.0)
            body = json.dumps(PROBLEM if computed else RESULT).encode()
            self.send_response(409 if computed else 200)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        do_GET = do_POST = do_PUT = answer  # noqa: N815 - names of the base class

        def log_message(self, *_: Any) -> None:
            pass

    server = HTTPServer(("127.0.0.1", 0), Computes)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    calls: dict[str, Callable[[Client], Any]] = {
        "dry_run": lambda client: client.dry_run(Recipe()),
        "replace_plan": lambda client: client.replace_plan("x", 1, [(0.0, 0.0, -0.4)]),
        "forecast_plan": lambda client: client.forecast_plan("x", 1, [(0.0, 0.0, -0.4)]),
        "download": lambda client: client.download("x", 0, "maps.exr", tmp_path / "maps.exr"),
    }
    try:
        with Client(f"http://127.0.0.1:{server.server_port}") as client:
            client._http.timeout = 0.2  # pyright: ignore[reportPrivateUsage]
            with pytest.raises(ProblemError) as refused:
                calls[call](client)
        assert refused.value.code is ErrorCode.RIG_BUSY
    finally:
        server.shutdown()
        server.server_close()


PROBLEM = Problem.of(ErrorCode.RIG_BUSY, "A session is working").model_dump(mode="json")
RESULT = {
    "number": 0, "passes": [0], "created": "2026-11-30T12:00:00Z", "seconds": 1.0, "artefacts": [], "links": {},
    "summary": {
        "images": 4, "object_pixels": 9, "solved_pixels": 9, "mean_sigma_deg": 1.0, "median_sigma_deg": 1.0,
        "predicted_sigma_deg": None, "predicted_median_deg": None, "fewer_than_three_lights": 0.0,
        "intensity_factors": [], "noise": {},
    },
}  # fmt: skip
