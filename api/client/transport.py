"""What both clients set on each connection: the time limit of a request, the trusted certificates, and the key."""

import os
import ssl
from typing import Any

import httpx

TIMEOUT_S = 30.0
"""Time limit of a request, s: longer than a start may wait for devices, and than the pause between two keep-alive
comments of the event stream."""

LIMITS = httpx.Limits(keepalive_expiry=2.0)
"""An idle connection is given up after this time, s: long before the service closes it (5 s), since a request that is
sent while it is being closed fails. The service counts from when it has sent an answer, the client from when it has
read it: one that was kept from running for three seconds in between may send at the very moment of closing. Of 120
clients that read an answer 5.0 s late, 4 did."""

CLOSED_MEANWHILE = (httpx.RemoteProtocolError, httpx.ReadError, httpx.WriteError)
"""What a request on a connection that is just being closed fails with: an end or a reset in place of the answer."""


def connection() -> dict[str, Any]:
    """Options of a connection: no proxy of the environment; certificates are those that this machine trusts.

    `SSL_CERT_FILE` names a file of others, such as that of a laboratory's own authority.
    """
    return {"timeout": TIMEOUT_S, "limits": LIMITS, "trust_env": False, "verify": ssl.create_default_context()}


def may_repeat(method: str, address: str) -> bool:
    """Whether a request may be sent again where its answer did not come (RFC 9110, 9.2.2): it is the same done twice.

    A question is, and so is the stop of the cell.
    """
    return method == "GET" or (method, address) == ("POST", "/v1/rig/stop")


def authorization_headers(key: str | None) -> dict[str, str]:
    """The Authorization header of an API key (default: that of LIGHTPOSE_KEY), empty without a key."""
    key = key or os.environ.get("LIGHTPOSE_KEY")
    return {"Authorization": f"Bearer {key}"} if key else {}
