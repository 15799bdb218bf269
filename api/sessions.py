"""Sessions over HTTP: create, act, follow, fetch what was made.

A resource is read off the journal for each request. Creating moves nothing; only an action does, and start and resume
may wait for devices, so actions have threads of their own: however many callers wait for a dead device, reading goes
on, and a stop has threads that nothing else may take.
"""

import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import anyio.to_thread
from fastapi import APIRouter, Body, Header, Query, Request, Response
from fastapi import Path as InPath
from fastapi.responses import FileResponse

from acquisition import session
from acquisition.errors import ErrorCode, RigError
from acquisition.session import Trigger
from acquisition.store import Action, Artifact, SessionRow
from acquisition.types import LightPlan, Recipe, ResultSummary, Route, Shot
from api import preview, problems
from api.context import Actor, ServiceOf
from api.schemas import (
    ActionAccepted,
    ActionRequest,
    ActionResource,
    ArtefactResource,
    Page,
    PassResource,
    PassSummary,
    Problem,
    ResultResource,
    SessionResource,
    ShotResource,
    moment,
)
from api.wiring import Service

router = APIRouter(tags=["sessions"])

SessionId = Annotated[str, InPath(max_length=80)]
Number = Annotated[int, InPath(ge=0, le=10_000)]
Limit = Annotated[int, Query(ge=1, le=200)]
ItemT = TypeVar("ItemT")

MEDIA_TYPES = {".png": "image/png", ".tiff": "image/tiff", ".json": "application/json"}
_NOT_FOUND = problems.declared(ErrorCode.SESSION_NOT_FOUND, ErrorCode.REQUEST_NOT_FOUND)


# ------------------------------------------------------------------------------------------------------------ sessions


@router.post(
    "/v1/sessions",
    status_code=201,
    responses={
        200: {"model": SessionResource, "description": "The session that this Idempotency-Key made before"},
        **problems.declared(
            ErrorCode.REQUEST_INVALID,
            ErrorCode.REQUEST_TOO_LARGE,
            ErrorCode.REQUEST_MEDIA_TYPE,
            ErrorCode.STORE_DISK_FULL,
        ),
    },
)
def create(
    service: ServiceOf,
    response: Response,
    recipe: Annotated[Recipe, Body(description="`{}` is a good session")] = Recipe(),  # noqa: B008 - frozen
    idempotency_key: Annotated[str | None, Header(min_length=1, max_length=200)] = None,
) -> SessionResource:
    """Creates a session from a recipe; nothing moves. The same Idempotency-Key never makes a second one."""
    row, new = service.runner.create(recipe, idempotency_key)
    response.status_code = 201 if new else 200
    response.headers["Location"] = f"/v1/sessions/{row.id}"
    return _resource(service, row)


@router.get("/v1/sessions", responses=problems.declared(ErrorCode.REQUEST_INVALID))
def sessions(
    service: ServiceOf,
    limit: Limit = 20,
    after: Annotated[int | None, Query(ge=1, le=2**62, description="The number of the last session seen")] = None,
) -> Page[SessionResource]:
    """Sessions, newest first."""
    rows = service.store.journal.sessions(limit + 1, after)
    more = f"/v1/sessions?limit={limit}&after={rows[limit - 1].number}" if len(rows) > limit else None
    return Page[SessionResource](items=[_resource(service, row) for row in rows[:limit]], next=more)


@router.get("/v1/sessions/{session_id}", responses=_NOT_FOUND)
def read(service: ServiceOf, session_id: SessionId) -> SessionResource:
    """One session: state, progress, what may be done, the answer."""
    return _resource(service, service.store.journal.session(session_id))


@router.delete(
    "/v1/sessions/{session_id}",
    status_code=204,
    responses={**_NOT_FOUND, **problems.declared(ErrorCode.SESSION_ACTION_NOT_ALLOWED)},
)
def delete(service: ServiceOf, session_id: SessionId) -> None:
    """Removes a session that does not hold the rig, with all its files."""
    folder = service.store.folder(session_id)
    service.store.journal.delete_session(session_id)
    if folder.exists():
        shutil.rmtree(folder)


# ------------------------------------------------------------------------------------------------------------- actions


@router.post(
    "/v1/sessions/{session_id}/actions",
    status_code=202,
    responses={
        **_NOT_FOUND,
        **problems.declared(
            ErrorCode.SESSION_ACTION_NOT_ALLOWED,
            ErrorCode.RIG_BUSY,
            ErrorCode.RIG_CHANGED,
            ErrorCode.REQUEST_INVALID,
            ErrorCode.SAFETY_NOT_ACKNOWLEDGED,
            ErrorCode.ARM_PROTECTIVE_STOP,
            ErrorCode.ARM_EMERGENCY_STOP,
            ErrorCode.RIG_NOT_READY,
            ErrorCode.ARM_UNREACHABLE,
            ErrorCode.ARM_PREFLIGHT,
            ErrorCode.CAMERA_UNREACHABLE,
        ),
    },
)
async def act(service: ServiceOf, session_id: SessionId, request: ActionRequest, actor: Actor) -> ActionAccepted:
    """Starts, pauses, resumes or stops a session; repeating a request is no error."""
    trigger = Trigger(request.action)
    waits = trigger in (Trigger.START, Trigger.RESUME)
    state = await anyio.to_thread.run_sync(
        service.runner.act,
        session_id,
        trigger,
        actor,
        limiter=service.limits.start if waits else service.limits.stop,
    )
    return ActionAccepted(state=state, links={"session": f"/v1/sessions/{session_id}"})


@router.get("/v1/sessions/{session_id}/actions", responses=_NOT_FOUND)
def actions(
    service: ServiceOf,
    request: Request,
    session_id: SessionId,
    limit: Limit = 100,
    after: Annotated[int, Query(ge=0, le=2**62)] = 0,
) -> Page[ActionResource]:
    """Who asked for what, oldest first; what the service did of itself is there too."""
    service.store.journal.session(session_id)
    items = [_action(item) for item in service.store.journal.actions(session_id)]
    return _page(request, items, limit, after)


# -------------------------------------------------------------------------------------------------------------- passes


@router.get("/v1/sessions/{session_id}/passes", responses=_NOT_FOUND)
def passes(service: ServiceOf, session_id: SessionId) -> Page[PassSummary]:
    """The passes that have a plan."""
    service.store.journal.session(session_id)
    shots = service.store.journal.shots(session_id)
    items = [
        PassSummary(
            number=plan.number,
            method=plan.body["method"],
            lights=plan.body["lights"],
            shots=sum(shot.key.pass_number == plan.number for shot in shots),
            predicted_sigma_deg=plan.body["predicted_sigma_deg"],
            links={"self": f"/v1/sessions/{session_id}/passes/{plan.number}"},
        )
        for plan in service.store.journal.artifacts(session_id, "plan")
    ]
    return Page[PassSummary](items=items)


@router.get("/v1/sessions/{session_id}/passes/{number}", responses=_NOT_FOUND)
def one_pass(service: ServiceOf, session_id: SessionId, number: Number) -> PassResource:
    """One pass: its lights, the way through them, its images."""
    folder = service.store.folder(session_id)
    plan = _newest(service, session_id, "plan", number)
    if plan is None:
        raise RigError(ErrorCode.REQUEST_NOT_FOUND, f"Session {session_id} has no pass {number} (yet)")
    route = _newest(service, session_id, "route", number)
    here = f"/v1/sessions/{session_id}/passes/{number}"
    return PassResource(
        number=number,
        plan=LightPlan.model_validate_json(_stored(folder / plan.path)),
        route=None if route is None else Route.model_validate_json(_stored(folder / route.path)),
        shots=[
            ShotResource(shot=shot, links={"image": f"{here}/shots/{shot.key.number}/image"})
            for shot in service.store.journal.shots(session_id)
            if shot.key.pass_number == number
        ],
        links={"self": here, "session": f"/v1/sessions/{session_id}"},
    )


@router.get(
    "/v1/sessions/{session_id}/passes/{number}/shots/{shot_number}/image",
    response_class=Response,
    responses={200: {"content": {"image/png": {}, "image/tiff": {}}}, **_NOT_FOUND},
)
async def image(
    service: ServiceOf,
    session_id: SessionId,
    number: Number,
    shot_number: Number,
    format: Annotated[Literal["png", "tiff"], Query()] = "png",  # noqa: A002 - the name in the address
) -> Response:
    """One image: an 8-bit picture to look at, or with `?format=tiff` the linear 16-bit frame as it was taken."""
    shot = await anyio.to_thread.run_sync(_shot, service, session_id, number, shot_number)
    path = service.store.data / "sessions" / session_id / shot.frame.path
    if format == "tiff":
        return _file(path, f"{session_id}-pass{number}-shot{shot_number}.tiff", shot.frame.sha256)
    picture = await anyio.to_thread.run_sync(
        preview.png, path, service.calibration.sensor, limiter=service.limits.pictures
    )
    return Response(picture, media_type="image/png", headers=_kept(f"{shot.frame.sha256}-8"))


# ------------------------------------------------------------------------------------------------------------- results


@router.get("/v1/sessions/{session_id}/results", responses=_NOT_FOUND)
def results(service: ServiceOf, session_id: SessionId) -> Page[ResultResource]:
    """The results so far, oldest first; the last one is the session's answer."""
    folder = service.store.folder(session_id)
    found = service.store.journal.artifacts(session_id, "result")
    return Page[ResultResource](items=[_result(session_id, folder, item) for item in found])


@router.get(
    "/v1/sessions/{session_id}/results/{number}",
    responses={**_NOT_FOUND, **problems.declared(ErrorCode.RESULT_NOT_READY)},
)
def result(service: ServiceOf, session_id: SessionId, number: Number) -> ResultResource:
    """One result: its figures and its files."""
    return _result(session_id, service.store.folder(session_id), _ready(service, session_id, number))


@router.get(
    "/v1/sessions/{session_id}/results/{number}/{artefact}",
    response_class=FileResponse,
    responses={
        200: {"content": {media_type: {} for media_type in MEDIA_TYPES.values()}},
        **_NOT_FOUND,
        **problems.declared(ErrorCode.RESULT_NOT_READY, ErrorCode.STORE_CORRUPT),
    },
)
def artefact(
    service: ServiceOf, session_id: SessionId, number: Number, artefact: Annotated[str, InPath(max_length=100)]
) -> FileResponse:
    """One file of a result, by its name in the manifest."""
    entry = _ready(service, session_id, number)
    manifest = service.store.folder(session_id) / entry.path
    known = {name: str(facts["sha256"]) for name, facts in _files(manifest).items()} | {manifest.name: entry.sha256}
    if artefact not in known:  # so no name reaches the disk that the manifest does not list
        raise RigError(
            ErrorCode.REQUEST_NOT_FOUND, f"Result {number} has no file of this name", artefacts=sorted(known)
        )
    return _file(manifest.parent / artefact, f"{session_id}-{number}-{artefact}", known[artefact])


# ----------------------------------------------------------------------------------------------------------- resources


def _resource(service: Service, row: SessionRow) -> SessionResource:
    progress = service.runner.progress(row.id)
    answers = service.store.journal.artifacts(row.id, "result")
    plans = service.store.journal.artifacts(row.id, "plan")
    here = f"/v1/sessions/{row.id}"
    return SessionResource(
        id=row.id,
        number=row.number,
        state=row.state,
        arm=session.THE_ARM[row.state],
        stage=progress.stage,
        progress=progress.progress,
        seconds_left=progress.seconds_left,
        reason=None if row.reason is None else _reason(row.reason, here),
        conclusion=plans[-1].body.get("conclusion") if plans else None,
        allowed_actions=[str(action) for action in session.allowed(row.state)],
        recipe=row.recipe,
        cell=json.loads(row.cell)["name"],
        created=moment(row.created_at),
        started=None if row.started_at is None else moment(row.started_at),
        ended=None if row.ended_at is None else moment(row.ended_at),
        answer=_result(row.id, service.store.folder(row.id), answers[-1]) if answers else None,
        links={
            "self": here,
            "actions": f"{here}/actions",
            "events": f"/v1/events?session_id={row.id}&after=0",
            "passes": f"{here}/passes",
            "results": f"{here}/results",
        },
    )


def _reason(stored: dict[str, Any], instance: str) -> Problem:
    context = {key: value for key, value in stored.items() if key not in ("code", "detail")}
    return Problem.of(ErrorCode(stored["code"]), stored["detail"], context, instance)


def _action(item: Action) -> ActionResource:
    return ActionResource(action=item.action, actor=item.actor, outcome=item.outcome, at=moment(item.at))


def _result(session_id: str, folder: Path, entry: Artifact) -> ResultResource:
    here = f"/v1/sessions/{session_id}/results/{entry.number}"
    figures = {name: entry.body[name] for name in ResultSummary.model_fields if name in entry.body}
    return ResultResource(
        number=entry.number,
        passes=list(range(entry.number + 1)),
        origin=entry.body["origin"],
        created=moment(entry.created_at),
        seconds=entry.body["seconds"],
        summary=ResultSummary.model_validate(figures),
        artefacts=[
            ArtefactResource(name=name, bytes=facts["bytes"], sha256=facts["sha256"], href=f"{here}/{name}")
            for name, facts in _files(folder / entry.path).items()
        ],
        links={"self": here, "manifest": f"{here}/manifest.json", "session": f"/v1/sessions/{session_id}"},
    )


def _ready(service: Service, session_id: str, number: int) -> Artifact:
    """The entry of a result. Raises RigError result.not_ready while it may still come, else request.not_found."""
    row = service.store.journal.session(session_id)
    entry = _newest(service, session_id, "result", number)
    if entry is not None:
        return entry
    if row.state not in session.ENDED and number < session.passes_wanted(row.recipe):
        raise RigError(
            ErrorCode.RESULT_NOT_READY,
            f"Session {session_id} is {row.state} and has no result {number} yet",
            state=row.state,
            allowed=[str(action) for action in session.allowed(row.state)],
        )
    raise RigError(ErrorCode.REQUEST_NOT_FOUND, f"Session {session_id} is {row.state} and has no result {number}")


def _newest(service: Service, session_id: str, kind: str, number: int) -> Artifact | None:
    found = [item for item in service.store.journal.artifacts(session_id, kind) if item.number == number]
    return found[-1] if found else None


def _shot(service: Service, session_id: str, pass_number: int, number: int) -> Shot:
    service.store.journal.session(session_id)
    for shot in service.store.journal.shots(session_id):
        if (shot.key.pass_number, shot.key.number) == (pass_number, number):
            return shot
    raise RigError(ErrorCode.REQUEST_NOT_FOUND, f"Pass {pass_number} has no shot {number} (yet)")


def _files(manifest: Path) -> dict[str, dict[str, Any]]:
    return json.loads(_stored(manifest))["files"]


def _stored(path: Path) -> bytes:
    """A file that the journal names. Raises RigError store.corrupt when it is gone."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise RigError(ErrorCode.STORE_CORRUPT, f"{path.name}: {error.strerror}", file=path.name) from error


def _file(path: Path, name: str, digest: str) -> FileResponse:
    if not path.is_file():
        raise RigError(ErrorCode.STORE_CORRUPT, f"{path.name} is gone", file=path.name)
    media_type = MEDIA_TYPES.get(path.suffix, "application/octet-stream")
    return FileResponse(
        path, media_type=media_type, filename=name, content_disposition_type="inline", headers=_kept(digest)
    )


def _kept(digest: str) -> dict[str, str]:
    # What was announced never changes; browsers may keep it.
    return {"ETag": f'"{digest}"', "Cache-Control": "private, max-age=31536000, immutable"}


def _page(request: Request, items: Sequence[ItemT], limit: int, after: int) -> Page[ItemT]:
    """The items past the first `after`, at most `limit`."""
    end = after + limit
    more = f"{request.url.path}?limit={limit}&after={end}" if end < len(items) else None
    return Page[Any](items=list(items[after:end]), next=more)
