"""HTTP/1.1 protocol of the server: uvicorn's, with a time limit for a request's head and problem objects for bad bytes.

uvicorn waits without limit for an incomplete request. A client that sends a byte now and then could thus use up the
process's connections and keep an operator from the stop (slowloris). Here the head of a request must arrive within
`HEAD_TIMEOUT_S` after the connection is ready for it; `request_checks` limits the body, which it reads. A connection
that accepts nothing of its answer for `WRITE_TIMEOUT_S` is cut, because an unread stream would hold its descriptor for
ever.
"""

import asyncio
from collections.abc import Callable, Mapping
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

from acquisition.models.errors import ErrorCode
from api.rest import problems
from api.rest.schemas import Problem

HEAD_TIMEOUT_S = 10.0
"""Time limit for the head of a request, s."""

WRITE_TIMEOUT_S = 60.0
"""Time after which a connection that accepts no more data is cut, s; nobody reads it any more."""


class TimeLimitedH11Protocol(H11Protocol):
    """Closes a connection whose request does not arrive in time, and answers malformed HTTP with a problem object."""

    def __init__(
        self, *arguments: Any, received: bytes, security_headers: Mapping[str, str], on_lost: Callable[[], None],
        **options: Any,
    ) -> None:  # fmt: skip
        """`received` are the bytes that the listener has read; `on_lost` is called when the connection has ended."""
        super().__init__(*arguments, **options)
        self._received = received
        self._security_headers = security_headers
        self._on_lost = on_lost
        self._head_timer: asyncio.TimerHandle | None = None
        self._write_timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Starts the time limit of the first request."""
        super().connection_made(transport)  # pyright: ignore[reportArgumentType] - uvicorn narrows the type
        self._expect_head()
        self.data_received(self._received)

    def pause_writing(self) -> None:
        """Starts the time limit of a connection that accepts no more data."""
        super().pause_writing()
        self._write_timer = self.loop.call_later(WRITE_TIMEOUT_S, self.transport.abort)

    def resume_writing(self) -> None:
        """Cancels this time limit."""
        self._cancel_write_timer()
        super().resume_writing()

    def on_response_complete(self) -> None:
        """Starts the time limit of the next request."""
        super().on_response_complete()
        self._expect_head()

    def connection_lost(self, exc: Exception | None) -> None:
        """Cancels the time limits."""
        if self._head_timer is not None:
            self._head_timer.cancel()
        self._cancel_write_timer()
        super().connection_lost(exc)
        self._on_lost()

    def send_400_response(self, msg: str) -> None:
        """Answers malformed HTTP with a problem object and closes the connection."""
        # The whole request is malformed, not one field, so the status is 400 and not the 422 of the table.
        body = Problem.of(ErrorCode.REQUEST_INVALID, msg).model_copy(update={"status": 400}).model_dump_json().encode()
        headers = [
            ("Content-Type", problems.MEDIA_TYPE), ("Content-Length", str(len(body))), ("Connection", "close"),
            *self._security_headers.items(),
        ]  # fmt: skip
        head = h11.Response(status_code=400, headers=headers, reason=b"Bad Request")
        for event in (head, h11.Data(data=body), h11.EndOfMessage()):
            self.transport.write(self.conn.send(event) or b"")
        self.transport.close()

    def _expect_head(self) -> None:
        if self._head_timer is not None:
            self._head_timer.cancel()
        self._head_timer = self.loop.call_later(HEAD_TIMEOUT_S, self._close_idle)

    def _cancel_write_timer(self) -> None:
        if self._write_timer is not None:
            self._write_timer.cancel()
            self._write_timer = None

    def _close_idle(self) -> None:
        answering = bool(self.cycle) and not self.cycle.response_complete  # none before the first request
        if not answering and not self.transport.is_closing():
            self.transport.close()
