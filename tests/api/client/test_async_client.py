"""The asynchronous client: a session from creation to deletion, and concurrent event listeners."""

import asyncio
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

import pytest

from acquisition.models.errors import ErrorCode
from acquisition.models.recipe import Recipe
from acquisition.session import State
from api import AsyncClient, ProblemError


def test_async_client_session_from_creation_to_deletion(administered: Any) -> None:
    async def script() -> None:
        async with AsyncClient(administered.url, administered.key) as client:
            assert not (await client.rig()).may_start
            made = await client.create(Recipe(label="awaited"), idempotency_key="one")
            assert (await client.create(Recipe(label="awaited"), idempotency_key="one")).id == made.id
            assert [item.id async for item in client.sessions()] == [made.id]
            assert await client.stop(made.id) is State.STOPPED
            assert (await client.wait(made.id)).state is State.STOPPED
            assert [event.type for event in await client.past_events(made.id)] == ["session.created", "session.state"]
            assert await client.passes(made.id) == []
            assert await client.results(made.id) == []
            await client.halt()
            assert (await client.acknowledge()).clear
            await client.delete(made.id)
            with pytest.raises(ProblemError) as gone:
                await client.session(made.id)
            assert gone.value.code is ErrorCode.SESSION_NOT_FOUND

    asyncio.run(script())


def test_wait_ready_absent_rig_raises_reasons(shared: Any) -> None:
    async def script() -> None:
        async with AsyncClient(shared.url) as client:
            with pytest.raises(ProblemError) as missing:
                await client.wait_ready(timeout_s=0)
            assert missing.value.code is ErrorCode.RIG_NOT_READY

    asyncio.run(script())


def test_events_concurrent_listeners_miss_none_over_restart(start: Callable[..., AbstractContextManager[Any]]) -> None:
    async def listen(client: AsyncClient, count: int) -> list[int]:
        received: list[int] = []
        async for event in client.events(after=0):
            received.append(event.id)
            if len(received) == count:
                return received
        raise AssertionError

    async def script() -> None:
        with start() as running:
            port = int(running.url.rsplit(":", 1)[1])
            async with AsyncClient(running.url) as client:
                listeners = [asyncio.create_task(listen(client, 4)) for _ in range(8)]
                made = await client.create(Recipe())
                await client.stop(made.id)
                await asyncio.sleep(0.3)
                await asyncio.to_thread(running.client.close)
                running.server.should_exit = True
                await asyncio.to_thread(running.thread.join, 60)
                with start(port=port) as again:
                    made = await asyncio.to_thread(again.client.create, Recipe())
                    await asyncio.to_thread(again.client.stop, made.id)
                    heard = await asyncio.wait_for(asyncio.gather(*listeners), 90)
                assert heard == [heard[0]] * 8
                assert heard[0] == sorted(set(heard[0]))

    asyncio.run(script())
