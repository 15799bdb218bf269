"""URScript's socket functions (UR script manual, module interfaces): the program as a client of servers.

They are real TCP sockets, to loopback addresses only: a test's program must not reach a machine that it was not written
for. None of them blocks the tick, because a call that waits gives up its time slot. Time-outs count ticks; zero or less
waits for ever. A read that fails returns the manual's value (a count of 0, or an empty string), and so does each read
after the server has hung up. The sockets end with the program.
"""

import errno
import ipaddress
import math
import socket
import struct
from collections.abc import Callable, Generator
from typing import Any, TypeVar

from hardware_sim.controller.script_links import ScriptLink, ScriptLinks
from hardware_sim.controller.script_values import STEP_TIME, FunctionGroup, integer_below, number
from hardware_sim.controller.semantics import MOST_CHARACTERS, ScriptError, integer, script_text

Read = TypeVar("Read")
_NAME = "socket_0"
_PATIENCE = 2.0  # s, of connecting, sending and `socket_get_var` (manual)
_MOST_VALUES = 30  # of one read (manual)
_MOST_LINKS = 64
_TEXT = "latin-1"  # the manual's "extended ASCII"
_PENDING = (errno.EINPROGRESS, errno.EALREADY)
_INTEGER = struct.Struct(">i")
_ESCAPES = {"\\n": "\n", "\\r": "\r", "\\t": "\t"}


def _read(
    links: ScriptLinks, name: Any, timeout: Any, take: Callable[[ScriptLink], Read | None], failed: Read
) -> Generator[None, None, Read]:
    """Waits for what `take` finds; returns `failed` if it finds nothing for `timeout` s, or the server is gone."""
    seconds = number(timeout, "timeout")
    left = _ticks(seconds) if seconds > 0.0 else math.inf
    while (link := links.get(_text(name))) is not None:
        link.fill()
        found = take(link)
        if found is not None:
            return found
        if left <= 0 or link.ended:
            break
        left -= 1
        yield
    if link is None or link.ended:
        yield  # a program that reads again and again must not use up its share of the tick
    return failed


def _reading(code: str) -> Callable[..., Generator[None, None, list[int]]]:
    """A function that reads integers of a struct code."""

    def method(
        self: "SocketFunctions", number: Any, socket_name: Any = _NAME, timeout: Any = _PATIENCE
    ) -> Generator[None, None, list[int]]:
        count = _count(number)
        layout = struct.Struct(f">{count}{code}")

        def take(link: ScriptLink) -> list[int] | None:
            return [count, *layout.unpack(link.take(layout.size))] if len(link.unread) >= layout.size else None

        return (yield from _read(self.robot.links, socket_name, timeout, take, [0] + [-1] * count))

    return method


class SocketFunctions(FunctionGroup):
    """Sockets by name."""

    def socket_open(self, address: Any, port: Any, socket_name: Any = _NAME) -> Generator[None, None, bool]:
        host = "127.0.0.1" if address == "localhost" else address
        try:
            loopback = ipaddress.IPv4Address(host).is_loopback
        except ValueError:
            loopback = False
        if not loopback:
            raise ScriptError(
                f"socket_open: this controller connects to loopback addresses only (127.0.0.0/8, localhost),"
                f" not to {script_text(address)}"
            )
        target = host, integer_below(port, "socket_open: the port", 1 << 16)
        links = self._robot.links
        links.close(_text(socket_name))
        if len(links) >= _MOST_LINKS:
            raise ScriptError(f"socket_open: {_MOST_LINKS} sockets are open")
        stream = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        stream.setblocking(False)
        stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        links[socket_name] = link = ScriptLink(stream)  # from now on the program's end closes it
        left = _ticks(_PATIENCE)
        while (error := stream.connect_ex(target)) in _PENDING and left > 0 and links.get(socket_name) is link:
            left -= 1
            yield
        if error in (0, errno.EISCONN):
            return True
        links.close(socket_name)
        self._robot.report(f"socket_open: {host}:{port}: {errno.errorcode.get(error, error)}")
        return False

    def socket_close(self, socket_name: Any = _NAME) -> None:
        self._robot.links.close(_text(socket_name))

    def _send(self, data: bytes, name: Any) -> Generator[None, None, bool]:
        for _ in range(_ticks(_PATIENCE)):
            link = self._robot.links.get(_text(name))
            try:
                data = data[0 if link is None else link.stream.send(data) :]
            except BlockingIOError:
                pass
            except OSError:
                link = None
            if not data:
                return True
            yield
            if link is None:
                break
        return False

    def socket_send_byte(self, value: Any, socket_name: Any = _NAME) -> Generator[None, None, bool]:
        return (yield from self._send(bytes([integer_below(value, "socket_send_byte: the value", 256)]), socket_name))

    def socket_send_int(self, value: Any, socket_name: Any = _NAME) -> Generator[None, None, bool]:
        whole = integer(int(number(value, "socket_send_int: the value")))
        return (yield from self._send(_INTEGER.pack(whole), socket_name))

    def socket_send_string(self, str: Any, socket_name: Any = _NAME) -> Generator[None, None, bool]:  # noqa: A002
        return (yield from self._send(script_text(str).encode(_TEXT, "replace"), socket_name))

    def socket_send_line(self, str: Any, socket_name: Any = _NAME) -> Generator[None, None, bool]:  # noqa: A002
        return (yield from self._send(script_text(str).encode(_TEXT, "replace") + b"\n", socket_name))

    def socket_set_var(self, name: Any, value: Any, socket_name: Any = _NAME) -> Generator[None, None, bool]:
        return (yield from self.socket_send_line(f"SET {_text(name)} {script_text(value)}", socket_name))

    def socket_get_var(self, name: Any, socket_name: Any = _NAME) -> Generator[None, None, int]:
        yield from self.socket_send_line(f"GET {_text(name)}", socket_name)
        answer = yield from self.socket_read_line(socket_name, _PATIENCE)
        _, _, value = answer.partition(f"{name} ")
        try:
            return integer(int(value))
        except ValueError:
            return 0

    socket_read_binary_integer, socket_read_byte_list = _reading("i"), _reading("B")

    def socket_read_ascii_float(
        self, number: Any, socket_name: Any = _NAME, timeout: Any = _PATIENCE
    ) -> Generator[None, None, list[float]]:
        count = _count(number)
        failed = [0, *[math.nan] * count]

        def take(link: ScriptLink) -> list[float] | None:
            text = link.take_to(b")")
            if text is None:
                return None
            try:
                values = [float(word) for word in text.rpartition(b"(")[2].split(b",")]
            except ValueError:
                return failed
            return [count, *values] if len(values) == count else failed

        return (yield from _read(self._robot.links, socket_name, timeout, take, failed))

    def socket_read_line(self, socket_name: Any = _NAME, timeout: Any = _PATIENCE) -> Generator[None, None, str]:
        return (yield from self.socket_read_string(socket_name, "", "\n", False, timeout))

    def socket_read_string(
        self,
        socket_name: Any = _NAME,
        prefix: Any = "",
        suffix: Any = "",
        interpret_escape: Any = False,
        timeout: Any = _PATIENCE,
    ) -> Generator[None, None, str]:
        before, after = _text(prefix), _text(suffix)
        for written, meant in _ESCAPES.items() if interpret_escape else ():
            before, after = before.replace(written, meant), after.replace(written, meant)
        begin, end = before.encode(_TEXT, "replace"), after.encode(_TEXT, "replace")

        def take(link: ScriptLink) -> str | None:
            at = link.unread.find(begin)
            if at < 0 or len(link.unread) == at + len(begin) or (end and link.unread.find(end, at + len(begin)) < 0):
                return None
            link.take(at + len(begin))
            data = (link.take_to(end) or b"") if end else link.take(len(link.unread))
            if len(data) > MOST_CHARACTERS:
                raise ScriptError(f"socket_read_string: more than {MOST_CHARACTERS} characters")
            return data.decode(_TEXT)

        return (yield from _read(self._robot.links, socket_name, timeout, take, ""))


def _count(number: Any) -> int:
    return integer_below(number, "the number of values", _MOST_VALUES + 1)


def _ticks(seconds: float) -> int:
    return max(1, round(seconds / STEP_TIME))


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise ScriptError(f"{script_text(value)} is not a string")
    return value
