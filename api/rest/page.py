"""Routes of the operator's page: a static bundle, which does nothing that a script over this API could not do.

The bundle is built from `api/page/sources` and committed in `api/page/built`, so a user needs no Node. It is served
without a key, since it holds none: the page asks for the key itself and sends it with each request. Its content
security policy allows this host alone and neither inline scripts nor inline styles, so that a label or a note of a
session, whatever stands in it, can never run as a script beside the stop. The one addition is `blob:` for pictures:
with keys an image cannot be the address of an `<img>`, which sends no header, so the page fetches it with its key and
shows it from memory.
"""

from functools import cache

from api.rest import static_files
from api.rest.static_files import StaticFile

CONTENT_SECURITY_POLICY = (
    "default-src 'self'; img-src 'self' blob:; object-src 'none'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)


@cache
def bundle() -> dict[str, StaticFile]:
    """Reads the built bundle, by file name; once for a process."""
    return static_files.read("api", "page", "built")


router = static_files.router("/", "/page", bundle, CONTENT_SECURITY_POLICY)
