"""Five hundred hostile inputs: bytes that are no HTTP, bodies that are no JSON, numbers and texts at the types' edges.

Made from lists and a seed, sent over raw sockets, as no HTTP library would. Each has to be answered below 500, or by a
fault that the description declares, or to be cut where it never was a whole request; none may be waited for in vain.
"""

import json
import random
import re
import socket
import struct
import time
import zlib
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

COUNT = 500
AT_ONCE = 16
WITHIN_S = 180.0
"""How long an answer is waited for, s: what does not arrive is cut after 10, a valid dry run waits for its turn."""

TEXTS = (
    '"\\u0000"', '"\\ud800"', '"\\udfff\\ud800"', '"' + "a" * 200_000 + '"', '"\\u202e\\u2066"', '"../../rig.db"',
    '"\\r\\nX-Evil: 1"', '"%00"', "\"'; DROP TABLE sessions;--\"", '"${jndi:ldap://x}"', '"\\ufeff"', '"\U0001f4a3"',
)  # fmt: skip
NUMBERS = (
    "1e400", "-1e400", "-0", "1e-400", str(2**63), str(-(2**63) - 1), "9" * 4000, "9" * 5000, "0." + "1" * 10_000,
    "1" + "0" * 308 + ".5", "NaN", "Infinity", "-Infinity", "0x10", "1_000", "01", "+1", ".5", "1.",
)  # fmt: skip
SHAPES = (
    "null", "true", "[]", "{}", "[[[[[]]]]]", "[" * 50_000 + "]" * 50_000, '{"a":' * 20_000 + "1" + "}" * 20_000,
    "[" + "0," * 100_000 + "0]", "[null]", '[{"a":[]}]', '["1"]', "[true]", "[1e400, 1e400, 1e400]",
    "[[1e308,1e308,1e308]]", "[[0,0,0]]", "[[0,0,-1e-320]]",
)  # fmt: skip
WHOLE_BODIES = (
    b"", b"{", b"}", b"[]", b"null", b'"text"', b"{}{}", b"\x00" * 100, b"\xff\xfe{\x00}\x00", b"\xef\xbb\xbf{}",
    b'{"label": "\xff\xfe"}', b'{"label": "a", "label": "b"}', b"{'label': 'a'}", b'{"label": "a",}', b"{" * 100_000,
    b"<xml/>", b'{"__proto__": {"x": 1}}', b'{"": 1}', b" " * 200_000 + b"{}", b"{}" + b" " * 300_000, b"\r\n\r\n",
)  # fmt: skip
MEDIA_TYPES = (
    "application/json", "application/json; charset=utf-16", "text/plain", "multipart/form-data; boundary=x",
    "application/x-www-form-urlencoded", "image/png", "", "application/json" * 300, "\u00e9/\u00e9",
)  # fmt: skip
PLACES = (
    "/", "//", "/v1//sessions", "/v1/sessions/", "/v1/sessions/%2e%2e/%2e%2e/rig.db", "/v1/sessions/..;/", "/%", "/%zz",
    "/v1/sessions/%00", "/v1/sessions/%ff%fe", "/v1/sessions/%ed%a0%80", "/v1/sessions/" + "a" * 8000, "/\u00e9",
    "/v1/sessions?limit=%00", "/v1/sessions?state=" + "x" * 5000, "/v1/sessions?since=9999-99-99T00:00:00Z",
    "/v1/sessions?since=0001-01-01T00:00:00Z", "/v1/sessions?until=9999-12-31T23:59:59.999999-23:59",
    "/v1/sessions?until=%2B10000-01-01T00:00:00Z", "/v1/sessions?since=1e308", "/v1/sessions?since=-1e18",
    "/v1/sessions?label=%00", "/v1/sessions?label=%ed%a0%80", "/v1/sessions?" + "&".join(["state=running"] * 500),
    "/v1/sessions?after=0", "/v1/sessions?limit=-1", "/v1/events?follow=false&after=-1", "/v1/events?follow=maybe",
    "/v1/events?follow=false&session_id=%00", "/v1/events?follow=false&type=%ed%a0%80", "/v1/rig/reach.exe",
    "/v1/events?follow=false&" + "&".join(f"type=t{number}" for number in range(300)), "/docs/../../../etc/passwd",
    "/v1/sessions/{id}/passes/0/shots/0/image?format=exe", "/v1/sessions/{id}/passes/0/shots/0/image?frame=%00",
    "/v1/sessions/{id}/passes/0/shots/0/thumbnail.jpg?width=0",
    "/v1/sessions/{id}/passes/0/shots/0/thumbnail.jpg?width=1e9",
    "/v1/sessions/{id}/results/0/%2e%2e%2fmanifest.json", "/v1/sessions/{id}/results/0/..%5c..%5crig.db",
    "/v1/sessions/{id}/results/0/manifest.json%00.png", "/v1/sessions/{id}/results/0/CON", "/v1/rig/scene/meshes/%00",
    "/v1/sessions/{id}/results/99999999999999999999", "/v1/sessions/{id}/passes/-1", "/problems/%00", "/metrics?x=%",
    "/v1/queue/entries/0", "/v1/queue/entries/99999999999999999999", "/v1/sessions/{id}/passes/0/lights/-1/gain.png",
    "http://evil.example/v1/rig", "*", "evil.example:80", "/v1/rig#fragment", "/v1/rig?ticket=%00",
    "/v1/rig?ticket=\u00ff",
)  # fmt: skip
METHODS = ("GET", "HEAD", "OPTIONS", "TRACE", "CONNECT", "PROPFIND", "get", "G\u00cbT", "POST", "DELETE", "X" * 5000)
HEADERS = (
    "Authorization: Bearer " + "a" * 10_000, "Authorization: Bearer \x80\xff", "Authorization: Basic AAAA",
    "Authorization:", "Authorization: Bearer", "Idempotency-Key: " + "k" * 300, "Idempotency-Key: \xff\xfe",
    "If-None-Match: " + ", ".join(['"a"'] * 3000), 'If-None-Match: W/"', "If-None-Match: *", "If-Modified-Since: never",
    "Range: bytes=0-0,1-1,2-2," + ",".join(f"{n}-{n}" for n in range(500)), "Range: bytes=99999999999999999999-",
    "Range: bytes=-0", "Accept: " + "text/html;q=0.1," * 2000, "Accept: \xff", "Accept-Encoding: gzip;q=NaN",
    "Accept-Encoding: identity;q=0, *;q=0", "Last-Event-ID: -1", "Last-Event-ID: " + "9" * 100, "Last-Event-ID: \xff",
    "X-Forwarded-For: " + "1.1.1.1, " * 1000, "X-Forwarded-Proto: javascript", "Forwarded: for=\"[::1\"", "Host: \xff",
    "Origin: null", "Origin: http://evil.example", "Sec-Fetch-Site: cross-site", "Cookie: " + "a=b; " * 2000,
    "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: AAAA\r\nSec-WebSocket-Version: 13",
    "Upgrade: h2c\r\nConnection: Upgrade, HTTP2-Settings\r\nHTTP2-Settings: AAMAAABk", "Expect: 100-continue",
    "Expect: the unexpected", "Content-Length: -1", "Content-Length: 1e3", "Content-Length: 99999999999999999999",
    "Content-Length: +5", "Transfer-Encoding: gzip, chunked", "Transfer-Encoding: chunked\r\nContent-Length: 5",
    "Content-Encoding: gzip", "Connection: close, keep-alive", "X-A: b\r\n folded", ": no name", "No colon",
    *("X-Many: 1\r\n" * number + "X-Last: 1" for number in (100, 1000)),
)  # fmt: skip
NO_HTTP = (
    b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03", b"\x00" * 1000, b"\r\n\r\n\r\n", b"SSH-2.0-OpenSSH_9.2\r\n",
    b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n", b"GET\r\n\r\n", b"GET /\r\n\r\n", b"GET / HTTP/9.9\r\n\r\n", b"\xff" * 5000,
    b"GET / HTTP/1.1\nHost: localhost\n\n", b"GET / HTTP/1.1\r\rHost: localhost\r\r", b"GET  /  HTTP/1.1\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n", b"GET / HTTP/1.1\r\n\r\n", b"POST /v1/rig/stop", b"{" * 1000,
    b"GET / HTTP/1.0\r\n\r\n", b"POST /v1/rig/stop HTTP/1.1\r\nHost: evil.example\r\n\r\n",
    b"GET / HTTP/1.1\r\nX: \x00\r\n\r\n",
    b"POST /v1/rig/stop HTTP/1.1\r\n" + b"X: 1\r\n" * 5000 + b"\r\n",
    b"GET /v1/rig HTTP/1.1\r\nX-Long: " + b"a" * 80_000,
)  # fmt: skip


@dataclass(frozen=True)
class Hostile:
    """One input: what it is, its bytes, and whether it is a whole request that deserves an answer."""

    name: str
    sent: bytes
    whole: bool = True


@dataclass(frozen=True)
class Outcome:
    """What an input was answered: the status (None: the connection was cut), and after how many seconds it ended."""

    hostile: Hostile
    status: int | None
    body: bytes
    seconds: float
    hung: bool


def inputs(description: Mapping[str, Any], session_id: str, key: str, seed: int = 22) -> list[Hostile]:
    """The inputs, in an order by the seed; `key` is an operator's.

    `description` is the OpenAPI description, whose routes and fields they go to.
    """
    draw = random.Random(seed)  # noqa: S311 - no secret
    made = [*_foreign_bytes(), *_places(key), *_headers(key), *_methods(key), *_chunks(key), *_pictures(key)]
    made += draw.sample(list(_bodies(description, key)), COUNT - len(made))
    draw.shuffle(made)
    return [Hostile(item.name, item.sent.replace(b"{id}", session_id.encode()), item.whole) for item in made]


def send(hostile: Hostile, host: str, port: int) -> Outcome:
    """Sends an input, and reads until the service closes the connection."""
    begun, answer, hung = time.monotonic(), b"", False
    with socket.create_connection((host, port), WITHIN_S) as opened:
        with suppress(OSError):  # refused before all of it was sent; the answer may be there all the same
            opened.sendall(hostile.sent)
        try:
            while part := opened.recv(1 << 16):
                answer += part
                if time.monotonic() - begun > WITHIN_S:
                    hung = True
                    break
        except TimeoutError:
            hung = True
        except OSError:
            pass
    if answer.startswith(b"HTTP/1.1 100 "):
        answer = answer.partition(b"\r\n\r\n")[2]
    head, _, body = answer.partition(b"\r\n\r\n")
    words = head.split(b" ", 2)
    status = int(words[1]) if len(words) > 1 and words[1].isdigit() else None
    return Outcome(hostile, status, body, time.monotonic() - begun, hung)


def send_all(hostile: Sequence[Hostile], host: str, port: int) -> list[Outcome]:
    """Sends all inputs, `AT_ONCE` at a time: what is never a whole request is cut by a time limit."""
    with ThreadPoolExecutor(AT_ONCE) as senders:
        return [sent.result() for sent in [senders.submit(send, item, host, port) for item in hostile]]


def _request(method: str, place: str, key: str, headers: str = "", body: bytes | None = None) -> bytes:
    head = f"{method} {place} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n"
    if "Authorization:" not in headers:
        head += f"Authorization: Bearer {key}\r\n"
    if body is not None and "Content-Length:" not in headers and "Transfer-Encoding:" not in headers:
        head += f"Content-Length: {len(body)}\r\n"
    head += f"{headers}\r\n" if headers else ""
    return (head + "\r\n").encode("latin-1", "backslashreplace") + (body or b"")


def _foreign_bytes() -> Iterator[Hostile]:
    yield from (Hostile(f"no HTTP: {item[:30]!r}", item, whole=False) for item in NO_HTTP)


def _places(key: str) -> Iterator[Hostile]:
    for place in PLACES:
        yield Hostile(f"GET {place[:60]}", _request("GET", place, key), whole=place.isascii())


def _headers(key: str) -> Iterator[Hostile]:
    for header in HEADERS:
        for place in ("/v1/rig", "/v1/sessions/{id}/results/0/manifest.json"):
            # A length that is stated and not sent, or a malformed head, is cut or refused.
            yield Hostile(f"{place} with {header[:40]!r}", _request("GET", place, key, header), whole=False)


def _methods(key: str) -> Iterator[Hostile]:
    for method in METHODS:
        for place in ("/v1/rig", "/v1/nothing"):
            yield Hostile(f"{method[:20]} {place}", _request(method, place, key), whole=False)


def _chunks(key: str) -> Iterator[Hostile]:
    bodies = (
        b"zz\r\n{}\r\n0\r\n\r\n", b"-1\r\n{}\r\n0\r\n\r\n", b"ffffffffffffffff\r\n{}", b"2\r\n{}",
        b"2;ext=1\r\n{}\r\n0\r\n\r\n",
        b"2\r\n{}\r\n0\r\nX-Trailer: 1\r\n\r\n", b"1\r\n{\r\n1\r\n}\r\n0\r\n\r\n",
        b"0\r\n\r\nGET /v1/rig HTTP/1.1\r\n\r\n",
        b"".join(b"1\r\n \r\n" for _ in range(20_000)) + b"2\r\n{}\r\n0\r\n\r\n", b"2\n{}\n0\n\n",
    )  # fmt: skip
    headers = "Content-Type: application/json\r\nTransfer-Encoding: chunked"
    for number, body in enumerate(bodies):
        yield Hostile(f"chunks {number}", _request("POST", "/v1/queue/order", key, headers, body), whole=False)


def _pictures(key: str) -> Iterator[Hostile]:
    """Pictures for the region of interest: a bomb, truncated ones, sizes that lie."""
    signature = b"\x89PNG\r\n\x1a\n"
    pictures = [b"", signature, signature + b"\x00" * 100, b"GIF89a" + b"\x00" * 50, b"\xff\xd8\xff" + b"\x00" * 50]
    for width, height, depth, kind in (
        (2**31 - 1, 2**31 - 1, 8, 0), (0, 0, 8, 0), (50_000, 50_000, 1, 0), (1, 1, 16, 6), (96, 96, 3, 3),
        (20_000, 20_000, 8, 0),
    ):  # fmt: skip
        header = _chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, depth, kind, 0, 0, 0))
        packed = zlib.compress(b"\x00" * 10_000_000, 9)
        pictures += [signature + header + _chunk(b"IDAT", packed) + _chunk(b"IEND", b""), signature + header]
    for number, picture in enumerate(pictures):
        sent = _request("PUT", "/v1/sessions/{id}/region.png", key, "Content-Type: image/png", picture)
        yield Hostile(f"picture {number}", sent)


def _bodies(description: Mapping[str, Any], key: str) -> Iterator[Hostile]:
    """Bodies for every route that has one; the fields of its example replaced one by one."""
    for path, methods in description["paths"].items():
        for method, operation in methods.items():
            schema = operation.get("requestBody", {}).get("content", {}).get("application/json", {}).get("schema", {})
            name = schema.get("$ref", "").rpartition("/")[2]
            if not name:
                continue
            resource = description["components"]["schemas"][name]
            place, where = _filled(path), f"{method.upper()} {path}"
            for body in WHOLE_BODIES:
                sent = _request(method.upper(), place, key, "Content-Type: application/json", body)
                yield Hostile(f"{where} {body[:30]!r}", sent)
            for media_type in MEDIA_TYPES:
                sent = _request(method.upper(), place, key, f"Content-Type: {media_type}", b"{}")
                yield Hostile(f"{where} as {media_type[:30]!r}", sent, whole=media_type.isascii())
            example = (resource.get("examples") or [{}])[0]
            for field in resource["properties"]:
                for value in (*TEXTS, *NUMBERS, *SHAPES):
                    text = json.dumps({**example, field: "@"}).replace(f'"{field}": "@"', f'"{field}": {value}')
                    sent = _request(method.upper(), place, key, "Content-Type: application/json", text.encode())
                    yield Hostile(f"{where} {field}={value[:30]}", sent)


def _filled(path: str) -> str:
    return re.sub(r"\{(?!session_id)\w+\}", "0", path).replace("{session_id}", "{id}")


def _chunk(kind: bytes, content: bytes) -> bytes:
    checked = kind + content
    return struct.pack(">I", len(content)) + checked + struct.pack(">I", zlib.crc32(checked))


def problem_code(body: bytes) -> str | None:
    """The code of a problem object; None where the body is none."""
    try:
        value = json.loads(body)
    except ValueError:
        return None
    return value.get("code") if isinstance(value, dict) else None
