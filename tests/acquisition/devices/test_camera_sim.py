"""The simulated camera's client against the cell's camera server, and against faulty servers."""

import json
import math
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from acquisition.devices import StopToken
from acquisition.devices.camera_sim import SimCamera
from acquisition.models import cell_config
from acquisition.models.camera_config import SimCameraConfig
from acquisition.models.errors import ErrorCode, Halted, RigError
from hardware_sim.camera import CameraServer
from hardware_sim.shutter import CellState

CALIBRATION = cell_config.load_calibration(
    Path(__file__).parents[3] / "hardware_sim" / "cells" / "calibration.sim.json"
).model_copy(update={"width": 320, "height": 200})
HONEST = SimCameraConfig(address="127.0.3.10", timeout_s=60.0)
CROOKED = SimCameraConfig(address="127.0.3.11", timeout_s=60.0)
FRAME = np.arange(320 * 200, dtype=np.uint16).reshape(200, 320)


class Standing:
    """An arm at rest under a dark lamp."""

    def state(self) -> CellState:
        return CellState(
            joints=(0.0,) * 6, lamp_on=False, lamp_age_s=math.inf, speed_factor=1.0, clock_s=time.monotonic()
        )


def numbered(moments: object, exposure_s: float, attempt: int) -> npt.NDArray[np.uint16]:
    return FRAME + np.uint16(attempt)


@pytest.fixture(scope="module")
def camera() -> Iterator[SimCamera]:
    with CameraServer(HONEST, CALIBRATION, numbered, Standing()):
        yield SimCamera(HONEST)


@contextmanager
def answering(answer: Callable[[socket.socket], None], timeout_s: float = CROOKED.timeout_s) -> Iterator[SimCamera]:
    """A server that reads one request and then does what the test says."""
    with socket.socket() as server:
        server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        server.bind((CROOKED.address, CROOKED.port))
        server.listen()

        def serve() -> None:
            connection, _ = server.accept()
            with connection:
                connection.recv(4096)
                answer(connection)

        thread = threading.Thread(target=serve)
        thread.start()
        yield SimCamera(CROOKED.model_copy(update={"timeout_s": timeout_s}))
        thread.join()


def header(**changes: object) -> bytes:
    values = {"width": 4, "height": 2, "dtype": "<u2", "exposure_s": 0.01, "taken_at": 1.0} | changes
    return json.dumps(values).encode() + b"\n"


def test_sim_expose_returns_a_complete_frame(camera: SimCamera) -> None:
    camera.connect()
    before = time.time()
    frame = camera.expose(0.002, 3, StopToken())
    assert frame.pixels.dtype == np.uint16
    assert frame.pixels.flags.writeable
    np.testing.assert_array_equal(frame.pixels, FRAME + np.uint16(3))
    assert frame.exposure_s == 0.002
    assert before <= frame.taken_at <= time.time()
    camera.close()


def test_sim_expose_set_token_requests_no_frame(camera: SimCamera) -> None:
    stop = StopToken()
    stop.set()
    with pytest.raises(Halted):
        camera.expose(0.002, 0, stop)


def test_sim_expose_token_set_meanwhile_raises_halted(camera: SimCamera) -> None:
    stop = StopToken()
    threading.Timer(0.1, stop.set).start()
    with pytest.raises(Halted):
        camera.expose(1.0, 0, stop)
    frame = camera.expose(0.001, 7, StopToken())  # the frame given up is not taken for this one
    np.testing.assert_array_equal(frame.pixels, FRAME + np.uint16(7))


@pytest.mark.parametrize("exposure_s", [0.0, -1.0, 5.0, math.nan, math.inf])
def test_sim_expose_beyond_the_limits_is_refused(camera: SimCamera, exposure_s: float) -> None:
    with pytest.raises(RigError) as caught:
        camera.expose(exposure_s, 0, StopToken())
    assert caught.value.code == ErrorCode.REQUEST_INVALID


def test_sim_expose_refusal_contains_the_cameras_message(camera: SimCamera) -> None:
    with pytest.raises(RigError, match="attempt must be") as caught:
        camera.expose(0.002, -1, StopToken())
    assert caught.value.code == ErrorCode.CAMERA_TIMEOUT


def test_sim_connect_without_listener_raises_unreachable() -> None:
    absent = SimCamera(SimCameraConfig(address="127.0.3.12"))
    started = time.monotonic()
    with pytest.raises(RigError) as caught:
        absent.connect()
    assert caught.value.code == ErrorCode.CAMERA_UNREACHABLE
    with pytest.raises(RigError) as caught:
        absent.expose(0.01, 0, StopToken())
    assert caught.value.code == ErrorCode.CAMERA_UNREACHABLE
    assert time.monotonic() - started < 30.0


def test_sim_camera_silent_server_times_out() -> None:
    ending = threading.Event()
    with answering(lambda connection: ending.wait() and None, timeout_s=0.3) as camera:
        with pytest.raises(RigError) as caught:
            camera.connect()
        ending.set()
    assert caught.value.code == ErrorCode.CAMERA_UNREACHABLE
    ending.clear()
    with answering(lambda connection: ending.wait() and None, timeout_s=0.3) as camera:
        with pytest.raises(RigError) as caught:
            camera.expose(0.01, 0, StopToken())
        ending.set()
    assert caught.value.code == ErrorCode.CAMERA_TIMEOUT


@pytest.mark.parametrize(
    ("answer", "code"),
    [
        (b"HTTP/1.1 400 Bad Request\r\n\r\n", ErrorCode.CAMERA_UNREACHABLE),
        (b"[1, 2]\n", ErrorCode.CAMERA_UNREACHABLE),
        (header(dtype=">u2"), ErrorCode.CAMERA_UNREACHABLE),
        (header(width=-4), ErrorCode.CAMERA_UNREACHABLE),
        (header(height=10**9), ErrorCode.CAMERA_UNREACHABLE),
        (header(taken_at=None), ErrorCode.CAMERA_UNREACHABLE),
        (header() + b"\0" * 15, ErrorCode.DEVICE_DISCONNECTED),
        (header() + b"\0" * 17, ErrorCode.DEVICE_DISCONNECTED),
        (b"", ErrorCode.DEVICE_DISCONNECTED),
        (b'{"error": "no light"}\n', ErrorCode.CAMERA_TIMEOUT),
    ],
)
def test_sim_camera_malformed_reply_raises_with_reason(answer: bytes, code: ErrorCode) -> None:
    with answering(lambda connection: connection.sendall(answer)) as camera, pytest.raises(RigError) as caught:
        camera.expose(0.01, 0, StopToken())
    assert caught.value.code == code
