"""Conditional GET (RFC 9110, If-None-Match) for every answer with an ETag; text without an ETag gets one.

A route states the ETag of what it sends; this module decides whether the caller has that content already. Where the
answer is expensive to make, the route calls `is_current` first. A resource is made for each request, and its ETag is
the hash of its text: it is made in any case, but sent only if it differs.
"""

import hashlib

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

KEPT = frozenset({"etag", "cache-control", "vary", "expires", "content-location", "date"})
"""Headers of an answer that a 304 repeats (RFC 9110, 15.4.5)."""

_HASHED = ("application/json", "text/plain", "text/html")
LARGEST_HASHED_BYTES = 4_000_000
"""Size above which a text gets no ETag here, bytes; hashing this size takes 5 ms of the event loop."""

_REVALIDATED = "private, no-cache"


class ConditionalGet:
    """ASGI middleware that answers 304 without a body where `If-None-Match` names the answer's ETag."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handles one request."""
        if scope["type"] != "http" or scope["method"] not in ("GET", "HEAD"):
            await self._app(scope, receive, send)
            return
        answer = _Answer(Headers(scope=scope).get("if-none-match", ""), send)
        await self._app(scope, receive, answer.send)


class _Answer:
    """One answer being sent: held until its ETag is known, and replaced by a 304 if the caller has it."""

    def __init__(self, wanted: str, send: Send) -> None:
        self._wanted, self._send = wanted, send
        self._held: Message | None = None
        self._body = bytearray()
        self._left_out = False

    async def send(self, message: Message) -> None:
        """Sends a message of the answer at once, later, or not at all."""
        if self._left_out:
            return
        if message["type"] == "http.response.start":
            headers = MutableHeaders(raw=message["headers"])
            if message["status"] == 200 and "etag" not in headers and _may_be_hashed(headers):
                self._held = message
            else:
                await self._begin(message)
        elif self._held is None:
            await self._send(message)
        else:
            self._body += message.get("body", b"")
            if not message.get("more_body", False):
                headers = MutableHeaders(raw=self._held["headers"])
                headers["ETag"] = f'W/"{hashlib.sha256(self._body).hexdigest()[:32]}"'
                headers.setdefault("Cache-Control", _REVALIDATED)
                await self._begin(self._held)
                if not self._left_out:
                    await self._send({"type": "http.response.body", "body": bytes(self._body)})

    async def _begin(self, start: Message) -> None:
        headers = MutableHeaders(raw=start["headers"])
        if start["status"] != 200 or not self._wanted or not is_current(self._wanted, headers.get("etag", "")):
            await self._send(start)
            return
        self._left_out = True
        kept = [pair for pair in headers.raw if _is_kept(pair[0])]
        await self._send({"type": "http.response.start", "status": 304, "headers": kept})
        await self._send({"type": "http.response.body", "body": b""})


def is_current(if_none_match: str, etag: str) -> bool:
    """Compares an `If-None-Match` header with an ETag by weak comparison (RFC 9110, 13.1.2)."""
    if not etag:
        return False
    return if_none_match.strip() == "*" or _opaque(etag) in map(_opaque, if_none_match.split(","))


def _may_be_hashed(headers: Headers) -> bool:
    length = headers.get("content-length", "")
    return (
        headers.get("content-type", "").startswith(_HASHED)
        and length.isdigit()
        and int(length) <= LARGEST_HASHED_BYTES
        and "no-store" not in headers.get("cache-control", "")
    )


def _opaque(tag: str) -> str:
    return tag.strip().removeprefix("W/")


def _is_kept(name: bytes) -> bool:
    return name.decode("latin-1").lower() in KEPT or name.lower().startswith(b"access-control-")
