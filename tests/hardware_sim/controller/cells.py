"""A controller process per test or per module, and the real library's clients on it."""

import itertools
import os
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import pytest

from acquisition.errors import RigError
from hardware_sim.controller.process import ControllerProcess

HOME = [0.0, -1.9, 1.9, -1.57, -1.57, 0.0]
_numbers = itertools.count(os.getpid() * 7)


def start(**options: Any) -> ControllerProcess:
    """A controller at an address of 127.0.1.1–250 that is free: another run of the tests may hold some."""
    for _ in range(20):
        try:
            return ControllerProcess(f"127.0.1.{1 + next(_numbers) % 250}", **({"home": HOME} | options))
        except RigError:
            continue
    raise RuntimeError("no free address")


def wait_until(condition: Callable[[], object], seconds: float = 3.0) -> None:
    """Waits until a condition holds; fails when it does not within `seconds`."""
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            pytest.fail("the condition did not come true in time")
        time.sleep(0.002)


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
