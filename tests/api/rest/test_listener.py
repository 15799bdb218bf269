"""The listener: a stop is answered whatever the event loop does and however many connections are held open."""

import re
import resource
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Generator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from api.rest import capacity, http_protocol, keys
from api.rest.keys import Role
from api.rest.listener import Listener
from tests.api.conftest import write_cell
from tests.load.posters import posting

DESCRIPTORS = 1024
"""What a process gets without further ado."""
ADDRESS = "127.0.4.1"  # where nobody listens
ATTACKERS = "127.0.4.7"
STOP = "POST /v1/rig/stop HTTP/1.1\r\nHost: localhost\r\n{headers}\r\n"
GET = "GET {path} HTTP/1.1\r\nHost: localhost\r\n{headers}\r\n"
WITHIN_S = 60.0


@dataclass(frozen=True)
class Limited:
    """A service process that may open so many descriptors."""

    pid: int
    port: int
    log: Path
    viewer: str  # a viewer's secret

    @property
    def descriptors(self) -> int:
        """How many descriptors the process may open now (its soft limit)."""
        limits = Path(f"/proc/{self.pid}/limits").read_text(encoding="ascii")
        return int(re.search(r"^Max open files\s+(\d+)", limits, re.MULTILINE)[1])  # type: ignore[index]


@contextmanager
def limited_service(folder: Path, descriptors: int = DESCRIPTORS, soft_limit: int | None = None) -> Generator[Limited]:
    """A service process that may open so many descriptors, of which it has `soft_limit` when it starts."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    data, log = folder / "data", folder / "serve.log"
    secret = keys.add(keys.path_in(data), "a-viewer", Role.VIEWER)
    arguments = ["serve", "--cell", str(write_cell(folder, ADDRESS)), "--data", str(data), "--port", "0"]
    limit = f"ulimit -S -n {soft_limit or descriptors} && ulimit -H -n {descriptors}"
    with log.open("wb") as file:
        process = subprocess.Popen(
            ["sh", "-c", f'{limit} && exec "$@"', "sh", sys.executable, "-m", "api.cli", *arguments],
            stdout=file,
            stderr=file,
        )
    try:
        deadline = time.monotonic() + WITHIN_S
        while not (found := re.search(r"ready http://127\.0\.0\.1:(\d+)", log.read_text(encoding="utf-8"))):
            assert process.poll() is None, log.read_text(encoding="utf-8")
            assert time.monotonic() < deadline
            time.sleep(0.05)
        yield Limited(process.pid, int(found[1]), log, secret)
    finally:
        process.terminate()
        process.wait(60)
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def connect(port: int, source: str = ATTACKERS, host: str = "127.0.0.1") -> socket.socket:
    opened = socket.socket()
    opened.bind((source, 0))
    opened.settimeout(WITHIN_S)
    opened.connect((host, port))
    return opened


def stop(port: int, secret: str, source: str = ATTACKERS) -> float:
    """Stops the cell over a new connection; seconds to the answer."""
    begun = time.monotonic()
    with connect(port, source) as opened:
        opened.sendall(STOP.format(headers=f"Authorization: Bearer {secret}\r\n").encode())
        answer = opened.recv(4096)
    assert answer.startswith(b"HTTP/1.1 202 "), answer
    return time.monotonic() - begun


def told(what: str, delays_s: list[float]) -> None:
    p99_s = float(np.quantile(delays_s, 0.99, method="higher"))
    print(f"\n{what}: {len(delays_s)} stops, p50 {1e3 * np.median(delays_s):.1f} ms, p99 {1e3 * p99_s:.1f} ms")


def stops_beside_streams(service: Limited, stack: ExitStack, count: int) -> tuple[list[float], float]:
    """Stops the cell beside so many streams that its viewer asks for: delays of the answers, streams that are held."""
    headers = f"Authorization: Bearer {service.viewer}\r\n"
    for _ in range(count):
        stream = stack.enter_context(connect(service.port))
        stream.sendall(GET.format(path="/v1/events?after=0", headers=headers).encode())
    delays_s = [stop(service.port, service.viewer) for _ in range(20)]
    bearer = {"Authorization": f"Bearer {service.viewer}"}
    address = f"http://127.0.0.1:{service.port}/metrics"
    text = httpx.get(address, headers=bearer, timeout=WITHIN_S, trust_env=False).text
    return delays_s, float(re.search(r"^lightpose_event_listeners (\S+)$", text, re.MULTILINE)[1])  # type: ignore[index]


def test_stop_beside_1300_idle_connections_is_answered(tmp_path: Path) -> None:
    with limited_service(tmp_path, soft_limit=300) as service, ExitStack() as stack:
        for _ in range(1300):
            stack.enter_context(connect(service.port))
        delays_s = [stop(service.port, service.viewer) for _ in range(20)]
        size, descriptors = service.log.stat().st_size, service.descriptors

    told("1300 idle connections", delays_s)
    assert descriptors == DESCRIPTORS, "the service raises its limit at start"
    assert size < 20_000, service.log.read_text(encoding="utf-8")[-2000:]


def test_stop_beside_1300_event_streams_of_a_viewer_is_answered(tmp_path: Path) -> None:
    with limited_service(tmp_path) as service, ExitStack() as stack:
        delays_s, listeners = stops_beside_streams(service, stack, 1300)
        size = service.log.stat().st_size

    told("1300 event streams asked for", delays_s)
    assert 0 < listeners <= capacity.of_descriptors(DESCRIPTORS).streams_per_caller
    assert size < 1_000_000


def test_stop_with_blocked_event_loop_is_answered(start: Callable[..., AbstractContextManager[Any]]) -> None:
    blocked, done = threading.Event(), threading.Event()

    def block() -> None:
        blocked.set()
        done.wait(WITHIN_S)

    with start() as service:
        service.server.loop.call_soon_threadsafe(block)
        assert blocked.wait(WITHIN_S)
        try:
            answer = httpx.post(f"{service.url}/v1/rig/stop", timeout=WITHIN_S, trust_env=False)
            halts = service.service.runner.halts
        finally:
            done.set()

    assert (answer.status_code, halts) == (202, 1)
    assert answer.json()["links"]["rig"] == "/v1/rig"


def raw(service: Any, *parts: bytes) -> bytes:
    """Sends parts of a request, each when the one before has arrived; all that is answered."""
    host, port = service.url.removeprefix("http://").split(":")
    with connect(int(port), host=host) as opened:
        for part in parts:
            opened.sendall(part)
            time.sleep(0.02)
        answer = b""
        while block := opened.recv(4096):
            answer += block
    return answer


def test_stop_that_arrives_in_pieces_is_carried_out_once(shared: Any) -> None:
    before = shared.service.runner.halts
    request = STOP.format(headers="X-A: b\r\n").encode()
    answer = raw(shared, *(request[at : at + 9] for at in range(0, len(request), 9)))

    assert answer.startswith(b"HTTP/1.1 202 ")
    assert shared.service.runner.halts == before + 1


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ("Origin: http://evil.example\r\n", b"403"),
        ("Host: evil.example\r\n", b"400"),  # a second one
        ("Broken\r\n", b"400"),
    ],
)
def test_stop_that_the_listener_leaves_is_answered(shared: Any, headers: str, status: bytes) -> None:
    answer = raw(shared, STOP.format(headers=f"Connection: close\r\n{headers}").encode())
    assert answer.split()[1] == status


@pytest.mark.parametrize(
    ("kind", "body"),
    [
        ("application/json", b"{}"),
        ("application/x-www-form-urlencoded", b"{}"),  # curl -d '{}'
        ("", b"garbage"),
        ("application/json", b"{"),
        ("text/plain", 300_000 * b"x"),
    ],
)
@pytest.mark.parametrize("path", ["/v1/rig/stop", "/v1/rig/stop/"])
@pytest.mark.parametrize("opened_before", [False, True], ids=["new", "open"])
def test_stop_with_any_body_is_carried_out(shared: Any, path: str, kind: str, body: bytes, opened_before: bool) -> None:
    before = shared.service.runner.halts
    with httpx.Client(base_url=shared.url, timeout=WITHIN_S, trust_env=False) as http:
        if opened_before:
            assert http.get("/health/live").status_code == 200
        stopped = http.post(path, content=body, headers={"Content-Type": kind} if kind else {})
        halts = shared.service.runner.halts
        foreign = http.post(path, content=body, headers={"Origin": "http://evil.example"})

    assert (stopped.status_code, halts) == (202, before + 1)
    assert foreign.status_code == 403
    assert shared.service.runner.halts == halts


def test_stop_whose_body_never_comes_is_carried_out(shared: Any) -> None:
    before = shared.service.runner.halts
    host, port = shared.url.removeprefix("http://").split(":")
    for path in ("/v1/rig/stop", "/v1/rig/stop/"):
        with connect(int(port), host=host) as opened:
            head = STOP.format(headers="Content-Length: 2\r\n").replace("/v1/rig/stop", path)
            opened.sendall(head.encode())
            assert opened.recv(4096).startswith(b"HTTP/1.1 202 ")
    assert shared.service.runner.halts == before + 2


def test_connections_beyond_the_limit_are_refused_but_no_stop(
    start: Callable[..., AbstractContextManager[Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    small = replace(capacity.present(), connections=8, undecided=4)
    monkeypatch.setattr(capacity, "present", lambda: small)
    with start() as service, ExitStack() as stack:
        host, port = service.url.removeprefix("http://").split(":")
        first: list[socket.socket] = []
        for _ in range(6):
            first.append(opened := stack.enter_context(connect(int(port), host=host)))
            opened.sendall(GET.format(path="/v1/events?after=0", headers="").encode())
            assert opened.recv(4096).startswith(b"HTTP/1.1 200 ")
        refused = raw(service, GET.format(path="/health/live", headers="").encode())
        stopped = raw(service, STOP.format(headers="").encode())
        other = httpx.get(f"{service.url}/health/live", trust_env=False)
        first[0].close()
        until(lambda: service.server._listener.served < 7)

    assert refused.startswith(b"HTTP/1.1 503 ")
    assert b"retry-after: 5" in refused.lower()
    assert b"service.overloaded" in refused
    assert stopped.startswith(b"HTTP/1.1 202 ")
    assert other.status_code == 200  # from another address


def test_stream_that_nobody_reads_is_cut(
    start: Callable[..., AbstractContextManager[Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(http_protocol, "WRITE_TIMEOUT_S", 0.3)
    with start() as service:
        host, port = service.url.removeprefix("http://").split(":")
        opened = socket.socket()
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        opened.connect((host, int(port)))
        with opened:
            opened.sendall(GET.format(path="/v1/events?after=0", headers="").encode())
            until(lambda: service.server._feed.listeners == 1)
            big = {"text": "x" * 100_000}
            announced = 0
            while service.server._feed.listeners == 1:
                service.service.store.journal.announce(None, "test.event", big)
                announced += 1
                assert announced < 2000
                time.sleep(0.01)


def test_listener_is_joined_when_the_service_ends(start: Callable[..., AbstractContextManager[Any]]) -> None:
    with start() as service:
        listener: Listener = service.server._listener
    assert not listener._thread.is_alive()
    assert not listener._undecided


def until(true: Callable[[], bool]) -> None:
    deadline = time.monotonic() + WITHIN_S
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.01)


@pytest.mark.long
def test_stop_beside_1500_event_streams_and_many_descriptors(tmp_path: Path) -> None:
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    many = min(hard, 20_000)
    with limited_service(tmp_path, many) as service, ExitStack() as stack:
        delays_s, listeners = stops_beside_streams(service, stack, 1500)

    told(f"1500 event streams asked for, {many} descriptors; the first {1e3 * delays_s[0]:.1f} ms", delays_s)
    assert 0 < listeners <= capacity.of_descriptors(many).streams_per_caller
    assert float(np.quantile(delays_s, 0.99, method="higher")) <= 0.3


@pytest.mark.long
def test_stop_beside_idle_streaming_and_posting_clients_p99(tmp_path: Path) -> None:
    with limited_service(tmp_path) as service, ExitStack() as stack:
        port, log, secret = service.port, service.log, service.viewer
        headers = f"Authorization: Bearer {secret}\r\n"
        for number in range(5500):
            opened = stack.enter_context(connect(port))
            if number >= 5000:
                opened.sendall(GET.format(path="/v1/events?after=0", headers=headers).encode())
        stack.enter_context(posting(port, secret, 100))
        time.sleep(10)  # the log's burst is over
        begun, size = time.monotonic(), log.stat().st_size
        delays_s: list[float] = []
        for _ in range(200):
            delays_s.append(stop(port, secret, "127.0.0.1"))
            time.sleep(0.05)
        rate = (log.stat().st_size - size) / (time.monotonic() - begun) * 60

    told("5000 idle, 500 streams, 100 posting", delays_s)
    print(f"log: {rate / 1e6:.2f} MB a minute")
    assert float(np.quantile(delays_s, 0.99, method="higher")) <= 0.3
    assert rate <= 1e6
