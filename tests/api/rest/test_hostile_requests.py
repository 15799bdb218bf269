"""Hostile requests: partial or malformed HTTP, path traversal, request smuggling, huge numbers."""

import json
import socket
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

import httpx
import pytest

from acquisition.models.errors import ErrorCode
from api.rest import http_protocol, request_checks

MEDIA_TYPE = "application/problem+json"


def raw(service: Any, request: bytes, within_s: float = 10.0) -> bytes:
    """Everything that the service answers to these bytes until it closes the connection."""
    host, port = service.url.removeprefix("http://").split(":")
    answer = b""
    with socket.create_connection((host, int(port)), within_s) as opened:
        opened.sendall(request)
        while part := opened.recv(1 << 16):
            answer += part
    return answer


def problem_in(answer: bytes) -> dict[str, Any]:
    head, _, body = answer.partition(b"\r\n\r\n")
    assert MEDIA_TYPE.encode() in head.lower()
    return json.loads(body)


@pytest.mark.parametrize(
    "request_bytes",
    [
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",  # a TLS greeting
        b"GET / SOMETHING\r\n\r\n",
        b"GET /v1/rig HTTP/1.1\r\nHost: localhost\r\nBad Header: x\r\n\r\n",
        b"GET /v1/rig HTTP/1.1\r\nHost: localhost\r\nHost: localhost\r\n\r\n",
        b"POST /v1/sessions HTTP/1.1\r\nHost: localhost\r\nContent-Length: 2\r\nContent-Length: 3\r\n\r\n{}",
        b"GET /v1/rig HTTP/1.1\r\nX-Long: " + b"a" * 80_000,
    ],
    ids=["tls", "version", "header", "two hosts", "two lengths", "endless header"],
)
def test_protocol_malformed_http_is_a_problem_object(shared: Any, request_bytes: bytes) -> None:
    answer = raw(shared, request_bytes)

    assert answer.startswith(b"HTTP/1.1 400 ")
    problem = problem_in(answer)
    assert problem["code"] == ErrorCode.REQUEST_INVALID
    assert problem["status"] == 400
    assert shared.http.get("/health/live").status_code == 200


def test_problem_long_address_is_truncated(shared: Any) -> None:
    answer = shared.http.get("/" + "a" * 60_000)

    assert answer.status_code == 404
    assert len(answer.content) < 2_000


def test_protocol_smuggled_request_is_not_served(shared: Any) -> None:
    """A length and chunks at once: HTTP lets the chunks hold, and what follows them is no body's rest."""
    before = len(shared.service.store.journal.sessions(200))

    answer = raw(
        shared,
        b"POST /v1/nothing HTTP/1.1\r\nHost: localhost\r\nContent-Length: 4\r\nTransfer-Encoding: chunked\r\n\r\n"
        b"0\r\n\r\nPOST /v1/sessions HTTP/1.1\r\nHost: evil.example\r\nContent-Length: 0\r\n\r\n",
    )

    assert b"201 Created" not in answer
    assert len(shared.service.store.journal.sessions(200)) == before


def test_protocol_slow_request_is_closed(
    start: Callable[..., AbstractContextManager[Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(http_protocol, "HEAD_TIMEOUT_S", 0.3)
    monkeypatch.setattr(request_checks, "BODY_TIMEOUT_S", 0.3)
    with start() as service:
        head = b"POST /v1/sessions HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"

        assert raw(service, head) == b""  # no request was there to be answered
        assert raw(service, b"") == b""
        problem = problem_in(raw(service, head + b'Content-Length: 50\r\n\r\n{"label":'))

        assert problem["code"] == ErrorCode.REQUEST_TIMEOUT
        assert service.service.store.journal.sessions(10) == []


def test_stop_beside_many_slow_connections_is_served(
    start: Callable[..., AbstractContextManager[Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(http_protocol, "HEAD_TIMEOUT_S", 1.0)
    with start() as service:
        host, port = service.url.removeprefix("http://").split(":")
        many = [socket.create_connection((host, int(port)), 60) for _ in range(200)]
        for opened in many:
            opened.sendall(b"GET /v1/rig HTTP/1.1\r\nX-")
        assert service.http.post("/v1/rig/stop").status_code == 202
        deadline = time.monotonic() + 60
        for opened in many:
            opened.settimeout(max(deadline - time.monotonic(), 0.1))
            assert opened.recv(100) == b""
            opened.close()


def test_protocol_slow_response_is_not_cut_off(
    start: Callable[..., AbstractContextManager[Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(http_protocol, "HEAD_TIMEOUT_S", 0.2)
    with start() as service, service.http.stream("GET", "/v1/events?after=0") as answer:
        parts = answer.iter_text()
        next(parts)
        time.sleep(0.6)
        made = service.client.create()
        text = ""
        while "session.created" not in text:
            text += next(parts)
        assert made.id in text


PLACES = (
    "/v1/sessions/{}",
    "/v1/sessions/{}/archive",
    "/v1/sessions/{}/log",
    "/v1/sessions/{}/region.png",
    "/v1/sessions/{}/passes/0/shots/0/image",
    "/v1/sessions/x/results/0/{}",
    "/problems/{}",
)


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize(
    "name", ["..", "../../rig.db", "..%2f..%2frig.db", "%2e%2e%2frig.db", "..%5crig.db", "%00", "rig.db%00.png", "~"]
)
def test_paths_with_traversal_are_refused(shared: Any, place: str, name: str) -> None:
    answer = raw(shared, f"GET {place.format(name)} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n".encode())

    assert answer.split(b" ")[1] in (b"404", b"422"), answer
    assert problem_in(answer)["code"] in (ErrorCode.REQUEST_NOT_FOUND, ErrorCode.SESSION_NOT_FOUND, "request.invalid")
    assert b"SQLite" not in answer


@pytest.mark.parametrize("header", ["Idempotency-Key", "X-Request-Id", "Authorization"])
def test_headers_with_injection_do_not_reach_response(shared: Any, header: str) -> None:
    head = "POST /v1/sessions HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n"
    request = f"{head}{header}: a%0d%0aX-Evil: 1\u0085\r\n\r\n"

    answer = raw(shared, request.encode("latin-1"))

    assert b"x-evil" not in answer.partition(b"\r\n\r\n")[0].lower()


def test_address_with_line_ends_adds_no_header(shared: Any) -> None:
    answer: httpx.Response = shared.http.get("/v1/nothing%0d%0aX-Evil:%201")

    assert answer.status_code == 404
    assert "x-evil" not in answer.headers


@pytest.mark.parametrize(
    "address",
    [
        f"/v1/sessions?limit={10**400}",
        f"/v1/sessions?after={10**400}",
        f"/v1/events?after={2**63}&follow=false",
        f"/v1/sessions/x/passes/{10**300}",
        f"/v1/sessions/x/results/{2**63}",
        f"/v1/sessions/x/passes/0/shots/{2**64}/image",
        "/v1/sessions?limit=١٢",  # digits that are no ASCII
        "/v1/sessions?limit=1e3",
    ],
)
def test_query_huge_and_odd_numbers_are_refused(shared: Any, address: str) -> None:
    answer = shared.http.get(address)

    assert answer.status_code in (404, 422)
    assert answer.headers["content-type"] == MEDIA_TYPE


def test_archive_session_id_is_that_of_the_service(own: Any) -> None:
    """Names in the zip are the session's id and what lies in its folder; a label cannot make one."""
    made = own.http.post("/v1/sessions", json={"label": '../../evil"\r\nX-Evil: 1', "notes": "\u202e/etc/passwd"})

    answer = own.http.get(f"{made.json()['links']['self']}/archive")

    assert answer.headers["content-disposition"] == f'attachment; filename="{made.json()["id"]}.zip"'
    assert "x-evil" not in answer.headers
    assert b"../" not in answer.content[:30]
