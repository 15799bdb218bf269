"""Following a session: where a listener is in the stream of events, when to stop waiting, and the bar that shows it."""

import time
from types import TracebackType

import httpx
from httpx_sse import EventSource, ServerSentEvent
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from acquisition.session import ENDED, State
from api.rest.schemas import EventResource, SessionResource

PATIENCE_S = 30.0
"""How long a broken connection is tried again."""
_FIRST_PAUSE_S, _LONGEST_PAUSE_S = 0.1, 2.0


class Place:
    """Where a listener is in the stream of events, and how long it has waited for a service that is away."""

    def __init__(self, session_id: str | None, after: int | None, patience_s: float) -> None:
        self.query: dict[str, str] = {} if session_id is None else {"session_id": session_id}
        self._last = after
        self._patience_s = patience_s
        self._pause = _FIRST_PAUSE_S
        self._broken_since: float | None = None

    @property
    def headers(self) -> dict[str, str]:
        """What tells the service where to go on."""
        return {} if self._last is None else {"Last-Event-ID": str(self._last)}

    def connected(self) -> None:
        """The service is there."""
        self._pause, self._broken_since = _FIRST_PAUSE_S, None

    def read(self, message: ServerSentEvent) -> EventResource | None:
        """The event in a message; the first message only says where the stream begins."""
        self._last = int(message.id) if message.id else self._last
        return EventResource.model_validate_json(message.data) if message.data else None

    def broke(self, error: httpx.TransportError) -> None:
        """The connection broke; raises `error` when that has lasted too long."""
        self._broken_since = self._broken_since or time.monotonic()
        if time.monotonic() > self._broken_since + self._patience_s:
            raise error

    def next_pause(self) -> float:
        """Seconds to wait before the next try."""
        pause, self._pause = self._pause, min(2 * self._pause, _LONGEST_PAUSE_S)
        return pause


class Bar:
    """A progress bar of one session, with what it does and the time left."""

    def __init__(self) -> None:
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TaskProgressColumn(),
            TimeElapsedColumn(),
            TextColumn("{task.fields[left]}"),
        )
        self._task = self._progress.add_task("", total=1.0, left="")

    def __enter__(self) -> "Bar":
        self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._progress.stop()

    def show(self, session: SessionResource) -> None:
        """Brings the bar up to date."""
        left = "" if session.seconds_left is None else f"{session.seconds_left:.0f} s left"
        self._progress.update(
            self._task, completed=session.progress, description=f"{session.state}: {session.stage}", left=left
        )


def rests(event: EventResource) -> bool:
    """Whether after this event a session has ended, or goes on only when a person says so."""
    if event.type != "session.state":
        return False
    state = event.body["state"]
    return state in ENDED or (state in (State.INTERRUPTED, State.PAUSED) and "reason" in event.body)


def goes_on_by_itself(session: SessionResource) -> bool:
    """Whether anything happens in a session without a person: it has not ended, nor stopped for a reason."""
    return session.state not in ENDED and session.reason is None


def past(answer: httpx.Response) -> list[EventResource]:
    """The events of a stream that has ended."""
    return [EventResource.model_validate_json(item.data) for item in EventSource(answer).iter_sse() if item.data]
