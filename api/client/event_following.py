"""Following a session by its events: a cursor that survives broken connections, and the events that end the wait.

The cursor holds no connection and does not sleep: it counts ids and time, and the two clients connect and sleep, each
in its own way. So what is lost or repeated when a connection breaks is decided in one place for both.
"""

import time

import httpx
from httpx_sse import EventSource, ServerSentEvent

from acquisition.session import ENDED, State
from api.rest.events import STREAM_RESET
from api.rest.schemas import EventResource, SessionResource

RECONNECT_TIMEOUT_S = 30.0
"""How long a broken connection is tried again, s, before the error is raised."""

_FIRST_PAUSE_S, _LONGEST_PAUSE_S = 0.1, 2.0


class EventCursor:
    """Position of a listener in the stream of events (id of the last event), with exponential back-off of its
    reconnections.
    """

    def __init__(self, session_id: str | None, after: int | None, reconnect_timeout_s: float) -> None:
        self.query: dict[str, str] = {} if session_id is None else {"session_id": session_id}
        self._last_event_id = after
        self._reconnect_timeout_s = reconnect_timeout_s
        self._pause_s = _FIRST_PAUSE_S
        self._disconnected_at: float | None = None

    @property
    def headers(self) -> dict[str, str]:
        """Request headers that make the service replay from the last event (`Last-Event-ID`)."""
        return {} if self._last_event_id is None else {"Last-Event-ID": str(self._last_event_id)}

    def connected(self) -> None:
        """Resets the back-off: the service has answered."""
        self._pause_s, self._disconnected_at = _FIRST_PAUSE_S, None

    def read(self, message: ServerSentEvent) -> EventResource | None:
        """Parses a message and advances to it; None for the first message, which holds only an id."""
        self._last_event_id = int(message.id) if message.id else self._last_event_id
        return EventResource.model_validate_json(message.data) if message.data else None

    def disconnected(self, error: httpx.TransportError) -> None:
        """Notes a broken connection. Raises `error` when the service has been away for the reconnection time."""
        self._disconnected_at = self._disconnected_at or time.monotonic()
        if time.monotonic() > self._disconnected_at + self._reconnect_timeout_s:
            raise error

    def next_pause(self) -> float:
        """Seconds to wait before the next connection; doubles with each call up to 2 s."""
        pause, self._pause_s = self._pause_s, min(2 * self._pause_s, _LONGEST_PAUSE_S)
        return pause


def ends_or_suspends(event: EventResource) -> bool:
    """Whether with this event a session has, or may have, ended, or is suspended until a person acts."""
    # Its events are not all in this journal, or it was deleted: the session itself must be asked.
    if event.type in (STREAM_RESET, "session.deleted"):
        return True
    if event.type != "session.state":
        return False
    state = event.body["state"]
    return state in ENDED or (state in (State.INTERRUPTED, State.PAUSED) and "reason" in event.body)


def continues_unattended(session: SessionResource) -> bool:
    """Whether a session goes on without a person: it has not ended, nor stopped for a reason."""
    return session.state not in ENDED and session.reason is None


def parse_events(response: httpx.Response) -> list[EventResource]:
    """Parses the events of a stream that has ended."""
    return [EventResource.model_validate_json(item.data) for item in EventSource(response).iter_sse() if item.data]
