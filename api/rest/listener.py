"""The listener: accepts connections in its own thread, which answers a stop itself and limits everything else.

asyncio accepts as many connections as there are descriptors, and then fails with a log entry at each turn of its loop;
a stop would wait in the same queue. Here one thread accepts every connection and reads its first bytes. It carries out
and answers a well-formed and permitted stop itself, which needs neither the event loop, nor a thread of the pool, nor a
descriptor that others may hold. It hands everything else to the event loop with the bytes read so far, including a
refused stop, because the application states the reason.

A connection without a complete first line is undecided. There is room for a fixed number of them; a further one
replaces the oldest, so that idle connections cannot keep a new one out. Connections that the application serves are
counted, in total and by address. Beyond the limits they are answered with 503 and Retry-After, but only after the
thread has seen that they are no stop (decision 52).
"""

import errno
import logging
import selectors
import socket
import ssl
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from acquisition.models.errors import ErrorCode
from api.rest import problems
from api.rest.authentication import STOP_PATH
from api.rest.capacity import Capacity
from api.rest.tls import TlsSession

BACKLOG = 4096
"""Number of connections that the kernel holds until they are accepted; its own limit caps this."""

STOP_LINE = f"POST {STOP_PATH} ".encode()
"""Beginning of the request of a stop."""

MAX_HEAD_BYTES = 16_384
"""Longest head of a stop that is read here, bytes; the application handles longer ones."""

LINGER_S = 1.0
"""Time for which an answered connection waits for its peer to close it, s; closing at once may lose the answer."""

RETRY_AFTER_S = 5
"""Time after which a refused client may try again, s."""

WARN_EVERY_S = 60.0
"""Minimum time between two log entries about refused connections, s."""

_READ_BYTES = 8192
_WAKE_S = 0.25
_KEEP_ALIVE = {socket.TCP_KEEPIDLE: 20, socket.TCP_KEEPINTVL: 5, socket.TCP_KEEPCNT: 4}
# These options detect a vanished peer after 40 s.

_log = logging.getLogger(__name__)

Stop = Callable[[bytes, str, str], tuple[bytes, dict[str, Any]] | None]
"""Carries out the stop in a head, given its peer and the address it arrived at. Returns the answer and its log entry,
or None if the application has to answer."""

HandOver = Callable[[socket.socket, bytes, str, TlsSession | None], None]
"""Gives the event loop a connection, the bytes read from it, its peer and its TLS session."""


@dataclass
class _Connection:
    peer: str
    deadline: float  # s, monotonic: time at which an undecided or answered connection is closed
    tls: TlsSession | None
    received: bytearray = field(default_factory=bytearray)
    answered: bool = False


class Listener:
    """Accepts the connections of bound sockets. Call `start`, `release` and `close` on the event loop."""

    def __init__(
        self, sockets: list[socket.socket], capacity: Capacity, head_timeout_s: Callable[[], float],
        security_headers: Mapping[str, str], tls: ssl.SSLContext | None = None,
    ) -> None:  # fmt: skip
        """`tls` is the context of an encrypted service."""
        self._tls = tls
        self._security_headers = security_headers
        self._sockets = sockets
        self._capacity = capacity
        self._head_timeout_s = head_timeout_s
        self._selector = selectors.DefaultSelector()
        self._undecided: dict[socket.socket, _Connection] = {}  # in order of arrival
        self._served: Counter[str] = Counter()
        self._counting = threading.Lock()
        self._refused = 0
        self._warned_at = -WARN_EVERY_S
        self._look_again_at = 0.0
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="listener", daemon=True)
        self._stop: Stop | None = None
        self._hand_over: HandOver | None = None

    def start(self, stop: Stop, hand_over: HandOver) -> None:
        """Starts accepting connections."""
        self._stop, self._hand_over = stop, hand_over
        for listening in self._sockets:
            listening.setblocking(False)
            listening.listen(BACKLOG)
            self._selector.register(listening, selectors.EVENT_READ)
        self._thread.start()

    def release(self, peer: str) -> None:
        """Notes that a connection from this address, which was handed over, has been closed."""
        with self._counting:
            self._served[peer] -= 1
            if self._served[peer] <= 0:
                del self._served[peer]

    def close(self) -> None:
        """Ends the thread and closes its sockets."""
        self._closing.set()
        if self._thread.is_alive():
            self._thread.join()
        for held in [*self._undecided, *self._sockets]:
            held.close()
        self._selector.close()

    @property
    def served(self) -> int:
        """Number of connections that the application serves."""
        return self._served.total()

    # ---------------------------------------------------------------------------------------------------- the thread

    def _run(self) -> None:
        while not self._closing.is_set():
            try:
                for key, _ in self._selector.select(_WAKE_S):
                    held = key.fileobj
                    assert isinstance(held, socket.socket)  # noqa: S101 - only sockets are registered
                    if held in self._undecided:
                        self._read(held, self._undecided[held])
                    elif held in self._sockets:
                        self._accept(held)
                self._close_overdue()
            except Exception:  # noqa: BLE001 - without this thread nobody could stop the cell
                _log.exception("error in the listener, which goes on")

    def _accept(self, listening: socket.socket) -> None:
        """Accepts one connection. Further waiting ones are accepted in the next turns, between readings."""
        try:
            accepted, address = listening.accept()
        except BlockingIOError:
            return
        except OSError as error:
            if error.errno not in (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM):
                return  # the peer has gone again
            self._warn("no descriptor is left for a connection")
            if self._undecided:
                self._drop(next(iter(self._undecided)))
            else:
                self._closing.wait(0.02)
            return
        if len(self._undecided) >= self._capacity.undecided:
            self._drop(next(iter(self._undecided)))
        accepted.setblocking(False)
        accepted.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        accepted.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for option, value in _KEEP_ALIVE.items():
            accepted.setsockopt(socket.IPPROTO_TCP, option, value)
        self._undecided[accepted] = connection = _Connection(
            str(address[0]),
            time.monotonic() + self._head_timeout_s(),
            None if self._tls is None else TlsSession(self._tls),
        )
        self._selector.register(accepted, selectors.EVENT_READ)
        self._read(accepted, connection)  # most clients have sent their request by now

    def _read(self, held: socket.socket, connection: _Connection) -> None:
        try:
            block = held.recv(_READ_BYTES)
            arrived = len(block)
            if connection.tls is not None and block and not connection.answered:  # after that: the body of a stop
                block = self._decrypted(held, connection.tls, block)
        except BlockingIOError:
            return
        except OSError:
            self._drop(held)
            return
        if not arrived:
            self._drop(held)
        elif block and not connection.answered:
            connection.received += block
            self._decide(held, connection)

    @staticmethod
    def _decrypted(held: socket.socket, tls: TlsSession, block: bytes) -> bytes:
        """Decrypts a block and sends TLS's own answer, which fits into an empty send buffer. Raises OSError."""
        try:
            return tls.receive(block)
        finally:
            answer = tls.to_send()
            if answer:
                held.send(answer)

    def _decide(self, held: socket.socket, connection: _Connection) -> None:
        received = bytes(connection.received)
        if STOP_LINE.startswith(received):
            return  # too few bytes to decide
        if received.startswith(STOP_LINE) and len(received) < MAX_HEAD_BYTES:
            head, end, _ = received.partition(b"\r\n\r\n")
            if not end:
                return
            assert self._stop is not None  # noqa: S101 - set before the thread starts
            stopped = self._stop(head + end, connection.peer, str(held.getsockname()[0]))
            if stopped is not None:
                self._answer(held, connection, stopped[0])
                _log.info("request", extra=stopped[1])  # after the answer, because logging may be slow
                return
        self._serve(held, connection, received)

    def _serve(self, held: socket.socket, connection: _Connection, received: bytes) -> None:
        with self._counting:
            most = self._capacity
            full = (
                self._served.total() >= most.connections
                or self._served[connection.peer] >= most.connections_per_address
            )
            if not full:
                self._served[connection.peer] += 1
        if full:
            self._refused += 1
            self._warn(f"connections are refused, the last one from {connection.peer}")
            self._answer(held, connection, _overloaded(most.connections, self._security_headers))
            return
        self._forget(held)
        assert self._hand_over is not None  # noqa: S101 - set before the thread starts
        self._hand_over(held, received, connection.peer, connection.tls)

    def _answer(self, held: socket.socket, connection: _Connection, answer: bytes) -> None:
        """Sends a whole answer, which fits into an empty send buffer, and lets the peer close the connection."""
        connection.answered, connection.deadline = True, time.monotonic() + LINGER_S
        try:
            held.send(answer if connection.tls is None else connection.tls.send(answer) + connection.tls.close())
            held.shutdown(socket.SHUT_WR)
        except OSError:
            self._drop(held)

    def _close_overdue(self) -> None:
        now = time.monotonic()
        if now < self._look_again_at:
            return
        self._look_again_at = now + _WAKE_S
        for held, connection in list(self._undecided.items()):
            if connection.deadline <= now:
                self._drop(held)

    def _forget(self, held: socket.socket) -> None:
        self._undecided.pop(held, None)
        self._selector.unregister(held)

    def _drop(self, held: socket.socket) -> None:
        self._forget(held)
        held.close()

    def _warn(self, what: str) -> None:
        now = time.monotonic()
        if now - self._warned_at >= WARN_EVERY_S:
            self._warned_at = now
            _log.warning("%s; %d refused so far", what, self._refused)


def _overloaded(limit: int, security_headers: Mapping[str, str]) -> bytes:
    answer = problems.response(
        ErrorCode.SERVICE_OVERLOADED,
        f"All {limit} connections are in use, or this address uses its maximum of three quarters",
        {"limit": limit, "retry_after_s": RETRY_AFTER_S},
    )
    return response_bytes(503, "Service Unavailable", {**security_headers, **answer.headers}, bytes(answer.body))


def response_bytes(status: int, reason: str, headers: dict[str, str], body: bytes) -> bytes:
    """Encodes an HTTP/1.1 response after which the connection is closed."""
    given = {**headers, "content-length": str(len(body)), "connection": "close"}
    lines = [f"HTTP/1.1 {status} {reason}", *(f"{name}: {value}" for name, value in given.items())]
    return "\r\n".join([*lines, "", ""]).encode("latin-1") + body


def bound_sockets(host: str, port: int) -> list[socket.socket]:
    """Binds a socket for each address of a host, all at the same port. Raises OSError."""
    found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    made: list[socket.socket] = []
    try:
        for family, kind, protocol, _, address in dict.fromkeys(found):
            bound = socket.socket(family, kind, protocol)
            made.append(bound)
            bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            if family == socket.AF_INET6:
                bound.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
            bound.bind((address[0], made[0].getsockname()[1] if len(made) > 1 else port, *address[2:]))
    except OSError:
        for bound in made:
            bound.close()
        raise
    return made
