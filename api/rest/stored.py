"""Files that the journal names, as answers: what was announced never changes, so browsers may keep it."""

import json
from pathlib import Path
from typing import Any

from fastapi.responses import FileResponse

from acquisition.models.errors import ErrorCode, RigError
from acquisition.store import Artifact
from api.rest.wiring import Service

MEDIA_TYPES = {
    ".png": "image/png",
    ".tiff": "image/tiff",
    ".json": "application/json",
    ".html": "text/html",
    ".exr": "image/x-exr",
    ".ply": "application/octet-stream",
    ".lp": "text/plain",
    ".dome": "application/json",
    ".zip": "application/zip",
    ".npz": "application/octet-stream",
}


def newest(service: Service, session_id: str, kind: str, number: int) -> Artifact | None:
    """The newest artefact of this kind and number, if there is one."""
    found = [item for item in service.store.journal.artifacts(session_id, kind) if item.number == number]
    return found[-1] if found else None


def content(path: Path) -> bytes:
    """A file that the journal names. Raises RigError store.corrupt when it is gone."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise RigError(ErrorCode.STORE_CORRUPT, f"{path.name}: {error.strerror}", file=path.name) from error


def files(manifest: Path) -> dict[str, dict[str, Any]]:
    """What a manifest says of each file, by name. Raises RigError store.corrupt when it is gone."""
    return json.loads(content(manifest))["files"]


def answer(path: Path, name: str, digest: str) -> FileResponse:
    """A file as an answer under `name`. Raises RigError store.corrupt when it is gone."""
    if not path.is_file():
        raise RigError(ErrorCode.STORE_CORRUPT, f"{path.name} is gone", file=path.name)
    media_type = MEDIA_TYPES.get(path.suffix, "application/octet-stream")
    return FileResponse(
        path, media_type=media_type, filename=name, content_disposition_type="inline", headers=kept(digest)
    )


def kept(digest: str) -> dict[str, str]:
    """Headers of what never changes."""
    return {"ETag": f'"{digest}"', "Cache-Control": "private, max-age=31536000, immutable"}
