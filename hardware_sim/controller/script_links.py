"""Connections of a running program to servers, read and written by `socket_functions`."""

import socket

_MOST_UNREAD = 1 << 20  # bytes, beyond which the server has to wait


class ScriptLink:
    """One connection of a program to a server."""

    def __init__(self, stream: socket.socket) -> None:
        self.stream = stream
        self.unread = bytearray()
        self.ended = False

    def fill(self) -> None:
        """Reads the bytes that have arrived."""
        while not self.ended and len(self.unread) < _MOST_UNREAD:
            try:
                data = self.stream.recv(1 << 16)
            except BlockingIOError:
                return
            except OSError:
                data = b""
            self.ended = not data
            self.unread += data

    def take(self, count: int) -> bytes:
        """Removes the first bytes and returns them."""
        data = bytes(self.unread[:count])
        del self.unread[:count]
        return data

    def take_to(self, end: bytes) -> bytes | None:
        """Removes all up to and including `end`, and returns what precedes it; None if `end` has not arrived."""
        at = self.unread.find(end)
        return None if at < 0 else self.take(at + len(end))[:at]


class ScriptLinks(dict[str, ScriptLink]):
    """The connections of the running program, by name."""

    def close(self, name: str) -> None:
        """Closes a connection if it is open."""
        link = self.pop(name, None)
        if link is not None:
            link.stream.close()

    def close_all(self) -> None:
        for name in list(self):
            self.close(name)
