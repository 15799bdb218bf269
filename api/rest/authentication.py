"""Who asks, and whether they may: decided for every route in one place, before any route sees the request.

Reading needs a viewer, changing an operator, deleting an admin; every key may stop. A page that shows images or follows
events cannot send headers, so it asks for a ticket first, which is short-lived and can only look. All of it is done on
the event loop from memory, so that a stop waits for nothing. Where there are no keys, only this machine can call, and
whoever is on it is an operator.
"""

import time
from collections import deque
from urllib.parse import parse_qs

from starlette.datastructures import Headers
from starlette.types import Scope

from acquisition.models.errors import ErrorCode, RigError
from api.rest.keys import Caller, KeyRing, Role

OPEN = ("/health/", "/problems/")
"""Answered to anybody: whether the service lives, and what a problem means."""

LOOKING = frozenset({"GET", "HEAD", "OPTIONS"})
EVERY_KEY_MAY = frozenset({("POST", "/v1/rig/stop"), ("POST", "/v1/tickets")})
FAILURES = 10
WITHIN_S = 60.0
"""Wrong keys that one host may send in this time before it is told to wait. A right key passes all the same: with 256
bits there is nothing to guess, and nobody's guessing may keep an operator from the stop."""

MOST_HOSTS = 10_000


class Authentication:
    """Tells callers apart by key or ticket."""

    def __init__(self, keys: KeyRing) -> None:
        self.keys = keys
        self._failures: dict[str, deque[float]] = {}

    def caller(self, scope: Scope, headers: Headers) -> Caller:
        """Who asks. Raises RigError request.unauthenticated, request.forbidden, request.too_many_failures."""
        method, path = scope["method"], scope["path"]
        host = scope["client"][0] if scope.get("client") else "local"
        if path.startswith(OPEN) and method in LOOKING:
            return Caller("anybody", Role.VIEWER)
        if not self.keys.required:
            return Caller("operator", Role.ADMIN)
        now = time.monotonic()
        found = self._found(scope, headers, now)
        if found is None:
            self._count_failure(host, now)
            raise RigError(ErrorCode.REQUEST_UNAUTHENTICATED, f"{method} {path[:200]} needs a key")
        needed = _needed(method, path)
        if not found.role.covers(needed):
            raise RigError(
                ErrorCode.REQUEST_FORBIDDEN,
                f"The key {found.name!r} is a {found.role}'s; {method} {path[:200]} needs an {needed}'s",
                role=str(found.role),
                needed=str(needed),
            )
        return found

    def _found(self, scope: Scope, headers: Headers, now: float) -> Caller | None:
        scheme, _, secret = headers.get("authorization", "").partition(" ")
        if secret:
            return self.keys.caller(secret.strip()) if scheme.lower() == "bearer" else None
        ticket = parse_qs(scope["query_string"].decode("latin-1")).get("ticket", [""])[0]
        return self.keys.holder(ticket, now) if ticket and scope["method"] in LOOKING else None

    def _count_failure(self, host: str, now: float) -> None:
        recent = self._failures.setdefault(host, deque(maxlen=FAILURES))
        if len(recent) == FAILURES and now - recent[0] < WITHIN_S:
            wait = WITHIN_S - (now - recent[0])
            raise RigError(
                ErrorCode.REQUEST_TOO_MANY_FAILURES,
                f"{FAILURES} wrong keys came from {host}",
                retry_after_s=round(wait),
            )
        recent.append(now)
        while len(self._failures) > MOST_HOSTS:
            del self._failures[next(iter(self._failures))]


def _needed(method: str, path: str) -> Role:
    if method in LOOKING or (method, path) in EVERY_KEY_MAY:
        return Role.VIEWER
    return Role.ADMIN if method == "DELETE" else Role.OPERATOR
