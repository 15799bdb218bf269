"""The synchronous client is generated from the asynchronous one."""

import inspect
from pathlib import Path

import pytest

from api.client import generate
from api.client.async_client import AsyncClient
from api.client.client import Client


@pytest.mark.parametrize("source", generate.TARGETS, ids=lambda source: source.name)
def test_generated_committed_module_is_up_to_date(source: Path) -> None:
    committed = generate.TARGETS[source].read_text(encoding="utf-8")
    assert committed == generate.generated(source), "run python -m api.client.generate"


def test_synchronous_awaited_calls_become_plain_calls() -> None:
    source = (
        "import asyncio\n"
        "async def f(self: AsyncClient) -> AsyncGenerator[int, None]:\n"
        '    async with a as b, await asyncio.to_thread(p.open, "wb") as file:\n'
        "        await b.aclose()\n"
        "        await asyncio.sleep(1)\n"
    )
    assert generate.synchronous(source) == (
        "def f(self: Client) -> Generator[int, None, None]:\n"
        '    with a as b, p.open("wb") as file:\n'
        "        b.close()\n"
        "        time.sleep(1)\n"
    )


def test_clients_have_the_same_methods_and_parameters() -> None:
    def methods(kind: type) -> dict[str, list[str]]:
        members = inspect.getmembers(kind, inspect.isfunction)
        return {name: list(inspect.signature(method).parameters) for name, method in members if name[0] != "_"}

    assert methods(AsyncClient) == methods(Client)
