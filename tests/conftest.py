"""Nothing in this suite may reach a real arm: this process and every one it starts are held to loopback."""

import ipaddress
import os
import socket
from typing import Any

import pytest

os.environ["LIGHTPOSE_LOOPBACK_ONLY"] = "1"  # inherited by driver processes, which refuse any other address


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
