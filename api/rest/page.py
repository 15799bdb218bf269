"""Routes of the operator's page: a static bundle, which does nothing that a script over this API could not do.

The bundle is built from `api/page/sources` and committed in `api/page/built`, so a user needs no Node. It is served
without a key, since it holds none: the page asks for the key itself and sends it with each request. Its content
security policy allows this host alone and neither inline scripts nor inline styles, so that a label or a note of a
session, whatever stands in it, can never run as a script beside the stop. The one addition is `blob:` for pictures:
with keys an image cannot be the address of an `<img>`, which sends no header, so the page fetches it with its key and
shows it from memory.
"""

import gzip
import hashlib
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Annotated

from fastapi import APIRouter, Header
from fastapi import Path as InPath
from fastapi.responses import Response

from acquisition.models.errors import ErrorCode, RigError

CONTENT_SECURITY_POLICY = (
    "default-src 'self'; img-src 'self' blob:; object-src 'none'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)

MEDIA_TYPES = {
    ".html": "text/html",
    ".js": "text/javascript",
    ".css": "text/css",
    ".svg": "image/svg+xml",
    ".txt": "text/plain",
}
"""Media types of the bundle's files by suffix; a file of another kind is not served."""

HEADERS = {
    "Content-Security-Policy": CONTENT_SECURITY_POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",  # an address may carry a ticket
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-cache",  # revalidated by ETag, so that an upgraded service never meets its old page
    "Vary": "Accept-Encoding",
}

router = APIRouter(include_in_schema=False)


@dataclass(frozen=True)
class BundleFile:
    """One file of the bundle, as it is and compressed."""

    content: bytes
    compressed: bytes
    media_type: str
    etag: str


@cache
def bundle() -> dict[str, BundleFile]:
    """Reads the built bundle, by file name; once for a process."""
    folder = resources.files("api").joinpath("page", "built")
    return {
        file.name: _file(file.read_bytes(), MEDIA_TYPES[suffix])
        for file in folder.iterdir()
        if (suffix := "." + file.name.rpartition(".")[2]) in MEDIA_TYPES
    }


@router.get("/")
async def index(accept_encoding: Annotated[str, Header()] = "") -> Response:
    """The page."""
    return _answer("index.html", accept_encoding)


@router.get("/page/{name}")
async def part(
    name: Annotated[str, InPath(max_length=100)], accept_encoding: Annotated[str, Header()] = ""
) -> Response:
    """A file of the page's bundle."""
    return _answer(name, accept_encoding)


def _answer(name: str, accept_encoding: str) -> Response:
    file = bundle().get(name)
    if file is None:
        raise RigError(ErrorCode.REQUEST_NOT_FOUND, "The page has no file of this name", files=sorted(bundle()))
    headers = {**HEADERS, "ETag": file.etag}
    if "gzip" in accept_encoding:
        return Response(file.compressed, media_type=file.media_type, headers={**headers, "Content-Encoding": "gzip"})
    return Response(file.content, media_type=file.media_type, headers=headers)


def _file(content: bytes, media_type: str) -> BundleFile:
    digest = hashlib.sha256(content).hexdigest()
    return BundleFile(content, gzip.compress(content, mtime=0), media_type, f'W/"{digest}"')
