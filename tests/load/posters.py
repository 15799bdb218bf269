"""Clients in a separate process that send one POST after another, each over a connection of its own, until ended.

    LIGHTPOSE_KEY=… python -m tests.load.posters HOST PORT COUNT

prints `ready` when every client has had an answer, whatever it was.
"""

import asyncio
import os
import subprocess
import sys
from collections.abc import Generator
from contextlib import contextmanager

REQUEST = "POST /v1/tickets HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {key}\r\n\r\n"


@contextmanager
def posting(port: int, key: str, count: int) -> Generator[None]:
    """So many posting clients of a service on loopback, in a process of their own, each with an answer by now."""
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.load.posters", "127.0.0.1", str(port), str(count)],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "LIGHTPOSE_KEY": key},
    )
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        yield
    finally:
        process.kill()
        process.wait()


async def post(host: str, port: int, answered: asyncio.Event) -> None:
    """Posts for ever; opens another connection where one ends."""
    request = REQUEST.format(key=os.environ["LIGHTPOSE_KEY"]).encode()
    while True:
        try:
            reader, writer = await asyncio.open_connection(host, port)
            while True:
                writer.write(request)
                head = await reader.readuntil(b"\r\n\r\n")
                await reader.readexactly(int(head.lower().partition(b"content-length:")[2].partition(b"\r\n")[0]))
                answered.set()
        except (OSError, asyncio.IncompleteReadError):
            await asyncio.sleep(0.1)


async def main(host: str, port: str, count: str) -> None:
    """All clients."""
    answered = [asyncio.Event() for _ in range(int(count))]
    async with asyncio.TaskGroup() as group:
        for event in answered:
            group.create_task(post(host, int(port), event))
        for event in answered:
            await event.wait()
        print("ready", flush=True)


if __name__ == "__main__":
    asyncio.run(main(*sys.argv[1:]))
