"""Routes of results: summaries, files, exports made on their first request, choice of the answer, re-solving.

A re-solve needs no hardware. It is accepted at once and computed when no session runs. An event announces its end.
"""

from typing import Annotated

import anyio.to_thread
from fastapi import APIRouter, Body, Header, Request, Response
from fastapi import Path as InPath
from fastapi.responses import FileResponse

from acquisition import session, session_state
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.result import ResultSummary
from acquisition.runner.re_solve import EXPORTS
from acquisition.store import Artifact
from api.rest import problems, stored_files
from api.rest.dependencies import IDEMPOTENCY_KEY, Actor, Number, ServiceOf, SessionId
from api.rest.paging import Limit, Offset, page
from api.rest.schemas import (
    Accepted,
    ArtefactResource,
    Page,
    ResolveAccepted,
    ResolveRequest,
    ResultResource,
    as_datetime,
)
from api.rest.wiring import Service

router = APIRouter(tags=["sessions"])

_CHOOSE = "choose-answer"
_NO_RESULT = (ErrorCode.RESULT_NOT_READY, ErrorCode.RESULT_CANCELLED, ErrorCode.NORMALS_INFEASIBLE)


@router.get("/v1/sessions/{session_id}/results", responses=problems.NOT_FOUND)
def results(
    service: ServiceOf, request: Request, session_id: SessionId, limit: Limit = 100, after: Offset = 0
) -> Page[ResultResource]:
    """Lists the results so far, oldest first. Until a person chooses, the last of origin `session` is the answer."""
    service.store.journal.session(session_id)
    entries = service.store.journal.artifacts(session_id, "result")
    return page(request, [resource(service, session_id, entry) for entry in entries], limit, after)


@router.post(
    "/v1/sessions/{session_id}/results",
    status_code=202,
    responses={
        200: {"model": ResolveAccepted, "description": "The result that an equal request has asked for before"},
        **problems.NOT_FOUND,
        **problems.responses_of(
            ErrorCode.SESSION_ACTION_NOT_ALLOWED,
            ErrorCode.NORMALS_INFEASIBLE,
            ErrorCode.CALIBRATION_NOT_FOUND,
            ErrorCode.CALIBRATION_DOES_NOT_FIT,
            *problems.BODY_CODES,
        ),
    },
)
def resolve(
    service: ServiceOf,
    session_id: SessionId,
    actor: Actor,
    response: Response,
    request: Annotated[
        ResolveRequest, Body(description="`{}`: all images, with the default settings")
    ] = ResolveRequest(),  # noqa: B008 - frozen
    idempotency_key: Annotated[str | None, Header(min_length=1, max_length=200, description=IDEMPOTENCY_KEY)] = None,
) -> ResolveAccepted:
    """Solves the images of an ended session again with other settings. No hardware is used.

    The event `normals.ready` announces the result; `resolve.failed` announces a failure and its reason. A request with
    the same Idempotency-Key, or with equal settings for the same images, leads to the same result.
    """
    accepted, new = service.resolving.submit(
        session_id, request.settings, request.last_pass, actor, idempotency_key, request.calibration
    )
    response.status_code = 202 if new else 200
    session_path = f"/v1/sessions/{session_id}"
    response.headers["Location"] = f"{session_path}/results/{accepted.number}"
    return ResolveAccepted(
        number=accepted.number,
        links={
            "result": f"{session_path}/results/{accepted.number}",
            "cancellation": f"{session_path}/results/{accepted.number}/cancellation",
            "session": session_path,
            "events": f"/v1/events?session_id={session_id}&after=0",
        },
    )


@router.post(
    "/v1/sessions/{session_id}/results/{number}/cancellation",
    status_code=202,
    responses={**problems.NOT_FOUND, **problems.responses_of(ErrorCode.SESSION_ACTION_NOT_ALLOWED)},
)
def cancel_resolve(service: ServiceOf, session_id: SessionId, number: Number, actor: Actor) -> Accepted:
    """Cancels a waiting or running solve: its process ends and its memory is freed.

    The event `resolve.failed` with the code `result.cancelled` announces the end. Repeating the request is not an
    error.
    """
    service.resolving.cancel(session_id, number, actor)
    session_path = f"/v1/sessions/{session_id}"
    return Accepted(links={"session": session_path, "events": f"/v1/events?session_id={session_id}&after=0"})


@router.get(
    "/v1/sessions/{session_id}/results/{number}",
    responses={**problems.NOT_FOUND, **problems.responses_of(*_NO_RESULT)},
)
def result(service: ServiceOf, session_id: SessionId, number: Number) -> ResultResource:
    """Returns one result with its summary and its files. After a failed re-solve, the problem states the reason."""
    return resource(service, session_id, _ready(service, session_id, number))


@router.get(
    "/v1/sessions/{session_id}/results/{number}/{artefact:file}",
    response_class=FileResponse,
    responses={
        **stored_files.binary(*stored_files.ARTEFACT_TYPES, description="The file"),
        **problems.NOT_FOUND,
        **problems.responses_of(*_NO_RESULT, ErrorCode.RIG_BUSY, ErrorCode.STORE_CORRUPT),
    },
)
async def artefact(
    service: ServiceOf,
    session_id: SessionId,
    number: Number,
    artefact: Annotated[
        str, InPath(max_length=100, description="File name: one of `artefacts` or `exports` of the result")
    ],
) -> FileResponse:
    """Returns one file of a result: a map, `report.html`, or an export, which is made on its first request."""
    limiter = service.limits.exports if artefact in EXPORTS else None
    return await anyio.to_thread.run_sync(_artefact, service, session_id, number, artefact, limiter=limiter)


def choose_answer(service: Service, session_id: str, number: int, actor: str) -> None:
    """Makes a result the session's answer. Raises RigError result.not_ready, normals.infeasible, request.not_found."""
    _ready(service, session_id, number)
    service.store.journal.record_action(session_id, _CHOOSE, actor, f"result {number}")
    service.store.journal.announce(session_id, "answer.chosen", {"number": number, "by": actor})


def answer(service: Service, session_id: str) -> ResultResource | None:
    """Returns the session's answer: the result that a person chose last, else the newest of origin `session`."""
    entries = service.store.journal.artifacts(session_id, "result")
    chosen = [item.outcome for item in service.store.journal.actions(session_id) if item.action == _CHOOSE]
    of_choice = [item for item in entries if chosen and f"result {item.number}" == chosen[-1]]
    own = of_choice or [item for item in entries if item.body["origin"] == "session"]
    return resource(service, session_id, own[-1]) if own else None


def resource(service: Service, session_id: str, entry: Artifact) -> ResultResource:
    """Builds the resource of a result from its journal entry."""
    result_path = f"/v1/sessions/{session_id}/results/{entry.number}"
    summary = {name: entry.body[name] for name in ResultSummary.model_fields if name in entry.body}
    return ResultResource(
        number=entry.number,
        passes=entry.body.get("passes", list(range(entry.number + 1))),
        origin=entry.body["origin"],
        settings=entry.body.get("settings"),
        calibration=entry.body.get("calibration"),
        created=as_datetime(entry.created_at),
        seconds=entry.body["seconds"],
        summary=ResultSummary.model_validate(summary),
        artefacts=[
            ArtefactResource(name=name, bytes=facts.bytes, sha256=facts.sha256, href=f"{result_path}/{name}")
            for name, facts in stored_files.manifest_entries(service.store.folder(session_id), entry.path).items()
        ],
        exports={name: f"{result_path}/{name}" for name in EXPORTS},
        links={
            "self": result_path,
            "manifest": f"{result_path}/manifest.json",
            "session": f"/v1/sessions/{session_id}",
        },
    )


def _artefact(service: Service, session_id: str, number: int, artefact: str) -> FileResponse:
    entry = _ready(service, session_id, number)
    name = f"{session_id}-{number}-{artefact}"
    if artefact in EXPORTS:
        path = service.resolving.make_export(session_id, number, artefact)
        return stored_files.file_response(path, name, f"{entry.sha256}-{artefact}")
    folder = service.store.folder(session_id)
    manifest = folder / entry.path
    known = {name: facts.sha256 for name, facts in stored_files.manifest_entries(folder, entry.path).items()}
    known[manifest.name] = entry.sha256
    if artefact not in known:  # only names in the manifest reach the file system
        raise RigError(
            ErrorCode.REQUEST_NOT_FOUND,
            f"Result {number} has no file of this name",
            artefacts=sorted([*known, *EXPORTS]),
        )
    return stored_files.file_response(manifest.parent / artefact, name, known[artefact])


def _ready(service: Service, session_id: str, number: int) -> Artifact:
    """Returns the journal's entry of a result. Raises RigError result.not_ready if pending, else request.not_found."""
    row = service.store.journal.session(session_id)
    entry = stored_files.newest(service, session_id, "result", number)
    if entry is not None:
        return entry
    service.resolving.raise_outcome(session_id, number)
    if row.state not in session_state.ENDED and number < session.max_passes(row.recipe):
        raise RigError(
            ErrorCode.RESULT_NOT_READY,
            f"Session {session_id} is {row.state} and has no result {number} yet",
            state=row.state,
            allowed=[str(action) for action in session_state.allowed_actions(row.state)],
        )
    raise RigError(ErrorCode.REQUEST_NOT_FOUND, f"Session {session_id} is {row.state} and has no result {number}")
