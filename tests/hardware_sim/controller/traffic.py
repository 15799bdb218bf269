"""What the real library sends in a session, and how fuzzing changes it."""

import contextlib
import random
import select
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Iterator

from hardware_sim.controller.process import ControllerProcess

PORTS = (29999, 30001, 30002, 30003, 30004)
SESSION = """
import sys, time
import rtde_control, rtde_io, rtde_receive, dashboard_client
address = sys.argv[1]
control = rtde_control.RTDEControlInterface(address)
receive = rtde_receive.RTDEReceiveInterface(address)
io = rtde_io.RTDEIOInterface(address)
board = dashboard_client.DashboardClient(address)
board.connect()
control.moveJ([0.1, -1.9, 1.9, -1.57, -1.57, 0.0], 3.0, 20.0)
control.getInverseKinematics(receive.getActualTCPPose())
control.moveJ([[0.0, -1.9, 1.9, -1.57, -1.57, 0.0, 3.0, 20.0, 0.0]])
io.setStandardDigitalOut(3, True)
io.setSpeedSlider(0.5)
io.setAnalogOutputVoltage(0, 0.5)
for name in ("polyscopeVersion", "robotmode", "programState", "safetystatus", "running", "stop"):
    getattr(board, name)()
for client in (board, io, receive, control):
    client.disconnect()
"""


class Tap:
    """Passes connections at one address on to another and keeps what clients send, by port."""

    def __init__(self, address: str, target: str) -> None:
        self.sent: dict[int, bytes] = dict.fromkeys(PORTS, b"")
        self._target = target
        self._listeners = {socket.create_server((address, port)): port for port in PORTS}
        self._pairs: dict[socket.socket, tuple[socket.socket, int | None]] = {}
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while not self._ended.is_set():
            ready, _, _ = select.select([*self._listeners, *self._pairs], [], [], 0.05)
            for stream in ready:
                if stream in self._listeners:
                    self._accept(stream)
                elif stream in self._pairs:
                    self._pass_on(stream)

    def _accept(self, listener: socket.socket) -> None:
        client, port = listener.accept()[0], self._listeners[listener]
        server = socket.create_connection((self._target, port))
        self._pairs[client], self._pairs[server] = (server, port), (client, None)

    def _pass_on(self, stream: socket.socket) -> None:
        other, port = self._pairs[stream]
        data = b""
        with contextlib.suppress(ConnectionError):
            data = stream.recv(65536)
            if port is not None:
                self.sent[port] += data
            other.sendall(data)
        if not data:
            for end in (stream, other):
                self._pairs.pop(end, None)
                end.close()

    def close(self) -> None:
        """Ends it."""
        self._ended.set()
        self._thread.join()
        for stream in [*self._listeners, *self._pairs]:
            stream.close()


def frames(data: bytes) -> Iterator[bytes]:
    """RTDE's frames, one by one."""
    at = 0
    while at + 3 <= len(data):
        (size,) = struct.unpack_from(">H", data, at)
        yield data[at : at + size]
        at += size


def recorded(process: ControllerProcess, address: str) -> dict[int, list[bytes]]:
    """One session of the library with a controller: its frames, lines and programs by port."""
    tap = Tap(address, process.address)
    try:
        subprocess.run([sys.executable, "-c", SESSION, address], check=True, timeout=30, capture_output=True)
    finally:
        tap.close()
    lines = [line + b"\n" for line in tap.sent[29999].splitlines()]
    programs = [b"def rtde_control" + text for text in tap.sent[30003].split(b"def rtde_control")[1:]]
    assert lines
    assert len(programs) >= 2
    return {29999: lines, 30001: programs, 30002: programs, 30003: programs, 30004: list(frames(tap.sent[30004]))}


def mutated(chance: random.Random, seed: bytes) -> bytes:
    """A copy with a few bytes changed, removed, doubled or cut off."""
    data = bytearray(seed)
    for _ in range(chance.randrange(4)):
        at = chance.randrange(len(data) + 1)
        kind = chance.randrange(5)
        if kind == 0:
            data[at:at] = chance.randbytes(chance.randrange(1, 9))
        elif kind == 1:
            del data[at : at + chance.randrange(1, 9)]
        elif kind == 2 and at < len(data):
            data[at] = chance.randrange(256)
        elif kind == 3:
            del data[at:]
        else:
            data[at:at] = data[: chance.randrange(min(len(data), 4096) + 1)]
    return bytes(data)


def piece(chance: random.Random, program: bytes) -> bytes:
    """A program of some lines of another: compiling all of it each time would take hours."""
    lines = program.split(b"\n")
    first = chance.randrange(len(lines))
    return b"def f():\n" + b"\n".join(lines[first : first + chance.randrange(1, 12)]) + b"\nend\n"
