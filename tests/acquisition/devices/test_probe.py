"""Probe of an arm's address: no listener, silent ports, another software than the cell file's, foreign hosts."""

import socket
import struct
import threading
import time
from collections.abc import Generator
from contextlib import ExitStack, contextmanager

import pytest

from acquisition.devices.ur import dashboard, probe, tcp
from acquisition.devices.ur.dashboard import PolyScope5
from acquisition.models.errors import ErrorCode, RigError
from tests.acquisition.devices.arm_scenes import arm_config

ABSENT, SILENT = "127.0.3.1", "127.0.3.2"
V5, X, OLD_X = (5, 11, 1, 108318), (10, 14, 0, 0), (10, 8, 0, 0)


def probed(address: str, polyscope: str = "5") -> RigError:
    """What the probe of an arm that is not as it should be raises."""
    config = arm_config(address, polyscope)
    with pytest.raises(RigError) as caught:
        probe.probe(config, probe.software_of(config))
    return caught.value


@contextmanager
def listening(address: str, *ports: int) -> Generator[None]:
    """Ports that accept connections and say nothing."""
    with ExitStack() as stack:
        for port in ports:
            stack.enter_context(server_at(address, port))
        yield


def server_at(address: str, port: int) -> socket.socket:
    server = socket.socket()
    server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    server.bind((address, port))
    server.listen()
    return server


@contextmanager
def rtde_of(version: tuple[int, int, int, int]) -> Generator[None]:
    """An RTDE port that names this version, once, and an open script port; no others."""
    with listening(SILENT, probe.SCRIPT_PORT), server_at(SILENT, probe.RTDE_PORT) as server:

        def reply() -> None:
            connection, _ = server.accept()
            with connection:
                connection.recv(100)
                connection.sendall(struct.pack(">HBB", 4, ord("V"), 1))
                connection.recv(100)
                connection.sendall(struct.pack(">HB4I", 19, ord("v"), *version))

        thread = threading.Thread(target=reply)
        thread.start()
        yield
        thread.join()


def test_probe_without_listener_raises_arm_unreachable() -> None:
    started = time.monotonic()
    error = probed(ABSENT)
    assert error.code == ErrorCode.ARM_UNREACHABLE
    assert error.context["port"] == probe.RTDE_PORT
    assert time.monotonic() - started < 30.0


def test_probe_silent_port_raises_arm_unreachable() -> None:
    started = time.monotonic()
    with listening(SILENT, 29999, 30003, 30004):
        error = probed(SILENT)
    assert error.code == ErrorCode.ARM_UNREACHABLE
    assert "does not answer in time" in error.detail
    assert time.monotonic() - started < 30.0
    assert 4 * tcp.PROBE_S < 3.0, "RTDE, the script port, and the software's two, each within PROBE_S"


@pytest.mark.parametrize(
    ("version", "polyscope", "port"), [(V5, "5", dashboard.DASHBOARD_PORT), (X, "x", 30001)], ids=["5", "x"]
)
def test_probe_software_without_its_port_is_unreachable(
    version: tuple[int, int, int, int], polyscope: str, port: int
) -> None:
    with rtde_of(version):
        error = probed(SILENT, polyscope)
    assert error.code == ErrorCode.ARM_UNREACHABLE
    assert error.context["port"] == port


@pytest.mark.parametrize(
    ("version", "polyscope", "words"),
    [
        (X, "5", 'runs PolyScope X (10.14.0), the cell file says PolyScope 5: set `polyscope = "x"` in [arm]'),
        (V5, "x", 'runs PolyScope 5 (5.11.1), the cell file says PolyScope X: set `polyscope = "5"` in [arm]'),
        (OLD_X, "x", "update it to 10.12 or later"),
    ],
    ids=["x as 5", "5 as x", "too old"],
)
def test_probe_other_software_says_what_to_do(version: tuple[int, int, int, int], polyscope: str, words: str) -> None:
    with rtde_of(version):
        error = probed(SILENT, polyscope)
    assert error.code == ErrorCode.CONFIG_INVALID
    assert words in error.detail


def test_state_without_listener_raises_arm_unreachable() -> None:
    with pytest.raises(RigError) as caught:
        PolyScope5(ABSENT).state()
    assert caught.value.code == ErrorCode.ARM_UNREACHABLE


@pytest.mark.parametrize("address", ["192.168.56.101", "arm.example", "10.0.0.1"])
def test_refuse_foreign_in_tests_refuses_other_hosts(address: str) -> None:
    error = probed(address)
    assert error.code == ErrorCode.ARM_UNREACHABLE
    assert "loopback" in error.detail
    with pytest.raises(PermissionError), socket.socket() as plain:
        plain.connect((address, 80))


def test_refuse_foreign_localhost_is_accepted() -> None:
    tcp.refuse_foreign("localhost")
    tcp.refuse_foreign("127.0.3.3")


def test_refuse_foreign_outside_tests_accepts_other_hosts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("LIGHTPOSE_LOOPBACK_ONLY")
    tcp.refuse_foreign("192.168.56.101")
