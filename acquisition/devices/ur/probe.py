"""Probes a controller before any call that could hang: do its ports answer, and is it what the cell file states?

ur-rtde's constructors never return if a port is open but silent. RTDE is asked first: every software has it, and it
reports the version, which decides whether the dashboard or the Robot API is to be expected.
"""

import struct
import time

from acquisition.devices.ur import tcp
from acquisition.devices.ur.dashboard import PolyScope5
from acquisition.devices.ur.polyscope_x import PolyScopeX
from acquisition.devices.ur.software import Software, Version
from acquisition.models.cell_config import ArmConfig
from acquisition.models.errors import ErrorCode, RigError

SCRIPT_PORT = 30003
RTDE_PORT = 30004

_PROTOCOL = struct.pack(">HBH", 5, ord("V"), 2)
_VERSION = struct.pack(">HB", 3, ord("v"))
_VERSION_REPLY = struct.Struct(">HB4I")


def software_of(config: ArmConfig) -> Software:
    """Returns the software that the cell file names."""
    if config.polyscope == "x":
        return PolyScopeX(config.address, config.robot_api_port, config.stop_deceleration_rad_s2)
    return PolyScope5(config.address)


def probe(config: ArmConfig, software: Software) -> None:
    """Checks version and ports, each within `tcp.PROBE_S`.

    Raises RigError arm.unreachable unless all ports are open and answer, config.invalid if the controller runs another
    software than `arm.polyscope` states.
    """
    address, port = config.address, RTDE_PORT
    try:
        version = _version(address)
        port = SCRIPT_PORT
        tcp.connect(address, port, tcp.PROBE_S).close()
    except OSError as error:
        raise tcp.unreachable(address, port, error) from error
    if version.polyscope != config.polyscope:
        names = {"5": "PolyScope 5", "x": "PolyScope X"}
        raise RigError(
            ErrorCode.CONFIG_INVALID,
            f"The controller at {address} runs {names[version.polyscope]} ({version}), the cell file says "
            f'{names[config.polyscope]}: set `polyscope = "{version.polyscope}"` in [arm].',
            address=address,
            polyscope=version.polyscope,
        )
    software.probe(version)


def _version(address: str) -> Version:
    """Returns the software's version by RTDE, protocol 2. Raises OSError."""
    deadline = time.monotonic() + tcp.PROBE_S
    with tcp.connect(address, RTDE_PORT, tcp.PROBE_S) as connection:
        connection.sendall(_PROTOCOL)
        reply = b""
        while len(reply) < 4:
            reply += tcp.receive(connection, deadline)
        if reply[2:4] != b"V\x01":
            raise ConnectionError("does not speak RTDE version 2")
        connection.sendall(_VERSION)
        reply = b""
        while len(reply) < _VERSION_REPLY.size:
            reply += tcp.receive(connection, deadline)
    _, kind, *numbers = _VERSION_REPLY.unpack_from(reply)
    if kind != ord("v"):
        raise ConnectionError("does not report its version")
    return Version(*numbers)
