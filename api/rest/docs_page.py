"""Routes of the page for trying the API: Swagger UI with this service's own description, without a network.

The files are those of the npm package swagger-ui-dist 5.35.0 (Apache 2.0; its licences are beside them), without the
lines that name source maps. They are package data, so that the page works without internet. Like the operator's page it
needs no key: it holds none, and sends the key that a person types into it.
"""

from functools import cache

from api.rest import static_files
from api.rest.static_files import StaticFile

CONTENT_SECURITY_POLICY = (
    "default-src 'self'; img-src 'self' data: blob:; object-src 'none'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
"""Only this host, no inline scripts or styles. The page's icons are `data:`, pictures of answers are `blob:`."""


@cache
def files() -> dict[str, StaticFile]:
    """Reads the page's files, by name, once per process."""
    return static_files.read("api.rest", "swagger_ui")


router = static_files.router("/docs", "/docs", files, CONTENT_SECURITY_POLICY)
