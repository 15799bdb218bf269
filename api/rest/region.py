"""Routes of the region of interest: the mask for which lights are planned and a target accuracy is judged."""

from typing import Annotated

import anyio.to_thread
from fastapi import APIRouter, Body
from fastapi.responses import FileResponse
from pydantic import WithJsonSchema

from acquisition.models.errors import ErrorCode, RigError
from api.rest import problems, stored_files
from api.rest.dependencies import Actor, ServiceOf, SessionId
from api.rest.schemas import RegionResource

router = APIRouter(tags=["sessions"])

_MASK = {
    "type": "string",
    "format": "binary",
    "contentMediaType": "image/png",
    "description": "A PNG of the camera's size, black where unwanted",
}


@router.put(
    "/v1/sessions/{session_id}/region.png",
    responses={
        **problems.responses_of(ErrorCode.SESSION_NOT_FOUND),
        **problems.responses_of(
            *problems.BODY_CODES,
            ErrorCode.SESSION_ACTION_NOT_ALLOWED,
            ErrorCode.STORE_DISK_FULL,
        ),
    },
)
async def draw_region(
    service: ServiceOf,
    session_id: SessionId,
    actor: Actor,
    mask: Annotated[bytes, Body(media_type="image/png"), WithJsonSchema(_MASK)],
) -> RegionResource:
    """Sets the region of interest: lights are planned for it, and a target accuracy is judged on it.

    Allowed before the start, or while the session is paused before its lights are planned. A new mask replaces the old
    one.
    """
    pixels = await anyio.to_thread.run_sync(service.runner.set_region, session_id, mask, actor)
    return RegionResource(
        pixels=pixels,
        links={"self": f"/v1/sessions/{session_id}/region.png", "session": f"/v1/sessions/{session_id}"},
    )


@router.get(
    "/v1/sessions/{session_id}/region.png",
    response_class=FileResponse,
    responses={**stored_files.binary("image/png", description="The mask"), **problems.NOT_FOUND},
)
def region(service: ServiceOf, session_id: SessionId) -> FileResponse:
    """Returns the present region of interest, white on black."""
    service.store.journal.session(session_id)
    entries = service.store.journal.artifacts(session_id, "region")
    if not entries:
        raise RigError(ErrorCode.REQUEST_NOT_FOUND, f"Session {session_id} has no region of interest: all pixels count")
    path = service.store.folder(session_id) / entries[-1].path
    return stored_files.revalidated_png(path, entries[-1].sha256)
