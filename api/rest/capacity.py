"""How many connections, requests and streams the service holds at once, from the descriptors that it may open.

A descriptor is what runs out first: each connection takes one, each download another, and without any left neither the
journal nor the camera can open a file. So all that comes from outside is bounded by what remains after a reserve, and
a stop never competes for it (`listener`).
"""

import resource
from dataclasses import dataclass

WANTED_DESCRIPTORS = 16_384
"""Descriptors that the process asks for at start; the kernel's own default of a hard limit is 4,096 or more."""

RESERVED_DESCRIPTORS = 200
"""Number of descriptors for the service itself: journal, sessions' files, devices, processes. An idle service has about
40 open, a session about 20 more.
"""

MOST_CONNECTIONS = 4_096
"""Connections beyond which more descriptors are of no use to a lab's service."""


@dataclass(frozen=True)
class Capacity:
    """Upper limits of what is open at once."""

    undecided: int  # connections whose first line has not arrived
    connections: int  # connections that the application serves, one address may have all but a quarter
    requests: int  # requests in progress, each of which may open a file
    streams: int  # event streams and live images
    streams_per_caller: int

    @property
    def connections_per_address(self) -> int:
        """Connections of one address that the application serves."""
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
    """Raises this process's soft limit of descriptors as far as its hard limit allows; returns the limit."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = WANTED_DESCRIPTORS if hard == resource.RLIM_INFINITY else min(WANTED_DESCRIPTORS, hard)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
        soft = wanted
    return WANTED_DESCRIPTORS if soft == resource.RLIM_INFINITY else soft
