"""Many clients of one service in a separate process: listeners, stalled listeners, pollers.

    LIGHTPOSE_KEY=… python -m tests.load.crowd URL LISTENERS STALLED POLLERS

prints `ready` when all are connected, reads the last event's id from standard input, waits until every listener has
heard up to it (the stalled ones begin to read only then), and prints what all of them saw as one JSON object.
"""

import asyncio
import json
import os
import socket
import sys
import time
from urllib.parse import urlsplit

POLL_EVERY_S = 1.0
HEARD_WITHIN_S = 60.0


class Listener:
    """Reads one stream of events and keeps their ids."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader, self._writer = reader, writer
        self._task: asyncio.Task[None] | None = None
        self.ids: list[int] = []

    def read(self) -> None:
        """Begins to read."""
        self._task = asyncio.create_task(self._read())

    async def has_read(self, last: int, deadline: float) -> None:
        """Waits until the event `last` was heard, the stream has ended, or the deadline is over."""
        while time.monotonic() < deadline and self._task is not None and not self._task.done():
            if self.ids and self.ids[-1] >= last:
                break
            await asyncio.sleep(0.02)
        if self._task is not None:
            self._task.cancel()
        self._writer.close()

    async def _read(self) -> None:
        first = True
        async for line in self._reader:
            if line.startswith(b"id: "):
                if not first:  # the first says where the stream begins
                    self.ids.append(int(line[4:]))
                first = False


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
            "polls": len(self.polls_s),
            "polls_refused": self.refused,
            "poll_p99_s": delays[int(0.99 * (len(delays) - 1))],
        }

    async def _listener(self, buffer: int) -> Listener:
        opened = socket.socket()
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer)
        opened.setblocking(False)
        await asyncio.get_running_loop().sock_connect(opened, (self._host, self._port))
        reader, writer = await asyncio.open_connection(sock=opened, limit=buffer)
        writer.write(f"GET /v1/events?after=0 HTTP/1.1\r\n{self._headers}".encode())
        await writer.drain()
        return Listener(reader, writer)

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
