"""Routes of the operator's page: a static bundle, which does nothing that a script over this API could not do.

The bundle is built from `api/page/sources` and committed in `api/page/built`, so a user needs no Node. It is served
without a key, since it holds none: the page asks for the key itself and sends it with each request. Its content
security policy allows this host alone and neither inline scripts nor inline styles, so that a label or a note of a
session, whatever stands in it, can never run as a script beside the stop. The one addition is `blob:` for pictures:
with keys an image cannot be the address of an `<img>`, which sends no header, so the page fetches it with its key and
shows it from memory.
"""

from functools import cache
from typing import Annotated

from fastapi import APIRouter, Header
from fastapi import Path as InPath
from fastapi.responses import Response

from api.rest import static_files
from api.rest.static_files import StaticFile

CONTENT_SECURITY_POLICY = (
    "default-src 'self'; img-src 'self' blob:; object-src 'none'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)

router = APIRouter(include_in_schema=False)


@cache
def bundle() -> dict[str, StaticFile]:
    """Reads the built bundle, by file name; once for a process."""
    return static_files.read("api", "page", "built")


@router.get("/")
async def index(accept_encoding: Annotated[str, Header()] = "") -> Response:
    """The page."""
    return static_files.answer(bundle(), "index.html", CONTENT_SECURITY_POLICY, accept_encoding)


@router.get("/page/{name}")
async def part(
    name: Annotated[str, InPath(max_length=100)], accept_encoding: Annotated[str, Header()] = ""
) -> Response:
    """A file of the page's bundle."""
    return static_files.answer(bundle(), name, CONTENT_SECURITY_POLICY, accept_encoding)
