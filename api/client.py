"""The Python client: what a session script needs, typed, over the same HTTP that anybody may use.

Following a session loses nothing: events are replayed from the first one, and a connection that breaks is taken up
again from the last event seen. Every refusal of the service is a `ProblemError` that says what to do.

    with Client("http://127.0.0.1:8000") as client:
        session = client.capture(Recipe(planned_lights=8))
        client.download(session.id, session.answer.number, "normals.png", Path("normals.png"))
"""

import hashlib
import os
import time
from collections.abc import Callable, Generator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, TypeVar

import httpx
from httpx_sse import EventSource, connect_sse
from pydantic import BaseModel, ValidationError
from rich.progress import BarColumn, Progress, TaskID, TaskProgressColumn, TextColumn, TimeElapsedColumn

from acquisition.errors import ErrorCode
from acquisition.session import ENDED, State
from acquisition.types import Recipe
from api.schemas import (
    ActionAccepted,
    EventResource,
    Page,
    PassResource,
    PassSummary,
    Problem,
    RegionResource,
    ResultResource,
    RigResource,
    SafetyResource,
    SessionResource,
)

TIMEOUT_S = 30.0
"""Longer than a start may wait for devices, and than the pause between two keep-alive comments of the event stream."""
PATIENCE_S = 30.0
"""How long a broken connection is tried again."""
_FIRST_PAUSE_S, _LONGEST_PAUSE_S = 0.1, 2.0

ModelT = TypeVar("ModelT", bound=BaseModel)


class ProblemError(Exception):
    """The service refused, or a session did not complete: a code for programs, a sentence, and what to do."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(f"{problem.code}: {problem.detail}. {problem.remedy}")
        self.problem = problem

    @property
    def code(self) -> ErrorCode:
        """The code, such as `rig.busy`."""
        return self.problem.code

    @property
    def detail(self) -> str:
        """What happened in this case."""
        return self.problem.detail

    @property
    def remedy(self) -> str:
        """What to do."""
        return self.problem.remedy

    @property
    def context(self) -> Mapping[str, Any]:
        """Further facts, such as `allowed`, `holder` or `errors`."""
        return self.problem.model_extra or {}


class Client:
    """One service; use it as a context manager or `close` it. Methods raise ProblemError, and httpx.TransportError
    when the service cannot be reached.

    `key` is the caller's API key; none: what LIGHTPOSE_KEY says, or no key at all.
    """

    def __init__(self, url: str, key: str | None = None) -> None:
        key = key or os.environ.get("LIGHTPOSE_KEY")
        headers = {"Authorization": f"Bearer {key}"} if key else {}
        self._http = httpx.Client(base_url=url, timeout=TIMEOUT_S, trust_env=False, headers=headers)

    def __enter__(self) -> "Client":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Closes the connections."""
        self._http.close()

    # ------------------------------------------------------------------------------------------------------------- rig

    def rig(self) -> RigResource:
        """Who is there, and whether a session may start."""
        return self._get("/v1/rig", RigResource)

    def halt(self) -> None:
        """Halts whatever moves, at once, and stops the session that holds the rig."""
        self._send("POST", "/v1/rig/stop")

    def safety(self) -> SafetyResource:
        """The faults that nobody has acknowledged."""
        return self._get("/v1/rig/safety", SafetyResource)

    def acknowledge(self) -> SafetyResource:
        """Says that a person has looked at the cell and finds it clear."""
        return _parsed(self._send("POST", "/v1/rig/safety/acknowledgement"), SafetyResource)

    def wait_ready(self, timeout_s: float = 60.0) -> RigResource:
        """Waits until a session may start. Raises ProblemError rig.not_ready with the last reasons."""
        deadline = time.monotonic() + timeout_s
        while True:
            rig = self.rig()
            if rig.may_start:
                return rig
            if time.monotonic() > deadline:
                raise ProblemError(Problem.of(ErrorCode.RIG_NOT_READY, "; ".join(item.detail for item in rig.reasons)))
            time.sleep(0.2)

    # -------------------------------------------------------------------------------------------------------- sessions

    def create(self, recipe: Recipe | None = None, idempotency_key: str | None = None) -> SessionResource:
        """Creates a session; nothing moves. Repeating the call with the same key makes no second one."""
        headers = {} if idempotency_key is None else {"Idempotency-Key": idempotency_key}
        content = (recipe or Recipe()).model_dump(mode="json")
        return _parsed(self._send("POST", "/v1/sessions", json=content, headers=headers), SessionResource)

    def session(self, session_id: str) -> SessionResource:
        """One session as it is now."""
        return self._get(f"/v1/sessions/{session_id}", SessionResource)

    def sessions(self) -> Generator[SessionResource, None, None]:
        """All sessions, newest first."""
        address: str | None = "/v1/sessions"
        while address is not None:
            page = self._get(address, Page[SessionResource])
            yield from page.items
            address = page.next

    def delete(self, session_id: str) -> None:
        """Removes a session that does not hold the rig, with its files."""
        self._send("DELETE", f"/v1/sessions/{session_id}")

    def draw_region(self, session_id: str, mask: Path) -> int:
        """Says by a PNG of the camera's size which part of the object matters; returns its number of pixels."""
        answer = self._send(
            "PUT",
            f"/v1/sessions/{session_id}/region.png",
            content=mask.read_bytes(),
            headers={"Content-Type": "image/png"},
        )
        return _parsed(answer, RegionResource).pixels

    def start(self, session_id: str) -> State:
        """Starts a session; returns its state."""
        return self.act(session_id, "start")

    def pause(self, session_id: str) -> State:
        """Pauses a session after its present step."""
        return self.act(session_id, "pause")

    def resume(self, session_id: str) -> State:
        """Goes on with a session that was paused or interrupted."""
        return self.act(session_id, "resume")

    def stop(self, session_id: str) -> State:
        """Stops a session, at once."""
        return self.act(session_id, "stop")

    def act(self, session_id: str, action: str) -> State:
        """Takes one of the session's `allowed_actions`."""
        answer = self._send("POST", f"/v1/sessions/{session_id}/actions", json={"action": action})
        return _parsed(answer, ActionAccepted).state

    def passes(self, session_id: str) -> list[PassSummary]:
        """The passes that have a plan."""
        return self._get(f"/v1/sessions/{session_id}/passes", Page[PassSummary]).items

    def one_pass(self, session_id: str, number: int) -> PassResource:
        """One pass: plan, route, shots."""
        return self._get(f"/v1/sessions/{session_id}/passes/{number}", PassResource)

    def results(self, session_id: str) -> list[ResultResource]:
        """The results so far, oldest first."""
        return self._get(f"/v1/sessions/{session_id}/results", Page[ResultResource]).items

    def result(self, session_id: str, number: int) -> ResultResource:
        """One result."""
        return self._get(f"/v1/sessions/{session_id}/results/{number}", ResultResource)

    def download(self, session_id: str, number: int, name: str, path: Path) -> Path:
        """Fetches one file of a result, checked against the manifest; `path` appears whole or not at all.

        Raises ProblemError store.corrupt when what came is not what the manifest says.
        """
        expected = {item.name: item for item in self.result(session_id, number).artefacts}.get(name)
        beside = path.with_name(f".{path.name}.part")
        digest = hashlib.sha256()
        try:
            with (
                self._http.stream("GET", f"/v1/sessions/{session_id}/results/{number}/{name}") as answer,
                beside.open("wb") as file,
            ):
                if answer.is_error:
                    answer.read()
                    _raise_problem(answer)
                for block in answer.iter_bytes():
                    digest.update(block)
                    file.write(block)
            if expected is not None and digest.hexdigest() != expected.sha256:
                raise ProblemError(Problem.of(ErrorCode.STORE_CORRUPT, f"{name} is not what the manifest says"))
            beside.rename(path)
        finally:
            beside.unlink(missing_ok=True)
        return path

    # ---------------------------------------------------------------------------------------------------------- events

    def events(
        self, session_id: str | None = None, after: int | None = None, patience_s: float = PATIENCE_S
    ) -> Generator[EventResource, None, None]:
        """Events above `after` (None: from now on), without end; a broken connection is taken up where it broke.

        Raises httpx.TransportError when the service stays away for `patience_s`.
        """
        query = {} if session_id is None else {"session_id": session_id}
        last = after
        pause, broken_since = _FIRST_PAUSE_S, None
        while True:
            headers = {} if last is None else {"Last-Event-ID": str(last)}
            try:
                with connect_sse(self._http, "GET", "/v1/events", params=query, headers=headers) as source:
                    if source.response.is_error:
                        source.response.read()
                        _raise_problem(source.response)
                    pause, broken_since = _FIRST_PAUSE_S, None
                    for message in source.iter_sse():
                        last = int(message.id) if message.id else last
                        if message.data:  # the first message only says where the stream begins
                            yield EventResource.model_validate_json(message.data)
            except httpx.TransportError:
                broken_since = broken_since or time.monotonic()
                if time.monotonic() > broken_since + patience_s:
                    raise
            time.sleep(pause)
            pause = min(2 * pause, _LONGEST_PAUSE_S)

    def past_events(self, session_id: str) -> list[EventResource]:
        """What has happened in a session so far."""
        answer = self._http.get("/v1/events", params={"session_id": session_id, "after": 0, "follow": False})
        if answer.is_error:
            _raise_problem(answer)
        found = EventSource(answer).iter_sse()
        return [EventResource.model_validate_json(message.data) for message in found if message.data]

    def wait(self, session_id: str, on_event: Callable[[EventResource], None] | None = None) -> SessionResource:
        """Follows a session from its first event until it has ended or nothing goes on without a person.

        The latter is a session that is interrupted, or paused for a reason of its own.
        """
        for event in self.events(session_id, after=0):
            if on_event is not None:
                on_event(event)
            if event.type == "session.state" and _rests(event.body):
                session = self.session(session_id)
                if session.state in ENDED or session.reason is not None:
                    return session
        raise AssertionError("the events of a session have no end")

    def capture(self, recipe: Recipe | None = None, *, progress: bool = True) -> SessionResource:
        """Creates a session, starts it, follows it to its end, with a progress bar on a terminal.

        Raises ProblemError with the session's reason when it does not complete.
        """
        created = self.create(recipe)
        self.start(created.id)
        if progress:
            with Bar(created, self) as bar:
                session = self.wait(created.id, bar.show)
        else:
            session = self.wait(created.id)
        if session.state is State.COMPLETED:
            return session
        detail = f"Session {session.id} is {session.state}"
        raise ProblemError(session.reason or Problem.of(ErrorCode.SESSION_STEP_FAILED, detail))

    # ------------------------------------------------------------------------------------------------------- internals

    def _get(self, address: str, model: type[ModelT]) -> ModelT:
        return _parsed(self._send("GET", address), model)

    def _send(self, method: str, address: str, **arguments: Any) -> httpx.Response:
        answer = self._http.request(method, address, **arguments)
        if answer.is_error:
            _raise_problem(answer)
        return answer


class Bar:
    """A progress bar of one session, with what it does and the time left."""

    def __init__(self, session: SessionResource, client: Client) -> None:
        self._client = client
        self._session = session
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TaskProgressColumn(),
            TimeElapsedColumn(),
            TextColumn("{task.fields[left]}"),
        )
        self._task: TaskID | None = None

    def __enter__(self) -> "Bar":
        self._progress.start()
        self._task = self._progress.add_task("", total=1.0, left="")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._progress.stop()

    def show(self, event: EventResource) -> None:
        """Brings the bar up to date after an event of the session."""
        if self._task is None or not event.type.startswith(("session.", "shot.", "normals.")):
            return
        session = self._client.session(self._session.id)
        left = "" if session.seconds_left is None else f"{session.seconds_left:.0f} s left"
        self._progress.update(
            self._task, completed=session.progress, description=f"{session.state}: {session.stage}", left=left
        )


def _rests(body: Mapping[str, Any]) -> bool:
    return body["state"] in ENDED or (body["state"] in (State.INTERRUPTED, State.PAUSED) and "reason" in body)


def _parsed(answer: httpx.Response, model: type[ModelT]) -> ModelT:
    return model.model_validate_json(answer.content)


def _raise_problem(answer: httpx.Response) -> None:
    try:
        problem = Problem.model_validate_json(answer.content)
    except ValidationError:
        detail = f"{answer.url} answered {answer.status_code}, not as this service does: {answer.text[:200]!r}"
        problem = Problem.of(ErrorCode.SERVICE_FAULT, detail)
    raise ProblemError(problem)
