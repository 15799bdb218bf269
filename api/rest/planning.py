"""What a person tells the plan, and what the plan tells a person: the region of interest, and what each light gains."""

from typing import Annotated

import anyio.to_thread
from fastapi import APIRouter, Body
from fastapi import Path as InPath
from fastapi.responses import FileResponse

from acquisition.models.errors import ErrorCode, RigError
from api.rest import problems
from api.rest.context import Actor, ServiceOf
from api.rest.schemas import RegionResource
from api.rest.wiring import Service

router = APIRouter(tags=["sessions"])

SessionId = Annotated[str, InPath(max_length=80)]
Number = Annotated[int, InPath(ge=0, le=10_000)]
_NOT_FOUND = problems.declared(ErrorCode.SESSION_NOT_FOUND, ErrorCode.REQUEST_NOT_FOUND)
_PICTURE = {200: {"content": {"image/png": {}}}}


@router.put(
    "/v1/sessions/{session_id}/region.png",
    responses={
        **problems.declared(ErrorCode.SESSION_NOT_FOUND),
        **problems.declared(
            ErrorCode.REQUEST_INVALID,
            ErrorCode.REQUEST_TOO_LARGE,
            ErrorCode.REQUEST_MEDIA_TYPE,
            ErrorCode.SESSION_ACTION_NOT_ALLOWED,
            ErrorCode.STORE_DISK_FULL,
        ),
    },
)
async def draw_region(
    service: ServiceOf,
    session_id: SessionId,
    actor: Actor,
    mask: Annotated[
        bytes, Body(media_type="image/png", description="A PNG of the camera's size, black where unwanted")
    ],
) -> RegionResource:
    """Says which part of the object matters: lights are planned for it, and an accuracy on order is judged by it.

    Before the start, or while the session is paused before its lights are planned; the newest mask holds.
    """
    pixels = await anyio.to_thread.run_sync(service.runner.set_region, session_id, mask, actor)
    return RegionResource(
        pixels=pixels,
        links={"self": f"/v1/sessions/{session_id}/region.png", "session": f"/v1/sessions/{session_id}"},
    )


@router.get("/v1/sessions/{session_id}/region.png", response_class=FileResponse, responses={**_PICTURE, **_NOT_FOUND})
def region(service: ServiceOf, session_id: SessionId) -> FileResponse:
    """The region of interest that holds, white on black."""
    service.store.journal.session(session_id)
    found = service.store.journal.artifacts(session_id, "region")
    if not found:
        raise RigError(ErrorCode.REQUEST_NOT_FOUND, f"Session {session_id} has no region of interest: all pixels count")
    return _picture(service, session_id, found[-1].path, found[-1].sha256)


@router.get(
    "/v1/sessions/{session_id}/passes/{number}/lights/{light}/gain.png",
    response_class=FileResponse,
    responses={**_PICTURE, **_NOT_FOUND, **problems.declared(ErrorCode.STORE_CORRUPT)},
)
def gain(service: ServiceOf, session_id: SessionId, number: Number, light: Number) -> FileResponse:
    """Where on the object a planned light makes the normals more certain: dark nothing, brightest
    `brightest_gain_deg` of the plan."""
    service.store.journal.session(session_id)
    plans = [item for item in service.store.journal.artifacts(session_id, "plan") if item.number == number]
    digests: list[str] = plans[-1].body.get("pictures", []) if plans else []
    if light >= len(digests):
        raise RigError(
            ErrorCode.REQUEST_NOT_FOUND, f"Pass {number} has no picture of light {light}: only planned lights have one"
        )
    return _picture(service, session_id, f"passes/{number}/gain_{light}.png", digests[light])


def _picture(service: Service, session_id: str, name: str, digest: str) -> FileResponse:
    path = service.store.folder(session_id) / name
    if not path.is_file():
        raise RigError(ErrorCode.STORE_CORRUPT, f"{name} is gone", file=name)
    # The region of interest may be drawn anew under the same address, so a browser has to ask.
    return FileResponse(path, media_type="image/png", headers={"ETag": f'"{digest}"', "Cache-Control": "no-cache"})
