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
from collections.abc import Callable, Generator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Literal

import httpx
from httpx_sse import connect_sse

from acquisition.models.base import Vector3
from acquisition.models.errors import ErrorCode
from acquisition.models.recipe import Recipe
from acquisition.models.result import SolveSettings
from acquisition.session import State
from api.client.following import PATIENCE_S, Bar, Place, goes_on_by_itself, past, rests
from api.client.responses import ModelT, ProblemError, completed, parsed, raise_problem
from api.rest.schemas import (
    ActionAccepted,
    DryRunResource,
    EventResource,
    Page,
    PassResource,
    PassSummary,
    Problem,
    RegionResource,
    ResolveAccepted,
    ResolveRequest,
    ResultResource,
    RigResource,
    SafetyResource,
    SessionResource,
)

TIMEOUT_S = 30.0
"""Longer than a start may wait for devices, and than the pause between two keep-alive comments of the event stream."""


def headers_with(key: str | None) -> dict[str, str]:
    """The headers that show a key; without one, what LIGHTPOSE_KEY says."""
    key = key or os.environ.get("LIGHTPOSE_KEY")
    return {"Authorization": f"Bearer {key}"} if key else {}


class Client:
    """One service; use it as a context manager or `close` it. Methods raise ProblemError, and httpx.TransportError
    when the service cannot be reached.

    `key` is the caller's API key; none: what LIGHTPOSE_KEY says, or no key at all.
    """

    def __init__(self, url: str, key: str | None = None) -> None:
        self._http = httpx.Client(base_url=url, timeout=TIMEOUT_S, trust_env=False, headers=headers_with(key))

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

    def preview(self) -> bytes:
        """What the camera sees now, as a JPEG; while a session holds the rig, the last frame that it took."""
        return self._send("GET", "/v1/rig/preview.jpg").content

    def safety(self) -> SafetyResource:
        """The faults that nobody has acknowledged."""
        return self._get("/v1/rig/safety", SafetyResource)

    def acknowledge(self) -> SafetyResource:
        """Says that a person has looked at the cell and finds it clear."""
        return parsed(self._send("POST", "/v1/rig/safety/acknowledgement"), SafetyResource)

    def recover(self, step: Literal["unlock", "power", "brakes"]) -> None:
        """One step out of a stop, where the cell file allows it, after `acknowledge` by the same caller."""
        self._send("POST", "/v1/rig/safety/recovery", json={"step": step})

    def park(self) -> None:
        """Sends the arm home from wherever it stands; `rig.parked` among the events tells how it ended."""
        self._send("POST", "/v1/rig/park")

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
        return parsed(self._send("POST", "/v1/sessions", json=content, headers=headers), SessionResource)

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
        return parsed(answer, RegionResource).pixels

    def start(self, session_id: str) -> State:
        """Starts a session; returns its state."""
        return self.act(session_id, "start")

    def pause(self, session_id: str) -> State:
        """Pauses a session after its present step."""
        return self.act(session_id, "pause")

    def resume(self, session_id: str, *, from_here: bool = False) -> State:
        """Goes on with a session that was paused or interrupted.

        With `from_here` a person lets the arm go on from where it stands, although it was moved meanwhile.
        """
        body = {"action": "resume", "from_here": from_here}
        answer = self._send("POST", f"/v1/sessions/{session_id}/actions", json=body)
        return parsed(answer, ActionAccepted).state

    def stop(self, session_id: str) -> State:
        """Stops a session, at once."""
        return self.act(session_id, "stop")

    def act(self, session_id: str, action: str) -> State:
        """Takes one of the session's `allowed_actions`."""
        answer = self._send("POST", f"/v1/sessions/{session_id}/actions", json={"action": action})
        return parsed(answer, ActionAccepted).state

    def passes(self, session_id: str) -> list[PassSummary]:
        """The passes that have a plan."""
        return self._all(f"/v1/sessions/{session_id}/passes", PassSummary)

    def one_pass(self, session_id: str, number: int) -> PassResource:
        """One pass: plan, route, shots."""
        return self._get(f"/v1/sessions/{session_id}/passes/{number}", PassResource)

    def replace_plan(self, session_id: str, number: int, lights: Sequence[Vector3]) -> PassResource:
        """Puts lights of one's own (m, view frame) in the place of a plan that waits for review."""
        body = {"lights": [list(position) for position in lights]}
        answer = self._send("PUT", f"/v1/sessions/{session_id}/passes/{number}/plan", json=body)
        return parsed(answer, PassResource)

    def dry_run(self, recipe: Recipe) -> DryRunResource:
        """What the first pass of a recipe would do: lights, way, time; nothing moves."""
        answer = self._send("POST", "/v1/dry-runs", json=recipe.model_dump(mode="json"))
        return parsed(answer, DryRunResource)

    def results(self, session_id: str) -> list[ResultResource]:
        """The results so far, oldest first."""
        return self._all(f"/v1/sessions/{session_id}/results", ResultResource)

    def choose_answer(self, session_id: str, number: int) -> ResultResource:
        """Says which result is the session's answer."""
        answer = self._send("PATCH", f"/v1/sessions/{session_id}", json={"answer": number})
        return parsed(answer, ResultResource)

    def result(self, session_id: str, number: int) -> ResultResource:
        """One result."""
        return self._get(f"/v1/sessions/{session_id}/results/{number}", ResultResource)

    def resolve(self, session_id: str, settings: SolveSettings | None = None, last_pass: int | None = None) -> int:
        """Asks for an ended session to be solved again, from the passes up to `last_pass` (None: all of its images).

        Returns the number that the result will have; the event `normals.ready` or `resolve.failed` tells the outcome.
        """
        request = ResolveRequest(settings=settings or SolveSettings(), last_pass=last_pass)
        body = request.model_dump(mode="json")
        return parsed(self._send("POST", f"/v1/sessions/{session_id}/results", json=body), ResolveAccepted).number

    def download(self, session_id: str, number: int, name: str, path: Path) -> Path:
        """Fetches one file of a result, checked against the manifest; `path` appears whole or not at all.

        Raises ProblemError store.corrupt when what came is not what the manifest says.
        """
        told = {item.name: item.sha256 for item in self.result(session_id, number).artefacts}
        return self._fetch(f"/v1/sessions/{session_id}/results/{number}/{name}", path, told.get(name))

    def archive(self, session_id: str, path: Path) -> Path:
        """Fetches the session's folder as one zip file; `path` appears whole or not at all."""
        return self._fetch(f"/v1/sessions/{session_id}/archive", path, None)

    def log(self, session_id: str) -> str:
        """What happened in a session, a line each."""
        return self._send("GET", f"/v1/sessions/{session_id}/log").text

    # ---------------------------------------------------------------------------------------------------------- events

    def events(
        self, session_id: str | None = None, after: int | None = None, patience_s: float = PATIENCE_S
    ) -> Generator[EventResource, None, None]:
        """Events above `after` (None: from now on), without end; a broken connection is taken up where it broke.

        Raises httpx.TransportError when the service stays away for `patience_s`.
        """
        place = Place(session_id, after, patience_s)
        while True:
            try:
                with connect_sse(self._http, "GET", "/v1/events", params=place.query, headers=place.headers) as source:
                    if source.response.is_error:
                        source.response.read()
                        raise_problem(source.response)
                    place.connected()
                    for message in source.iter_sse():
                        event = place.read(message)
                        if event is not None:
                            yield event
            except httpx.TransportError as error:
                place.broke(error)
            time.sleep(place.next_pause())

    def past_events(self, session_id: str) -> list[EventResource]:
        """What has happened in a session so far."""
        answer = self._http.get("/v1/events", params={"session_id": session_id, "after": 0, "follow": False})
        if answer.is_error:
            raise_problem(answer)
        return past(answer)

    def wait(self, session_id: str, on_event: Callable[[EventResource], None] | None = None) -> SessionResource:
        """Follows a session from its first event until it has ended or nothing goes on without a person.

        The latter is a session that is interrupted, or paused for a reason of its own.
        """
        for event in self.events(session_id, after=0):
            if on_event is not None:
                on_event(event)
            if rests(event):
                session = self.session(session_id)
                if not goes_on_by_itself(session):
                    return session
        raise AssertionError("the events of a session have no end")

    def capture(self, recipe: Recipe | None = None, *, progress: bool = True) -> SessionResource:
        """Creates a session, starts it, follows it to its end, with a progress bar on a terminal.

        Raises ProblemError with the session's reason when it does not complete.
        """
        created = self.create(recipe)
        self.start(created.id)
        if progress:
            with Bar() as bar:
                return completed(self.wait(created.id, lambda _: bar.show(self.session(created.id))))
        return completed(self.wait(created.id))

    # ------------------------------------------------------------------------------------------------------- internals

    def _get(self, address: str, model: type[ModelT]) -> ModelT:
        return parsed(self._send("GET", address), model)

    def _all(self, address: str, model: type[ModelT]) -> list[ModelT]:
        """All items of a list that comes in pages."""
        items: list[ModelT] = []
        part: str | None = address
        while part is not None:
            answer = self._get(part, Page[model])
            items += answer.items
            part = answer.next
        return items

    def _fetch(self, address: str, path: Path, sha256: str | None) -> Path:
        beside = path.with_name(f".{path.name}.part")
        digest = hashlib.sha256()
        try:
            with (
                self._http.stream("GET", address) as answer,
                beside.open("wb") as file,
            ):
                if answer.is_error:
                    answer.read()
                    raise_problem(answer)
                for block in answer.iter_bytes():
                    digest.update(block)
                    file.write(block)
            if sha256 is not None and digest.hexdigest() != sha256:
                raise ProblemError(Problem.of(ErrorCode.STORE_CORRUPT, f"{address} is not what the manifest says"))
            beside.rename(path)
        finally:
            beside.unlink(missing_ok=True)
        return path

    def _send(self, method: str, address: str, **arguments: Any) -> httpx.Response:
        answer = self._http.request(method, address, **arguments)
        if answer.is_error:
            raise_problem(answer)
        return answer
