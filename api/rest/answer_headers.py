"""Generic HTTP behaviour of all routes: HEAD, OPTIONS, Allow, ranges, security headers, preflights.

A route states what GET answers. HEAD answers the same without a body, and the other allowed methods follow from the
routes. Unless an answer has its own headers, only the service's own page may use it, it loads and runs nothing when it
is opened, and browsers take it for what its media type states. A report contains scripts, so it runs in a sandbox
without the service's origin and can send no request in its reader's name.
"""

import asyncio
from collections.abc import Mapping
from typing import Any

from fastapi.middleware.cors import CORSMiddleware
from fastapi.responses import Response
from starlette.datastructures import Headers, MutableHeaders
from starlette.routing import Match
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from acquisition.models.errors import ErrorCode
from api.rest import problems

EXPOSED = ("Location", "ETag", "Retry-After", "Allow", "Content-Disposition", "X-Frame-Number")
"""Headers that an allowed page may read."""

CONTENT_SECURITY_POLICY = "default-src 'none'; frame-ancestors 'none'"
SANDBOX = (
    "sandbox allow-scripts allow-downloads allow-popups; default-src 'none'; script-src 'unsafe-inline'; "
    "style-src 'unsafe-inline'; img-src data: blob:; font-src data:; frame-ancestors 'none'"
)
"""Policy of HTML without one of its own: reports, drawings, pages of problems."""

METHODS = ("GET", "POST", "PUT", "PATCH", "DELETE")


def security_headers(foreign_pages: bool) -> dict[str, str]:
    """Returns the security headers of every answer that has none of its own, except HTML's policy.

    `foreign_pages` states whether the settings allow other pages, which show images of the service.
    """
    return {
        "Content-Security-Policy": CONTENT_SECURITY_POLICY,
        "X-Content-Type-Options": "nosniff",
        "Cross-Origin-Resource-Policy": "cross-origin" if foreign_pages else "same-origin",
        "Referrer-Policy": "no-referrer",
    }


class AnswerHeaders:
    """ASGI middleware that adds security headers where an answer has none of its own, except to a 304.

    A browser replaces the headers stored with the content by those of the 304, so a page or a report that is loaded
    again would get the policy of bare data.
    """

    def __init__(self, app: ASGIApp, defaults: Mapping[str, str]) -> None:
        """`defaults` are the headers of `security_headers`."""
        self._app = app
        self._defaults = defaults

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handles one request."""

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start" and message["status"] != 304:
                headers = MutableHeaders(raw=message.setdefault("headers", []))
                if headers.get("content-type", "").startswith("text/html"):
                    headers.setdefault("Content-Security-Policy", SANDBOX)
                for name, value in self._defaults.items():
                    headers.setdefault(name, value)
            await send(message)

        await self._app(scope, receive, send_with_headers if scope["type"] == "http" else send)


class HeadAsGet:
    """ASGI middleware that answers HEAD like GET without the body. A stream ends when its head has been sent."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handles one request."""
        if scope["type"] != "http" or scope["method"] != "HEAD":
            await self._app(scope, receive, send)
            return
        begun, asked = asyncio.Event(), False

        async def receive_until_begun() -> Message:
            nonlocal asked
            if not asked:
                asked = True
                return await receive()
            await begun.wait()
            return {"type": "http.disconnect"}

        async def send_head(message: Message) -> None:
            if message["type"] == "http.response.start":
                await send(message)
                begun.set()

        await self._app({**scope, "method": "GET"}, receive_until_begun, send_head)
        await send({"type": "http.response.body", "body": b""})


class AllowedMethods:
    """ASGI middleware that completes the Allow header of a 405, and answers OPTIONS with it."""

    def __init__(self, app: ASGIApp, routes: Any) -> None:
        self._app = app
        self._routes = routes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handles one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        if scope["method"] == "OPTIONS" and (methods := self._of(scope)):
            await Response(status_code=204, headers={"Allow": methods})(scope, receive, send)
            return

        async def send_allowed(message: Message) -> None:
            if message["type"] == "http.response.start" and message["status"] == 405:
                MutableHeaders(raw=message["headers"])["Allow"] = self._of(scope)
            await send(message)

        await self._app(scope, receive, send_allowed)

    def _of(self, scope: Scope) -> str:
        """Returns the methods of an address in the form of the Allow header; empty for an unknown address."""
        found = [
            method
            for method in METHODS
            if any(route.matches({**scope, "method": method})[0] is Match.FULL for route in self._routes)
        ]
        return ", ".join([*found, *(["HEAD"] if "GET" in found else []), "OPTIONS"]) if found else ""


class RefusedRanges:
    """ASGI middleware that answers a `Range` that cannot be served with a problem object, like other errors."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handles one request."""
        wanted = Headers(scope=scope).get("range", "") if scope["type"] == "http" else ""
        if not wanted:
            await self._app(scope, receive, send)
            return
        refused = False

        async def send_problem(message: Message) -> None:
            nonlocal refused
            if message["type"] == "http.response.start" and message["status"] in (400, 416):
                headers = Headers(raw=message["headers"])
                refused = not headers.get("content-type", "").startswith(problems.MEDIA_TYPE)
                if refused:
                    size = headers.get("content-range")
                    detail = f"The file cannot be sent by Range {wanted[:100]!r}"
                    answer = problems.with_status(message["status"], ErrorCode.REQUEST_INVALID, detail, scope["path"])
                    answer.headers.update({} if size is None else {"Content-Range": size})
                    await answer(scope, receive, send)
            if not refused:
                await send(message)

        await self._app(scope, receive, send_problem)


class Preflights(CORSMiddleware):
    """CORS for the allowed pages; preflights of other pages are refused with a problem object."""

    def preflight_response(self, request_headers: Headers) -> Response:
        """Returns the answer to a preflight."""
        answer = super().preflight_response(request_headers)
        if answer.status_code < 400:
            return answer
        origin = request_headers.get("origin", "")[:100]
        detail = f"The page {origin!r} may not call: {bytes(answer.body).decode()}"
        return problems.response(ErrorCode.REQUEST_FOREIGN, detail)
