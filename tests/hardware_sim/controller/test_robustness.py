"""Bad bytes on every port: the controller lives, serves others on time and leaks nothing."""

import contextlib
import os
import random
import socket
import struct
from pathlib import Path

import pytest

from hardware_sim.controller.process import ControllerProcess
from tests.hardware_sim.controller.cells import start, wait_until
from tests.hardware_sim.controller.plain_client import PlainClient

PORTS = (29999, 30001, 30002, 30003, 30004, 30200)
SCRIPT = b"def f():\n  global x = [1, 2]\n  if x[0] > 1:\n    movej(x, a=1)\n  else:\n    sync()\n  end\nend\n"
SEEDS = {
    29999: [b"running\n", b"load x.urp\n", b"popup hello\n", b"power off\n", b"\n", b"x" * 70000],
    30001: [SCRIPT],
    30002: [SCRIPT, b"sec s():\n set_digital_out(1, True)\nend\n"],
    30003: [SCRIPT, b"x" * 70000],
    30004: [
        struct.pack(">HBH", 5, ord("V"), 2),
        struct.pack(">HB", 3, ord("v")),
        struct.pack(">HBd", 11 + 18, ord("O"), 500.0) + b"timestamp,actual_q",
        struct.pack(">HB", 3 + 20, ord("I")) + b"input_int_register_0",
        struct.pack(">HB", 3, ord("S")),
        struct.pack(">HBBi", 8, ord("U"), 1, 5),
        struct.pack(">HB", 65535, ord("O")) + b"," * 65532,
    ],
    30200: [b'{"command": "state"}\n', b'{"command": "log"}\n', b'{"command": "fault", "kind": "clear"}\n'],
}


def mutated(chance: random.Random, seed: bytes) -> bytes:
    """A copy with a few bytes changed, removed, doubled or cut off."""
    data = bytearray(seed)
    for _ in range(chance.randrange(4)):
        at = chance.randrange(len(data) + 1)
        kind = chance.randrange(4)
        if kind == 0:
            data[at:at] = chance.randbytes(chance.randrange(1, 9))
        elif kind == 1:
            del data[at : at + chance.randrange(1, 9)]
        elif kind == 2 and at < len(data):
            data[at] = chance.randrange(256)
        else:
            data[at:at] = data[: chance.randrange(len(data) + 1)]
    return bytes(data)


def attack(address: str, packets: int, seed: int) -> None:
    """Sends mutated and random bytes to all ports, hanging up now and then."""
    chance = random.Random(seed)  # noqa: S311 - mutations, not secrets
    sockets: dict[int, socket.socket] = {}
    for _ in range(packets):
        port = chance.choice(PORTS)
        if port not in sockets:
            sockets[port] = socket.create_connection((address, port), 5.0)
        data = (
            chance.randbytes(chance.randrange(200))
            if chance.random() < 0.2
            else mutated(chance, chance.choice(SEEDS[port]))
        )
        try:
            sockets[port].sendall(data)
            sockets[port].setblocking(False)
            with contextlib.suppress(BlockingIOError):
                while sockets[port].recv(65536):
                    pass
            sockets[port].settimeout(5.0)
        except OSError:
            sockets.pop(port).close()
            continue
        if chance.random() < 0.05:
            sockets.pop(port).close()
    for stream in sockets.values():
        stream.close()


def descriptors(process: ControllerProcess) -> int:
    return len(list(Path(f"/proc/{process.process.pid}/fd").iterdir()))


def threads(process: ControllerProcess) -> int:
    return len(list(Path(f"/proc/{process.process.pid}/task").iterdir()))


def resident_megabytes(process: ControllerProcess) -> float:
    pages = int(Path(f"/proc/{process.process.pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def survive(packets: int) -> None:
    with start() as process, process.control() as control:
        bystander = PlainClient(process.address)
        bystander.outputs("timestamp")
        bystander.request("S")
        last = bystander.sample()[0]
        before = descriptors(process)
        for seed in range(max(1, packets // 1000)):
            attack(process.address, min(packets, 1000), seed)
            # The bystander's socket holds about a second of packets; what it has not read may be dropped.
            while bystander.sample()[0] < control.state()["timestamp"] - 0.01:
                pass
        assert bystander.sample()[0] > last
        wait_until(lambda: descriptors(process) == before)
        assert process.process.poll() is None


def test_mutated_bytes_on_every_port() -> None:
    survive(2000)


@pytest.mark.long
@pytest.mark.timeout(600)
def test_a_hundred_thousand_mutated_packets() -> None:
    survive(100_000)


def test_upload_cut_in_the_middle_starts_nothing(controller: ControllerProcess) -> None:
    with socket.create_connection((controller.address, 30003), 3.0) as script:
        script.sendall(b"def f():\n  while True:\n    sync()\n")
    with controller.control() as control:
        wait_until(lambda: control.state()["timestamp"] > 0.2)
        assert not control.state()["program_running"]


def cycles(count: int) -> None:
    import rtde_control

    with start(speed=10.0) as process, process.control() as control:
        rtde_control.RTDEControlInterface(process.address).disconnect()
        before, memory, running = descriptors(process), resident_megabytes(process), threads(process)
        for number in range(count):
            client = rtde_control.RTDEControlInterface(process.address)
            assert client.moveJ([0.01 * (number % 2), -1.9, 1.9, -1.57, -1.57, 0.0], 3.0, 20.0)
            client.disconnect()
        wait_until(lambda: descriptors(process) == before)
        assert threads(process) == running
        assert resident_megabytes(process) < memory + 5.0
        assert control.state()["program_running"]


def test_cycles_of_connecting_leave_nothing_behind() -> None:
    cycles(2)


@pytest.mark.long
@pytest.mark.timeout(600)
def test_two_hundred_cycles_leave_nothing_behind() -> None:
    cycles(200)
