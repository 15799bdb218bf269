"""Server-sent events: streams of the journal's event table for clients.

The table is the message bus. One thread waits for the journal to grow and wakes the listeners on the event loop. Each
listener then reads the table itself, in batches, from the last id that it has sent. A slow client therefore falls
behind alone, costs only one wake-up flag and misses nothing. A client that reconnects with its last id resumes there.
On request a stream also carries joint readings, which are not journalled (`joint_readings`).
"""

import asyncio
import logging
import threading
import time
from collections.abc import AsyncGenerator, Callable, Sequence
from datetime import UTC, datetime
from typing import Annotated, Literal

import anyio.to_thread
from fastapi import APIRouter, Depends, Header, Query, Request
from fastapi.responses import StreamingResponse

from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.event_type import EventType
from acquisition.store import Event, Journal
from api.rest import joint_readings, open_streams, problems
from api.rest.dependencies import CallerOf, refuse_unknown_query
from api.rest.joint_readings import JointReadings
from api.rest.open_streams import OpenStreams
from api.rest.schemas import EventResource, as_datetime

_log = logging.getLogger(__name__)

KEEP_ALIVE_S = 10.0
"""Time between two keep-alive comments of a stream without events, s."""

BATCH = 200
"""Number of events that a listener reads at once."""

READERS = 4
"""Number of threads that all listeners together may occupy; the limit leaves threads to the rest of the service."""

STREAM_RESET = "stream.reset"
"""Type of the event which states that a listener's position is not from this journal."""

StreamType = Literal[EventType, "stream.reset", "arm.joints"]
"""Types of a stream's events: the journal's, and those that are not journalled."""

_POLL_S = 0.2


class EventFeed:
    """Wakes listeners when the journal grows. It is created and ended on the event loop that serves them."""

    def __init__(self, journal: Journal, readings: JointReadings) -> None:
        self._journal = journal
        self._readings = readings
        self._listeners: set[asyncio.Event] = set()
        self._stopping = threading.Event()
        self._newest = 0
        self._readers = anyio.CapacityLimiter(READERS)
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Starts the thread that watches the journal. Call it on the event loop."""
        self._newest = self._journal.last_event_id()
        self._thread = threading.Thread(
            target=self._watch, args=(asyncio.get_running_loop(),), name="event-feed", daemon=True
        )
        self._thread.start()

    def end(self) -> None:
        """Ends all streams without waiting. Call it on the event loop."""
        self._stopping.set()
        self._wake()

    def close(self) -> None:
        """Ends all streams and joins the thread. The journal may be closed afterwards."""
        self.end()
        if self._thread is not None:
            self._thread.join()

    @property
    def listeners(self) -> int:
        """Number of connected clients."""
        return len(self._listeners)

    async def require_session(self, session_id: str) -> None:
        """Raises RigError session.not_found if the journal knows neither the session nor an event of it.

        Events of a deleted session remain, so that a listener that reconnects hears of its deletion.
        """
        await anyio.to_thread.run_sync(self._require_session, session_id, limiter=self._readers)

    def _require_session(self, session_id: str) -> None:
        try:
            self._journal.session(session_id)
        except RigError:
            if not self._journal.events(0, 1, session_id):
                raise

    async def stream(
        self,
        after: int | None,
        session_id: str | None = None,
        types: Sequence[str] = (),
        *,
        follow: bool = True,
        joints: bool = False,
        is_admitted: Callable[[], bool] = lambda: True,
    ) -> AsyncGenerator[str, None]:
        """Yields events above `after` (None: from now on) as event-stream text until `end` or loss of admission.

        Without `follow` the stream ends with the newest event. With `joints` it carries joint readings too; without
        `follow` one, at its end. An `after` above the newest id is from another journal; the stream then begins with
        the event `stream.reset` and continues from now.
        """
        wake = asyncio.Event()
        self._listeners.add(wake)
        sent = self._newest if after is None else after
        period_s = joint_readings.PERIOD_S if joints else KEEP_ALIVE_S
        due, grown = time.monotonic() + (0 if joints else period_s), True
        try:
            if sent > self._newest:  # a listener reads the table itself and may be ahead of `_newest`
                newest = await anyio.to_thread.run_sync(self._journal.last_event_id, limiter=self._readers)
                if sent > newest:
                    yield _reset(sent, newest)
                    sent = newest
            yield f"retry: 1000\nid: {sent}\n\n"  # without data this is no event; it states the id to resume from
            while not self._stopping.is_set() and is_admitted():
                batch: list[Event] = []
                if grown:
                    wake.clear()
                    newest = self._newest
                    batch = await anyio.to_thread.run_sync(
                        self._journal.events, sent, BATCH, session_id, tuple(types), limiter=self._readers
                    )
                    if batch:
                        yield "".join(map(_message, batch))
                    # Other sessions' events up to the newest id are not read again.
                    sent = batch[-1].id if len(batch) == BATCH else max(sent, newest, *(item.id for item in batch[-1:]))
                if not follow and len(batch) < BATCH:
                    if joints:
                        yield self._readings.message()
                    return
                if time.monotonic() >= due:
                    yield self._readings.message() if joints else ": keep-alive\n\n"
                    due = time.monotonic() + period_s
                patience_s = min(due - time.monotonic(), open_streams.CHECK_S)
                grown = len(batch) == BATCH or await _is_set_within(wake, patience_s)
        finally:
            self._listeners.discard(wake)

    def _watch(self, loop: asyncio.AbstractEventLoop) -> None:
        newest = self._newest
        while not self._stopping.is_set():
            try:
                if self._journal.wait_for_event(newest, _POLL_S):
                    newest = self._journal.last_event_id()
                    loop.call_soon_threadsafe(self._announce, newest)
            except RigError:  # a disk that fails for a moment must not silence all streams for good
                _log.exception("the journal cannot be followed")
                self._stopping.wait(_POLL_S)

    def _announce(self, newest: int) -> None:
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
        200: {
            "description": "An endless stream (`follow=false`: until now); an event's `data` is an EventResource",
            "content": {
                "text/event-stream": {
                    "schema": {
                        "type": "string",
                        "description": "Lines `id`, `event` and `data` of each event, and comments",
                        "contentMediaType": "application/json",
                        "contentSchema": {"$ref": "#/components/schemas/EventResource"},
                    }
                }
            },
        },
        **problems.responses_of(
            ErrorCode.SESSION_NOT_FOUND,
            ErrorCode.REQUEST_INVALID,
            ErrorCode.REQUEST_TOO_MANY_STREAMS,
            ErrorCode.SERVICE_OVERLOADED,
        ),
    },
    dependencies=[Depends(refuse_unknown_query)],
)
async def events(
    request: Request,
    caller: CallerOf,
    after: Annotated[
        int | None, Query(ge=0, le=2**62, description="Replay events above this id; none: from now on")
    ] = None,
    session_id: Annotated[str | None, Query(max_length=80, description="Only events of this session")] = None,
    type: Annotated[list[StreamType], Query(max_length=20, description="Only events of these types")] = [],  # noqa: A002, B006
    follow: Annotated[bool, Query(description="false: end with the newest event")] = True,
    joints: Annotated[
        bool,
        Query(
            description="true: eight times a second also an event `arm.joints` (JointReadingResource), which is not "
            "journalled and has no id; `type=arm.joints` implies it. With `follow=false` one, at the end"
        ),
    ] = False,
    last_event_id: Annotated[
        str | None, Header(pattern="^[0-9]{1,18}$", description="An event's `id`; takes precedence over `after`")
    ] = None,
) -> StreamingResponse:
    """Streams events as they happen (server-sent events). `Last-Event-ID` or `after` replays missed events.

    If that id is above the newest one, as after restoring the journal from a backup, the event `stream.reset` comes
    first; the client must then read its state anew. The stream ends when the key or ticket that opened it is no longer
    valid.
    """
    feed: EventFeed = request.app.state.feed
    streams: OpenStreams = request.app.state.streams
    if session_id is not None:
        await feed.require_session(session_id)
    start = int(last_event_id) if last_event_id is not None else after
    joints = joints or joint_readings.EVENT_TYPE in type
    content = feed.stream(
        start, session_id, type, follow=follow, joints=joints, is_admitted=lambda: streams.is_valid(caller)
    )
    headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
    return streams.response(caller, content, "text/event-stream", headers)


def _reset(asked: int, newest: int) -> str:
    data = EventResource(
        id=newest, session_id=None, type=STREAM_RESET, at=datetime.now(UTC), body={"last_event_id": asked}
    )
    return f"id: {newest}\nevent: {STREAM_RESET}\ndata: {data.model_dump_json()}\n\n"


def _message(event: Event) -> str:
    data = EventResource(
        id=event.id, session_id=event.session_id, type=event.type, at=as_datetime(event.at), body=event.body
    )
    return f"id: {event.id}\nevent: {event.type}\ndata: {data.model_dump_json()}\n\n"


async def _is_set_within(event: asyncio.Event, timeout_s: float) -> bool:
    """Waits for an event for at most `timeout_s` and returns whether it is set."""
    if event.is_set():
        return True
    try:
        await asyncio.wait_for(event.wait(), max(timeout_s, 0.0))
    except TimeoutError:
        return False
    return True
