"""Routes of the page on which one can try the API: Swagger UI over this service's own description, without a network.

The files are those of the npm package swagger-ui-dist 5.35.0 (Apache 2.0; its licences lie beside them), less the lines
that name source maps; they are package data, so that a laboratory without internet has the page too. As the operator's
page it needs no key: it holds none, and sends the one that is typed into it.
"""

from functools import cache
from typing import Annotated

from fastapi import APIRouter, Header
from fastapi import Path as InPath
from fastapi.responses import Response

from api.rest import static_files
from api.rest.static_files import StaticFile

CONTENT_SECURITY_POLICY = (
    "default-src 'self'; img-src 'self' data: blob:; object-src 'none'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
"""This host alone, no inline scripts, no inline styles; the page's icons are `data:`, pictures of answers `blob:`."""

router = APIRouter(include_in_schema=False)


@cache
def files() -> dict[str, StaticFile]:
    """Reads the page's files, by name; once for a process."""
    return static_files.read("api.rest", "swagger_ui")


@router.get("/docs")
async def index(accept_encoding: Annotated[str, Header()] = "") -> Response:
    """The page."""
    return static_files.answer(files(), "index.html", CONTENT_SECURITY_POLICY, accept_encoding)


@router.get("/docs/{name}")
async def part(
    name: Annotated[str, InPath(max_length=100)], accept_encoding: Annotated[str, Header()] = ""
) -> Response:
    """A file of the page."""
    return static_files.answer(files(), name, CONTENT_SECURITY_POLICY, accept_encoding)
