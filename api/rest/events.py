"""Server-sent events: the journal's event table, read aloud.

The table is the bus. One thread waits for the journal to grow and wakes the listeners on the event loop; each listener
then reads the table itself, from the last id it has sent, in batches. So a slow client falls behind by itself, costs a
wake-up flag and misses nothing, and whoever comes back with the last id it saw reads on from there.
"""

import asyncio
import threading
from collections.abc import AsyncGenerator, Sequence
from typing import Annotated

import anyio.to_thread
from fastapi import APIRouter, Header, Query, Request
from fastapi.responses import StreamingResponse

from acquisition.models.errors import ErrorCode
from acquisition.store import Event, Journal
from api.rest import problems
from api.rest.schemas import EventResource, moment

KEEP_ALIVE_S = 10.0
BATCH = 200
READERS = 4
"""Threads that listeners may occupy together, so that a hundred of them leave the others to the rest of the service."""
_LOOK_AGAIN_S = 0.2


class EventFeed:
    """Wakes listeners when the journal grows; made and ended on the event loop that serves them."""

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self._listeners: set[asyncio.Event] = set()
        self._ending = threading.Event()
        self._newest = 0
        self._readers = anyio.CapacityLimiter(READERS)
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Begins to watch the journal; called on the event loop."""
        self._newest = self._journal.last_event_id()
        self._thread = threading.Thread(
            target=self._watch, args=(asyncio.get_running_loop(),), name="event-feed", daemon=True
        )
        self._thread.start()

    def end(self) -> None:
        """Ends all streams; on the event loop, waits for nothing."""
        self._ending.set()
        self._wake()

    def close(self) -> None:
        """Ends all streams and the thread; the journal may be closed afterwards."""
        self.end()
        if self._thread is not None:
            self._thread.join()

    @property
    def listeners(self) -> int:
        """How many clients listen."""
        return len(self._listeners)

    async def stream(
        self, after: int | None, session_id: str | None = None, types: Sequence[str] = (), follow: bool = True
    ) -> AsyncGenerator[str, None]:
        """Events above `after` (None: from now on) as the text of an event stream, until `end`.

        Without `follow` the stream ends with the newest event.
        """
        wake = asyncio.Event()
        self._listeners.add(wake)
        sent = self._newest if after is None else after
        try:
            yield f"retry: 1000\nid: {sent}\n\n"  # no data, so no event: it says where to come back to
            while not self._ending.is_set():
                wake.clear()
                newest = self._newest
                batch = await anyio.to_thread.run_sync(
                    self._journal.events, sent, BATCH, session_id, tuple(types), limiter=self._readers
                )
                if batch:
                    yield "".join(map(_message, batch))
                sent = batch[-1].id if batch else sent
                if len(batch) == BATCH:
                    continue
                if not follow:
                    return
                sent = max(sent, newest)  # events of others up to there need not be looked at again
                try:
                    await asyncio.wait_for(wake.wait(), KEEP_ALIVE_S)
                except TimeoutError:
                    yield ": keep-alive\n\n"
        finally:
            self._listeners.discard(wake)

    def _watch(self, loop: asyncio.AbstractEventLoop) -> None:
        seen = self._newest
        while not self._ending.is_set():
            if self._journal.wait_for_event(seen, _LOOK_AGAIN_S):
                seen = self._journal.last_event_id()
                loop.call_soon_threadsafe(self._grown, seen)

    def _grown(self, newest: int) -> None:
        self._newest = newest
        self._wake()

    def _wake(self) -> None:
        for wake in self._listeners:
            wake.set()


router = APIRouter(tags=["events"])


@router.get(
    "/v1/events",
    response_class=StreamingResponse,
    responses={
        200: {"description": "An endless stream; `data` is an EventResource", "content": {"text/event-stream": {}}},
        **problems.declared(ErrorCode.REQUEST_INVALID),
    },
)
async def events(
    request: Request,
    after: Annotated[int | None, Query(ge=0, le=2**62, description="Replay from here; none: from now on")] = None,
    session_id: Annotated[str | None, Query(max_length=80)] = None,
    type: Annotated[list[str], Query(max_length=20, description="These types only")] = [],  # noqa: A002, B006
    follow: Annotated[bool, Query(description="false: end with the newest event")] = True,
    last_event_id: Annotated[int | None, Header(ge=0, le=2**62, description="Goes before `after`")] = None,
) -> StreamingResponse:
    """What happens, as it happens (server-sent events); `Last-Event-ID` or `after` replays what was missed."""
    feed: EventFeed = request.app.state.feed
    start = last_event_id if last_event_id is not None else after
    return StreamingResponse(
        feed.stream(start, session_id, type, follow),
        media_type="text/event-stream",
        headers={"Cache-Control": "no-store", "X-Accel-Buffering": "no"},
    )


def _message(event: Event) -> str:
    data = EventResource(
        id=event.id, session_id=event.session_id, type=event.type, at=moment(event.at), body=event.body
    )
    return f"id: {event.id}\nevent: {event.type}\ndata: {data.model_dump_json()}\n\n"
