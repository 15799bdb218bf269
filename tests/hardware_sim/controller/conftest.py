"""Fixtures: one cell for all tests that leave it as they found it, a controller of its own for those that do not."""

from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from hardware_sim.controller.process import ControllerProcess
from tests.hardware_sim.controller.cells import Cell, at_home, connect, start


@pytest.fixture(scope="session")
def shared_cell() -> Iterator[Cell]:
    """A controller with the real library's clients: constructing and disconnecting them takes seconds."""
    with ExitStack() as stack:
        yield connect(stack)


@pytest.fixture
def cell(shared_cell: Cell) -> Cell:
    """The shared cell, its program running, the arm at home."""
    at_home(shared_cell)
    return shared_cell


@pytest.fixture
def controller() -> Iterator[ControllerProcess]:
    """A controller without clients."""
    with start() as process:
        yield process
