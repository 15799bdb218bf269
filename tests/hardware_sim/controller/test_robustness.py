"""Malformed bytes, bad and many clients on every port: the controller survives, stays on time, leaks nothing."""

import contextlib
import json
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from hardware_sim.controller.process import ControllerProcess
from tests.hardware_sim.controller import hostile_traffic
from tests.hardware_sim.controller.cells import HOME, start, wait_until
from tests.hardware_sim.controller.hostile_traffic import (
    EVERY_PORT,
    ROBOT_API,
    Bystander,
    descriptors,
    library_traffic,
    polyscope_5,
    polyscope_x,
    resident_megabytes,
    threads,
)
from tests.hardware_sim.controller.plain_client import PlainClient


@pytest.fixture(scope="module")
def process() -> Iterator[ControllerProcess]:
    """One controller that all of this happens to."""
    with start(speed=20.0) as process:
        yield process


@pytest.fixture(scope="module")
def traffic(process: ControllerProcess) -> dict[int, list[bytes]]:
    """What the library sends, by port."""
    return library_traffic(process)


def test_ports_survive_mutated_traffic(process: ControllerProcess, traffic: dict[int, list[bytes]]) -> None:
    """Check 33, for 300 packets a port."""
    print(polyscope_5(process, traffic).survives(0, 300))


def test_robot_api_survives_mutated_traffic() -> None:
    with start(speed=20.0, polyscope="x", robot_api_port=ROBOT_API) as process:
        print(polyscope_x(process).survives(0, 300))


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_ports_survive_hundred_thousand_packets(tmp_path: Path) -> None:
    """Check 33, as it is run by hand; two runs, the second goes on behind the first."""
    for packets in (3000, 100_000):
        command = ["--packets", str(packets), "--record", str(tmp_path / "record")]
        done = subprocess.run([sys.executable, "-m", hostile_traffic.__name__, *command], check=False)
        assert done.returncode == 0
    rows = [json.loads(line) for line in (tmp_path / "record").read_text().splitlines()]
    assert sorted(row["shard"] for row in rows if row["controller"] == "x") == list(range(100))


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
