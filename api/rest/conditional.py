"""Conditional GET (RFC 9110, If-None-Match) for every answer with an ETag, in one place.

A route states the ETag of what it sends; whether the caller has that already is no concern of the route. Where making
the answer is what costs, the route may ask `is_current` before it does.
"""

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

KEPT = frozenset({"etag", "cache-control", "vary", "expires", "content-location", "date"})
"""Headers of an answer that a 304 repeats (RFC 9110, 15.4.5)."""


class ConditionalGet:
    """ASGI middleware that answers 304 without a body where `If-None-Match` names the answer's ETag."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """One request."""
        wanted = Headers(scope=scope).get("if-none-match", "") if scope["type"] == "http" else ""
        if not wanted or scope["method"] not in ("GET", "HEAD"):
            await self._app(scope, receive, send)
            return
        replaced = False

        async def send_changed(message: Message) -> None:
            nonlocal replaced
            if message["type"] == "http.response.start" and message["status"] == 200:
                headers = MutableHeaders(raw=message["headers"])
                if is_current(wanted, headers.get("etag", "")):
                    replaced = True
                    kept = [pair for pair in headers.raw if _is_kept(pair[0])]
                    await send({"type": "http.response.start", "status": 304, "headers": kept})
                    await send({"type": "http.response.body", "body": b""})
            if not replaced:
                await send(message)

        await self._app(scope, receive, send_changed)


def is_current(if_none_match: str, etag: str) -> bool:
    """Weak comparison of an `If-None-Match` header with an ETag (RFC 9110, 13.1.2)."""
    if not etag:
        return False
    return if_none_match.strip() == "*" or _opaque(etag) in map(_opaque, if_none_match.split(","))


def _opaque(tag: str) -> str:
    return tag.strip().removeprefix("W/")


def _is_kept(name: bytes) -> bool:
    return name.decode("latin-1").lower() in KEPT or name.lower().startswith(b"access-control-")
