"""Keeps the suite away from real arms: this process and its children connect to loopback only.

Tests of real processes over real sockets depend on a clock that a busy machine does not keep. One that fails is run
once more, and the summary names it. Tests without a clock, and long ones, are not repeated.
"""

import gc
import ipaddress
import itertools
import os
import socket
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

# The same examples in every run, without a time limit; `--hypothesis-profile=default` draws others.
settings.register_profile("suite", deadline=None, derandomize=True)
settings.load_profile("suite")

TESTS = Path(__file__).parent
NO_CLOCK = tuple(TESTS / "acquisition" / name for name in ("calibrate", "normals", "plan", "waypoints"))
COMPUTING = (*NO_CLOCK, TESTS / "path_traced", TESTS / "unseen")

os.environ["LIGHTPOSE_LOOPBACK_ONLY"] = "1"  # inherited by driver processes, which refuse any other address

if "PYTEST_XDIST_WORKER" in os.environ:
    # Workers fill the cores, so small kernels whose threads wait for one another take several times as long.
    for name in ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")

# Modules and tests stay until the end. Searching them for garbage takes a fifth of collection's time, and some of each
# test's.
gc.disable()


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Excludes the objects made by collection from the search for garbage."""
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Lets tests of the default suite that depend on a clock run a second time, and mixes those that compute with those
    that wait for an arm: of either alone, the workers would keep each other waiting, or the cores idle."""
    for item in items:
        if item.get_closest_marker("long") is None and not any(map(item.path.is_relative_to, NO_CLOCK)):
            item.add_marker(pytest.mark.flaky(reruns=1))
    if "PYTEST_XDIST_WORKER" in os.environ:
        items[:] = mixed(items)


def mixed(items: list[pytest.Item]) -> list[pytest.Item]:
    """Returns the tests with files of `COMPUTING` spread evenly among the others; each file's tests stay together."""
    files: dict[Path, list[pytest.Item]] = {}
    for item in items:
        files.setdefault(item.path, []).append(item)
    placed: list[tuple[float, list[pytest.Item]]] = []
    for computing in (True, False):
        ours = [tests for path, tests in files.items() if any(map(path.is_relative_to, COMPUTING)) is computing]
        before = itertools.accumulate(map(len, ours), initial=0)
        count = sum(map(len, ours))
        placed += [(number / count, tests) for number, tests in zip(before, ours, strict=False)]
    return [item for _, tests in sorted(placed, key=lambda one: one[0]) for item in tests]


def refuse_foreign_address(address: Any) -> None:
    """Raises PermissionError for an Internet address that is not on loopback."""
    if not isinstance(address, tuple) or not address:
        return  # a Unix socket
    host = str(address[0])
    if host == "localhost":
        return
    try:
        allowed = ipaddress.ip_address(host).is_loopback
    except ValueError:
        allowed = False
    if not allowed:
        raise PermissionError(f"tests connect to loopback only, not to {address}")


@pytest.fixture(autouse=True)
def loopback_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sockets of this process connect to loopback only."""
    connect, connect_ex = socket.socket.connect, socket.socket.connect_ex

    def guarded_connect(self: socket.socket, address: Any) -> None:
        refuse_foreign_address(address)
        connect(self, address)

    def guarded_connect_ex(self: socket.socket, address: Any) -> int:
        refuse_foreign_address(address)
        return connect_ex(self, address)

    monkeypatch.setattr(socket.socket, "connect", guarded_connect)
    monkeypatch.setattr(socket.socket, "connect_ex", guarded_connect_ex)
