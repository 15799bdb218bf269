"""Pictures of what the arm can reach and of a route: stills, and pages that can be turned; made when asked for."""

from functools import partial
from typing import Annotated, Any, Literal

import anyio.to_thread
from fastapi import APIRouter
from fastapi import Path as InPath
from fastapi.responses import Response

from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.route import Route
from api.rest import problems, stored
from api.rest.context import Number, ServiceOf, SessionId
from api.rest.wiring import Service

router = APIRouter()

Form = Annotated[Literal["png", "html"], InPath(description="A still, or a page that can be turned")]
_TYPES = {"png": "image/png", "html": "text/html"}
_PICTURE: dict[int | str, dict[str, Any]] = {200: {"content": {kind: {} for kind in _TYPES.values()}}}
_BUSY = problems.declared(ErrorCode.RIG_BUSY, ErrorCode.RIG_NOT_READY, ErrorCode.SESSION_STEP_FAILED)


@router.get("/v1/rig/reach.{form}", tags=["rig"], response_class=Response, responses={**_PICTURE, **_BUSY})
async def reach_picture(service: ServiceOf, form: Form) -> Response:
    """What the arm can light: the dome seen from the camera, or cell and dome from all sides, with all reasons."""
    runner = service.runner
    await anyio.to_thread.run_sync(runner.reach, limiter=service.limits.reach)
    draw = partial(runner.render, "draw_reach", service.cell, service.calibration, runner.reach_file, form)
    return await _picture(service, draw, form)


@router.get(
    "/v1/sessions/{session_id}/passes/{number}/route.{form}",
    tags=["sessions"],
    response_class=Response,
    responses={
        **_PICTURE,
        **_BUSY,
        **problems.declared(ErrorCode.SESSION_NOT_FOUND, ErrorCode.REQUEST_NOT_FOUND, ErrorCode.STORE_CORRUPT),
    },
)
async def route_picture(service: ServiceOf, session_id: SessionId, number: Number, form: Form) -> Response:
    """The cell, a pass's lights in the order of travel, and the lamp's way through them and home."""
    route, cell, calibration = await anyio.to_thread.run_sync(
        _routed, service, session_id, number, limiter=service.limits.pictures
    )
    return await _picture(service, partial(service.runner.render, "draw_route", route, cell, calibration, form), form)


def _routed(service: Service, session_id: str, number: int) -> tuple[Route, CellConfig, Calibration]:
    """A pass's route, in the cell that the session began with."""
    service.store.journal.session(session_id)
    found = stored.newest(service, session_id, "route", number)
    if found is None:
        raise RigError(ErrorCode.REQUEST_NOT_FOUND, f"Pass {number} of session {session_id} has no route (yet)")
    folder = service.store.folder(session_id)
    return (
        Route.model_validate_json(stored.content(folder / found.path)),
        CellConfig.model_validate_json(stored.content(folder / "cell.json")),
        Calibration.model_validate_json(stored.content(folder / "calibration.json")),
    )


async def _picture(service: Service, draw: partial[bytes], form: str) -> Response:
    content = await anyio.to_thread.run_sync(draw, limiter=service.limits.pictures)
    return Response(content, media_type=_TYPES[form])
