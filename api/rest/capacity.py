"""Limits of open connections, requests and streams, derived from the number of descriptors the process may open.

Descriptors run out first: each connection takes one and each download another. Without a free one neither the journal
nor the camera can open a file. All callers together are therefore limited to what remains after a reserve, and a stop
never competes for it (`listener`).
"""

import resource
from dataclasses import dataclass

WANTED_DESCRIPTORS = 16_384
"""Number of descriptors that the process requests at start; the kernel's default hard limit is 4,096 or more."""

RESERVED_DESCRIPTORS = 200
"""Number of descriptors for the service itself: journal, sessions' files, devices, processes. An idle service has about
40 open, a session about 20 more."""

MOST_CONNECTIONS = 4_096
"""Upper limit of connections; a lab's service has no use for more."""


@dataclass(frozen=True)
class Capacity:
    """Upper limits of what is open at the same time."""

    undecided: int  # connections whose first line has not arrived
    connections: int  # connections that the application serves; one address may have three quarters of them
    requests: int  # requests in progress, each of which may open a file
    streams: int  # event streams and live images
    streams_per_caller: int

    @property
    def connections_per_address(self) -> int:
        """Maximum number of connections from one address that the application serves."""
        return self.connections * 3 // 4


def of_descriptors(descriptors: int) -> Capacity:
    """Divides descriptors: an eighth for undecided connections, five eighths for connections, two for their files."""
    free = max(descriptors - RESERVED_DESCRIPTORS, 64)
    connections = min(free * 5 // 8, MOST_CONNECTIONS)
    return Capacity(
        undecided=min(free // 8, MOST_CONNECTIONS),
        connections=connections,
        requests=min(free // 4, MOST_CONNECTIONS),
        streams=connections // 2,
        streams_per_caller=min(connections // 4, 200),
    )


def present() -> Capacity:
    """Divides the descriptors that this process may open at present."""
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return of_descriptors(WANTED_DESCRIPTORS if soft == resource.RLIM_INFINITY else soft)


def raise_descriptor_limit() -> int:
    """Raises this process's soft limit of descriptors as far as its hard limit allows, and returns the limit."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = WANTED_DESCRIPTORS if hard == resource.RLIM_INFINITY else min(WANTED_DESCRIPTORS, hard)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
        soft = wanted
    return WANTED_DESCRIPTORS if soft == resource.RLIM_INFINITY else soft
