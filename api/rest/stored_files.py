"""Files that the journal names, as HTTP responses.

A file that was announced never changes, so browsers may cache it for good, with its digest as ETag. The exceptions are
images under an address that may receive other content; a browser must revalidate those.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fastapi.responses import FileResponse
from starlette.convertors import Convertor, register_url_convertor

from acquisition.models.errors import ErrorCode, RigError
from acquisition.store import Artifact
from acquisition.store.folder import damaged
from api.rest.wiring import Service


class FileName(Convertor[str]):
    """Path convertor for a file's name: a part with a dot, which no other address below a result has."""

    regex = r"[^/]*\.[^/]*"

    def convert(self, value: str) -> str:
        """Returns the name unchanged."""
        return value

    def to_string(self, value: str) -> str:
        """Returns the name unchanged."""
        return value


register_url_convertor("file", FileName())

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


ARTEFACT_TYPES = sorted(set(MEDIA_TYPES.values()), key=lambda kind: (kind != "application/octet-stream", kind))
"""Media types of a result's files. The type for any bytes is first; generated clients receive the content by it."""

NOT_MODIFIED: dict[int | str, dict[str, Any]] = {304: {"description": "The ETag of `If-None-Match` is still valid"}}
"""OpenAPI response of routes whose answers have an ETag."""


def binary(*media_types: str, description: str) -> dict[int | str, dict[str, Any]]:
    """Returns the OpenAPI response of a route that answers bytes of these types; text as text, JSON as an object."""
    content = {kind: {"schema": _schema(kind)} for kind in media_types}
    return {200: {"description": description, "content": content}}


def _schema(media_type: str) -> dict[str, str]:
    if media_type.startswith("text/"):
        return {"type": "string"}
    if media_type == "application/json":
        return {"type": "object"}
    return {"type": "string", "format": "binary", "contentMediaType": media_type}


def newest(service: Service, session_id: str, kind: str, number: int) -> Artifact | None:
    """Returns the newest artefact of a kind and number in a session, None without one."""
    entries = [item for item in service.store.journal.artifacts(session_id, kind) if item.number == number]
    return entries[-1] if entries else None


def read_bytes(path: Path) -> bytes:
    """Reads a file that the journal names. Raises RigError store.corrupt when it cannot be read."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise RigError(ErrorCode.STORE_CORRUPT, f"{path.name}: {error.strerror}", file=path.name) from error


@dataclass(frozen=True)
class ManifestEntry:
    """A file as a manifest states it."""

    bytes: int
    sha256: str


def manifest_entries(folder: Path, manifest: str) -> dict[str, ManifestEntry]:
    """Reads the entries of a manifest in a session's folder, by file name.

    Raises RigError store.corrupt, naming session and file, when it is missing or is no manifest.
    """
    try:
        files = json.loads((folder / manifest).read_bytes())["files"]
        return {str(name): ManifestEntry(int(facts["bytes"]), str(facts["sha256"])) for name, facts in files.items()}
    except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:
        raise damaged(folder, manifest, error) from error


def file_response(path: Path, name: str, digest: str) -> FileResponse:
    """Responds with a file to be saved as `name` and cached for good. Raises RigError store.corrupt without it."""
    if not path.is_file():
        raise RigError(ErrorCode.STORE_CORRUPT, f"{path.name} is missing", file=path.name)
    media_type = MEDIA_TYPES.get(path.suffix, "application/octet-stream")
    return FileResponse(
        path, media_type=media_type, filename=name, content_disposition_type="inline", headers=immutable(digest)
    )


def immutable(digest: str) -> dict[str, str]:
    """Returns the headers of content that never changes: its digest as ETag, to be cached for a year."""
    return {"ETag": f'"{digest}"', "Cache-Control": "private, max-age=31536000, immutable"}


def revalidated_png(path: Path, digest: str) -> FileResponse:
    """Responds with a PNG whose address may later hold another one, so that browsers must revalidate it by its ETag.

    Raises RigError store.corrupt when the file is missing.
    """
    if not path.is_file():
        raise RigError(ErrorCode.STORE_CORRUPT, f"{path.name} is missing", file=path.name)
    return FileResponse(path, media_type="image/png", headers=revalidated(digest))


def revalidated(digest: str) -> dict[str, str]:
    """Returns the headers of content that may change at its address: browsers keep it and revalidate it each time."""
    return {"ETag": f'"{digest}"', "Cache-Control": "private, no-cache"}
