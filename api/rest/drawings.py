"""Routes of drawings rendered on request, as a still or a 3-D page: the reach of the arm, and a route.

A drawing takes seconds and depends only on stored values. Their hash is its ETag, so that a caller who has the drawing
receives a 304 before anything is rendered. The newest drawings are kept for other callers.
"""

import hashlib
from functools import partial
from importlib.metadata import version
from typing import Annotated, Literal

import anyio.to_thread
from fastapi import APIRouter, Request
from fastapi import Path as InPath
from fastapi.responses import Response

from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.route import Route
from acquisition.runner.memo import Memo
from acquisition.store.folder import read_value
from api.rest import problems, stored_files
from api.rest.conditional import is_current
from api.rest.dependencies import Number, ServiceOf, SessionId
from api.rest.turns import in_turn
from api.rest.wiring import Service

router = APIRouter()

Format = Annotated[Literal["png", "html"], InPath(description="A still, or a 3-D page")]
_TYPES = {"png": "image/png", "html": "text/html"}
_PICTURE = stored_files.binary(*_TYPES.values(), description="The still, or the page")
_BUSY = problems.responses_of(
    ErrorCode.RIG_BUSY, ErrorCode.RIG_NOT_READY, ErrorCode.SESSION_STEP_FAILED, ErrorCode.COMPUTE_LOST,
    ErrorCode.SERVICE_OVERLOADED,
)  # fmt: skip

KEPT_DRAWINGS = 4
"""Number of newest drawings that are kept; a 3-D page has 5 MB."""


@router.get(
    "/v1/rig/reach.{form}",
    tags=["rig"],
    response_class=Response,
    responses={**_PICTURE, **stored_files.NOT_MODIFIED, **_BUSY},
)
async def reach_picture(service: ServiceOf, request: Request, form: Format) -> Response:
    """Returns a drawing of the arm's reach with reasons of refusals: the dome seen from the camera, or a 3-D page."""
    runner = service.runner
    reach = await in_turn(service.limits.reach, runner.planning.reach)
    cell = runner.choices.lamp_cell
    draw = partial(runner.render, "draw_reach", cell, service.calibration, runner.planning.reach_file, form)
    return await _rendered(service, request, draw, form, reach, cell, service.calibration)


@router.get(
    "/v1/sessions/{session_id}/passes/{number}/route.{form}",
    tags=["sessions"],
    response_class=Response,
    responses={
        **_PICTURE,
        **stored_files.NOT_MODIFIED,
        **_BUSY,
        **problems.responses_of(ErrorCode.SESSION_NOT_FOUND, ErrorCode.REQUEST_NOT_FOUND, ErrorCode.STORE_CORRUPT),
    },
)
async def route_picture(
    service: ServiceOf, request: Request, session_id: SessionId, number: Number, form: Format
) -> Response:
    """Returns a drawing of the cell, a pass's lights in order of travel, and the lamp's path through them and home."""
    route, cell, calibration = await anyio.to_thread.run_sync(
        _stored_route, service, session_id, number, limiter=service.limits.pictures
    )
    draw = partial(service.runner.render, "draw_route", route, cell, calibration, form)
    return await _rendered(service, request, draw, form, route.model_dump_json(), cell, calibration)


def _stored_route(service: Service, session_id: str, number: int) -> tuple[Route, CellConfig, Calibration]:
    """Reads a pass's route, and the cell and calibration with which the session began."""
    service.store.journal.session(session_id)
    entry = stored_files.newest(service, session_id, "route", number)
    if entry is None:
        raise RigError(ErrorCode.REQUEST_NOT_FOUND, f"Pass {number} of session {session_id} has no route (yet)")
    folder = service.store.folder(session_id)
    return (
        read_value(Route, folder, entry.path),
        read_value(CellConfig, folder, "cell.json"),
        read_value(Calibration, folder, "calibration.json"),
    )


async def _rendered(
    service: Service,
    request: Request,
    draw: partial[bytes],
    form: str,
    drawn: str,
    cell: CellConfig,
    calibration: Calibration,
) -> Response:
    """Responds with a drawing of these values, or with 304 if the caller has it."""
    parts = (version("lightpose"), form, drawn, cell.model_dump_json(), calibration.model_dump_json())
    headers = stored_files.revalidated(hashlib.sha256("\0".join(parts).encode()).hexdigest()[:32])
    if is_current(request.headers.get("if-none-match", ""), headers["ETag"]):
        return Response(status_code=304, headers=headers)
    drawings: Memo[bytes] = request.app.state.drawings
    content = await anyio.to_thread.run_sync(drawings.of, headers["ETag"], draw, limiter=service.limits.pictures)
    return Response(content, media_type=_TYPES[form], headers=headers)
