"""Routes of calibration sessions besides those of all sessions: the kinds of calibration, and a session's estimates.

The kinds follow from the recipes' schemas, so that a page or a script offers a new kind without a change: the named
schema defines the form, and `tool` states what must be on the flange.
"""

from datetime import UTC, datetime
from typing import Annotated, get_args

from fastapi import APIRouter, Request
from fastapi import Path as InPath
from fastapi.responses import FileResponse

from acquisition.models import calibration_recipe
from acquisition.models.calibration_recipe import CalibrationRecipe
from acquisition.models.calibration_result import CalibrationSummary
from acquisition.models.errors import ErrorCode, RigError
from acquisition.runner import calibration_checks
from acquisition.store import Artifact
from api.rest import problems, stored_files
from api.rest.calibration_schemas import CalibrationKindResource, EstimateResource
from api.rest.dependencies import Number, ServiceOf, SessionId
from api.rest.paging import Limit, Offset, page
from api.rest.schemas import ArtefactResource, Page, as_datetime
from api.rest.wiring import Service

router = APIRouter()


@router.get("/v1/rig/calibration-kinds", tags=["rig"])
def calibration_kinds(service: ServiceOf) -> Page[CalibrationKindResource]:
    """Lists the kinds of calibration sessions (`POST /v1/sessions`), what each needs, and its newest result's age."""
    now, sets = datetime.now(UTC), service.store.calibrations.all()
    made = {one.kind: one for one in sets}  # the last of a kind: they come oldest first
    made_at = {kind: one.made_at for kind, one in made.items()}
    checks = calibration_checks.newest(service.store).values()
    made_at |= {"check": max(one.made_at for one in checks)} if checks else {}
    result: list[CalibrationKindResource] = []
    for recipe in _recipes():
        field = recipe.model_fields["kind"]
        for kind in get_args(field.annotation):
            newest, since = made.get(kind), made_at.get(kind)
            age = None if since is None else (now - datetime.fromisoformat(since)).total_seconds() / 86_400
            result.append(
                CalibrationKindResource(
                    kind=kind,
                    recipe=recipe.__name__,
                    explanation=field.description or "",
                    tool=recipe.tool,
                    made_at=since,
                    age_days=age,
                    calibration=None if newest is None else newest.id,
                    links={"sessions": "/v1/sessions", "tool": "/v1/rig/tool", "calibrations": "/v1/rig/calibrations"},
                )
            )
    return Page[CalibrationKindResource](items=result)


@router.get("/v1/sessions/{session_id}/estimates", tags=["sessions"], responses=problems.NOT_FOUND)
def estimates(
    service: ServiceOf, request: Request, session_id: SessionId, limit: Limit = 100, after: Offset = 0
) -> Page[EstimateResource]:
    """Lists the estimates of a calibration session so far, oldest first. A capture session has none."""
    service.store.journal.session(session_id)
    made = service.store.journal.artifacts(session_id, "estimate")
    return page(request, [_resource(service, session_id, entry) for entry in made], limit, after)


@router.get(
    "/v1/sessions/{session_id}/estimates/{number}/{artefact:file}",
    tags=["sessions"],
    response_class=FileResponse,
    responses={
        **stored_files.binary("application/json", "image/png", "text/html", description="The file"),
        **problems.NOT_FOUND,
        **problems.responses_of(ErrorCode.STORE_CORRUPT),
    },
)
def estimate_file(
    service: ServiceOf,
    session_id: SessionId,
    number: Number,
    artefact: Annotated[str, InPath(max_length=100, description="File name, one of the estimate's `artefacts`")],
) -> FileResponse:
    """Returns one file of an estimate: values with covariance, residuals of each image, corners, pictures."""
    service.store.journal.session(session_id)
    entry = stored_files.newest(service, session_id, "estimate", number)
    if entry is None:
        raise RigError(ErrorCode.REQUEST_NOT_FOUND, f"Session {session_id} has no estimate {number}")
    folder = service.store.folder(session_id)
    known = stored_files.manifest_entries(folder, entry.path)
    if artefact not in known:  # only names in the manifest reach the file system
        raise RigError(
            ErrorCode.REQUEST_NOT_FOUND, f"Estimate {number} has no file of this name", artefacts=sorted(known)
        )
    name = f"{session_id}-{number}-{artefact}"
    return stored_files.file_response((folder / entry.path).parent / artefact, name, known[artefact].sha256)


def _recipes() -> list[type[CalibrationRecipe]]:
    """Returns the calibration recipes among all recipes of a session."""
    union = get_args(calibration_recipe.AnyRecipe)[0]
    members = [get_args(tagged)[0] for tagged in get_args(union)]
    return [one for one in members if issubclass(one, CalibrationRecipe)]


def _resource(service: Service, session_id: str, entry: Artifact) -> EstimateResource:
    address = f"/v1/sessions/{session_id}/estimates/{entry.number}"
    files = stored_files.manifest_entries(service.store.folder(session_id), entry.path)
    return EstimateResource(
        number=entry.number,
        created=as_datetime(entry.created_at),
        seconds=entry.body["seconds"],
        summary=CalibrationSummary.model_validate(
            {name: entry.body[name] for name in CalibrationSummary.model_fields if name in entry.body}
        ),
        artefacts=[
            ArtefactResource(name=name, bytes=facts.bytes, sha256=facts.sha256, href=f"{address}/{name}")
            for name, facts in files.items()
        ],
        links={"session": f"/v1/sessions/{session_id}"},
    )
