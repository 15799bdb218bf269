"""Turns of slow requests: one of a kind is worked on at a time, a few wait, and more are refused at once.

A request that waits is answered late; where any number may wait, it is answered after any time. So what comes beyond
`MOST_WAITING` is told to come again, which bounds the wait of everyone else.
"""

from collections.abc import Callable
from typing import TypeVar, TypeVarTuple

import anyio.to_thread
from anyio import CapacityLimiter

from acquisition.models.errors import ErrorCode, RigError

MOST_WAITING = 8
"""Requests of a kind that may wait. A plan takes 1 to 3 s, five times that beside other programs: 2 min for all."""
RETRY_AFTER_S = 15
"""Time after which a refused request may be sent again, s: a plan or several have been made by then."""

Answer = TypeVar("Answer")
Arguments = TypeVarTuple("Arguments")


async def in_turn(limiter: CapacityLimiter, work: Callable[[*Arguments], Answer], *arguments: *Arguments) -> Answer:
    """Runs `work` in a thread as soon as the limiter admits it. Raises RigError service.overloaded."""
    refuse_crowd(limiter)
    return await anyio.to_thread.run_sync(work, *arguments, limiter=limiter)


def refuse_crowd(limiter: CapacityLimiter) -> None:
    """Refuses a request for whose kind enough wait already. Raises RigError service.overloaded."""
    if limiter.statistics().tasks_waiting >= MOST_WAITING:
        raise RigError(
            ErrorCode.SERVICE_OVERLOADED,
            f"{MOST_WAITING} requests of this kind wait for their turn",
            limit=MOST_WAITING,
            retry_after_s=RETRY_AFTER_S,
        )
