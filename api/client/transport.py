"""What both clients set on each connection: the time limit of a request, and the key."""

import os

import httpx

TIMEOUT_S = 30.0
"""Time limit of a request, s: longer than a start may wait for devices, and than the pause between two keep-alive
comments of the event stream."""

LIMITS = httpx.Limits(keepalive_expiry=2.0)
"""An idle connection is given up after this time, s: long before the service closes it (5 s), since a request that is
sent while it is being closed fails."""


def authorization_headers(key: str | None) -> dict[str, str]:
    """The Authorization header of an API key (default: that of LIGHTPOSE_KEY), empty without a key."""
    key = key or os.environ.get("LIGHTPOSE_KEY")
    return {"Authorization": f"Bearer {key}"} if key else {}
