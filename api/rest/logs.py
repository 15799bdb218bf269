"""The service's log: a line for people or a JSON object for machines, with the session that each entry belongs to.

The code logs by the standard library; here it is only decided what an entry looks like. The session is context: who
works for one binds `session_id`, and every entry made meanwhile carries it, in whichever module. An address is logged
as it was sent, percent-encoded, so that no request can write lines of its own.
"""

import logging
import re
import sys
import time
from typing import Literal

import structlog
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from structlog.contextvars import bound_contextvars, merge_contextvars
from structlog.typing import Processor

LogForm = Literal["text", "json"]

_log = logging.getLogger(__name__)
_SESSION = re.compile(rb"^/v1/sessions/([0-9A-Za-z-]{1,80})(?:/|$)")
LONGEST_ADDRESS = 200


def configure(form: LogForm) -> None:
    """Makes this process log to its standard error in that form, from INFO upwards."""
    known: list[Processor] = [
        merge_contextvars,
        structlog.stdlib.add_log_level,
        structlog.stdlib.add_logger_name,
        structlog.stdlib.ExtraAdder(),
        structlog.processors.TimeStamper(fmt="iso", utc=True),
    ]
    last: list[Processor] = (
        [structlog.processors.format_exc_info, structlog.processors.JSONRenderer(ensure_ascii=False)]
        if form == "json"
        else [structlog.dev.ConsoleRenderer(colors=False, pad_event_to=0)]
    )
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(
        structlog.stdlib.ProcessorFormatter(
            foreign_pre_chain=known, processors=[structlog.stdlib.ProcessorFormatter.remove_processors_meta, *last]
        )
    )
    logging.basicConfig(level=logging.INFO, handlers=[handler], force=True)


class RequestLog:
    """ASGI middleware: says who asked for what and what was answered; quiet about reading that succeeds."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """One request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        begun, status = time.monotonic(), 500

        async def noting(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
            await send(message)

        named = _SESSION.match(scope["raw_path"])
        with bound_contextvars(**({"session_id": named[1].decode()} if named else {})):
            try:
                await self._app(scope, receive, noting)
            finally:
                quiet = scope["method"] in ("GET", "HEAD") and status < 400
                _log.log(
                    logging.DEBUG if quiet else logging.INFO,
                    "request",
                    extra={
                        "method": scope["method"],
                        "path": scope["raw_path"][:LONGEST_ADDRESS].decode("ascii", "replace"),
                        "status": status,
                        "by": str(getattr(scope.get("state", {}).get("caller"), "name", "nobody")),
                        "host": scope["client"][0] if scope.get("client") else "local",
                        "ms": round(1e3 * (time.monotonic() - begun), 1),
                    },
                )
