"""Routes of the page on which one can try the API: Swagger UI over this service's own description, without a network.

The files are those of the npm package swagger-ui-dist 5.35.0 (Apache 2.0; its licences lie beside them), less the lines
that name source maps; they are package data, so that a laboratory without internet has the page too. As the operator's
page it needs no key: it holds none, and sends the one that is typed into it.
"""

from functools import cache

from api.rest import static_files
from api.rest.static_files import StaticFile

CONTENT_SECURITY_POLICY = (
    "default-src 'self'; img-src 'self' data: blob:; object-src 'none'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
"""This host alone, no inline scripts, no inline styles; the page's icons are `data:`, pictures of answers `blob:`."""


@cache
def files() -> dict[str, StaticFile]:
    """Reads the page's files, by name; once for a process."""
    return static_files.read("api.rest", "swagger_ui")


router = static_files.router("/docs", "/docs", files, CONTENT_SECURITY_POLICY)
