"""Driver of the simulated cell's camera over its port: one TCP connection for each request.

A connection per request costs a fraction of a millisecond on loopback and leaves no state behind: a frame that was
given up can never be taken for the next one. Request: one JSON line. Reply: one JSON line, then for a frame width ×
height little-endian uint16 values, row 0 at the top. Each request for a frame has a number, which the reply repeats.
"""

import itertools
import json
import socket
import time
from dataclasses import dataclass
from typing import Any, NoReturn, cast

import numpy as np

from acquisition.devices import Frame, StopToken
from acquisition.models.camera import CameraCapabilities, CameraSettings
from acquisition.models.camera_config import SimCameraConfig
from acquisition.models.errors import ErrorCode, Halted, RigError

CONNECT_S = 1.0
INFO_S = 1.5  # with CONNECT_S it stays below the 3 s within which an absent camera is reported
POLL_S = 0.05  # within which a stop token is seen
_LONGEST_LINE = 65536
_LONGEST_SIDE = 16384


@dataclass(frozen=True)
class _Header:
    width: int
    height: int
    exposure_s: float
    taken_at: float
    number: int | None


class SimCamera:
    """A client of the simulated camera; see the Protocol `CameraDriver`."""

    def __init__(self, config: SimCameraConfig) -> None:
        self._config = config
        self._numbers = itertools.count()

    def connect(self) -> CameraCapabilities:
        """Asks the camera for its properties. Raises RigError camera.unreachable within 3 s."""
        never = StopToken()
        try:
            with self._request({"info": True}) as connection:
                line, _ = _read_line(connection, time.monotonic() + INFO_S, never)
        except OSError as error:
            self._raise_unreachable(error)
        answer = self._parse(line)
        try:
            return CameraCapabilities(
                name=f"simulated camera at {self._config.address}:{self._config.port}",
                width=int(answer["width"]),
                height=int(answer["height"]),
                bits=int(answer["bits"]),
                mosaic=answer.get("mosaic"),
                triggers=("software",),
                min_exposure_s=float(answer["min_exposure_s"]),
                max_exposure_s=float(answer["max_exposure_s"]),
                frame_numbers=True,
                chunk_exposure=True,
            )
        except (KeyError, TypeError, ValueError) as error:
            raise self._foreign(line) from error

    def expose(self, exposure_s: float, attempt: int, stop: StopToken) -> Frame:
        """Takes one frame.

        Raises RigError request.invalid for an exposure time beyond the cell file's limits, camera.unreachable,
        camera.timeout; Halted as soon as the token is set.
        """
        limits = self._config
        limits.require_exposure(exposure_s)
        if stop.is_set():
            raise Halted
        deadline = time.monotonic() + limits.timeout_s + exposure_s
        try:
            request = {"exposure_s": exposure_s, "attempt": attempt, "number": next(self._numbers)}
            connection = self._request(request)
        except OSError as error:
            self._raise_unreachable(error)
        try:
            with connection:
                line, rest = _read_line(connection, deadline, stop)
                header = self._header(self._parse(line))
                data = _read_pixels(connection, rest, 2 * header.width * header.height, deadline, stop)
        except TimeoutError as error:
            detail = f"The camera sent no complete frame within {limits.timeout_s:.0f} s after the exposure."
            raise RigError(ErrorCode.CAMERA_TIMEOUT, detail) from error
        except OSError as error:
            raise RigError(ErrorCode.DEVICE_DISCONNECTED, f"The link to the camera broke: {error}") from error
        pixels = np.frombuffer(data, dtype="<u2").astype(np.uint16).reshape(header.height, header.width)
        settings = CameraSettings(
            exposure_s=header.exposure_s, pixel_format="Mono16", width=header.width, height=header.height
        )
        return Frame(pixels, header.exposure_s, header.taken_at, header.number, settings)

    def restart(self) -> None:
        """Does nothing: nothing is under way between requests."""

    def close(self) -> None:
        """Does nothing: nothing is held between requests."""

    def _request(self, request: dict[str, Any]) -> socket.socket:
        connection = socket.create_connection((self._config.address, self._config.port), CONNECT_S)
        try:
            connection.sendall(json.dumps(request).encode() + b"\n")
        except OSError:
            connection.close()
            raise
        return connection

    def _parse(self, line: bytes) -> dict[str, Any]:
        try:
            reply = json.loads(line)
        except ValueError as error:
            raise self._foreign(line) from error
        if not isinstance(reply, dict):
            raise self._foreign(line)
        answer = cast(dict[str, Any], reply)
        if "error" in answer:
            raise RigError(ErrorCode.CAMERA_TIMEOUT, f"The camera took no frame: {answer['error']}")
        return answer

    def _header(self, answer: dict[str, Any]) -> _Header:
        try:
            number = answer.get("number")
            header = _Header(
                int(answer["width"]), int(answer["height"]), float(answer["exposure_s"]), float(answer["taken_at"]),
                None if number is None else int(number),
            )  # fmt: skip
            sound = (
                answer["dtype"] == "<u2" and 0 < header.width <= _LONGEST_SIDE and 0 < header.height <= _LONGEST_SIDE
            )
        except (KeyError, TypeError, ValueError) as error:
            raise self._foreign(json.dumps(answer).encode()) from error
        if not sound:
            raise self._foreign(json.dumps(answer).encode())
        return header

    def _foreign(self, line: bytes) -> RigError:
        return RigError(
            ErrorCode.CAMERA_UNREACHABLE,
            f"{self._config.address}:{self._config.port} is not the simulated camera's port: it sent {line[:80]!r}",
        )

    def _raise_unreachable(self, error: OSError) -> NoReturn:
        where = f"{self._config.address}:{self._config.port}"
        raise RigError(
            ErrorCode.CAMERA_UNREACHABLE, f"No camera answers at {where}: {error or 'time-out'}", address=where
        ) from error


def _read_line(connection: socket.socket, deadline: float, stop: StopToken) -> tuple[bytes, bytes]:
    """Returns one line without its end, and the bytes that came after it."""
    data = bytearray()
    while b"\n" not in data:
        if len(data) > _LONGEST_LINE:
            raise ConnectionError("sent no line end")
        data += _receive(connection, deadline, stop)
    line, _, rest = bytes(data).partition(b"\n")
    return line, rest


def _read_pixels(connection: socket.socket, start: bytes, size: int, deadline: float, stop: StopToken) -> bytes:
    data = bytearray(start)
    while len(data) < size:
        data += _receive(connection, deadline, stop)
    if len(data) > size:
        raise ConnectionError(f"sent {len(data)} bytes instead of {size}")
    return bytes(data)


def _receive(connection: socket.socket, deadline: float, stop: StopToken) -> bytes:
    """Returns the next bytes; checks the token every POLL_S. Raises TimeoutError, ConnectionError, Halted."""
    connection.settimeout(POLL_S)
    while True:
        if stop.is_set():
            raise Halted
        try:
            data = connection.recv(1 << 20)
        except TimeoutError:
            if time.monotonic() > deadline:
                raise
            continue
        if not data:
            raise ConnectionError("the connection was closed")
        return data
