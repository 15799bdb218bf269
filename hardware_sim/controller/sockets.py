"""Non-blocking ports and connections: one epoll loop reads, ticks and writes, without threads.

A tick must never wait for a client. Replies are collected while a client's bytes are read, and then sent at once; what
its socket does not accept is kept (replies) or dropped (data packets). Each read is small, so that the loop returns to
the clock soon, however fast a client sends. What a client sent before it hung up is still read. A port can be stalled
or cut, as faults on demand.
"""

import logging
import select
import socket
from abc import ABC, abstractmethod
from collections.abc import Callable

from hardware_sim.controller.delay import Delay, Pipe

LOG = logging.getLogger("hardware_sim.controller")
_READ = 4096  # bytes: even if full of the smallest frames or lines, it is answered within a few ms
_MOST_PENDING = 1 << 20  # bytes of unread replies after which a client is disconnected
_MOST_CLIENTS = 64  # per port
# A peer that vanished silently, as at a pulled cable, is disconnected within half a minute.
_KEEPALIVE = (
    (socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1),
    (socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, 10),
    (socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, 5),
    (socket.IPPROTO_TCP, socket.TCP_KEEPCNT, 3),
    (socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, 25_000),  # ms
)


class Connection(ABC):
    """One client; subclasses implement a protocol in `received`."""

    def __init__(self, stream: socket.socket) -> None:
        self.stream = stream
        self.closed = False
        self._hung_up = False  # the client reads no more; what it has sent may still be unread
        self.unsent = bytearray()
        self.incoming, self.outgoing = Pipe(), Pipe()
        self.wants_write: Callable[[], None] = lambda: None

    @abstractmethod
    def received(self, data: bytes) -> None:
        """Takes bytes from the client."""

    def ended(self) -> None:  # noqa: B027 - most protocols have nothing to release
        """Called once when the connection is over."""

    def send(self, data: bytes) -> None:
        """Keeps a reply until all bytes at hand are read; the port then flushes it."""
        if not self.closed:
            self.unsent += data
            if len(self.unsent) + self.outgoing.held > _MOST_PENDING:
                LOG.warning("a client does not read its replies: connection closed")
                self.closed = True

    def offer(self, data: bytes) -> None:
        """Sends a packet that may be lost: it is dropped if the client has not read the ones before."""
        if not self.unsent and not self.closed and self.outgoing.held <= _MOST_PENDING - len(data):
            self._send_now(data)

    def flush(self) -> None:
        """Sends the kept bytes; those that the socket does not accept now follow later."""
        if self.unsent:
            data, self.unsent = bytes(self.unsent), bytearray()
            self._send_now(data)

    def pass_on(self, now: float) -> None:
        """Passes on the bytes whose delay is over."""
        for data in self.incoming.arrived(now):
            if not self.closed:
                self.received(data)
        self.flush()
        data = b"".join(self.outgoing.arrived(now))
        if data and not self.closed:
            self.outgoing.put_back(self._transmit(data))

    def _send_now(self, data: bytes) -> None:
        if not self.outgoing.holds_back(data):
            self.unsent = bytearray(self._transmit(data))
            if self.unsent:
                self.wants_write()

    def _transmit(self, data: bytes) -> bytes:
        """Sends bytes; returns those that the socket does not accept now."""
        if self._hung_up:
            return b""
        try:
            return data[self.stream.send(data) :]
        except BlockingIOError:
            return data
        except ConnectionError as error:
            # A sender of a program does not wait for the stream of the port. Reading ends the connection.
            LOG.info("the client has hung up: %s: %s", type(error).__name__, error)
            self._hung_up = True
            return b""
        except OSError as error:
            self.lost(error)
            return b""

    def lost(self, error: OSError) -> None:
        """Ends the connection because of its socket: reset, broken, timed out."""
        LOG.info("connection lost: %s: %s", type(error).__name__, error)
        self.closed = True


class Port:
    """A listening socket and its connections."""

    def __init__(
        self, poll: select.epoll, address: str, number: int, accept: Callable[[socket.socket], Connection]
    ) -> None:
        """Raises OSError if the port is in use."""
        self.number = number
        self.connections: dict[int, Connection] = {}
        self.stalled = False
        self.quick_acknowledge = False
        self.may_stay_unread = False  # a stream: the library uploads at 30003 for hours and never reads
        self._poll = poll
        self._accept = accept
        self.delayed: Delay | None = None
        self.open = True
        self._address = address
        self.listener = self._listen()

    def _listen(self) -> socket.socket:
        listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((self._address, self.number))
            listener.listen(64)
        except OSError:
            listener.close()
            raise
        listener.setblocking(False)
        self._poll.register(listener.fileno(), select.EPOLLIN)
        return listener

    def ready(self, descriptor: int, event: int) -> None:
        """Serves one descriptor that epoll named."""
        if self.stalled:
            return
        if descriptor == self.listener.fileno():
            self._take_client()
            return
        connection = self.connections.get(descriptor)
        if connection is None:
            return
        if event & (select.EPOLLIN | select.EPOLLHUP | select.EPOLLERR):
            self._read(connection)
        if not connection.closed:
            connection.flush()
            if event & select.EPOLLOUT and not connection.unsent:
                self._poll.modify(descriptor, select.EPOLLIN)
        if connection.closed:
            self._drop(descriptor)

    def _take_client(self) -> None:
        try:
            stream, _ = self.listener.accept()
        except (BlockingIOError, ConnectionError):
            return  # it hung up before it was served
        except OSError as error:
            LOG.warning("port %d cannot take a client: %s", self.number, error)
            return
        if len(self.connections) >= _MOST_CLIENTS:
            LOG.info("port %d has %d clients: another one refused", self.number, _MOST_CLIENTS)
            stream.close()
            return
        try:
            stream.setblocking(False)
            for level, option, value in ((socket.IPPROTO_TCP, socket.TCP_NODELAY, 1), *_KEEPALIVE):
                stream.setsockopt(level, option, value)
            if self.may_stay_unread:
                stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, 0)
        except OSError as error:
            LOG.info("client lost while it was accepted: %s", error)
            stream.close()
            return
        descriptor = stream.fileno()
        connection = self._accept(stream)
        connection.incoming.delay = connection.outgoing.delay = self.delayed
        connection.wants_write = lambda: self._watch_writing(descriptor)
        self.connections[descriptor] = connection
        self._poll.register(descriptor, select.EPOLLIN)
        connection.flush()
        if connection.closed:
            self._drop(descriptor)

    def _watch_writing(self, descriptor: int) -> None:
        if descriptor in self.connections and not self.stalled:
            self._poll.modify(descriptor, select.EPOLLIN | select.EPOLLOUT)

    def _read(self, connection: Connection) -> None:
        try:
            data = connection.stream.recv(_READ)
            if data and self.quick_acknowledge:
                # The library loses its TCP_NODELAY, so its next packet awaits this acknowledgement, 40 ms by default.
                connection.stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_QUICKACK, 1)
        except BlockingIOError:
            return
        except OSError as error:
            connection.lost(error)
            return
        if not data:
            connection.closed = True
        elif not connection.incoming.holds_back(data):
            connection.received(data)
        elif connection.incoming.held > _MOST_PENDING:
            LOG.warning("a client sends more than a slow link holds: connection closed")
            connection.closed = True

    def delay(self, delay: Delay | None) -> None:
        """Delays all present and future connections of the port; None ends the delay."""
        self.delayed = delay
        for connection in self.connections.values():
            connection.incoming.delay = connection.outgoing.delay = delay

    def pass_on(self, now: float) -> None:
        """Passes on the bytes of all connections whose delay is over."""
        for connection in self.connections.values():
            connection.pass_on(now)

    def shut(self) -> None:
        """Closes the port, like a controller that is off."""
        self.cut()
        self._poll.unregister(self.listener.fileno())
        self.listener.close()
        self.open = False

    def reopen(self) -> None:
        """Opens it again at the same address. Raises OSError."""
        self.listener = self._listen()
        self.open = True

    def sweep(self) -> None:
        """Closes connections that ended while something was sent to them."""
        for descriptor in [d for d, c in self.connections.items() if c.closed]:
            self._drop(descriptor)

    def cut(self) -> None:
        """Closes all connections, like a cable that is pulled and plugged in again at once."""
        for descriptor in list(self.connections):
            self._drop(descriptor)

    def stall(self, stalled: bool) -> None:
        """Stops reading, accepting and sending, or resumes them."""
        self.stalled = stalled
        if not self.open:
            return
        self._poll.modify(self.listener.fileno(), 0 if stalled else select.EPOLLIN)
        for descriptor, connection in self.connections.items():
            writing = select.EPOLLOUT if connection.unsent else 0
            self._poll.modify(descriptor, 0 if stalled else select.EPOLLIN | writing)

    def close(self) -> None:
        self.cut()
        self.listener.close()  # has no effect if it is shut

    def _drop(self, descriptor: int) -> None:
        connection = self.connections.pop(descriptor)
        connection.closed = True
        self._poll.unregister(descriptor)
        connection.stream.close()
        connection.ended()


class LineConnection(Connection):
    """A client that sends lines of text."""

    longest = 1 << 16

    def __init__(self, stream: socket.socket) -> None:
        super().__init__(stream)
        self._buffer = b""

    def received(self, data: bytes) -> None:
        """Splits data into lines; a client whose line is too long is disconnected."""
        *lines, self._buffer = (self._buffer + data).split(b"\n")
        for line in lines:
            if not self.closed:
                self.line(line.decode("utf-8", "replace"))
        if len(self._buffer) > self.longest:
            LOG.warning("a line of more than %d bytes: connection closed", self.longest)
            self.closed = True

    @abstractmethod
    def line(self, text: str) -> None:
        """Handles one line, without its end."""
