"""Latency and processor time of the simulated controller.

pytest tests/benchmarks/test_controller.py --benchmark-enable -q -s
"""

import importlib
import itertools
import os
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from statistics import median
from typing import Any

import pytest

from hardware_sim.controller.compiler import compile_program
from hardware_sim.controller.controller import Controller
from hardware_sim.controller.functions import VOCABULARY
from hardware_sim.controller.kinematics import MODELS
from tests.hardware_sim.controller.cells import HOME, Cell, Client, connect, start
from tests.hardware_sim.controller.plain_client import PlainClient

MOVE = """def f():
    while True:
        movej([0.5, -1.9, 1.9, -1.57, -1.57, 0], a=1.4, v=1.0)
        movej([0, -1.9, 1.9, -1.57, -1.57, 0])
    end
end
"""
BRANCHES = "def f():\n" + "".join(f" x{i} = [{i}, 2]\n if x{i}[0] > 1:\n  sync()\n end\n" for i in range(200)) + "end\n"


@pytest.fixture(scope="module")
def cell() -> Iterator[Cell]:
    """A controller with all four clients of the library."""
    with ExitStack() as stack:
        yield connect(stack)


def cpu_seconds(process: int) -> float:
    """User and system time a process has used."""
    fields = Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@pytest.mark.parametrize("interface", ["rtde_control.RTDEControl", "rtde_receive.RTDEReceive", "rtde_io.RTDEIO"])
def test_construct_client_time(benchmark: Any, interface: str) -> None:
    """Bars: control 0.3 s, receive 0.05 s; the IO client itself waits 0.1 s."""
    module, name = interface.split(".")
    construct_client = getattr(importlib.import_module(module), f"{name}Interface")
    with start() as process:
        clients: list[Any] = []

        def construct() -> None:
            clients.append(construct_client(process.address))

        def disconnect() -> None:
            if clients:
                clients.pop().disconnect()

        benchmark.pedantic(construct, setup=disconnect, rounds=5)
        disconnect()


def test_start_controller_time(benchmark: Any) -> None:
    """Bar: a controller is there in under a second."""
    running: list[Any] = []

    def end() -> None:
        if running:
            running.pop().close()

    benchmark.pedantic(lambda: running.append(start()), setup=end, rounds=5)
    end()


def test_output_round_trip_time(benchmark: Any, cell: Cell) -> None:
    level = [False]

    def toggle() -> None:
        level[0] = not level[0]
        cell.io.setStandardDigitalOut(3, level[0])
        while cell.receive.getDigitalOutState(3) != level[0]:
            time.sleep(0.0002)

    benchmark.pedantic(toggle, rounds=200)


DRAIN = """
import selectors, socket, sys
ports = selectors.DefaultSelector()
for port in (30001, 30002, 30003, 30011, 30012, 30013):
    ports.register(socket.create_connection((sys.argv[1], port)), selectors.EVENT_READ)
print("ready", flush=True)
while all(key.fileobj.recv(65536) for key, _ in ports.select()):
    pass
"""


def packets(benchmark: Any, cell: Cell) -> None:
    """Core share and intervals with one control, two receive clients and the IO client.

    A plain client measures, while the arm moves; its own process shares the cores.
    """
    import rtde_receive

    second = rtde_receive.RTDEReceiveInterface(cell.address)
    plain = PlainClient(cell.address)
    plain.outputs("timestamp,actual_q,actual_TCP_pose")
    plain.request("S")
    number = cell.process.process.pid
    cell.control.moveJ([2.0, *HOME[1:]], 0.2, 1.0, True)
    arrivals: list[float] = []

    def listen() -> None:
        used, began = cpu_seconds(number), time.monotonic()
        for _ in range(3000):
            plain.sample()
            arrivals.append(time.monotonic())
        benchmark.extra_info["share_of_a_core"] = (cpu_seconds(number) - used) / (time.monotonic() - began)

    benchmark.pedantic(listen, rounds=1)
    steps = sorted(b - a for a, b in itertools.pairwise(arrivals))
    benchmark.extra_info["p99_interval_ms"] = 1e3 * steps[int(0.99 * len(steps))]
    benchmark.extra_info["longest_interval_ms"] = 1e3 * steps[-1]
    benchmark.extra_info["median_interval_ms"] = 1e3 * median(steps)
    benchmark.extra_info["load"] = os.getloadavg()[0]
    print(benchmark.extra_info)
    cell.control.stopJ(2.0)
    assert cell.control.moveJ(HOME, 3.0, 20.0)
    plain.close()
    second.disconnect()


def test_packets_core_share_and_jitter(benchmark: Any, cell: Cell) -> None:
    """Bars: p99 of the time between packets 4 ms, half a core."""
    packets(benchmark, cell)


def test_packets_all_streams_core_share_and_jitter(benchmark: Any, cell: Cell) -> None:
    """Bars on two idle cores: p99 of the time between packets 3 ms, a quarter of a core; six streams are read, too."""
    reader = Client(DRAIN, cell.address)
    reader.wait_for("ready")
    packets(benchmark, cell)
    reader.process.kill()
    reader.process.communicate()


def test_upload_to_running_time(benchmark: Any, cell: Cell) -> None:
    """From the dashboard's stop to the control script playing again."""

    def upload() -> None:
        cell.control.reuploadScript()
        while not cell.control.isProgramRunning():
            time.sleep(0.0005)

    benchmark.pedantic(upload, rounds=5)


def test_tick_time(benchmark: Any) -> None:
    controller = Controller(MODELS["ur5e"], HOME, now=0.0)
    controller.load(MOVE)

    def tick() -> None:
        controller.tick(controller.timestamp)

    benchmark(tick)


def test_compile_program_time(benchmark: Any) -> None:
    def compile_anew() -> None:
        compile_program.cache_clear()
        compile_program(BRANCHES, VOCABULARY)

    benchmark(compile_anew)
