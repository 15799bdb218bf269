"""Authentication and authorisation of every request in one place, before any route sees it.

Reading needs the role viewer, changing operator, deleting and the list of keys admin. Every key may stop. A page that
shows images or follows events cannot send headers; it requests a short-lived ticket that allows reading only. All
checks run on the event loop from memory, so that a stop waits for nothing. Without keys only this machine can call, and
everybody on it is an operator; deleting and the list then need a key, or the command line.
"""

import time
from collections import deque
from urllib.parse import parse_qs

from starlette.datastructures import Headers
from starlette.types import Scope

from acquisition.models.errors import ErrorCode, RigError
from api.rest.keys import Caller, KeyRing, Role

PUBLIC_PATHS = ("/health/", "/problems/", "/page/", "/archive/page/", "/docs/")
"""Path prefixes that need no key: health probes, explanations of problems, and the files of the operator's page, the
archive's page and the page for trying the API, which ask for the key themselves."""

PUBLIC_PAGES = frozenset({"/", "/archive", "/docs", "/openapi.json"})
"""Addresses of these pages, and of the OpenAPI description, which is the same for every cell."""

STOP_PATH = "/v1/rig/stop"
"""Address of the stop. Every key may call it, no limit refuses it, and the listener's thread answers it itself."""

SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})
ALLOWED_TO_EVERY_KEY = frozenset({("POST", STOP_PATH), ("POST", "/v1/tickets")})
FOR_ADMINS = "/v1/keys"
"""Address that only admins may read, because the permissions of people in a lab are confidential."""

OPERATORS_MAY_DELETE = ("/v1/queue/",)
"""Path prefixes below which DELETE removes no data, only entries that an operator has added."""

MAX_FAILURES = 10
FAILURE_WINDOW_S = 60.0
"""Time in which one host may send MAX_FAILURES wrong keys before it has to wait, s. A valid key is accepted even then:
guessing 256 bits is hopeless, and nobody's guessing may keep an operator from the stop."""

MAX_HOSTS = 10_000
"""Maximum number of hosts whose failures are remembered; bounds the memory."""


class Authentication:
    """Identifies callers by key or ticket and checks their role."""

    def __init__(self, keys: KeyRing) -> None:
        self.keys = keys
        self._failures: dict[str, deque[float]] = {}

    def caller(self, scope: Scope, headers: Headers) -> Caller:
        """Returns the authenticated caller of a request that the caller may make.

        Raises RigError request.unauthenticated, request.forbidden, request.too_many_failures.
        """
        method, path = scope["method"], scope["path"]
        host = scope["client"][0] if scope.get("client") else "local"
        if (path in PUBLIC_PAGES or path.startswith(PUBLIC_PATHS)) and method in SAFE_METHODS:
            return Caller("anybody", Role.VIEWER)
        caller = self.recognised(scope, headers)
        if caller is None:
            self._count_failure(host, time.monotonic())
            raise RigError(
                ErrorCode.REQUEST_UNAUTHENTICATED, f"{method} {path[:200]} needs a key{_why(scope, headers)}"
            )
        needed = needed_role(method, path)
        if not caller.role.covers(needed):
            whose = f"The key {caller.name!r} has" if self.keys.required else "Without a key you have"
            raise RigError(
                ErrorCode.REQUEST_FORBIDDEN,
                f"{whose} the role {caller.role}; {method} {path[:200]} needs a key of the role {needed}",
                role=str(caller.role),
                needed=str(needed),
            )
        return caller

    def recognised(self, scope: Scope, headers: Headers) -> Caller | None:
        """Returns the caller by key or ticket, whatever the role; None if unknown. Callable from any thread."""
        if not self.keys.required:
            return Caller("operator", Role.OPERATOR)
        scheme, _, secret = headers.get("authorization", "").partition(" ")
        if secret:
            return self.keys.caller(secret.strip()) if scheme.lower() == "bearer" else None
        ticket = parse_qs(scope["query_string"].decode("latin-1")).get("ticket", [""])[0]
        return self.keys.holder(ticket, time.monotonic()) if ticket and scope["method"] in SAFE_METHODS else None

    def _count_failure(self, host: str, now: float) -> None:
        recent = self._failures.setdefault(host, deque(maxlen=MAX_FAILURES))
        if len(recent) == MAX_FAILURES and now - recent[0] < FAILURE_WINDOW_S:
            wait = FAILURE_WINDOW_S - (now - recent[0])
            raise RigError(
                ErrorCode.REQUEST_TOO_MANY_FAILURES,
                f"{MAX_FAILURES} requests without a valid key came from {host} within {FAILURE_WINDOW_S:.0f} s",
                retry_after_s=round(wait),
            )
        recent.append(now)
        while len(self._failures) > MAX_HOSTS:
            del self._failures[next(iter(self._failures))]


def _why(scope: Scope, headers: Headers) -> str:
    """Returns why what the caller sent is no key, as the end of a sentence; empty if nothing was sent."""
    if given := headers.get("authorization", ""):
        bearer = given.partition(" ")[0].lower() == "bearer"
        return "; the one sent is wrong or revoked" if bearer else "; the Authorization header sent is not a Bearer key"
    if "ticket" in parse_qs(scope["query_string"].decode("latin-1")):
        reading = scope["method"] in SAFE_METHODS
        return "; the ticket sent is wrong or has expired" if reading else "; a ticket allows reading only"
    return ""


def needed_role(method: str, path: str) -> Role:
    """Returns the role that a request needs."""
    if path == FOR_ADMINS:
        return Role.ADMIN
    if method in SAFE_METHODS or (method, path) in ALLOWED_TO_EVERY_KEY:
        return Role.VIEWER
    return Role.ADMIN if method == "DELETE" and not path.startswith(OPERATORS_MAY_DELETE) else Role.OPERATOR
