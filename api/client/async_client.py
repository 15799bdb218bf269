"""The same client for programs that do many things at once: every method of `Client`, awaited.

    async with AsyncClient("http://127.0.0.1:8000") as client:
        session = await client.capture(Recipe(planned_lights=8))

What is done with an answer, and how a broken stream of events is taken up again, is the other client's code.
"""

import asyncio
import hashlib
import time
from collections.abc import AsyncGenerator, Callable, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Literal

import httpx
from httpx_sse import aconnect_sse

from acquisition.models.base import Vector3
from acquisition.models.errors import ErrorCode
from acquisition.models.recipe import Recipe
from acquisition.models.result import SolveSettings
from acquisition.session import State
from api.client.client import TIMEOUT_S, headers_with
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


class AsyncClient:
    """One service; use it as an async context manager or `close` it. Methods raise ProblemError, and
    httpx.TransportError when the service cannot be reached.

    `key` is the caller's API key; none: what LIGHTPOSE_KEY says, or no key at all.
    """

    def __init__(self, url: str, key: str | None = None) -> None:
        self._http = httpx.AsyncClient(base_url=url, timeout=TIMEOUT_S, trust_env=False, headers=headers_with(key))

    async def __aenter__(self) -> "AsyncClient":
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    async def close(self) -> None:
        """Closes the connections."""
        await self._http.aclose()

    # ------------------------------------------------------------------------------------------------------------- rig

    async def rig(self) -> RigResource:
        """Who is there, and whether a session may start."""
        return await self._get("/v1/rig", RigResource)

    async def halt(self) -> None:
        """Halts whatever moves, at once, and stops the session that holds the rig."""
        await self._send("POST", "/v1/rig/stop")

    async def preview(self) -> bytes:
        """What the camera sees now, as a JPEG; while a session holds the rig, the last frame that it took."""
        return (await self._send("GET", "/v1/rig/preview.jpg")).content

    async def safety(self) -> SafetyResource:
        """The faults that nobody has acknowledged."""
        return await self._get("/v1/rig/safety", SafetyResource)

    async def acknowledge(self) -> SafetyResource:
        """Says that a person has looked at the cell and finds it clear."""
        return parsed(await self._send("POST", "/v1/rig/safety/acknowledgement"), SafetyResource)

    async def recover(self, step: Literal["unlock", "power", "brakes"]) -> None:
        """One step out of a stop, where the cell file allows it, after `acknowledge` by the same caller."""
        await self._send("POST", "/v1/rig/safety/recovery", json={"step": step})

    async def park(self) -> None:
        """Sends the arm home from wherever it stands; `rig.parked` among the events tells how it ended."""
        await self._send("POST", "/v1/rig/park")

    async def wait_ready(self, timeout_s: float = 60.0) -> RigResource:
        """Waits until a session may start. Raises ProblemError rig.not_ready with the last reasons."""
        deadline = time.monotonic() + timeout_s
        while True:
            rig = await self.rig()
            if rig.may_start:
                return rig
            if time.monotonic() > deadline:
                raise ProblemError(Problem.of(ErrorCode.RIG_NOT_READY, "; ".join(item.detail for item in rig.reasons)))
            await asyncio.sleep(0.2)

    # -------------------------------------------------------------------------------------------------------- sessions

    async def create(self, recipe: Recipe | None = None, idempotency_key: str | None = None) -> SessionResource:
        """Creates a session; nothing moves. Repeating the call with the same key makes no second one."""
        headers = {} if idempotency_key is None else {"Idempotency-Key": idempotency_key}
        content = (recipe or Recipe()).model_dump(mode="json")
        return parsed(await self._send("POST", "/v1/sessions", json=content, headers=headers), SessionResource)

    async def session(self, session_id: str) -> SessionResource:
        """One session as it is now."""
        return await self._get(f"/v1/sessions/{session_id}", SessionResource)

    async def sessions(self) -> AsyncGenerator[SessionResource, None]:
        """All sessions, newest first."""
        address: str | None = "/v1/sessions"
        while address is not None:
            page = await self._get(address, Page[SessionResource])
            for item in page.items:
                yield item
            address = page.next

    async def delete(self, session_id: str) -> None:
        """Removes a session that does not hold the rig, with its files."""
        await self._send("DELETE", f"/v1/sessions/{session_id}")

    async def draw_region(self, session_id: str, mask: Path) -> int:
        """Says by a PNG of the camera's size which part of the object matters; returns its number of pixels."""
        answer = await self._send(
            "PUT",
            f"/v1/sessions/{session_id}/region.png",
            content=await asyncio.to_thread(mask.read_bytes),
            headers={"Content-Type": "image/png"},
        )
        return parsed(answer, RegionResource).pixels

    async def start(self, session_id: str) -> State:
        """Starts a session; returns its state."""
        return await self.act(session_id, "start")

    async def pause(self, session_id: str) -> State:
        """Pauses a session after its present step."""
        return await self.act(session_id, "pause")

    async def resume(self, session_id: str, *, from_here: bool = False) -> State:
        """Goes on with a session that was paused or interrupted.

        With `from_here` a person lets the arm go on from where it stands, although it was moved meanwhile.
        """
        body = {"action": "resume", "from_here": from_here}
        answer = await self._send("POST", f"/v1/sessions/{session_id}/actions", json=body)
        return parsed(answer, ActionAccepted).state

    async def stop(self, session_id: str) -> State:
        """Stops a session, at once."""
        return await self.act(session_id, "stop")

    async def act(self, session_id: str, action: str) -> State:
        """Takes one of the session's `allowed_actions`."""
        answer = await self._send("POST", f"/v1/sessions/{session_id}/actions", json={"action": action})
        return parsed(answer, ActionAccepted).state

    async def passes(self, session_id: str) -> list[PassSummary]:
        """The passes that have a plan."""
        return await self._all(f"/v1/sessions/{session_id}/passes", PassSummary)

    async def one_pass(self, session_id: str, number: int) -> PassResource:
        """One pass: plan, route, shots."""
        return await self._get(f"/v1/sessions/{session_id}/passes/{number}", PassResource)

    async def replace_plan(self, session_id: str, number: int, lights: Sequence[Vector3]) -> PassResource:
        """Puts lights of one's own (m, view frame) in the place of a plan that waits for review."""
        body = {"lights": [list(position) for position in lights]}
        answer = await self._send("PUT", f"/v1/sessions/{session_id}/passes/{number}/plan", json=body)
        return parsed(answer, PassResource)

    async def dry_run(self, recipe: Recipe) -> DryRunResource:
        """What the first pass of a recipe would do: lights, way, time; nothing moves."""
        answer = await self._send("POST", "/v1/dry-runs", json=recipe.model_dump(mode="json"))
        return parsed(answer, DryRunResource)

    async def results(self, session_id: str) -> list[ResultResource]:
        """The results so far, oldest first."""
        return await self._all(f"/v1/sessions/{session_id}/results", ResultResource)

    async def choose_answer(self, session_id: str, number: int) -> ResultResource:
        """Says which result is the session's answer."""
        answer = await self._send("PATCH", f"/v1/sessions/{session_id}", json={"answer": number})
        return parsed(answer, ResultResource)

    async def result(self, session_id: str, number: int) -> ResultResource:
        """One result."""
        return await self._get(f"/v1/sessions/{session_id}/results/{number}", ResultResource)

    async def resolve(
        self, session_id: str, settings: SolveSettings | None = None, last_pass: int | None = None
    ) -> int:
        """Asks for an ended session to be solved again, from the passes up to `last_pass` (None: all of its images).

        Returns the number that the result will have; the event `normals.ready` or `resolve.failed` tells the outcome.
        """
        request = ResolveRequest(settings=settings or SolveSettings(), last_pass=last_pass)
        answer = await self._send("POST", f"/v1/sessions/{session_id}/results", json=request.model_dump(mode="json"))
        return parsed(answer, ResolveAccepted).number

    async def download(self, session_id: str, number: int, name: str, path: Path) -> Path:
        """Fetches one file of a result, checked against the manifest; `path` appears whole or not at all.

        Raises ProblemError store.corrupt when what came is not what the manifest says.
        """
        told = {item.name: item.sha256 for item in (await self.result(session_id, number)).artefacts}
        return await self._fetch(f"/v1/sessions/{session_id}/results/{number}/{name}", path, told.get(name))

    async def archive(self, session_id: str, path: Path) -> Path:
        """Fetches the session's folder as one zip file; `path` appears whole or not at all."""
        return await self._fetch(f"/v1/sessions/{session_id}/archive", path, None)

    async def log(self, session_id: str) -> str:
        """What happened in a session, a line each."""
        return (await self._send("GET", f"/v1/sessions/{session_id}/log")).text

    # ---------------------------------------------------------------------------------------------------------- events

    async def events(
        self, session_id: str | None = None, after: int | None = None, patience_s: float = PATIENCE_S
    ) -> AsyncGenerator[EventResource, None]:
        """Events above `after` (None: from now on), without end; a broken connection is taken up where it broke.

        Raises httpx.TransportError when the service stays away for `patience_s`.
        """
        place = Place(session_id, after, patience_s)
        while True:
            try:
                async with aconnect_sse(
                    self._http, "GET", "/v1/events", params=place.query, headers=place.headers
                ) as source:
                    if source.response.is_error:
                        await source.response.aread()
                        raise_problem(source.response)
                    place.connected()
                    async for message in source.aiter_sse():
                        event = place.read(message)
                        if event is not None:
                            yield event
            except httpx.TransportError as error:
                place.broke(error)
            await asyncio.sleep(place.next_pause())

    async def past_events(self, session_id: str) -> list[EventResource]:
        """What has happened in a session so far."""
        answer = await self._http.get("/v1/events", params={"session_id": session_id, "after": 0, "follow": False})
        if answer.is_error:
            raise_problem(answer)
        return past(answer)

    async def wait(
        self, session_id: str, on_session: Callable[[SessionResource], None] | None = None
    ) -> SessionResource:
        """Follows a session from its first event until it has ended or nothing goes on without a person.

        `on_session` is called with the session as it is after each event.
        """
        async for event in self.events(session_id, after=0):
            if on_session is None and not rests(event):
                continue
            session = await self.session(session_id)
            if on_session is not None:
                on_session(session)
            if rests(event) and not goes_on_by_itself(session):
                return session
        raise AssertionError("the events of a session have no end")

    async def capture(self, recipe: Recipe | None = None, *, progress: bool = True) -> SessionResource:
        """Creates a session, starts it, follows it to its end, with a progress bar on a terminal.

        Raises ProblemError with the session's reason when it does not complete.
        """
        created = await self.create(recipe)
        await self.start(created.id)
        if not progress:
            return completed(await self.wait(created.id))
        with Bar() as bar:
            return completed(await self.wait(created.id, bar.show))

    # ------------------------------------------------------------------------------------------------------- internals

    async def _get(self, address: str, model: type[ModelT]) -> ModelT:
        return parsed(await self._send("GET", address), model)

    async def _all(self, address: str, model: type[ModelT]) -> list[ModelT]:
        """All items of a list that comes in pages."""
        items: list[ModelT] = []
        part: str | None = address
        while part is not None:
            answer = await self._get(part, Page[model])
            items += answer.items
            part = answer.next
        return items

    async def _fetch(self, address: str, path: Path, sha256: str | None) -> Path:
        beside = path.with_name(f".{path.name}.part")
        digest = hashlib.sha256()
        file = await asyncio.to_thread(beside.open, "wb")
        try:
            with file:
                async with self._http.stream("GET", address) as answer:
                    if answer.is_error:
                        await answer.aread()
                        raise_problem(answer)
                    async for block in answer.aiter_bytes():
                        digest.update(block)
                        await asyncio.to_thread(file.write, block)
            if sha256 is not None and digest.hexdigest() != sha256:
                raise ProblemError(Problem.of(ErrorCode.STORE_CORRUPT, f"{address} is not what the manifest says"))
            await asyncio.to_thread(beside.rename, path)
        finally:
            await asyncio.to_thread(beside.unlink, missing_ok=True)
        return path

    async def _send(self, method: str, address: str, **arguments: Any) -> httpx.Response:
        answer = await self._http.request(method, address, **arguments)
        if answer.is_error:
            raise_problem(answer)
        return answer
