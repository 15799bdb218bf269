"""Compression (gzip) of text for callers that accept it; images and archives are compressed already.

An answer is compressed as a whole in a thread, because a page of several MB would block the event loop too long.
Streams are not compressed: an event must be sent at once. The compressed form has other bytes than the plain one, so
its ETag is a weak one (RFC 9110, 8.8.3). `If-None-Match` compares weakly, so that both forms match.
"""

import gzip

import anyio.to_thread
from anyio import CapacityLimiter
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

SMALLEST_BYTES = 1_000
"""Size below which compression saves less than a network's packet, bytes."""

LARGEST_BYTES = 32_000_000
"""Size above which an answer is not compressed, bytes, because compression holds it in memory as a whole."""

LEVEL = 5
"""Compression level. Levels of 6 and more take twice as long and save 2 % of the reach page."""

THREADS = 2

_TEXT = ("text/", "application/json", "application/problem+json", "image/svg+xml")
_STREAM = "text/event-stream"


class Compressed:
    """ASGI middleware that compresses text."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self._threads = CapacityLimiter(THREADS)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handles one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        asked = Headers(scope=scope)
        accepted = accepts_gzip(asked.get("accept-encoding", ""))
        held: Message | None = None
        body = bytearray()

        async def send_compressed(message: Message) -> None:
            nonlocal held
            if message["type"] == "http.response.start":
                headers = MutableHeaders(raw=message["headers"])
                if message["status"] == 304 and f"W/{headers.get('etag')}" in asked.get("if-none-match", ""):
                    headers["ETag"] = f"W/{headers['etag']}"  # the ETag of the compressed form, which the caller has
                if _is_text(headers):
                    headers.add_vary_header("Accept-Encoding")
                if accepted and _is_worth_it(headers):
                    held = message
                    return
            elif held is not None:
                body.extend(message.get("body", b""))
                if message.get("more_body", False):
                    return
                content = await anyio.to_thread.run_sync(gzip.compress, bytes(body), LEVEL, limiter=self._threads)
                headers = MutableHeaders(raw=held["headers"])
                headers["Content-Encoding"], headers["Content-Length"] = "gzip", str(len(content))
                etag = headers.get("etag", "")
                if etag and not etag.startswith("W/"):
                    headers["ETag"] = f"W/{etag}"
                await send(held)
                message = {"type": "http.response.body", "body": content}
            await send(message)

        await self._app(scope, receive, send_compressed)


def accepts_gzip(accept_encoding: str) -> bool:
    """Returns whether an `Accept-Encoding` header names gzip with a weight above 0."""
    for item in accept_encoding.lower().split(","):
        name, _, weight = item.partition(";")
        if name.strip() == "gzip":
            return weight.replace(" ", "").rstrip("0.") != "q="
    return False


def _is_text(headers: Headers) -> bool:
    media_type = headers.get("content-type", "")
    return media_type.startswith(_TEXT) and not media_type.startswith(_STREAM)


def _is_worth_it(headers: Headers) -> bool:
    if not _is_text(headers) or "content-encoding" in headers or "content-range" in headers:
        return False
    length = headers.get("content-length", "")
    return length.isdigit() and SMALLEST_BYTES <= int(length) <= LARGEST_BYTES
