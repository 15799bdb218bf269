"""Results over HTTP: their figures and files, exports made when they are first fetched, and solving again.

Solving again needs no hardware: it is accepted at once, done when no session runs, and told by an event.
"""

from typing import Annotated

import anyio.to_thread
from fastapi import APIRouter, Body, Request, Response
from fastapi import Path as InPath
from fastapi.responses import FileResponse

from acquisition import session
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.result import ResultSummary
from acquisition.runner.re_solve import EXPORTS
from acquisition.store import Artifact
from api.rest import problems, stored
from api.rest.context import Actor, Number, ServiceOf, SessionId
from api.rest.paging import Limit, Seen, page
from api.rest.schemas import (
    AnswerChoice,
    ArtefactResource,
    Page,
    ResolveAccepted,
    ResolveRequest,
    ResultResource,
    moment,
)
from api.rest.wiring import Service

router = APIRouter(tags=["sessions"])

_CHOOSE = "choose-answer"
_NOT_FOUND = problems.declared(ErrorCode.SESSION_NOT_FOUND, ErrorCode.REQUEST_NOT_FOUND)


@router.get("/v1/sessions/{session_id}/results", responses=_NOT_FOUND)
def results(
    service: ServiceOf, request: Request, session_id: SessionId, limit: Limit = 100, after: Seen = 0
) -> Page[ResultResource]:
    """The results so far, oldest first; the last one of origin `session` is the session's answer."""
    service.store.journal.session(session_id)
    found = service.store.journal.artifacts(session_id, "result")
    return page(request, [resource(service, session_id, item) for item in found], limit, after)


@router.post(
    "/v1/sessions/{session_id}/results",
    status_code=202,
    responses={
        **_NOT_FOUND,
        **problems.declared(
            ErrorCode.SESSION_ACTION_NOT_ALLOWED,
            ErrorCode.NORMALS_INFEASIBLE,
            ErrorCode.REQUEST_INVALID,
            ErrorCode.REQUEST_TOO_LARGE,
            ErrorCode.REQUEST_MEDIA_TYPE,
        ),
    },
)
def resolve(
    service: ServiceOf,
    session_id: SessionId,
    actor: Actor,
    response: Response,
    request: Annotated[
        ResolveRequest, Body(description="`{}`: all images, with the usual settings")
    ] = ResolveRequest(),  # noqa: B008 - frozen
) -> ResolveAccepted:
    """Solves the images of a session that has ended again, with other settings; no hardware is touched.

    The event `normals.ready` tells that the result is there, `resolve.failed` that there is none and why.
    """
    wish = service.resolving.submit(session_id, request.settings, request.last_pass, actor)
    here = f"/v1/sessions/{session_id}"
    response.headers["Location"] = f"{here}/results/{wish.number}"
    return ResolveAccepted(
        number=wish.number,
        links={
            "result": f"{here}/results/{wish.number}",
            "session": here,
            "events": f"/v1/events?session_id={session_id}&after=0",
        },
    )


@router.get(
    "/v1/sessions/{session_id}/results/{number}",
    responses={**_NOT_FOUND, **problems.declared(ErrorCode.RESULT_NOT_READY, ErrorCode.NORMALS_INFEASIBLE)},
)
def result(service: ServiceOf, session_id: SessionId, number: Number) -> ResultResource:
    """One result: its figures and its files; where solving again has failed, why."""
    return resource(service, session_id, _ready(service, session_id, number))


@router.get(
    "/v1/sessions/{session_id}/results/{number}/{artefact}",
    response_class=FileResponse,
    responses={
        200: {"content": {media_type: {} for media_type in sorted(set(stored.MEDIA_TYPES.values()))}},
        **_NOT_FOUND,
        **problems.declared(
            ErrorCode.RESULT_NOT_READY, ErrorCode.NORMALS_INFEASIBLE, ErrorCode.RIG_BUSY, ErrorCode.STORE_CORRUPT
        ),
    },
)
async def artefact(
    service: ServiceOf, session_id: SessionId, number: Number, artefact: Annotated[str, InPath(max_length=100)]
) -> FileResponse:
    """One file of a result by its name: maps, `report.html`, or an export, which is made when it is first asked for."""
    limiter = service.limits.exports if artefact in EXPORTS else None
    return await anyio.to_thread.run_sync(_artefact, service, session_id, number, artefact, limiter=limiter)


@router.patch(
    "/v1/sessions/{session_id}",
    responses={
        **_NOT_FOUND,
        **problems.declared(
            ErrorCode.RESULT_NOT_READY,
            ErrorCode.NORMALS_INFEASIBLE,
            ErrorCode.REQUEST_INVALID,
            ErrorCode.REQUEST_TOO_LARGE,
            ErrorCode.REQUEST_MEDIA_TYPE,
        ),
    },
)
def choose_answer(service: ServiceOf, session_id: SessionId, actor: Actor, choice: AnswerChoice) -> ResultResource:
    """Says which result is the session's answer: without a choice it is the last one of origin `session`."""
    entry = _ready(service, session_id, choice.answer)
    service.store.journal.record_action(session_id, _CHOOSE, actor, f"result {choice.answer}")
    service.store.journal.announce(session_id, "answer.chosen", {"number": choice.answer, "by": actor})
    return resource(service, session_id, entry)


def answer(service: Service, session_id: str) -> ResultResource | None:
    """The session's answer: the result that a person chose last, else the newest that the session itself made."""
    found = service.store.journal.artifacts(session_id, "result")
    chosen = [item.outcome for item in service.store.journal.actions(session_id) if item.action == _CHOOSE]
    of_choice = [item for item in found if chosen and f"result {item.number}" == chosen[-1]]
    own = of_choice or [item for item in found if item.body["origin"] == "session"]
    return resource(service, session_id, own[-1]) if own else None


def resource(service: Service, session_id: str, entry: Artifact) -> ResultResource:
    """A result of the journal as it is answered."""
    here = f"/v1/sessions/{session_id}/results/{entry.number}"
    figures = {name: entry.body[name] for name in ResultSummary.model_fields if name in entry.body}
    return ResultResource(
        number=entry.number,
        passes=entry.body.get("passes", list(range(entry.number + 1))),
        origin=entry.body["origin"],
        settings=entry.body.get("settings"),
        created=moment(entry.created_at),
        seconds=entry.body["seconds"],
        summary=ResultSummary.model_validate(figures),
        artefacts=[
            ArtefactResource(name=name, bytes=facts["bytes"], sha256=facts["sha256"], href=f"{here}/{name}")
            for name, facts in stored.files(service.store.folder(session_id) / entry.path).items()
        ],
        exports={name: f"{here}/{name}" for name in EXPORTS},
        links={"self": here, "manifest": f"{here}/manifest.json", "session": f"/v1/sessions/{session_id}"},
    )


def _artefact(service: Service, session_id: str, number: int, artefact: str) -> FileResponse:
    entry = _ready(service, session_id, number)
    name = f"{session_id}-{number}-{artefact}"
    if artefact in EXPORTS:
        path = service.resolving.make_export(session_id, number, artefact)
        return stored.answer(path, name, f"{entry.sha256}-{artefact}")
    manifest = service.store.folder(session_id) / entry.path
    known = {name: str(facts["sha256"]) for name, facts in stored.files(manifest).items()}
    known[manifest.name] = entry.sha256
    if artefact not in known:  # so no name reaches the disk that the manifest does not list
        raise RigError(
            ErrorCode.REQUEST_NOT_FOUND,
            f"Result {number} has no file of this name",
            artefacts=sorted([*known, *EXPORTS]),
        )
    return stored.answer(manifest.parent / artefact, name, known[artefact])


def _ready(service: Service, session_id: str, number: int) -> Artifact:
    """The entry of a result. Raises RigError result.not_ready while it may still come, else request.not_found."""
    row = service.store.journal.session(session_id)
    entry = stored.newest(service, session_id, "result", number)
    if entry is not None:
        return entry
    service.resolving.raise_outcome(session_id, number)
    if row.state not in session.ENDED and number < session.max_passes(row.recipe):
        raise RigError(
            ErrorCode.RESULT_NOT_READY,
            f"Session {session_id} is {row.state} and has no result {number} yet",
            state=row.state,
            allowed=[str(action) for action in session.allowed_actions(row.state)],
        )
    raise RigError(ErrorCode.REQUEST_NOT_FOUND, f"Session {session_id} is {row.state} and has no result {number}")
