import json
import socket
import threading
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from acquisition.models.camera_config import SimCameraConfig
from acquisition.models.errors import ErrorCode, RigError
from hardware_sim import nominal
from hardware_sim.camera import CameraServer
from hardware_sim.shutter import CellState, ExposureInterval

ADDRESS = "127.0.2.20"
PIXELS = 40


class Cell:
    """An arm at fixed joints, and a camera whose frames record the request they answer."""

    def __init__(self) -> None:
        self.lamp_on = True
        self.lost = False
        self.taking = 0
        self.most_at_once = 0

    def state(self) -> CellState:
        if self.lost:
            raise RigError(ErrorCode.DEVICE_DISCONNECTED, "the simulated controller is lost")
        return CellState((0.0,) * 6, self.lamp_on, 10.0, 10.0, time.monotonic())

    def frame(self, moments: list[ExposureInterval], exposure_s: float, attempt: int) -> np.ndarray:
        self.taking += 1
        self.most_at_once = max(self.most_at_once, self.taking)
        time.sleep(0.01)
        self.taking -= 1
        level = round(1e4 * exposure_s * moments[0].lamp_level) + attempt
        return np.arange(PIXELS * PIXELS, dtype=np.uint16).reshape(PIXELS, PIXELS) + np.uint16(level)


class Client:
    def __init__(self) -> None:
        self.socket = socket.create_connection((ADDRESS, 30100), 5)
        self.file = self.socket.makefile("rb")

    def send(self, data: bytes) -> dict[str, Any]:
        self.socket.sendall(data)
        return json.loads(self.file.readline())

    def ask(self, **request: Any) -> tuple[dict[str, Any], np.ndarray]:
        header = self.send(json.dumps(request).encode() + b"\n")
        count = header["width"] * header["height"]
        return header, np.frombuffer(self.file.read(2 * count), "<u2").reshape(header["height"], header["width"])

    def close(self) -> None:
        self.file.close()
        self.socket.close()


@pytest.fixture
def cell() -> Iterator[Cell]:
    cell = Cell()
    calibration = nominal.calibration(PIXELS)
    with CameraServer(SimCameraConfig(address=ADDRESS), calibration, cell.frame, cell):
        yield cell


@pytest.fixture
def client(cell: Cell) -> Iterator[Client]:
    client = Client()
    yield client
    client.close()


def test_camera_frame_follows_header(client: Client) -> None:
    before = time.time()
    header, pixels = client.ask(exposure_s=0.05, attempt=2)
    assert (header["width"], header["height"], header["dtype"]) == (PIXELS, PIXELS, "<u2")
    assert (header["exposure_s"], header["attempt"]) == (0.05, 2)
    assert before <= header["taken_at"] <= time.time()
    assert np.array_equal(pixels.ravel(), np.arange(PIXELS * PIXELS) + 502)


def test_camera_attempt_defaults_to_zero_and_lamp_shows(client: Client, cell: Cell) -> None:
    cell.lamp_on = False
    _, pixels = client.ask(exposure_s=0.05)
    assert pixels[0, 0] == 0


def test_camera_info_returns_size_and_limits(client: Client) -> None:
    info = client.send(b'{"info": true}\n')
    assert info == {
        "width": PIXELS,
        "height": PIXELS,
        "dtype": "<u2",
        "bits": 12,
        "min_exposure_s": 1e-4,
        "max_exposure_s": 1.0,
    }


@pytest.mark.parametrize(
    ("request_line", "says"),
    [
        (b"\n", "JSON"),
        (b"hello\n", "JSON"),
        (b"\xff\xfe\x00\n", "JSON"),
        (b"[" * 3000 + b"\n", "JSON"),
        (b"[1, 2]\n", "object"),
        (b"null\n", "object"),
        (b"{}\n", "exposure_s"),
        (b'{"exposure_s": NaN}\n', "finite"),
        (b'{"exposure_s": Infinity}\n', "finite"),
        (b'{"exposure_s": 1e999}\n', "finite"),
        (b'{"exposure_s": -0.1}\n', "between"),
        (b'{"exposure_s": 0}\n', "between"),
        (b'{"exposure_s": 3600}\n', "between"),
        (b'{"exposure_s": "0.1"}\n', "finite"),
        (b'{"exposure_s": true}\n', "finite"),
        (b'{"exposure_s": 0.1, "attempt": -1}\n', "attempt"),
        (b'{"exposure_s": 0.1, "attempt": 1.5}\n', "attempt"),
        (b'{"exposure_s": 0.1, "attempt": true}\n', "attempt"),
        (b'{"exposure_s": 0.1, "gain": 2}\n', "gain"),
        (b'{"truth": true}\n', "truth"),
        (b'{"info": true, "exposure_s": 0.1}\n', "info"),
    ],
)
def test_camera_invalid_request_is_named_and_connection_stays(client: Client, request_line: bytes, says: str) -> None:
    answer = client.send(request_line)
    assert list(answer) == ["error"]
    assert says in answer["error"]
    header, _ = client.ask(exposure_s=0.01)
    assert header["exposure_s"] == 0.01


def test_camera_endless_line_closes_connection(client: Client) -> None:
    answer = client.send(b"x" * 100_000)
    assert "bytes" in answer["error"]
    with pytest.raises((ConnectionError, json.JSONDecodeError)):
        client.send(b'{"info": true}\n')


def test_camera_client_hanging_up_harms_nobody(cell: Cell, client: Client) -> None:
    for _ in range(3):
        rude = Client()
        rude.socket.sendall(b'{"exposure_s": 0.05}\n')
        rude.close()
    header, _ = client.ask(exposure_s=0.02)
    assert header["exposure_s"] == 0.02


def test_camera_several_connections_are_served_in_turn(cell: Cell) -> None:
    clients = [Client() for _ in range(4)]
    result: dict[int, np.ndarray] = {}

    def photograph(number: int) -> None:
        result[number] = clients[number].ask(exposure_s=0.02, attempt=number)[1]

    threads = [threading.Thread(target=photograph, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(10)
    for client in clients:
        client.close()
    assert {number: int(pixels[0, 0]) for number, pixels in result.items()} == {k: 200 + k for k in range(4)}
    assert cell.most_at_once == 1


def test_camera_lost_controller_is_reported(cell: Cell, client: Client) -> None:
    cell.lost = True
    assert "lost" in client.send(b'{"exposure_s": 0.05}\n')["error"]
    cell.lost = False
    header, _ = client.ask(exposure_s=0.05)
    assert header["width"] == PIXELS
