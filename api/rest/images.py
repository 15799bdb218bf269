"""Routes of a session's images: the frame as captured, a picture of it, and a thumbnail.

Pass and shot numbers name a place in the session, not a frame: when the object was moved, the images of a pass are
discarded and taken anew under the same numbers. An answer is therefore immutable only under an address that holds the
frame's hash (`?frame=`), which answers 404 once the shot has another frame. Without the hash a browser revalidates each
time, with the frame's hash as ETag.
"""

from functools import lru_cache
from pathlib import Path
from typing import Annotated, Literal

import anyio.to_thread
from fastapi import APIRouter, Depends, Query
from fastapi.responses import FileResponse, Response

from acquisition.models.calibration import SensorModel
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.shot import Shot
from api.rest import image_encoding, problems, stored_files
from api.rest.dependencies import Number, ServiceOf, SessionId, refuse_unknown_query
from api.rest.wiring import Service

router = APIRouter(tags=["sessions"])

HASH_DIGITS = 16
"""Number of digits of a frame's SHA-256 in an address."""

KEPT_THUMBNAILS = 512
"""Number of thumbnails kept in memory; each takes about 10 kB."""

FrameHash = Annotated[
    str | None,
    Query(
        min_length=HASH_DIGITS,
        max_length=64,
        pattern="^[0-9a-f]+$",
        description="First digits of the frame's SHA-256: the answer is then immutable, and 404 once the shot has been "
        "taken again",
    ),
]


def links(pass_path: str, shot: Shot) -> dict[str, str]:
    """Returns the addresses of a shot's image and thumbnail."""
    shot_path = f"{pass_path}/shots/{shot.key.number}"
    return {
        "image": f"{shot_path}/image",
        "thumbnail": f"{shot_path}/thumbnail.jpg?frame={shot.frame.sha256[:HASH_DIGITS]}",
    }


@router.get(
    "/v1/sessions/{session_id}/passes/{number}/shots/{shot_number}/image",
    response_class=Response,
    responses={
        **stored_files.binary("image/png", "image/tiff", description="The image, in the form that was asked for"),
        **stored_files.NOT_MODIFIED,
        **problems.NOT_FOUND,
        **problems.responses_of(ErrorCode.STORE_CORRUPT, ErrorCode.REQUEST_INVALID),
    },
    dependencies=[Depends(refuse_unknown_query)],
)
async def image(
    service: ServiceOf,
    session_id: SessionId,
    number: Number,
    shot_number: Number,
    format: Annotated[  # noqa: A002 - the name in the address
        Literal["png", "tiff"], Query(description="`png`: 8 bits, gamma 2.2; `tiff`: linear 16 bits, as captured")
    ] = "png",
    frame: FrameHash = None,
) -> Response:
    """Returns one image as an 8-bit picture, or with `?format=tiff` as the linear 16-bit frame as captured."""
    shot, path = await anyio.to_thread.run_sync(_shot, service, session_id, number, shot_number, frame)
    if format == "tiff":
        headers = _caching(shot.frame.sha256, frame)
        return _tiff(path, f"{session_id}-pass{number}-shot{shot_number}.tiff", headers)
    picture = await anyio.to_thread.run_sync(
        image_encoding.png, path, service.calibration.sensor, limiter=service.limits.pictures
    )
    return Response(picture, media_type="image/png", headers=_caching(f"{shot.frame.sha256}-8", frame))


@router.get(
    "/v1/sessions/{session_id}/passes/{number}/shots/{shot_number}/thumbnail.jpg",
    response_class=Response,
    responses={
        **stored_files.binary("image/jpeg", description="The small image"),
        **stored_files.NOT_MODIFIED,
        **problems.NOT_FOUND,
        **problems.responses_of(ErrorCode.STORE_CORRUPT, ErrorCode.REQUEST_INVALID),
    },
    dependencies=[Depends(refuse_unknown_query)],
)
async def thumbnail(
    service: ServiceOf,
    session_id: SessionId,
    number: Number,
    shot_number: Number,
    width: Annotated[int, Query(ge=16, le=1024, description="Width in px; a narrower image is not enlarged")] = 240,
    frame: FrameHash = None,
) -> Response:
    """Returns a small JPEG of one image, on one scale for all images (black level to full scale, gamma 2.2)."""
    shot, path = await anyio.to_thread.run_sync(_shot, service, session_id, number, shot_number, frame)
    picture = await anyio.to_thread.run_sync(
        _thumbnail,
        str(path),
        shot.frame.sha256,
        width,
        service.calibration.sensor.model_dump_json(),
        limiter=service.limits.pictures,
    )
    return Response(picture, media_type="image/jpeg", headers=_caching(f"{shot.frame.sha256}-{width}", frame))


@lru_cache(maxsize=KEPT_THUMBNAILS)
def _thumbnail(path: str, sha256: str, width: int, sensor_json: str) -> bytes:
    """Encodes a frame as a small JPEG. The hash is part of the cache's key, because the file may be replaced."""
    del sha256
    pixels = image_encoding.read_frame(Path(path))
    return image_encoding.thumbnail(pixels, SensorModel.model_validate_json(sensor_json), width)


def _caching(digest: str, frame: str | None) -> dict[str, str]:
    return stored_files.revalidated(digest) if frame is None else stored_files.immutable(digest)


def _tiff(path: Path, name: str, headers: dict[str, str]) -> FileResponse:
    if not path.is_file():
        raise RigError(ErrorCode.STORE_CORRUPT, f"{path.name} is missing", file=path.name)
    return FileResponse(
        path, media_type="image/tiff", filename=name, content_disposition_type="inline", headers=headers
    )


def _shot(service: Service, session_id: str, pass_number: int, number: int, frame: str | None) -> tuple[Shot, Path]:
    """Returns a shot and the path of its frame. Raises RigError session.not_found, request.not_found."""
    folder = service.store.folder(session_id)
    for shot in service.store.journal.shots(session_id):
        if (shot.key.pass_number, shot.key.number) == (pass_number, number):
            if frame is not None and not shot.frame.sha256.startswith(frame):
                raise RigError(
                    ErrorCode.REQUEST_NOT_FOUND,
                    f"Shot {number} of pass {pass_number} has been taken again since: it has another frame now",
                    frame=shot.frame.sha256,
                )
            return shot, folder / shot.frame.path
    raise RigError(ErrorCode.REQUEST_NOT_FOUND, f"Pass {pass_number} has no shot {number} (yet)")
