"""Checks of every request before any route sees it: host, origin, authorisation, size, media type, well-formed JSON.

Even on loopback a web page must not move the arm. The Host header reveals a page that resolves its own name to this
machine (DNS rebinding), the Origin header any other page, and the media type a form. The checks run on the event loop,
take no lock and start no thread, so that a stop passes them at once.
"""

import asyncio
import json
import math
import time
from typing import Any, NoReturn

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from acquisition.models.errors import ErrorCode, RigError
from api.rest import problems
from api.rest.authentication import SAFE_METHODS, STOP_PATH, Authentication
from api.rest.settings import ServerSettings, is_loopback

MAX_BODY_BYTES = 262_144
"""Largest body, bytes; a recipe of 80 lights is below 10 kB."""

BODY_TIMEOUT_S = 10.0
"""Time limit for the arrival of a body, s."""

RETRY_AFTER_S = 1
"""Time after which a request refused because too many are in progress may be sent again, s."""

METHODS_WITH_BODY = frozenset({"POST", "PUT", "PATCH", "DELETE"})
"""Methods whose body has a meaning."""

VALID_UNTIL = "Valid-Until"
"""Header of a POST with the end of its validity, s since 1970 by this machine's clock. A request that a failed network
delivers a minute later is not carried out. A stop is never too late."""

STREAM_PATHS = frozenset({"/v1/events", "/v1/rig/preview.mjpeg"})
"""Addresses of streams, which are counted separately (`open_streams`)."""


class KnownPages:
    """The hosts by which the service may be called and the web pages that may call it."""

    def __init__(self, settings: ServerSettings) -> None:
        self._hosts = {settings.host.lower(), *settings.allowed_hosts}
        self._origins = set(settings.allowed_origins)

    def own(self, scope: Scope, headers: Headers) -> str:
        """Returns the origin of the service's own page as the caller reaches it."""
        return f"{scope.get('scheme', 'http')}://{headers.get('host', '')}".lower()

    def refuse_foreign(self, scope: Scope, headers: Headers) -> None:
        """Raises RigError request.foreign if the Host header names another host or another page sends the request."""
        host = headers.get("host", "")
        name = _without_port(host)
        arrived_at = (scope.get("server") or ("",))[0]  # an IP address: no foreign page can have it as its name
        if name not in self._hosts and not is_loopback(name) and name.strip("[]") != arrived_at:
            raise RigError(
                ErrorCode.REQUEST_FOREIGN,
                f"The Host header names {host[:100]!r}, which is not this service (LIGHTPOSE_ALLOWED_HOSTS)",
            )
        origin = headers.get("origin")
        if origin is not None and origin.lower() != self.own(scope, headers) and origin.lower() not in self._origins:
            raise RigError(
                ErrorCode.REQUEST_FOREIGN,
                f"The request comes from the page {origin[:100]!r} to {self.own(scope, headers)[:100]} "
                "(LIGHTPOSE_ALLOWED_ORIGINS; behind a TLS proxy LIGHTPOSE_TRUSTED_PROXIES)",
            )
        site = headers.get("sec-fetch-site", "none")
        if scope["method"] not in SAFE_METHODS and origin is None and site not in ("none", "same-origin"):
            raise RigError(ErrorCode.REQUEST_FOREIGN, f"The request comes from another page ({site[:20]})")


class RequestChecks:
    """ASGI middleware that answers a bad request with a problem object and passes on any other with its whole body."""

    def __init__(self, app: ASGIApp, pages: KnownPages, authentication: Authentication, most_requests: int) -> None:
        self._app = app
        self._pages = pages
        self._authentication = authentication
        self._most_requests = most_requests
        self._in_progress = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handles one request."""
        if scope["type"] != "http" or scope["path"] in STREAM_PATHS:
            await self._checked(scope, receive, send)
            return
        self._in_progress += 1
        try:
            await self._checked(scope, receive, send)
        finally:
            self._in_progress -= 1

    async def _checked(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        if scope["path"] == STOP_PATH + "/":
            scope["path"] = STOP_PATH  # a stop typed by hand with a trailing slash is accepted
        stops = scope["path"] == STOP_PATH and scope["method"] == "POST"
        try:
            self._pages.refuse_foreign(scope, headers)
            if self._in_progress > self._most_requests and not stops:
                raise RigError(
                    ErrorCode.SERVICE_OVERLOADED,
                    f"{self._most_requests} requests are already in progress",
                    limit=self._most_requests,
                    retry_after_s=RETRY_AFTER_S,
                )
            scope.setdefault("state", {})["caller"] = self._authentication.caller(scope, headers)
            try:
                async with asyncio.timeout(BODY_TIMEOUT_S):  # a stop's body is neither awaited nor read nor refused
                    body = b"" if stops else await _read_body(headers, receive)
            except TimeoutError as error:
                detail = f"The body was not complete within {BODY_TIMEOUT_S:g} s"
                raise RigError(ErrorCode.REQUEST_TIMEOUT, detail) from error
            if scope["method"] not in SAFE_METHODS and scope["path"] != STOP_PATH:
                _refuse_expired(headers)
            if body and scope["method"] in METHODS_WITH_BODY:  # with other methods a body changes nothing
                _refuse_malformed(scope, headers, body)
        except RigError as error:
            answer = problems.response(error.code, error.detail, error.context, scope["path"])
            answer.headers["Connection"] = "close"  # the rest of the body is not read
            if error.code is ErrorCode.REQUEST_UNAUTHENTICATED:
                answer.headers["WWW-Authenticate"] = "Bearer"
            await answer(scope, receive, send)
            return
        await self._app(scope, receive if stops else _replay(body, receive), send)


async def _read_body(headers: Headers, receive: Receive) -> bytes:
    length = headers.get("content-length", "0")
    if not length.isascii() or not length.isdigit() or int(length[:20]) > MAX_BODY_BYTES:
        raise _too_large()
    body = bytearray()
    while True:
        message = await receive()
        if message["type"] != "http.request":  # the client has disconnected; the route will notice
            return bytes(body)
        body += message.get("body", b"")
        if len(body) > MAX_BODY_BYTES:
            raise _too_large()
        if not message.get("more_body", False):
            return bytes(body)


def _too_large() -> RigError:
    detail = f"A body may have at most {MAX_BODY_BYTES} bytes"
    return RigError(ErrorCode.REQUEST_TOO_LARGE, detail, limit=MAX_BODY_BYTES)


def _refuse_expired(headers: Headers) -> None:
    stated = headers.get(VALID_UNTIL)
    if stated is None:
        return
    try:
        until = float(stated)
    except ValueError:
        until = math.nan
    if not 0 <= until < math.inf:
        message = f"{stated[:40]!r} is not a time in seconds since 1970"
        raise RigError(
            ErrorCode.REQUEST_INVALID, f"{VALID_UNTIL}: {message}", errors=[{"field": VALID_UNTIL, "message": message}]
        )
    late = time.time() - until
    if late > 0:
        raise RigError(ErrorCode.REQUEST_EXPIRED, f"It arrived {late:.1f} s after its {VALID_UNTIL} time", late_s=late)


def _refuse_malformed(scope: Scope, headers: Headers, body: bytes) -> None:
    media_type = headers.get("content-type", "").partition(";")[0].strip().lower()
    needed = "image/png" if scope["path"].endswith(".png") else "application/json"
    if media_type != needed:
        found = media_type[:80] or "missing"
        raise RigError(ErrorCode.REQUEST_MEDIA_TYPE, f"The body's Content-Type is {found}; this address takes {needed}")
    if needed == "image/png":
        return  # its route validates the image
    try:
        value: Any = json.loads(body, parse_constant=_refuse_constant)
    except (ValueError, RecursionError) as error:
        raise _invalid(f"The body is not JSON: {error}") from error
    if not isinstance(value, dict):
        raise _invalid("The body must be a JSON object")


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a number in JSON; leave the field out or give a finite number")


def _invalid(message: str) -> RigError:
    return RigError(ErrorCode.REQUEST_INVALID, message, errors=[{"field": "body", "message": message}])


def _replay(body: bytes, receive: Receive) -> Receive:
    delivered = False

    async def replay() -> Message:
        nonlocal delivered
        if not delivered:
            delivered = True
            return {"type": "http.request", "body": body, "more_body": False}
        return await receive()

    return replay


def _without_port(host: str) -> str:
    name, colon, port = host.lower().rpartition(":")
    return name if colon and port.isdigit() else host.lower()
