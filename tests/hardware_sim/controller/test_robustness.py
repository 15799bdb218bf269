"""Malformed bytes, bad and many clients on every port: the controller survives, stays on time, leaks nothing."""

import contextlib
import json
import os
import random
import socket
import struct
import subprocess
import sys
import textwrap
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from hardware_sim.controller.process import ControllerProcess
from tests.hardware_sim.controller.cells import HOME, start, wait_until
from tests.hardware_sim.controller.plain_client import PlainClient
from tests.hardware_sim.controller.traffic import PORTS, mutated, piece, recorded

EVERY_PORT = (*PORTS, 30011, 30012, 30013, 30020)
"""Also those at which the library sends nothing: the read-only ones and that of the interpreter mode."""
LONGEST_GAP = 1.0
"""Between two packets at a bystander: seconds for which the controller's main thread, which makes the ticks, has run.
That leaves out the time for which other work keeps it waiting; in all a gap is at most ten times as long."""

SMALL = {
    29999: [b"running\n", b"load x.urp\n", b"popup hello\n", b"power off\n", b"brake release\n", b"\n", b"x" * 70000],
    30001: [
        b"power off\n",
        b"set robotmode run\n",
        b"stop program\n",
        b"def f():\n  global x = [1, 2]\n  if x[0] > 1:\n    movej(x, a=1)\n  else:\n    sync()\n  end\nend\n",
    ],
    30002: [b"sec s():\n set_digital_out(1, True)\nend\n"],
    30003: [b"x" * 70000, b"movej([0,-1.9,1.9,-1.57,-1.57,0], a=20, v=3)\n"],
    30004: [
        struct.pack(">HBH", 5, ord("V"), 2),
        struct.pack(">HB", 65535, ord("O")) + b"," * 65532,
        struct.pack(">HB", 65535, ord("I")) + b"input_int_register_30," * 2978 + b"," * 16,
        struct.pack(">HBBHB", 7, ord("M"), 255, 3, 1),
    ],
}
BYSTANDER = """
import json, select, sys, time
from tests.hardware_sim.controller.plain_client import PlainClient
client = PlainClient(sys.argv[1])
running = open(f"/proc/{sys.argv[2]}/schedstat", "rb", buffering=0)

def busy():
    running.seek(0)
    return int(running.read().split()[0]) / 1e9

client.outputs("timestamp")
client.request("S")
client.sample()
print("ready", flush=True)
last, arrived, ran, gap, busiest, missing = client.sample()[0], time.monotonic(), busy(), 0.0, 0.0, 0
while not select.select([sys.stdin], [], [], 0)[0]:
    stamp, now, running_s = client.sample()[0], time.monotonic(), busy()
    missing += round((stamp - last) / 0.002) - 1
    gap, busiest = max(gap, now - arrived), max(busiest, running_s - ran)
    last, arrived, ran = stamp, now, running_s
print(json.dumps({"gap": gap, "busiest": busiest, "missing": missing}), flush=True)
"""


class Bystander:
    """A plain client in a process of its own that notes the packets it misses and how long it waits for one."""

    def __init__(self, process: ControllerProcess) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-c", textwrap.dedent(BYSTANDER), process.address, str(process.process.pid)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=Path.cwd(),
        )
        assert self._process.stdout is not None
        assert self._process.stdout.readline() == "ready\n"

    def undisturbed(self) -> float:
        """Ends it; fails where a packet was missing; the longest wait for one in s."""
        output, _ = self._process.communicate("\n", timeout=90)
        reply = json.loads(output)
        assert reply["missing"] == 0
        assert reply["busiest"] < LONGEST_GAP
        assert reply["gap"] < 10 * LONGEST_GAP
        return float(reply["gap"])


def descriptors(process: ControllerProcess) -> int:
    return len(list(Path(f"/proc/{process.process.pid}/fd").iterdir()))


def threads(process: ControllerProcess) -> int:
    return len(list(Path(f"/proc/{process.process.pid}/task").iterdir()))


def resident_megabytes(process: ControllerProcess) -> float:
    pages = int(Path(f"/proc/{process.process.pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


@pytest.fixture(scope="module")
def process() -> Iterator[ControllerProcess]:
    """One controller that all of this happens to."""
    with start(speed=20.0) as process:
        yield process


@pytest.fixture(scope="module")
def traffic(process: ControllerProcess) -> dict[int, list[bytes]]:
    """What the library sends, by port."""
    with start() as free:
        address = free.address
    return recorded(process, address)


def attack(address: str, port: int, seeds: list[bytes], packets: int, seed: int) -> None:
    """Sends mutated and random bytes to a port, hanging up now and then."""
    chance = random.Random(seed)  # noqa: S311 - mutations, not secrets
    stream: socket.socket | None = None
    for number in range(packets):
        if stream is None:
            stream = socket.create_connection((address, port), 10.0)
        if chance.random() < 0.2:
            data = chance.randbytes(chance.randrange(200))
        else:
            data = chance.choice(seeds)
            if len(data) > 1000 and number % 200 and port != 30004:
                data = piece(chance, data)
            data = mutated(chance, data)
        try:
            stream.sendall(data)
            stream.setblocking(False)
            with contextlib.suppress(BlockingIOError):
                while stream.recv(65536):
                    pass
            stream.settimeout(10.0)
        except OSError:
            stream.close()
            stream = None
            continue
        if chance.random() < 0.02:
            stream.close()
            stream = None
    if stream is not None:
        stream.close()


def survive(process: ControllerProcess, traffic: dict[int, list[bytes]], packets: int) -> str:
    """Attacks each port with so many packets; figures."""
    before, running, memory = descriptors(process), threads(process), resident_megabytes(process)
    bystander = Bystander(process)
    for part in range(max(1, packets // 1000)):
        for port in EVERY_PORT:
            like = port if port in PORTS else 30001
            attack(process.address, port, traffic[like] + SMALL[like] * 2, min(packets, 1000), part)
    gap = bystander.undisturbed()
    wait_until(lambda: descriptors(process) == before)
    assert process.process.poll() is None
    assert threads(process) == running
    assert resident_megabytes(process) < memory + 60.0
    with process.control() as control:
        control.fault("clear")
        control.fault("program_stop")
        assert control.state()["ok"]
    return f"longest gap {1e3 * gap:.0f} ms, memory {memory:.1f} → {resident_megabytes(process):.1f} MB"


def test_ports_survive_mutated_traffic(process: ControllerProcess, traffic: dict[int, list[bytes]]) -> None:
    """Check 33, for 400 packets a port."""
    print(survive(process, traffic, 400))


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_ports_survive_hundred_thousand_packets(process: ControllerProcess, traffic: dict[int, list[bytes]]) -> None:
    """Check 33."""
    print(survive(process, traffic, 100_000))


def test_ports_survive_names_of_64_kilobytes(process: ControllerProcess) -> None:
    """Check 33."""
    bystander = Bystander(process)
    with PlainClient(process.address) as client:
        for names in ("x" * 65000, "x," * 32000, "timestamp," * 6500, "actual_q," * 7200, ","):
            assert client.outputs(names)[0] == 0
            assert client.inputs(names)[0] == 0
        assert client.outputs("timestamp") == (1, ["DOUBLE"])
    for port in (29999, 30001):
        with socket.create_connection((process.address, port), 30.0) as stream:
            stream.sendall(b"def f():\n  " + b"x" * 60000 + b" = 1\nend\n")
            with contextlib.suppress(ConnectionError):
                stream.sendall(b"y" * 70000)
    bystander.undisturbed()


def test_ports_survive_slow_and_silent_clients(process: ControllerProcess) -> None:
    before = descriptors(process)
    bystander = Bystander(process)
    streams = [
        (port, socket.create_connection((process.address, port), 30.0)) for port in EVERY_PORT for _ in range(30)
    ]
    texts = {29999: b"robotmode\n", 30004: struct.pack(">HBH", 5, ord("V"), 2)}
    for at in range(6):
        for port, stream in streams:
            text = texts.get(port, b"def f()")
            stream.sendall(text[at % len(text) : at % len(text) + 1])
        time.sleep(0.05)
    # Beside them, others are served as ever.
    with PlainClient(process.address) as client:
        assert client.outputs("timestamp")[0] == 1
    for number, (_, stream) in enumerate(streams):
        if number % 3 == 0:
            stream.shutdown(socket.SHUT_WR)  # half closed
        elif number % 3 == 1:
            stream.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # reset
        stream.close()
    bystander.undisturbed()
    wait_until(lambda: descriptors(process) == before)


def connections(process: ControllerProcess, count: int) -> None:
    before = descriptors(process)
    bystander = Bystander(process)
    for number in range(count):
        for port in EVERY_PORT:
            stream = socket.create_connection((process.address, port), 30.0)
            if number % 2:
                stream.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            stream.close()
    # More than a port takes at once: the others are hung up on, not left waiting.
    crowd = [socket.create_connection((process.address, 29999), 30.0) for _ in range(100)]
    greetings = [stream.recv(100) for stream in crowd]
    assert 60 <= sum(greeting.startswith(b"Connected") for greeting in greetings) <= 64
    for stream in crowd:
        stream.close()
    bystander.undisturbed()
    wait_until(lambda: descriptors(process) == before)


def test_ports_survive_hundreds_of_connections(process: ControllerProcess) -> None:
    connections(process, 60)


@pytest.mark.long
def test_ports_survive_thousands_of_connections(process: ControllerProcess) -> None:
    connections(process, 2000)


def test_upload_cut_midway_starts_nothing(process: ControllerProcess, traffic: dict[int, list[bytes]]) -> None:
    """Check 35."""
    with process.control() as control:
        control.fault("program_stop")
        program = traffic[30003][0]
        started = len(control.log())
        for share in (0.1, 0.5, 0.9, 0.999):
            with socket.create_connection((process.address, 30003), 30.0) as script:
                script.sendall(program[: int(share * len(program))])
        before = control.state()["timestamp"]
        wait_until(lambda: control.state()["timestamp"] > before + 0.3)
        assert not control.state()["program_running"]
        assert len(control.log()) == started


def test_upload_long_program_compiles_beside_ticks(process: ControllerProcess) -> None:
    bystander = Bystander(process)
    lines = "".join(f"  movej([{n % 3 * 0.01}, -1.9, 1.9, -1.57, -1.57, 0], a=20, v=3)\n" for n in range(1500))
    with process.control() as control, socket.create_connection((process.address, 30002), 30.0) as script:
        script.sendall(f"def long_way():\n{lines}end\n".encode())
        wait_until(lambda: control.state()["program_running"])
        control.fault("program_stop")
    bystander.undisturbed()


def test_upload_oversized_program_closes_connection(process: ControllerProcess) -> None:
    with process.control() as control, socket.create_connection((process.address, 30002), 30.0) as script:
        began = len(control.log())
        with contextlib.suppress(ConnectionError):
            for _ in range(100):
                script.sendall(b"def f():\n" + b"  sync()\n" * 5000)
            assert script.recv(1) == b""
        assert len(control.log()) == began


def cycles(count: int) -> str:
    import rtde_control

    with start(speed=10.0) as process, process.control() as control:
        rtde_control.RTDEControlInterface(process.address).disconnect()
        before, memory, running = descriptors(process), resident_megabytes(process), threads(process)
        for number in range(count):
            client = rtde_control.RTDEControlInterface(process.address)
            assert client.moveJ([0.01 * (number % 2), *HOME[1:]], 3.0, 20.0)
            client.disconnect()
        wait_until(lambda: descriptors(process) == before)
        assert threads(process) == running
        grown = resident_megabytes(process) - memory
        assert grown < 6.0
        assert control.state()["program_running"]
    return f"{count} cycles: {before} descriptors, {running} threads, {grown:.2f} MB more memory"


def test_reconnecting_leaves_no_thread_or_register() -> None:
    """Check 34, for two cycles."""
    print(cycles(2))


@pytest.mark.long
@pytest.mark.timeout(600)
def test_reconnecting_two_hundred_times_leaves_nothing() -> None:
    """Check 34."""
    print(cycles(200))
