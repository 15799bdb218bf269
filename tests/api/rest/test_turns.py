"""Turns of slow requests: one works, a few wait, more are refused at once and told when to come again."""

import asyncio
import threading

import pytest
from anyio import CapacityLimiter

from acquisition.models.errors import ErrorCode, RigError
from api.rest.turns import MOST_WAITING, in_turn


def test_in_turn_more_than_may_wait_are_refused_at_once() -> None:
    async def script() -> list[int]:
        limiter, done = CapacityLimiter(1), threading.Event()

        def work(number: int) -> int:
            assert done.wait(60)
            return number

        turns = [asyncio.create_task(in_turn(limiter, work, number)) for number in range(1 + MOST_WAITING)]
        while limiter.statistics().tasks_waiting < MOST_WAITING:
            await asyncio.sleep(0)
        with pytest.raises(RigError) as refused:
            await in_turn(limiter, work, -1)
        assert refused.value.code is ErrorCode.SERVICE_OVERLOADED
        assert refused.value.context["retry_after_s"] > 0
        done.set()
        answers = await asyncio.gather(*turns)
        assert await in_turn(limiter, work, 99) == 99
        return answers

    assert asyncio.run(script()) == list(range(1 + MOST_WAITING))
