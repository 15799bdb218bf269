"""Probe of an arm's address: no listener, silent ports, foreign hosts."""

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import pytest

from acquisition.devices.ur import dashboard
from acquisition.models.errors import ErrorCode, RigError

ABSENT, SILENT, FOREIGN = "127.0.3.1", "127.0.3.2", "127.0.3.3"


@contextmanager
def listening(address: str, *ports: int) -> Iterator[None]:
    """Ports that accept connections and say nothing."""
    with ExitStack() as stack:
        for port in ports:
            server = stack.enter_context(socket.socket())
            server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            server.bind((address, port))
            server.listen()
        yield


def test_probe_without_listener_raises_arm_unreachable() -> None:
    started = time.monotonic()
    with pytest.raises(RigError) as caught:
        dashboard.probe(ABSENT)
    assert caught.value.code == ErrorCode.ARM_UNREACHABLE
    assert caught.value.context["port"] == dashboard.DASHBOARD_PORT
    assert time.monotonic() - started < 30.0


def test_probe_silent_port_raises_arm_unreachable() -> None:
    started = time.monotonic()
    with listening(SILENT, 29999, 30003, 30004), pytest.raises(RigError, match="does not answer in time") as caught:
        dashboard.probe(SILENT)
    assert caught.value.code == ErrorCode.ARM_UNREACHABLE
    assert time.monotonic() - started < 30.0
    assert 4 * dashboard.PROBE_S < 3.0, "the greeting, two connections and a reply, each within PROBE_S"


def test_probe_silent_rtde_port_raises_arm_unreachable() -> None:
    with listening(SILENT, 30003, 30004), socket.socket() as server:
        server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        server.bind((SILENT, dashboard.DASHBOARD_PORT))
        server.listen()

        def greet() -> None:
            connection, _ = server.accept()
            with connection:
                connection.sendall(b"Connected: Universal Robots Dashboard Server\n")

        thread = threading.Thread(target=greet)
        thread.start()
        with pytest.raises(RigError) as caught:
            dashboard.probe(SILENT)
        thread.join()
    assert caught.value.code == ErrorCode.ARM_UNREACHABLE
    assert caught.value.context["port"] == dashboard.RTDE_PORT


def test_ask_without_listener_raises_arm_unreachable() -> None:
    with pytest.raises(RigError) as caught:
        dashboard.ask(ABSENT, "robotmode")
    assert caught.value.code == ErrorCode.ARM_UNREACHABLE


@pytest.mark.parametrize("address", ["192.168.56.101", "arm.example", "10.0.0.1"])
def test_refuse_foreign_in_tests_refuses_other_hosts(address: str) -> None:
    with pytest.raises(RigError, match="loopback") as caught:
        dashboard.probe(address)
    assert caught.value.code == ErrorCode.ARM_UNREACHABLE
    with pytest.raises(PermissionError), socket.socket() as plain:
        plain.connect((address, 80))


def test_refuse_foreign_localhost_is_accepted() -> None:
    dashboard.refuse_foreign("localhost")
    dashboard.refuse_foreign("127.0.3.3")


def test_refuse_foreign_outside_tests_accepts_other_hosts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("LIGHTPOSE_LOOPBACK_ONLY")
    dashboard.refuse_foreign("192.168.56.101")
