"""Many clients of one service in a separate process: listeners, stalled listeners, pollers.

The service cuts a stream that nobody reads for 60 s; a listener whose stream has ended connects again and asks for what
comes after the last event that it has heard, as a browser does.

    LIGHTPOSE_KEY=… python -m tests.load.crowd URL LISTENERS STALLED POLLERS

prints `ready` when all are connected, reads the last event's id from standard input, waits until every listener has
heard up to it (the stalled ones begin to read only then), and prints what all of them saw as one JSON object.
"""

import asyncio
import contextlib
import json
import os
import socket
import sys
import time
from urllib.parse import urlsplit

POLL_EVERY_S = 1.0
HEARD_WITHIN_S = 120.0
AGAIN_AFTER_S = 0.5


class Listener:
    """Reads one stream of events after another and keeps their ids."""

    def __init__(self, host: str, port: int, headers: str, buffer: int) -> None:
        """`buffer` (bytes) is how much may wait to be read, which shows a stall early."""
        self._host, self._port, self._headers, self._buffer = host, port, headers, buffer
        self._streams: tuple[asyncio.StreamReader, asyncio.StreamWriter] | None = None
        self._task: asyncio.Task[None] | None = None
        self.ids: list[int] = []
        self.resumed = 0

    async def connect(self) -> None:
        """Asks for the events after the last one heard; reads nothing yet."""
        opened = socket.socket()
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, self._buffer)
        opened.setblocking(False)
        await asyncio.get_running_loop().sock_connect(opened, (self._host, self._port))
        reader, writer = await asyncio.open_connection(sock=opened, limit=1 << 16)
        last = self.ids[-1] if self.ids else 0
        writer.write(f"GET /v1/events?after={last} HTTP/1.1\r\n{self._headers}".encode())
        await writer.drain()
        self._streams = reader, writer

    def read(self) -> None:
        """Begins to read."""
        self._task = asyncio.create_task(self._read_on())

    async def has_read(self, last: int, deadline: float) -> None:
        """Waits until the event `last` was heard, or the deadline is over."""
        while time.monotonic() < deadline and (not self.ids or self.ids[-1] < last):
            await asyncio.sleep(0.02)
        if self._task is not None:
            self._task.cancel()
        if self._streams is not None:
            self._streams[1].close()

    async def _read_on(self) -> None:
        while True:
            with contextlib.suppress(OSError):  # what the service cut
                await self._read()
            self.resumed += 1
            await asyncio.sleep(AGAIN_AFTER_S)
            try:
                await self.connect()
            except OSError:
                continue

    async def _read(self) -> None:
        assert self._streams is not None
        first = True
        async for line in self._streams[0]:
            if line.startswith(b"id: "):
                if not first:  # the first says where the stream begins
                    self.ids.append(int(line[4:]))
                first = False
        self._streams[1].close()


class Crowd:
    """The clients of one service."""

    def __init__(self, url: str) -> None:
        parts = urlsplit(url)
        self._host, self._port = str(parts.hostname), int(parts.port or 80)
        self._headers = f"Host: {self._host}\r\nAuthorization: Bearer {os.environ.get('LIGHTPOSE_KEY', 'none')}\r\n\r\n"
        self._ending = asyncio.Event()
        self.polls_s: list[float] = []
        self.refused = 0

    async def run(self, listeners: int, stalled: int, pollers: int) -> dict[str, object]:
        """Connects all clients, reads the last event's number from standard input, returns a summary."""
        reading = [await self._listener(1 << 16) for _ in range(listeners)]
        slow = [await self._listener(4096) for _ in range(stalled)]
        for listener in reading:
            listener.read()
        polling = [asyncio.create_task(self._poll(number)) for number in range(pollers)]
        print("ready", flush=True)
        last = int(await asyncio.get_running_loop().run_in_executor(None, sys.stdin.readline))
        self._ending.set()
        await asyncio.gather(*polling)
        for listener in slow:
            listener.read()
        deadline = time.monotonic() + HEARD_WITHIN_S
        await asyncio.gather(*(listener.has_read(last, deadline) for listener in [*reading, *slow]))
        wanted = list(range(1, last + 1))
        delays = sorted(self.polls_s) or [0.0]
        return {
            "listeners": listeners + stalled,
            "events": last,
            "heard_all_in_order": sum(listener.ids[:last] == wanted for listener in [*reading, *slow]),
            "streams_resumed": sum(listener.resumed for listener in [*reading, *slow]),
            "polls": len(self.polls_s),
            "polls_refused": self.refused,
            "poll_p99_s": delays[int(0.99 * (len(delays) - 1))],
        }

    async def _listener(self, buffer: int) -> Listener:
        listener = Listener(self._host, self._port, self._headers, buffer)
        await listener.connect()
        return listener

    async def _poll(self, number: int) -> None:
        """Reads the list of sessions once a second over one connection, each at its own time of the second."""
        await asyncio.sleep(POLL_EVERY_S * (number % 50) / 50)
        reader, writer = await asyncio.open_connection(self._host, self._port)
        while not self._ending.is_set():
            begun = time.monotonic()
            writer.write(f"GET /v1/sessions?limit=1 HTTP/1.1\r\n{self._headers}".encode())
            head = await reader.readuntil(b"\r\n\r\n")
            size = int(head.lower().partition(b"content-length:")[2].partition(b"\r\n")[0])
            await reader.readexactly(size)
            self.polls_s.append(time.monotonic() - begun)
            self.refused += not head.startswith(b"HTTP/1.1 200")
            await asyncio.sleep(max(POLL_EVERY_S - (time.monotonic() - begun), 0))
        writer.close()


async def main(url: str, listeners: str, stalled: str, pollers: str) -> None:
    """The whole run."""
    print(json.dumps(await Crowd(url).run(int(listeners), int(stalled), int(pollers))), flush=True)


if __name__ == "__main__":
    asyncio.run(main(*sys.argv[1:]))
