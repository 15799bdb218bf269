"""Fixtures: one cell for a module's tests that leave it as they found it, a controller of its own for the others."""

from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from hardware_sim.controller.process import ControllerProcess
from tests.hardware_sim.controller.cells import Cell, at_home, connect, start, wait_until


@pytest.fixture(scope="module")
def shared_cell() -> Iterator[Cell]:
    """A controller with the real library's clients: constructing and disconnecting them takes two seconds, but idle
    they take 0.15 of a core, so that they end with the module."""
    with ExitStack() as stack:
        yield connect(stack)


@pytest.fixture
def cell(shared_cell: Cell) -> Cell:
    """The shared cell, its program running, the arm at home."""
    at_home(shared_cell)
    return shared_cell


@pytest.fixture
def cell_cleared_afterwards(shared_cell: Cell) -> Iterator[Cell]:
    """The shared cell at home, for tests that order faults: afterwards every fault and the program are taken away."""
    at_home(shared_cell)
    yield shared_cell
    with shared_cell.process.control() as control:
        control.fault("clear")
        control.fault("program_stop")
    wait_until(lambda: not shared_cell.control.isProgramRunning())
    wait_until(lambda: shared_cell.receive.getActualQd() == [0.0] * 6)


@pytest.fixture
def controller() -> Iterator[ControllerProcess]:
    """A controller without clients."""
    with start() as process:
        yield process
