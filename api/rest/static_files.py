"""Static pages of package data: read once, served plain or compressed, revalidated by their hash."""

import gzip
import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from importlib import resources
from typing import Annotated

from fastapi import APIRouter, Header, Path
from fastapi.responses import Response

from acquisition.models.errors import ErrorCode, RigError

MEDIA_TYPES = {
    ".html": "text/html",
    ".js": "text/javascript",
    ".css": "text/css",
    ".svg": "image/svg+xml",
    ".txt": "text/plain",
}
"""Media types of files by suffix. Other files are not served."""

HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",  # an address may carry a ticket
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-cache",  # revalidated by ETag, so that an upgraded service never meets its old page
    "Vary": "Accept-Encoding",
}


@dataclass(frozen=True)
class StaticFile:
    """One file of a page, plain and compressed."""

    content: bytes
    compressed: bytes
    media_type: str
    etag: str


def read(package: str, *folder: str) -> dict[str, StaticFile]:
    """Reads the files of a folder of package data, by name."""
    return {
        file.name: _file(file.read_bytes(), MEDIA_TYPES[suffix])
        for file in resources.files(package).joinpath(*folder).iterdir()
        if (suffix := "." + file.name.rpartition(".")[2]) in MEDIA_TYPES
    }


def _answer(files: dict[str, StaticFile], name: str, policy: str, accept_encoding: str) -> Response:
    """Responds with a file under a content security policy. Raises RigError request.not_found for an unknown file."""
    file = files.get(name)
    if file is None:
        raise RigError(ErrorCode.REQUEST_NOT_FOUND, "The page has no file of this name", files=sorted(files))
    headers = {**HEADERS, "Content-Security-Policy": policy, "ETag": file.etag}
    if "gzip" in accept_encoding:
        return Response(file.compressed, media_type=file.media_type, headers={**headers, "Content-Encoding": "gzip"})
    return Response(file.content, media_type=file.media_type, headers=headers)


def router(index: str, parts: str, files: Callable[[], dict[str, StaticFile]], policy: str) -> APIRouter:
    """Makes the routes of a page under a content security policy: index.html at `index`, its files below `parts`.

    `files` is called at each request.
    """
    made = APIRouter(include_in_schema=False)

    @made.get(index)
    async def page(accept_encoding: Annotated[str, Header()] = "") -> Response:
        return _answer(files(), "index.html", policy, accept_encoding)

    @made.get(f"{parts}/{{name}}")
    async def part(
        name: Annotated[str, Path(max_length=100)], accept_encoding: Annotated[str, Header()] = ""
    ) -> Response:
        return _answer(files(), name, policy, accept_encoding)

    _ = page, part  # registered
    return made


def _file(content: bytes, media_type: str) -> StaticFile:
    digest = hashlib.sha256(content).hexdigest()
    return StaticFile(content, gzip.compress(content, mtime=0), media_type, f'W/"{digest}"')
