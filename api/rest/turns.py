"""Turns of slow requests: one of each kind is processed at a time, a few wait, and further ones are refused at once.

The number of waiting requests is limited because an unlimited queue has an unlimited waiting time. A request beyond
`MOST_WAITING` is refused with the time after which to try again.
"""

from collections.abc import Callable
from typing import TypeVar, TypeVarTuple

import anyio.to_thread
from anyio import CapacityLimiter

from acquisition.models.errors import ErrorCode, RigError

MOST_WAITING = 8
"""Maximum number of waiting requests of a kind. A plan takes 1 to 3 s, or 5 times that beside other programs: 2 min."""
RETRY_AFTER_S = 15
"""Time after which a refused request may be sent again, s; one or several plans are made within it."""

Answer = TypeVar("Answer")
Arguments = TypeVarTuple("Arguments")


async def in_turn(limiter: CapacityLimiter, work: Callable[[*Arguments], Answer], *arguments: *Arguments) -> Answer:
    """Runs `work` in a thread as soon as the limiter admits it. Raises RigError service.overloaded."""
    refuse_crowd(limiter)
    return await anyio.to_thread.run_sync(work, *arguments, limiter=limiter)


def refuse_crowd(limiter: CapacityLimiter) -> None:
    """Refuses a request if enough of its kind wait already. Raises RigError service.overloaded."""
    if limiter.statistics().tasks_waiting >= MOST_WAITING:
        raise RigError(
            ErrorCode.SERVICE_OVERLOADED,
            f"{MOST_WAITING} requests of this kind are already waiting",
            limit=MOST_WAITING,
            retry_after_s=RETRY_AFTER_S,
        )
