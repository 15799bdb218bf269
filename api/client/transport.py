"""Settings of every connection of both clients: the time limit of a request, the trusted certificates, and the key."""

import os
import ssl
from typing import Any

import httpx

TIMEOUT_S = 30.0
"""Time limit of a request, s; longer than devices may delay a start, and than the pause between two keep-alive comments
of the event stream."""

COMPUTED_TIMEOUT_S = 300.0
"""Time limit of an answer that is computed first, s: a plan, a forecast, or a file that is made on its first request.
On a fresh machine the reach that a plan needs takes a minute, and up to eight such requests wait for one another."""

COMPUTED = httpx.Timeout(TIMEOUT_S, read=COMPUTED_TIMEOUT_S)
"""Time limits of a request whose answer is computed first."""

LEAST_TIMEOUT_S = 5.0
"""Time limit of a request whose answer is waited for until a deadline, at and shortly before that deadline, s: a busy
machine may need a second."""

LIMITS = httpx.Limits(keepalive_expiry=2.0)
"""Time after which an idle connection is given up, s: below the service's 5 s, because a request on a closing
connection fails. The service counts from sending an answer, the client from reading it; a client delayed by three
seconds in between may send at the very moment of closing. Measured: of 120 clients that read an answer 5.0 s late, 4
failed."""

CLOSED_MEANWHILE = (httpx.RemoteProtocolError, httpx.ReadError, httpx.WriteError)
"""Errors of a request on a connection that is just being closed: an end or a reset instead of the answer."""


def connection() -> dict[str, Any]:
    """Returns the options of a connection: no proxy of the environment; this machine's trusted certificates.

    `SSL_CERT_FILE` names a file of other certificates, such as that of a laboratory's own authority.
    """
    return {"timeout": TIMEOUT_S, "limits": LIMITS, "trust_env": False, "verify": ssl.create_default_context()}


def may_repeat(method: str, address: str) -> bool:
    """Returns whether an unanswered request may be repeated because it is idempotent (RFC 9110, 9.2.2).

    This holds for a GET and for the stop of the cell.
    """
    return method == "GET" or (method, address) == ("POST", "/v1/rig/stop")


def authorization_headers(key: str | None) -> dict[str, str]:
    """Returns the Authorization header of an API key (default: that of LIGHTPOSE_KEY); empty without a key."""
    key = key or os.environ.get("LIGHTPOSE_KEY")
    return {"Authorization": f"Bearer {key}"} if key else {}
