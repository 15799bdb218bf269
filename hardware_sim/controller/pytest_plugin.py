"""Fixtures of pytest: a simulated controller at a loopback address of its own.

The distribution `lightpose-ur-sim` registers this module, so a test only has to name them:

    @pytest.mark.ur_controller(model="ur20", speed=10.0)   # fields of `options.ControllerOptions`
    def test_robot_moves(ur_controller):
        control = rtde_control.RTDEControlInterface(ur_controller.address)
        ur_controller.control.fault("protective_stop", at_move=1)
"""

import random
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import pytest

from hardware_sim.controller.control import ControlClient
from hardware_sim.controller.options import ControllerOptions
from hardware_sim.controller.process import ControllerProcess

_MARKER = "ur_controller(**options): how the controller of this test is started (see ControllerOptions)"


@dataclass(frozen=True)
class UrController:
    """A running controller: its `address`, a client of its control port, and the process."""

    address: str
    control: ControlClient
    process: ControllerProcess


def pytest_configure(config: pytest.Config) -> None:
    """Registers the marker."""
    config.addinivalue_line("markers", _MARKER)


@pytest.fixture
def start_ur_controller() -> Iterator[Callable[..., UrController]]:
    """A function that starts a controller with fields of ControllerOptions; all controllers end with the test."""
    with ExitStack() as stack:

        def start(**options: Any) -> UrController:
            # The ports are fixed, so each controller has an address of its own: one of 15 million, not 127.0.x.x.
            a, b, c = (random.randint(low, 254) for low in (16, 0, 1))  # noqa: S311
            process = stack.enter_context(ControllerProcess(f"127.{a}.{b}.{c}", ControllerOptions(**options)))
            return UrController(process.address, stack.enter_context(process.control()), process)

        yield start


@pytest.fixture
def ur_controller(request: pytest.FixtureRequest, start_ur_controller: Callable[..., UrController]) -> UrController:
    """One controller, started with the options of the test's marker `ur_controller`."""
    marker = request.node.get_closest_marker("ur_controller")
    return start_ur_controller(**(marker.kwargs if marker else {}))
