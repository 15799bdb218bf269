"""Connections of a running program to servers, read and written by `socket_functions`."""

import socket

_MOST_UNREAD = 1 << 20  # bytes; beyond, the server waits


class ScriptLink:
    """One connection of a program to a server."""

    def __init__(self, stream: socket.socket) -> None:
        self.stream = stream
        self.unread = bytearray()
        self.ended = False

    def fill(self) -> None:
        """Takes what has arrived."""
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
        """Removes what comes before `end`, and that too; None where it has not arrived."""
        at = self.unread.find(end)
        return None if at < 0 else self.take(at + len(end))[:at]


class ScriptLinks(dict[str, ScriptLink]):
    """The connections of the program that runs, by name."""

    def close(self, name: str) -> None:
        """Closes one, if it is open."""
        link = self.pop(name, None)
        if link is not None:
            link.stream.close()

    def close_all(self) -> None:
        for name in list(self):
            self.close(name)
