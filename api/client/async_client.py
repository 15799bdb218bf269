"""AsyncClient: typed methods for session scripts, over the same HTTP API that anybody may use.

Following a session loses nothing: events are replayed from the first one, and after a broken connection the stream
resumes from the last event (`Last-Event-ID`). Every refusal of the service is a `ProblemError` that says what to do.

    async with AsyncClient("http://127.0.0.1:8000") as client:
        session = await client.capture(Recipe(planned_lights=8))
        await client.download(session.id, session.answer.number, "normals.png", Path("normals.png"))

There are two clients with the same methods, one awaited and one not. The awaited one is the source, the other one is
generated from it by `python -m api.client.generate`, and a test compares them.
"""

import asyncio
import time
from collections.abc import AsyncGenerator, Callable, Sequence
from pathlib import Path
from typing import Any, Literal

import httpx
from httpx_sse import aconnect_sse

from acquisition.models.base import Vector3
from acquisition.models.calibration_recipe import AnyRecipe
from acquisition.models.cell_config import Tool
from acquisition.models.light_forecast import LightForecast
from acquisition.models.recipe import Recipe
from acquisition.models.result import SolveSettings
from acquisition.session_state import State
from api.client.async_connection import AsyncConnection
from api.client.event_following import (
    RECONNECT_TIMEOUT_S,
    EventCursor,
    continues_unattended,
    ends_or_suspends,
    parse_events,
)  # fmt: skip
from api.client.progress_bar import SessionProgressBar
from api.client.responses import ProblemError, not_ready, parsed, raise_problem, require_completed, unreachable
from api.client.transport import COMPUTED, LEAST_TIMEOUT_S, TIMEOUT_S
from api.rest.calibration import RigCalibration, ToolResource
from api.rest.calibration_schemas import EstimateResource
from api.rest.key_schemas import CallerResource, KeyResource
from api.rest.preview_figures import PreviewFigures
from api.rest.queue import QueueEntryResource, QueueResource
from api.rest.rig_schemas import RigResource, SafetyResource
from api.rest.scene_schemas import SceneResource
from api.rest.schemas import (
    ActionAccepted,
    DryRunResource,
    EventResource,
    Page,
    PassResource,
    PassSummary,
    RegionResource,
    ResolveAccepted,
    ResolveRequest,
    ResultResource,
    SessionEdit,
    SessionResource,
)  # fmt: skip


class AsyncClient(AsyncConnection):
    """Client of one service; use it as an async context manager or `close` it.

    Methods raise ProblemError when the service refuses, httpx.TransportError when it cannot be reached. `key` is the
    caller's API key; its default is the environment variable LIGHTPOSE_KEY, or none.
    """

    async def rig(self) -> RigResource:
        """Returns the status of arm, camera and calibration, and whether a session may start."""
        return await self._get("/v1/rig", RigResource)

    async def scene(self) -> SceneResource:
        """Returns the cell's geometry for a three-dimensional view: arm, lamp, camera, object, obstacles, dome."""
        return await self._get("/v1/rig/scene", SceneResource)

    async def caller(self) -> CallerResource:
        """Returns name and role of the key that this client sends."""
        return await self._get("/v1/caller", CallerResource)

    async def keys(self) -> list[KeyResource]:
        """Returns the service's keys without their secrets; for admins."""
        return await self._all("/v1/keys", KeyResource)

    async def calibration(self) -> RigCalibration:
        """Returns the calibration in use: its values, age, source and validity."""
        return await self._get("/v1/rig/calibration", RigCalibration)

    async def activate_calibration(self, identity: str) -> RigCalibration:
        """Puts a calibration into use; `cell` is the cell file's."""
        return parsed(await self._send("PUT", "/v1/rig/calibrations/active", json={"id": identity}), RigCalibration)

    async def state_tool(self, tool: Tool) -> ToolResource:
        """States which tool a person has put on the flange."""
        return parsed(await self._send("PUT", "/v1/rig/tool", json={"tool": tool}), ToolResource)

    async def halt(self) -> None:
        """Halts all motion at once and stops the session that holds the rig; nothing moves before `acknowledge`."""
        await self._send("POST", "/v1/rig/stop")

    async def preview(self) -> bytes:
        """Returns the camera's present image as a JPEG; while a session holds the rig, its last captured frame."""
        return (await self._send("GET", "/v1/rig/preview.jpg")).content

    async def preview_figures(self) -> PreviewFigures:
        """Returns histogram, clipped shares and focus score of the camera's present image."""
        return await self._get("/v1/rig/preview/figures", PreviewFigures)

    async def safety(self) -> SafetyResource:
        """Returns the unacknowledged safety faults."""
        return await self._get("/v1/rig/safety", SafetyResource)

    async def acknowledge(self) -> SafetyResource:
        """Acknowledges the safety faults: a person has inspected the cell and finds it clear."""
        return parsed(await self._send("POST", "/v1/rig/safety/acknowledgement"), SafetyResource)

    async def recover(self, step: Literal["unlock", "power", "brakes"]) -> None:
        """Takes one step of recovery from a stop, where the cell file allows it, after `acknowledge` by this caller."""
        await self._send("POST", "/v1/rig/safety/recovery", json={"step": step})

    async def park(self) -> None:
        """Moves the arm home from its present position; the event `rig.parked` reports the outcome."""
        await self._send("POST", "/v1/rig/park")

    async def wait_ready(self, timeout_s: float = 60.0) -> RigResource:
        """Waits until a service answers and a session may start.

        Raises ProblemError at `timeout_s`: rig.not_ready with the last reasons and what to do about each, as to power
        the arm on, which only a person does; service.unreachable if none answers.
        """
        deadline = time.monotonic() + timeout_s
        while True:
            left_s = min(max(deadline - time.monotonic(), LEAST_TIMEOUT_S), TIMEOUT_S)
            try:
                rig = parsed(await self._send("GET", "/v1/rig", timeout=left_s), RigResource)
            except httpx.TransportError as error:
                problem = unreachable(error)
            else:
                if rig.may_start:
                    return rig
                problem = not_ready(rig)
            if time.monotonic() > deadline:
                raise ProblemError(problem)
            await asyncio.sleep(0.2)

    async def create(self, recipe: AnyRecipe | None = None, idempotency_key: str | None = None) -> SessionResource:
        """Creates a session; nothing moves. Repeating the call with the same key creates no second one."""
        headers = {} if idempotency_key is None else {"Idempotency-Key": idempotency_key}
        content = (recipe or Recipe()).model_dump(mode="json")
        return parsed(await self._send("POST", "/v1/sessions", json=content, headers=headers), SessionResource)

    async def session(self, session_id: str) -> SessionResource:
        """Returns the present state of a session."""
        return await self._get(f"/v1/sessions/{session_id}", SessionResource)

    async def sessions(self, **wanted: Any) -> AsyncGenerator[SessionResource, None]:
        """Yields sessions, newest first: all, or those selected by `state`, `label`, `since`, `until`."""
        next_address: str | None = f"/v1/sessions?{httpx.QueryParams(wanted)}"
        while next_address is not None:
            page = await self._get(next_address, Page[SessionResource])
            for item in page.items:
                yield item
            next_address = page.next

    async def delete(self, session_id: str) -> None:
        """Deletes a session that does not hold the rig, with its files."""
        await self._send("DELETE", f"/v1/sessions/{session_id}")

    async def draw_region(self, session_id: str, mask: Path) -> int:
        """Sets the region of interest from a PNG of the camera's size; returns its number of pixels."""
        content, headers = await asyncio.to_thread(mask.read_bytes), {"Content-Type": "image/png"}
        address = f"/v1/sessions/{session_id}/region.png"
        return parsed(await self._send("PUT", address, content=content, headers=headers), RegionResource).pixels

    async def start(self, session_id: str) -> State:
        """Starts a session; returns its state."""
        return await self.act(session_id, "start")

    async def pause(self, session_id: str) -> State:
        """Pauses a session after its present step; returns its state."""
        return await self.act(session_id, "pause")

    async def resume(self, session_id: str, *, from_here: bool = False) -> State:
        """Resumes a paused or interrupted session; returns its state.

        With `from_here` a person confirms that the arm may continue from its present position, although it was moved
        meanwhile.
        """
        body = {"action": "resume", "from_here": from_here}
        response = await self._send("POST", f"/v1/sessions/{session_id}/actions", json=body)
        return parsed(response, ActionAccepted).state

    async def stop(self, session_id: str) -> State:
        """Stops a session at once; returns its state."""
        return await self.act(session_id, "stop")

    async def act(self, session_id: str, action: str) -> State:
        """Requests one of the session's `allowed_actions`; returns its state."""
        response = await self._send("POST", f"/v1/sessions/{session_id}/actions", json={"action": action})
        return parsed(response, ActionAccepted).state

    async def passes(self, session_id: str) -> list[PassSummary]:
        """Returns the passes that have a plan."""
        return await self._all(f"/v1/sessions/{session_id}/passes", PassSummary)

    async def one_pass(self, session_id: str, number: int) -> PassResource:
        """Returns one pass: plan, route, shots."""
        return await self._get(f"/v1/sessions/{session_id}/passes/{number}", PassResource)

    async def replace_plan(self, session_id: str, number: int, lights: Sequence[Vector3]) -> PassResource:
        """Replaces the lights of a plan that waits for review by these positions (m, view frame)."""
        address = f"/v1/sessions/{session_id}/passes/{number}/plan"
        body = {"lights": list(map(list, lights))}
        return parsed(await self._send("PUT", address, json=body, timeout=COMPUTED), PassResource)

    async def forecast_plan(self, session_id: str, number: int, lights: Sequence[Vector3]) -> LightForecast:
        """Forecasts σ of a plan that waits for review with its lights at these positions; nothing is committed."""
        address = f"/v1/sessions/{session_id}/passes/{number}/plan/forecast"
        body = {"lights": list(map(list, lights))}
        return parsed(await self._send("POST", address, json=body, timeout=COMPUTED), LightForecast)

    async def dry_run(self, recipe: Recipe) -> DryRunResource:
        """Plans the first pass of a recipe (lights, path, duration); nothing moves."""
        body = recipe.model_dump(mode="json")
        return parsed(await self._send("POST", "/v1/dry-runs", json=body, timeout=COMPUTED), DryRunResource)

    async def results(self, session_id: str) -> list[ResultResource]:
        """Returns the results so far, oldest first."""
        return await self._all(f"/v1/sessions/{session_id}/results", ResultResource)

    async def estimates(self, session_id: str) -> list[EstimateResource]:
        """Returns the estimates of a calibration session so far, oldest first."""
        return await self._all(f"/v1/sessions/{session_id}/estimates", EstimateResource)

    async def choose_answer(self, session_id: str, number: int) -> ResultResource:
        """Chooses which result is the session's answer."""
        await self._send("PATCH", f"/v1/sessions/{session_id}", json={"answer": number})
        return await self.result(session_id, number)

    async def edit(self, session_id: str, *, label: str | None = None, notes: str | None = None) -> SessionResource:
        """Changes a session's label or notes; its recipe stays as it was ordered."""
        body = SessionEdit(label=label, notes=notes).model_dump(exclude_none=True)
        return parsed(await self._send("PATCH", f"/v1/sessions/{session_id}", json=body), SessionResource)

    async def result(self, session_id: str, number: int) -> ResultResource:
        """Returns one result."""
        return await self._get(f"/v1/sessions/{session_id}/results/{number}", ResultResource)

    async def resolve(
        self, session_id: str, settings: SolveSettings | None = None, last_pass: int | None = None,
        calibration: str | None = None,
    ) -> int:  # fmt: skip
        """Solves an ended session's images up to `last_pass` again, with `calibration`; returns the result's number."""
        wanted = ResolveRequest(settings=settings or SolveSettings(), last_pass=last_pass, calibration=calibration)
        address = f"/v1/sessions/{session_id}/results"
        return parsed(await self._send("POST", address, json=wanted.model_dump(mode="json")), ResolveAccepted).number

    async def cancel_resolve(self, session_id: str, number: int) -> None:
        """Cancels a waiting or running solve."""
        await self._send("POST", f"/v1/sessions/{session_id}/results/{number}/cancellation")

    async def download(self, session_id: str, number: int, name: str, path: Path) -> Path:
        """Downloads one file of a result and checks it against the manifest; `path` is written atomically.

        Raises ProblemError store.corrupt when the content differs from the manifest's digest.
        """
        result = await self.result(session_id, number)
        digests = {item.name: item.sha256 for item in result.artefacts}
        address = f"/v1/sessions/{session_id}/results/{number}/{name}"
        return await self._fetch(address, path, digests.get(name), COMPUTED)

    async def archive(self, session_id: str, path: Path) -> Path:
        """Downloads the session's folder as one zip file; `path` is written atomically."""
        return await self._fetch(f"/v1/sessions/{session_id}/archive", path, None)

    async def log(self, session_id: str) -> str:
        """Returns the log of a session, one line for each event or action."""
        return (await self._send("GET", f"/v1/sessions/{session_id}/log")).text

    async def queue(self) -> QueueResource:
        """Returns the queue of sessions that run one after another."""
        return await self._get("/v1/queue", QueueResource)

    async def enqueue(self, object_name: str, recipe: Recipe | None = None, **more: Any) -> QueueEntryResource:
        """Adds a session of an object at the end of the queue; `more` may be `unattended=True`."""
        body = {"object_name": object_name, "recipe": (recipe or Recipe()).model_dump(mode="json"), **more}
        return parsed(await self._send("POST", "/v1/queue/entries", json=body), QueueEntryResource)

    async def act_on_queue(self, action: Literal["resume", "pause"]) -> QueueResource:
        """Resumes the queue (the next object is in place, the cell is clear) or pauses it after the present session."""
        return parsed(await self._send("POST", "/v1/queue/actions", json={"action": action}), QueueResource)

    async def events(
        self,
        session_id: str | None = None,
        after: int | None = None,
        reconnect_timeout_s: float = RECONNECT_TIMEOUT_S,
    ) -> AsyncGenerator[EventResource, None]:
        """Yields events above `after` (None: from now on) without end; resumes a broken connection where it broke.

        Raises httpx.TransportError when the service cannot be reached for `reconnect_timeout_s`, and ProblemError
        session.not_found for a session that its journal does not know, as when that was restored meanwhile.
        """
        cursor = EventCursor(session_id, after, reconnect_timeout_s)
        while True:
            request = {"params": cursor.query, "headers": cursor.headers}
            try:
                async with aconnect_sse(self._http, "GET", "/v1/events", **request) as source:
                    if source.response.is_error:
                        await source.response.aread()
                        raise_problem(source.response)
                    cursor.connected()
                    async for message in source.aiter_sse():
                        event = cursor.read(message)
                        if event is not None:
                            yield event
            except httpx.TransportError as error:
                cursor.disconnected(error)
            await asyncio.sleep(cursor.next_pause())

    async def past_events(self, session_id: str) -> list[EventResource]:
        """Returns the events of a session so far. Raises ProblemError session.not_found."""
        query = {"session_id": session_id, "after": 0, "follow": False}
        return parse_events(await self._send("GET", "/v1/events", params=query))

    async def wait(
        self,
        session_id: str,
        on_event: Callable[[EventResource], None] | None = None,
        *,
        on_session: Callable[[SessionResource], None] | None = None,
    ) -> SessionResource:
        """Follows a session from its first event until it has ended, or is suspended until a person acts.

        A suspended session is interrupted, or paused for a reason of its own. `on_event` is called with each event, and
        `on_session` with the session's state after each event, which costs one request each time.
        """
        async for event in self.events(session_id, after=0):
            if on_event is not None:
                on_event(event)
            if on_session is None and not ends_or_suspends(event):
                continue
            session = await self.session(session_id)
            if on_session is not None:
                on_session(session)
            if ends_or_suspends(event) and not continues_unattended(session):
                return session
        raise AssertionError("the events of a session have no end")

    async def capture(self, recipe: Recipe | None = None, *, progress: bool = True) -> SessionResource:
        """Creates a session, starts it and follows it to its end, with a progress bar on a terminal.

        Raises ProblemError with the session's reason when it does not complete, session.stopped, with who stopped it
        and why it waited then, if somebody did.
        """
        created = await self.create(recipe)
        await self.start(created.id)
        if progress:
            with SessionProgressBar() as bar:
                ended = await self.wait(created.id, on_session=bar.update)
        else:
            ended = await self.wait(created.id)
        return require_completed(ended, [] if ended.state is State.COMPLETED else await self.past_events(ended.id))
