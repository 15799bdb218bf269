"""The stop of the cell as the listener's thread carries it out: without event loop, routes, or threads of a pool.

It makes the same checks as the application (host, origin, key) but answers only a request that passes them all. It
leaves any other request to the application, which refuses it with a reason. The body of a stop adds nothing to its
address, so it is not awaited, whatever its type.
"""

import time
from collections.abc import Mapping
from typing import Any

import h11
from starlette.datastructures import Headers

from acquisition.models.errors import RigError
from api.rest.authentication import STOP_PATH, Authentication
from api.rest.listener import STOP_LINE, response_bytes
from api.rest.request_checks import KnownPages
from api.rest.rig import stop_accepted
from api.rest.trusted_proxies import TrustedProxies
from api.rest.wiring import Service


class StopRequests:
    """Carries out stops of the cell. `answer` is called in the listener's thread."""

    def __init__(
        self, service: Service, pages: KnownPages, authentication: Authentication, proxies: TrustedProxies,
        security_headers: Mapping[str, str], scheme: str,
    ) -> None:  # fmt: skip
        self._service = service
        self._scheme = scheme
        self._headers = {**security_headers, "Content-Type": "application/json"}
        self._proxies = proxies
        self._pages = pages
        self._authentication = authentication

    def answer(self, head: bytes, peer: str, arrived_at: str) -> tuple[bytes, dict[str, Any]] | None:
        """Stops the cell if `head` is a permitted stop; returns the answer's bytes and the log entry, else None."""
        begun = time.monotonic()
        headers = _headers(head)
        if headers is None:
            return None
        peer, scheme = self._proxies.caller(peer, headers, self._scheme)
        scope = {
            "type": "http", "scheme": scheme, "method": "POST", "path": STOP_PATH, "query_string": b"",
            "client": (peer, 0), "headers": headers.raw, "server": (arrived_at, 0),
        }  # fmt: skip
        try:
            self._pages.refuse_foreign(scope, headers)
        except RigError:
            return None
        caller = self._authentication.recognised(scope, headers)
        if caller is None or ("origin" in headers and headers["origin"].lower() != self._pages.own(scope, headers)):
            return None
        self._service.runner.halt(f"{caller.name}@{peer}")
        body = stop_accepted().model_dump_json().encode()
        entry = {
            "method": "POST", "path": STOP_PATH, "status": 202, "by": caller.name, "host": peer,
            "ms": round(1e3 * (time.monotonic() - begun), 1),
        }  # fmt: skip
        return response_bytes(202, "Accepted", self._headers, body), entry


def _headers(head: bytes) -> Headers | None:
    """Returns the headers of a complete head; None if it is malformed or for another address."""
    connection = h11.Connection(h11.SERVER)
    try:
        connection.receive_data(head)
        event = connection.next_event()
    except h11.RemoteProtocolError:
        return None
    if not isinstance(event, h11.Request) or event.method + b" " + event.target + b" " != STOP_LINE:
        return None
    return Headers(raw=[(name.lower(), value) for name, value in event.headers])
