"""URScript's socket functions against a real server, in a controller without ports of its own."""

import contextlib
import math
import socket
import struct
import time
from collections.abc import Callable, Iterator

import pytest

from hardware_sim.controller.controller import Controller
from hardware_sim.controller.kinematics import MODELS
from hardware_sim.controller.modes import RuntimeState
from tests.hardware_sim.controller.programs import HOME, TICK


class Server:
    """A server on loopback, and a controller whose program connects to it."""

    def __init__(self) -> None:
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.listener.settimeout(30.0)
        self.port = self.listener.getsockname()[1]
        self.controller = Controller(MODELS["ur5e"], HOME, now=0.0)

    def start(self, lines: str) -> socket.socket:
        """Starts lines after `socket_open`; returns the server's end of the connection."""
        self.load(f' global opened = socket_open("localhost", {self.port})\n{lines}')
        self.tick(lambda: bool(self.controller.links))
        stream, _ = self.listener.accept()
        stream.settimeout(30.0)
        stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return stream

    def load(self, lines: str) -> None:
        """Starts a program."""
        self.controller.load(f"def f():\n{lines}\nend\n")
        assert self.controller.runtime_state is RuntimeState.PLAYING, list(self.controller.messages)

    def tick(self, condition: Callable[[], bool], most: int = 20_000) -> int:
        """Ticks until a condition holds; how often."""
        for count in range(most):
            if condition():
                return count
            self.controller.tick(self.controller.ticks * TICK)
            time.sleep(1e-5)  # else the ticks of a time-out of the program are over before what was sent has arrived
        pytest.fail(f"not within {most} ticks: {list(self.controller.messages)[-3:]}")

    def finish(self) -> list[float]:
        """Ticks until the program has ended; the first output registers."""
        self.tick(lambda: self.controller.runtime_state is RuntimeState.STOPPED)
        assert not [m for m in self.controller.messages if "exception" in m], list(self.controller.messages)
        return [self.controller.registers.get(f"output_double_register_{i}")[0] for i in range(5)]


@pytest.fixture
def server() -> Iterator[Server]:
    server = Server()
    yield server
    server.listener.close()
    server.controller.links.close_all()


def test_socket_functions_send_bytes_of_the_manual(server: Server) -> None:
    stream = server.start(
        """ socket_send_string("ab")
 socket_send_line([1, 2.5])
 socket_send_byte(255)
 socket_send_int(-2)
 socket_set_var("speed", 7)
 if socket_send_string("end") and opened:
  write_output_float_register(0, 1)
 end"""
    )
    assert server.finish()[0] == 1.0
    received = b""
    while not received.endswith(b"end"):
        received += stream.recv(100)
    assert received == b"ab[1, 2.5]\n\xff" + struct.pack(">i", -2) + b"SET speed 7\nend"
    assert stream.recv(1) == b""  # the program's end closes its sockets


def test_socket_functions_read_each_format(server: Server) -> None:
    stream = server.start(
        """ a = socket_read_binary_integer(2)
 b = socket_read_byte_list(3)
 c = socket_read_ascii_float(2)
 d = socket_read_line()
 e = socket_read_string(prefix=">", suffix="<")
 g = socket_read_string("socket_0", ">", "\\n", True)
 write_output_float_register(0, a[0] * 1000 + a[1] + a[2])
 write_output_float_register(1, b[0] * 1000 + b[1] + b[3])
 write_output_float_register(2, c[0] * 1000 + c[1] + c[2])
 write_output_float_register(3, socket_get_var("count"))
 if d == "a line" and e == "hi" and g == "world" and socket_read_string() == "rest":
  write_output_float_register(4, 1)
 end"""
    )
    stream.sendall(struct.pack(">2i", -5, 9) + bytes([200, 1, 55]) + b"(1.5, -2e1)a line\nxx>hi<>world\n")
    server.tick(lambda: "socket_0" in server.controller.links)
    asked = b""
    stream.setblocking(False)

    def request_arrived() -> bool:
        nonlocal asked
        with contextlib.suppress(BlockingIOError):
            asked += stream.recv(100)
        return asked == b"GET count\n"

    server.tick(request_arrived)
    stream.sendall(b"count -12\n")
    server.tick(lambda: server.controller.registers.get("output_double_register_3")[0] != 0.0)
    stream.sendall(b"rest")
    assert server.finish() == [2004.0, 3255.0, 1981.5, -12.0, 1.0]


def test_socket_read_without_data_times_out_with_count_0(server: Server) -> None:
    stream = server.start(
        """ a = socket_read_binary_integer(2, "socket_0", 0.02)
 b = socket_read_ascii_float(1, timeout=0.02)
 write_output_float_register(0, a[0] + a[1] + a[2])
 write_output_float_register(1, b[0])
 if socket_read_line("socket_0", 0.02) == "":
  write_output_float_register(2, 1)
 end"""
    )
    stream.sendall(b"half")  # of two integers: stays for the reads that follow
    before = server.controller.ticks
    assert server.finish()[:3] == [-2.0, 0.0, 1.0]
    assert 30 <= server.controller.ticks - before < 40  # three times ten
    assert math.isfinite(server.controller.timestamp)


def test_socket_read_after_server_hung_up_fails_at_once(server: Server) -> None:
    stream = server.start(
        """ count = 0
 a = socket_read_binary_integer(1, "socket_0", 0)
 while a[0] > 0:
  count = count + 1
  a = socket_read_binary_integer(1, "socket_0", 0)
 end
 write_output_float_register(0, count)
 write_output_float_register(1, 1)
 socket_send_line("the first one is taken by TCP")
 sync()
 if socket_send_line("gone"):
  write_output_float_register(1, 2)
 end"""
    )
    stream.sendall(struct.pack(">3i", 1, 2, 3))
    stream.close()
    assert server.finish()[:2] == [3.0, 1.0]


def test_socket_open_without_server_is_false(server: Server) -> None:
    server.listener.close()
    server.load(
        f""" if socket_open("127.0.0.1", {server.port}, "x") or socket_send_line("x", "x"):
  write_output_float_register(0, 1)
 else:
  write_output_float_register(0, 2)
 end"""
    )
    assert server.finish()[0] == 2.0
    assert any("ECONNREFUSED" in m for m in server.controller.messages)


@pytest.mark.parametrize("address", ['"192.0.2.1"', '"example.org"', '"10.0.0.1"', "7"])
def test_socket_open_off_loopback_is_refused(server: Server, address: str) -> None:
    server.load(f" socket_open({address}, 80)")
    server.tick(lambda: server.controller.runtime_state is RuntimeState.STOPPED, 10)
    assert any("loopback addresses only" in m for m in server.controller.messages)
    assert not server.controller.links
