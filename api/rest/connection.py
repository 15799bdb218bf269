"""One connection of the server: uvicorn's HTTP/1.1, with an end to patience and with problem objects for bad bytes.

uvicorn waits for ever for a request that never becomes whole, so whoever sends a byte now and then could use up the
process's connections and keep an operator from the stop. Here the head of a request has `HEAD_WITHIN_S` from the moment
the connection is ready for it; the body's time is the gate's affair, which reads it.
"""

import asyncio
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

from acquisition.models.errors import ErrorCode
from api.rest import problems
from api.rest.schemas import Problem

HEAD_WITHIN_S = 10.0


class Connection(H11Protocol):
    """Closes a connection whose request does not come; answers bytes that are no HTTP as every other error."""

    def __init__(self, *given: Any, **named: Any) -> None:
        super().__init__(*given, **named)
        self._overdue: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """The first request may come."""
        super().connection_made(transport)  # pyright: ignore[reportArgumentType] - uvicorn narrows the type
        self._expect_head()

    def on_response_complete(self) -> None:
        """The next request may come."""
        super().on_response_complete()
        self._expect_head()

    def connection_lost(self, exc: Exception | None) -> None:
        """Nothing is waited for any more."""
        if self._overdue is not None:
            self._overdue.cancel()
        super().connection_lost(exc)

    def send_400_response(self, msg: str) -> None:
        """What came is not HTTP: says so as a problem object and closes."""
        # No route is to correct its fields, so it is HTTP's own 400 and not the 422 of the table.
        body = Problem.of(ErrorCode.REQUEST_INVALID, msg).model_copy(update={"status": 400}).model_dump_json().encode()
        headers = [
            ("Content-Type", problems.MEDIA_TYPE), ("Content-Length", str(len(body))), ("Connection", "close"),
        ]  # fmt: skip
        head = h11.Response(status_code=400, headers=headers, reason=b"Bad Request")
        for event in (head, h11.Data(data=body), h11.EndOfMessage()):
            self.transport.write(self.conn.send(event) or b"")
        self.transport.close()

    def _expect_head(self) -> None:
        if self._overdue is not None:
            self._overdue.cancel()
        self._overdue = self.loop.call_later(HEAD_WITHIN_S, self._close_unless_asked)

    def _close_unless_asked(self) -> None:
        answering = bool(self.cycle) and not self.cycle.response_complete  # none before the first request
        if not answering and not self.transport.is_closing():
            self.transport.close()
