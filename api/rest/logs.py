"""Configuration of logging, as text for people or JSON for programs, and the log of requests.

The code logs through the standard library; this module decides only the format. Work for a session binds `session_id`
as context, and every entry made meanwhile carries it, in whichever module. An address is logged percent-encoded, as it
was sent, so that no request can forge log lines.
"""

import logging
import re
import sys
import threading
import time
from collections.abc import MutableMapping
from logging.handlers import RotatingFileHandler
from pathlib import Path
from typing import Any, Literal

import structlog
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from structlog.contextvars import bound_contextvars, merge_contextvars
from structlog.typing import Processor

from acquisition.models.errors import ErrorCode, RigError
from api.rest.log_queue import QueuedHandler

LogFormat = Literal["text", "json"]

_log = logging.getLogger(__name__)
_SESSION = re.compile(rb"^/v1/sessions/([0-9A-Za-z-]{1,80})(?:/|$)")
MAX_ADDRESS_LENGTH = 200
"""Maximum number of characters of an address that are logged."""


ENTRIES_PER_S = 40.0
"""Long-term rate of written entries of one kind (up to INFO, above), 1/s: about 0.7 MB a minute of requests."""

BURST = 400
"""Number of entries of one kind that are written at once before that rate applies."""


class RateLimit(logging.Filter):
    """Leaves out log entries beyond a rate, so that a flood of requests does not fill the disk, and counts them.

    Entries above INFO have a limit of their own, so that a flood of requests does not hide a fault.
    """

    def __init__(self) -> None:
        super().__init__()
        self._lock = threading.RLock()  # a signal handler may log while its own thread is in here
        self._buckets = {False: [float(BURST), time.monotonic(), 0.0], True: [float(BURST), time.monotonic(), 0.0]}

    def filter(self, record: logging.LogRecord) -> bool:
        """Returns whether an entry is written; its attribute `left_out` counts the entries left out before it."""
        with self._lock:
            bucket = self._buckets[record.levelno > logging.INFO]
            room, at, left_out = bucket
            now = time.monotonic()
            room = min(room + (now - at) * ENTRIES_PER_S, BURST)
            if room < 1:
                bucket[:] = [room, now, left_out + 1]
                return False
            bucket[:] = [room - 1, now, 0.0]
            if left_out:
                record.left_out = int(left_out)
            return True

    def count_left_out(self, record: logging.LogRecord) -> None:
        """Counts an entry that passed but could not be kept, together with the entries in its `left_out`."""
        with self._lock:
            self._buckets[record.levelno > logging.INFO][2] += 1 + getattr(record, "left_out", 0)


FILE_BYTES = 10_000_000
"""Size at which the log file is rotated, bytes."""

OLD_FILES = 5
"""Number of rotated log files that are kept besides the present one; the log takes at most 60 MB."""


def configure(log_format: LogFormat, file: Path | None = None) -> None:
    """Configures logging of this process, from INFO upwards, to its standard error or to a file that rotates.

    A thread that logs never waits for either. Tracebacks omit the values of variables, because those may hold keys.
    Raises RigError config.invalid when the file cannot be written.
    """
    common: list[Processor] = [
        merge_contextvars,
        structlog.stdlib.add_log_level,
        structlog.stdlib.add_logger_name,
        structlog.stdlib.ExtraAdder(),
        _without_colours,
        structlog.processors.TimeStamper(fmt="iso", utc=True),
    ]
    last: list[Processor] = (
        [structlog.processors.format_exc_info, structlog.processors.JSONRenderer(ensure_ascii=False)]
        if log_format == "json"
        else [
            structlog.dev.ConsoleRenderer(
                colors=False, pad_event_to=0, exception_formatter=structlog.dev.plain_traceback
            )
        ]
    )
    limit = RateLimit()
    handler = QueuedHandler(
        logging.StreamHandler(sys.stderr) if file is None else _rotating(file), limit.count_left_out
    )
    handler.addFilter(limit)
    handler.setFormatter(
        structlog.stdlib.ProcessorFormatter(
            foreign_pre_chain=common, processors=[structlog.stdlib.ProcessorFormatter.remove_processors_meta, *last]
        )
    )
    logging.basicConfig(level=logging.INFO, handlers=[handler], force=True)
    logging.captureWarnings(True)


def flush() -> None:
    """Waits until the entries so far are written, so that they stand before what a command says as it ends."""
    for handler in logging.getLogger().handlers:
        handler.flush()


def _rotating(file: Path) -> logging.Handler:
    try:
        return RotatingFileHandler(file, maxBytes=FILE_BYTES, backupCount=OLD_FILES, encoding="utf-8")
    except OSError as error:
        raise RigError(ErrorCode.CONFIG_INVALID, f"The log file {file} cannot be written: {error.strerror}") from error


def _without_colours(_logger: object, _method: str, event: MutableMapping[str, Any]) -> MutableMapping[str, Any]:
    event.pop("color_message", None)  # uvicorn's copy of the message with terminal colour codes
    return event


class RequestLogMiddleware:
    """ASGI middleware that logs caller, address and status of each request; successful reads at DEBUG."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handles one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        started, status = time.monotonic(), 500

        async def record_status(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
            await send(message)

        named = _SESSION.match(scope["raw_path"])
        with bound_contextvars(**({"session_id": named[1].decode()} if named else {})):
            try:
                await self._app(scope, receive, record_status)
            finally:
                quiet = scope["method"] in ("GET", "HEAD") and status < 400
                _log.log(
                    logging.DEBUG if quiet else logging.INFO,
                    "request",
                    extra={
                        "method": scope["method"],
                        "path": scope["raw_path"][:MAX_ADDRESS_LENGTH].decode("ascii", "replace"),
                        "status": status,
                        "by": str(getattr(scope.get("state", {}).get("caller"), "name", "nobody")),
                        "host": scope["client"][0] if scope.get("client") else "local",
                        "ms": round(1e3 * (time.monotonic() - started), 1),
                    },
                )
