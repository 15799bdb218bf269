"""Fixtures: a controller process per test or per module, and the real library's clients on it."""

from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from hardware_sim.controller.process import ControllerProcess
from tests.hardware_sim.controller.cells import Cell, connect, start


@pytest.fixture(scope="module")
def shared_cell() -> Iterator[Cell]:
    """One cell for a module whose tests leave program and modes as they found them."""
    with ExitStack() as stack:
        yield connect(stack)


@pytest.fixture
def cell() -> Iterator[Cell]:
    """A cell for one test."""
    with ExitStack() as stack:
        yield connect(stack)


@pytest.fixture
def controller() -> Iterator[ControllerProcess]:
    """A controller without clients."""
    with start() as process:
        yield process
