"""Following a session by its events: a cursor that survives broken connections, and the events that end the wait.

The cursor has no connection and does not sleep; it keeps event ids and times. The two clients connect and sleep, each
in its own way. What happens when a connection breaks is thus decided in one place for both.
"""

import time

import httpx
from httpx_sse import EventSource, ServerSentEvent

from acquisition.session_state import ENDED, State
from api.rest.events import STREAM_RESET
from api.rest.schemas import EventResource, SessionResource

RECONNECT_TIMEOUT_S = 30.0
"""Time for which a client tries to reconnect before it raises the error, s."""

_FIRST_PAUSE_S, _LONGEST_PAUSE_S = 0.1, 2.0


class EventCursor:
    """Position of a listener in the stream of events (last event's id), with exponential back-off of reconnections."""

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
        """Resets the back-off after the service has answered."""
        self._pause_s, self._disconnected_at = _FIRST_PAUSE_S, None

    def read(self, message: ServerSentEvent) -> EventResource | None:
        """Parses a message and advances to it; None for the first message, which holds only an id."""
        self._last_event_id = int(message.id) if message.id else self._last_event_id
        return EventResource.model_validate_json(message.data) if message.data else None

    def disconnected(self, error: httpx.TransportError) -> None:
        """Notes a broken connection. Raises `error` if the service has been unreachable for the reconnection time."""
        self._disconnected_at = self._disconnected_at or time.monotonic()
        if time.monotonic() > self._disconnected_at + self._reconnect_timeout_s:
            raise error

    def next_pause(self) -> float:
        """Returns the time to wait before the next connection, s. It doubles with each call up to 2 s."""
        pause, self._pause_s = self._pause_s, min(2 * self._pause_s, _LONGEST_PAUSE_S)
        return pause


def ends_or_suspends(event: EventResource) -> bool:
    """Returns whether a session has, or may have, ended with this event, or is suspended until a person acts."""
    # Not all of its events are in this journal, or it was deleted: only the session's own state tells.
    if event.type in (STREAM_RESET, "session.deleted"):
        return True
    if event.type != "session.state":
        return False
    state = event.body["state"]
    return state in ENDED or (state in (State.INTERRUPTED, State.PAUSED) and "reason" in event.body)


def continues_unattended(session: SessionResource) -> bool:
    """Returns whether a session continues without a person: it has neither ended nor stopped for a reason."""
    return session.state not in ENDED and session.reason is None


def parse_events(response: httpx.Response) -> list[EventResource]:
    """Parses the events of a stream that has ended."""
    return [EventResource.model_validate_json(item.data) for item in EventSource(response).iter_sse() if item.data]
