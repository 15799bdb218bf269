"""The second halt path by itself: it stops through its connection whatever else the process has open or gets wrong."""

import os
import resource
import socket
import threading
import time
from collections.abc import Callable, Generator

import pytest

from acquisition.devices.ur.program_stop import ProgramStop

SELECT_LIMIT = 1024
"""Descriptors from here on are beyond what `select` can watch."""


class Connection:
    """A real connection of a pair of sockets; what it is told is counted by its software."""

    def __init__(self, software: "StandIn") -> None:
        self.socket, self._other = socket.socketpair()
        self._software = software

    def stop(self) -> str:
        if self._software.failures:
            raise self._software.failures.pop()
        self._software.stops.release()
        return "Stopped"

    def read_unasked(self) -> None:
        raise OSError("has ended")

    def close(self) -> None:
        self.socket.close()
        self._other.close()


class StandIn:
    """A controller's software that takes stops, after the failures that a test wants."""

    stop_path = "the stand-in"

    def __init__(self) -> None:
        self.stops = threading.Semaphore(0)
        self.failures: list[Exception] = []

    def open_stop(self, timeout_s: float) -> Connection:
        return Connection(self)


@pytest.fixture
def software() -> StandIn:
    return StandIn()


@pytest.fixture
def path(software: StandIn) -> Generator[ProgramStop]:
    """The path beside a driver that accepts no halt."""
    made = ProgramStop(software, lambda: (False, False))  # pyright: ignore[reportArgumentType]
    yield made
    made.close()


@pytest.fixture
def many_descriptors() -> Generator[None]:
    """As many open as a service of many clients has: the next ones are beyond `SELECT_LIMIT`."""
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(4 * SELECT_LIMIT, before[1]), before[1]))
    held = [os.dup(0) for _ in range(SELECT_LIMIT)]
    yield
    for one in held:
        os.close(one)
    resource.setrlimit(resource.RLIMIT_NOFILE, before)


def test_halt_is_carried_out_with_more_descriptors_than_select_knows(
    many_descriptors: None, path: ProgramStop, software: StandIn
) -> None:
    path.watch(os.getpid())
    assert not software.stops.acquire(timeout=0.5)  # a path that cannot watch them fails, and stops at once
    path.notify_halt()
    assert software.stops.acquire(timeout=60)


@pytest.mark.parametrize("cause", [ProgramStop.notify_halt, ProgramStop.stop_at_once])
def test_stop_whose_connection_fails_in_any_way_is_sent_on_a_new_one(
    cause: Callable[[ProgramStop], None], path: ProgramStop, software: StandIn
) -> None:
    software.failures = [OSError("has ended")]
    cause(path)
    assert software.stops.acquire(timeout=60)
    software.failures = [ValueError("of a kind that nobody thought of")]
    cause(path)
    assert software.stops.acquire(timeout=60)


def test_path_that_has_failed_twice_stops_the_next_time(path: ProgramStop, software: StandIn) -> None:
    software.failures = [ValueError("again"), ValueError("of a kind that nobody thought of")]
    path.stop_at_once()
    deadline = time.monotonic() + 60
    while software.failures:
        assert time.monotonic() < deadline
        time.sleep(0.01)
    path.stop_at_once()
    assert software.stops.acquire(timeout=60)
