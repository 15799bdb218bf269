"""A TCP proxy between browser and service that can be cut, held, restored, slowed down, and led to another port."""

import contextlib
import socket
import threading
import time
from types import TracebackType
from typing import Self
from urllib.parse import urlsplit

CHUNK = 16_384
ARRIVES_WITHIN_S = 1.0
BAD_GATEWAY = b"HTTP/1.1 502 Bad Gateway\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"


class WeakNetwork:
    """Forwards connections from `url` to a service, as a context manager."""

    def __init__(self, address: str, target: tuple[str, int]) -> None:
        self.target = target
        self.bytes_per_s: float | None = None
        self.answer = b""
        """What it says itself while it is cut, as a proxy does for a service that is gone; else it refuses."""
        self._cut = False
        self._flowing = threading.Event()
        self._flowing.set()
        self._open: set[socket.socket] = set()
        self._lock = threading.Lock()
        self._listener = socket.create_server((address, 0))
        self.url = f"http://{address}:{self._listener.getsockname()[1]}"

    def __enter__(self) -> Self:
        threading.Thread(target=self._accept, daemon=True).start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.cut()
        self._flowing.set()
        self._listener.close()

    def cut(self) -> None:
        """Breaks all connections and refuses new ones."""
        with self._lock:
            self._cut = True
            for one in self._open:
                _end(one)
            self._open.clear()

    def hold(self) -> None:
        """Keeps what is sent until it is restored, as kernels do that send again what a network has lost."""
        self._flowing.clear()

    def restore(self) -> None:
        """Lets connections through again, and what was held."""
        self._cut = False
        self._flowing.set()

    def _accept(self) -> None:
        while True:
            try:
                client, _ = self._listener.accept()
            except OSError:
                return
            if self._cut:
                with contextlib.suppress(OSError):
                    if self.answer and client.recv(CHUNK):
                        client.sendall(self.answer)
                _end(client)
                continue
            try:
                server = socket.create_connection(self.target)
            except OSError:
                _end(client)
                continue
            with self._lock:
                self._open |= {client, server}
            for source, sink, asks in ((client, server, True), (server, client, False)):
                threading.Thread(target=self._forward, args=(source, sink, asks), daemon=True).start()

    def _forward(self, source: socket.socket, sink: socket.socket, asks: bool) -> None:
        held = False
        with contextlib.suppress(OSError):
            while data := source.recv(CHUNK):
                if self.bytes_per_s is not None:
                    time.sleep(len(data) / self.bytes_per_s)
                if not self._flowing.is_set():
                    self._flowing.wait()
                    if not asks:
                        break  # an answer that the browser has given up
                    # The service has closed what was silent for long: as from a proxy, it comes by another connection.
                    sink = socket.create_connection(self.target)
                    held = True
                sink.sendall(data)
        if held:
            time.sleep(ARRIVES_WITHIN_S)  # a service does not begin with a request whose sender has hung up
        _end(source)
        _end(sink)
        with self._lock:
            self._open -= {source, sink}


def target_of(url: str) -> tuple[str, int]:
    """Host and port of an address."""
    parts = urlsplit(url)
    assert parts.hostname is not None
    assert parts.port is not None
    return parts.hostname, parts.port


def _end(one: socket.socket) -> None:
    with contextlib.suppress(OSError):
        one.shutdown(socket.SHUT_RDWR)
    one.close()
