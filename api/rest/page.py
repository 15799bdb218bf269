"""Routes of the operator's page: a static bundle, which does nothing that a script over this API could not do.

The bundle is built from `api/page/sources` and committed in `api/page/built`, so that users need no Node. It is served
without a key, since it contains none: the page asks for the key and sends it with each request. Its content security
policy allows only this host and neither inline scripts nor inline styles. A label or a note of a session can therefore
never run as a script beside the stop, whatever it contains. The one addition is `blob:` for pictures: an `<img>` sends
no key with its address, so the page fetches the picture with its key and shows it from memory.
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
    """Reads the built bundle, by file name, once per process."""
    return static_files.read("api", "page", "built")


router = static_files.router("/", "/page", bundle, CONTENT_SECURITY_POLICY)
