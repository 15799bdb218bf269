"""A controller process per test or per module, and the real library's clients on it."""

import itertools
import os
import socket
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from hardware_sim.controller.options import ControllerOptions
from hardware_sim.controller.process import ControllerProcess

HOME = [0.0, -1.9, 1.9, -1.57, -1.57, 0.0]
_numbers = itertools.count(os.getpid() * 7)


def start(*, log_level: str = "WARNING", **options: Any) -> ControllerProcess:
    """A controller at an address of 127.0.1.1–250 that is free: another run of the tests may hold some.

    Digital output 0, the lamp's, goes low when no program plays.
    """
    for _ in range(20):
        try:
            return ControllerProcess(
                f"127.0.1.{1 + next(_numbers) % 250}",
                ControllerOptions(**({"home": HOME, "low_when_stopped": (0,)} | options)),
                log_level=log_level,
                module="hardware_sim.real_time_controller",
            )
        except ConnectionError:
            continue
    raise RuntimeError("no free address")


def wait_until(condition: Callable[[], object], seconds: float = 60.0) -> None:
    """Waits until a condition holds; the limit only keeps a failed test from hanging on a busy machine."""
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            pytest.fail("the condition did not come true in time")
        time.sleep(0.002)


def let_pass(receive: Any, seconds: float) -> None:
    """Waits for so many seconds of the controller's clock, as the receive client sees it."""
    since = receive.getTimestamp()
    wait_until(lambda: receive.getTimestamp() >= since + seconds)


@dataclass
class Cell:
    """A controller and the four clients of the real library."""

    process: ControllerProcess
    control: Any
    receive: Any
    io: Any
    dashboard: Any

    @property
    def address(self) -> str:
        """Where it listens."""
        return self.process.address


@contextmanager
def fault_in_move(cell: Cell, kind: str) -> Iterator[None]:
    """Orders a fault once the arm moves, whenever that is, while the block makes a synchronous move."""

    def order() -> None:
        with cell.process.control() as faults:
            wait_until(lambda: max(map(abs, faults.state()["joint_speeds"])) > 0.3)
            faults.fault(kind)

    with ThreadPoolExecutor(1) as pool:
        ordered = pool.submit(order)
        yield
        ordered.result()


def restart_program(cell: Cell) -> None:
    """Uploads the control script again and waits until it runs."""
    assert cell.control.reuploadScript()
    wait_until(cell.control.isProgramRunning)


def at_home(cell: Cell) -> None:
    """Takes faults away, puts outputs low, makes the control script run where it does not, and moves home."""
    with cell.process.control() as control:
        control.fault("clear")
    for number in range(8):
        if cell.receive.getDigitalOutState(number):
            cell.io.setStandardDigitalOut(number, False)
    if cell.dashboard.programState() != "PLAYING rtde_control":
        cell.dashboard.stop()
        wait_until(lambda: not cell.control.isProgramRunning())
        # A command that the library does not wait for stays in the registers; a call that fails takes it back.
        cell.control.setTcp([0.0] * 6)
        restart_program(cell)
    assert cell.control.moveJ(HOME, 3.0, 20.0)
    wait_until(lambda: cell.receive.getActualQ() == pytest.approx(HOME, abs=1e-9))


def connect(stack: ExitStack, **options: Any) -> Cell:
    """Starts a controller and connects all four clients; the stack disconnects them before it ends the controller."""
    import dashboard_client
    import rtde_control
    import rtde_io
    import rtde_receive

    process = stack.enter_context(start(**options))
    control = rtde_control.RTDEControlInterface(process.address)
    stack.callback(control.disconnect)
    receive = rtde_receive.RTDEReceiveInterface(process.address)
    stack.callback(receive.disconnect)
    io = rtde_io.RTDEIOInterface(process.address)
    stack.callback(io.disconnect)
    dashboard = dashboard_client.DashboardClient(process.address)
    dashboard.connect()
    stack.callback(dashboard.disconnect)
    return Cell(process, control, receive, io, dashboard)


class Client:
    """A Python program in a process of its own; `sys.argv[1]` is the controller's address."""

    def __init__(self, code: str, address: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-c", "import os, sys, time\n" + textwrap.dedent(code), address],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=Path.cwd(),
        )

    def wait_for(self, line: str) -> None:
        """Waits for a line of output."""
        assert self.process.stdout is not None
        assert self.process.stdout.readline() == line + "\n"

    def finish(self, seconds: float = 90.0) -> list[str]:
        """Lets it go on, waits for its end; the rest of its output."""
        output, errors = self.process.communicate("\n", timeout=seconds)
        return output.splitlines() or errors.splitlines()

    def hangs(self, seconds: float) -> bool:
        """Whether it is still at it after so long; ends it then."""
        try:
            self.process.communicate("\n", timeout=seconds)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.communicate()
            return True
        return False


def send_script(address: str, text: str) -> None:
    """Sends a program to the secondary port."""
    with socket.create_connection((address, 30002), 30.0) as script:
        script.sendall(text.encode())
