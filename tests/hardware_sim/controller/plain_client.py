"""An RTDE client written from the protocol's description alone; it shares no code with the server.

Its parts are those that a recorder or a control loop needs: agree on a version, set up recipes, start, read packets
by name, write registers, read and send texts.
"""

import socket
import struct
from typing import Any, Self

_CODES = {
    "DOUBLE": "d",
    "UINT64": "Q",
    "UINT32": "I",
    "INT32": "i",
    "UINT8": "B",
    "BOOL": "?",
    "VECTOR6D": "6d",
    "VECTOR3D": "3d",
    "VECTOR6INT32": "6i",
    "VECTOR6UINT32": "6I",
}


class PlainClient:
    """One RTDE connection; `version` None asks for none."""

    def __init__(self, address: str, version: int | None = 2) -> None:
        self.socket = socket.create_connection((address, 30004), 3.0)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.unread = b""
        self.texts: list[tuple[str, str, int]] = []
        self._output = ""
        self._inputs: dict[int, str] = {}
        if version is not None:
            assert self.request("V", struct.pack(">H", version)) == b"\x01"

    def send(self, kind: str, payload: bytes = b"") -> None:
        """Sends one frame."""
        self.socket.sendall(struct.pack(">HB", 3 + len(payload), ord(kind)) + payload)

    def receive(self) -> tuple[str, bytes]:
        """The next frame: its type and payload."""
        while len(self.unread) < 3 or len(self.unread) < struct.unpack_from(">H", self.unread)[0]:
            data = self.socket.recv(65536)
            if not data:
                raise EOFError("the controller has hung up")
            self.unread += data
        (size,) = struct.unpack_from(">H", self.unread)
        frame, self.unread = self.unread[:size], self.unread[size:]
        return chr(frame[2]), frame[3:]

    def request(self, kind: str, payload: bytes = b"") -> bytes:
        """Sends a request and returns its reply, which must be of the same type."""
        self.send(kind, payload)
        answered, reply = self.receive()
        assert answered == kind
        return reply

    def request_between_packets(self, kind: str) -> bytes:
        """Sends a request while packets arrive and returns its reply."""
        self.send(kind)
        answered, reply = self.receive()
        while answered in ("U", "M"):
            answered, reply = self.receive()
        assert answered == kind
        return reply

    def outputs(self, names: str, frequency: float = 500.0) -> tuple[int, list[str]]:
        """Sets up the output recipe: its id and the types."""
        reply = self.request("O", struct.pack(">d", frequency) + names.encode())
        types = reply[1:].decode().split(",")
        if reply[0]:
            self._output = ">B" + "".join(_CODES[t] for t in types)
        return reply[0], types

    def inputs(self, names: str) -> tuple[int, list[str]]:
        """Sets up an input recipe: its id and the types."""
        reply = self.request("I", names.encode())
        types = reply[1:].decode().split(",")
        if reply[0]:
            self._inputs[reply[0]] = ">B" + "".join(_CODES[t] for t in types)
        return reply[0], types

    def write(self, recipe: int, *values: Any) -> None:
        """Sends input values."""
        self.send("U", struct.pack(self._inputs[recipe], recipe, *values))

    def sample(self) -> tuple[Any, ...]:
        """The next packet's values; texts on the way go to `texts`."""
        kind, payload = self.receive()
        while kind == "M":
            self.texts.append(self.text(payload))
            kind, payload = self.receive()
        assert kind == "U"
        return struct.unpack(self._output, payload)[1:]

    @staticmethod
    def text(payload: bytes) -> tuple[str, str, int]:
        """A text message: its words, its source and its level."""
        length = payload[0]
        source = payload[1 + length]
        assert len(payload) == length + source + 3
        return payload[1 : 1 + length].decode(), payload[2 + length : -1].decode(), payload[-1]

    def say(self, words: str, source: str, level: int) -> None:
        """Sends a text message."""
        parts = [bytes([len(part)]) + part for part in (words.encode(), source.encode())]
        self.send("M", b"".join(parts) + bytes([level]))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *failure: object) -> None:
        self.close()

    def close(self) -> None:
        """Hangs up."""
        self.socket.close()
