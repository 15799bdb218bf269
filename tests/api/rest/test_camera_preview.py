"""The camera preview: exposures while the rig is free, the session's frames while held; viewers are independent."""

import json
import socket
import threading
import time
from collections.abc import Callable, Generator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import cv2
import httpx
import numpy as np
import pytest

from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.recipe import Recipe
from acquisition.models.shot import FrameQuality, Shot, ShotKey
from acquisition.session_state import Trigger
from acquisition.store.folder import write_frame
from api.rest import camera_preview, keys, preview_figures
from api.rest.image_encoding import jpeg
from api.rest.keys import Role
from api.rest.preview_figures import PreviewFigures, measured

CAMERA = "127.0.15.1"
SIDE = 64


INFO = {"width": SIDE, "height": SIDE, "bits": 12, "min_exposure_s": 1e-4, "max_exposure_s": 1.0}
"""What the camera says of itself."""


class PlainCamera:
    """The camera port's protocol with a picture that is bright to the right, linear in exposure time."""

    def __init__(self) -> None:
        self.exposures: list[float] = []
        self.dead = False
        self._socket = socket.create_server((CAMERA, 30100))
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def close(self) -> None:
        self._socket.shutdown(socket.SHUT_RDWR)  # ends the wait for a connection
        self._socket.close()
        self._thread.join()

    def _serve(self) -> None:
        while True:
            try:
                connection, _ = self._socket.accept()
            except OSError:
                return
            with connection:
                request = json.loads(connection.makefile().readline())
                if self.dead:
                    connection.sendall(b'{"error": "the shutter sticks"}\n')
                    continue
                if "exposure_s" not in request:
                    connection.sendall(json.dumps(INFO).encode() + b"\n")
                    continue
                self.exposures.append(request["exposure_s"])
                row = 64 + 20_000 * request["exposure_s"] * np.arange(SIDE) / SIDE
                pixels = np.tile(np.clip(row, 0, 4095), (SIDE, 1)).astype("<u2")
                header = {"width": SIDE, "height": SIDE, "dtype": "<u2", "taken_at": time.time(), **request}
                connection.sendall(json.dumps(header).encode() + b"\n" + pixels.tobytes())


@pytest.fixture
def camera() -> Generator[PlainCamera]:
    made = PlainCamera()
    yield made
    made.close()


def decoded(content: bytes) -> Any:
    return cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)


def held(service: Any) -> str:
    """A session that holds the rig, by its journal; nobody runs it."""
    made = service.client.create(Recipe())
    service.service.store.journal.trigger(made.id, Trigger.START, "test")
    return made.id


def take(service: Any, session_id: str, number: int, level: int) -> None:
    """Enters a frame of one grey."""
    frame = write_frame(
        service.service.store.folder(session_id),
        f"passes/0/shots/{number}.tiff",
        np.full((SIDE, 2 * SIDE), level, np.uint16),
    )
    shot = Shot(
        key=ShotKey(pass_number=0, number=number),
        kind="light",
        frame=frame,
        exposure_s=0.1,
        light_number=number,
        taken_at=time.time(),
        quality=FrameQuality(saturated=0.0, bright_level=0.5, accepted=True),
    )
    service.service.store.journal.add_shot(session_id, shot)


class Viewer:
    """Reads the parts of an MJPEG stream."""

    def __init__(self, answer: httpx.Response) -> None:
        self.parts = answer.iter_bytes()
        self._kept = b""

    def picture(self) -> Any:
        """The next picture."""
        while True:
            head, separator, rest = self._kept.partition(b"\r\n\r\n")
            size = int(head.rpartition(b"Content-Length: ")[2]) if separator else 0
            if separator and len(rest) >= size:
                self._kept = rest[size:]
                return decoded(rest[:size])
            self._kept += next(self.parts)


def test_preview_exposure_follows_the_scene(
    camera: PlainCamera, start: Callable[..., AbstractContextManager[Any]]
) -> None:
    with start(address=CAMERA) as service:
        answer = service.http.get("/v1/rig/preview.jpg")
        assert answer.headers["content-type"] == "image/jpeg"
        assert answer.headers["cache-control"] == "no-store"
        picture = decoded(answer.content)
        assert picture.shape == (SIDE, SIDE)
        assert picture[:, -1].mean() > 230
        assert picture[:, 0].mean() < 30
        for _ in range(3):
            time.sleep(0.25)
            service.http.get("/v1/rig/preview.jpg")

    levels = [20_000 * exposure_s / 4031 for exposure_s in camera.exposures]
    assert levels[-1] == pytest.approx(0.5, rel=0.05)


def test_preview_absent_camera_is_a_problem(shared: Any) -> None:
    for path in ("/v1/rig/preview.jpg", "/v1/rig/preview.mjpeg"):
        answer = shared.http.get(path)
        assert answer.status_code == 503
        assert answer.json()["code"] == ErrorCode.CAMERA_UNREACHABLE


def test_preview_figures_are_those_of_frame_shown(
    camera: PlainCamera, start: Callable[..., AbstractContextManager[Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(camera_preview, "PERIOD_S", 60.0)  # one frame for all that follows
    with start(address=CAMERA) as service:
        picture = service.http.get("/v1/rig/preview.jpg")
        overlay = service.http.get("/v1/rig/preview/clipping.png")
        figures = PreviewFigures.model_validate_json(service.http.get("/v1/rig/preview/figures").content)
        sensor = service.service.calibration.sensor

    assert picture.headers["x-frame-number"] == overlay.headers["x-frame-number"] == str(figures.frame) == "1"
    row = np.clip(64 + 20_000 * camera.exposures[0] * np.arange(SIDE) / SIDE, 0, 4095).astype("<u2")
    assert len(camera.exposures) == 1
    assert figures.exposure_s == camera.exposures[0]
    assert (figures.width_px, figures.height_px, figures.area) == (SIDE, SIDE, "frame")
    assert sum(figures.histogram) == SIDE * SIDE
    assert figures.histogram[0] == SIDE * np.count_nonzero(row < figures.bin_width_dn)
    black = row <= sensor.black_level_dn + 3 * sensor.read_noise_e / sensor.gain_e_per_dn
    assert figures.black == np.mean(black)
    assert figures.saturated == np.mean(row == 4095) == 0
    assert figures.bright_level == pytest.approx(
        (np.percentile(row, 99.5) - sensor.black_level_dn) / sensor.full_scale_dn, abs=0.01
    )
    assert np.array_equal(decoded(overlay.content)[0, :, 3] > 0, black)


def test_preview_figures_in_session_are_of_its_last_frame(
    camera: PlainCamera, start: Callable[..., AbstractContextManager[Any]]
) -> None:
    with start(address=CAMERA) as service:
        session_id = held(service)
        take(service, session_id, 0, 4095)
        figures = PreviewFigures.model_validate_json(service.http.get("/v1/rig/preview/figures").content)
        overlay = decoded(service.http.get("/v1/rig/preview/clipping.png").content)
        again = service.http.get("/v1/rig/preview/figures").json()

    assert (figures.taken_at, figures.exposure_s, figures.focus) == (None, None, None)
    assert (figures.saturated, figures.black) == (1.0, 0.0)
    assert figures.histogram[-1] == 2 * SIDE * SIDE
    assert again["frame"] == figures.frame  # the same file is the same frame
    assert (overlay == preview_figures.RED).all()


def test_measured_focus_falls_with_blur_and_counts_keep_out(shared: Any) -> None:
    sensor, side = shared.service.calibration.sensor, 200
    texture = 1500.0 + 1000.0 * ((np.indices((side, side)) // 20).sum(axis=0) % 2)
    inside = np.zeros((side, side), np.bool_)
    inside[50:150, 50:150] = True

    def figures(width: float) -> PreviewFigures:
        pixels = cv2.GaussianBlur(texture, (0, 0), width)
        pixels[:20] = 4095
        return measured(pixels.astype(np.uint16), inside, sensor, frame=1, taken_at=None, exposure_s=None)

    scores = [figures(width).focus or 0.0 for width in (0.5, 1.2, 2.5)]

    assert scores[0] > scores[1] > scores[2]
    assert figures(1.0).saturated == 0.0
    assert sum(figures(1.0).histogram) == np.count_nonzero(inside)


def test_preview_many_viewers_share_one_exposure(
    camera: PlainCamera, start: Callable[..., AbstractContextManager[Any]]
) -> None:
    with start(address=CAMERA) as service:
        begun = time.monotonic()
        with (
            service.http.stream("GET", "/v1/rig/preview.mjpeg") as one,
            service.http.stream("GET", "/v1/rig/preview.mjpeg") as other,
        ):
            assert one.headers["content-type"] == "multipart/x-mixed-replace; boundary=picture"
            viewers = Viewer(one), Viewer(other)
            for _ in range(4):
                assert all(viewer.picture().shape == (SIDE, SIDE) for viewer in viewers)
            assert "lightpose_preview_viewers 2.0" in service.http.get("/metrics").text
        assert len(camera.exposures) <= (time.monotonic() - begun) / 0.2 + 2


def test_metrics_count_frames_of_preview(
    camera: PlainCamera, start: Callable[..., AbstractContextManager[Any]]
) -> None:
    with start(address=CAMERA) as service:
        assert 'lightpose_camera_frames_total{outcome="good"} 0.0' in service.http.get("/metrics").text
        service.http.get("/v1/rig/preview.jpg").raise_for_status()
        metrics = service.http.get("/metrics").text
    assert f'lightpose_camera_frames_total{{outcome="good"}} {len(camera.exposures)}.0' in metrics
    assert 'lightpose_camera_frames_total{outcome="retaken"} 0.0' in metrics


def test_preview_stalled_viewer_drops_images_and_delays_nobody(
    camera: PlainCamera, start: Callable[..., AbstractContextManager[Any]]
) -> None:
    with start(address=CAMERA) as service:
        host, port = service.url.removeprefix("http://").split(":")
        with socket.create_connection((host, int(port))) as stalled:
            stalled.sendall(f"GET /v1/rig/preview.mjpeg HTTP/1.1\r\nHost: {host}\r\n\r\n".encode())  # and never reads
            with service.http.stream("GET", "/v1/rig/preview.mjpeg") as answer:
                viewer = Viewer(answer)
                assert [viewer.picture().shape for _ in range(5)] == [(SIDE, SIDE)] * 5


def test_preview_during_session_shows_its_last_frame(
    camera: PlainCamera, start: Callable[..., AbstractContextManager[Any]]
) -> None:
    with start(address=CAMERA) as service:
        session_id = held(service)
        before = len(camera.exposures)
        early = service.http.get("/v1/rig/preview.jpg")
        assert (early.status_code, early.json()["holder"]) == (409, session_id)
        take(service, session_id, 0, 1000)
        time.sleep(0.25)  # a picture, or its refusal, is good for as long
        with service.http.stream("GET", "/v1/rig/preview.mjpeg") as answer:
            viewer = Viewer(answer)
            assert viewer.picture().shape == (SIDE, 2 * SIDE)
            take(service, session_id, 1, 2000)
            assert viewer.picture().shape == (SIDE, 2 * SIDE)
            assert len(camera.exposures) == before  # the session's frames are shown, none is taken
            service.service.store.journal.trigger(session_id, Trigger.FINISH, "runner")
            assert viewer.picture().shape == (SIDE, SIDE)  # the camera is free again
        assert len(camera.exposures) > before


def test_preview_stream_survives_camera_failure_ends_with_service(
    camera: PlainCamera, start: Callable[..., AbstractContextManager[Any]]
) -> None:
    with start(address=CAMERA) as service, service.http.stream("GET", "/v1/rig/preview.mjpeg") as answer:
        viewer = Viewer(answer)
        viewer.picture()
        camera.dead = True
        deadline = time.monotonic() + 60
        while (refused := service.http.get("/v1/rig/preview.jpg")).status_code == 200:  # a picture taken before
            assert time.monotonic() < deadline
            time.sleep(0.05)
        assert refused.json()["code"] == ErrorCode.CAMERA_TIMEOUT
        camera.dead = False
        viewer.picture()
        service.server.should_exit = True
        assert all(part is not None for part in viewer.parts)  # the stream ends, it does not break


def test_preview_yields_camera_to_session(own: Any) -> None:
    preview = own.service.runner.preview
    held(own)
    with pytest.raises(RigError) as refused:
        preview.take_frame(0.1)
    assert refused.value.code is ErrorCode.RIG_BUSY


def test_preview_with_ticket_is_allowed(
    tmp_path: Path, camera: PlainCamera, start: Callable[..., AbstractContextManager[Any]]
) -> None:
    secret = keys.add(keys.path_in(tmp_path / "data"), "lab", Role.VIEWER)
    with start(address=CAMERA) as service:
        assert service.http.get("/v1/rig/preview.jpg").status_code == 401
        ticket = service.http.post("/v1/tickets", headers={"Authorization": f"Bearer {secret}"}).json()["ticket"]
        with service.http.stream("GET", "/v1/rig/preview.mjpeg", params={"ticket": ticket}) as answer:
            assert Viewer(answer).picture().shape == (SIDE, SIDE)


def test_jpeg_large_frames_are_reduced_dark_ones_brightened(shared: Any) -> None:
    sensor = shared.service.calibration.sensor
    large = decoded(jpeg(np.full((1500, 3000), 2000, np.uint16), sensor))
    dim = np.full((20, 20), round(sensor.black_level_dn), np.uint16)
    dim[:, 10:] += 30

    assert large.shape == (640, 1280)
    dark = decoded(jpeg(dim, sensor))
    assert dark[:, -1].mean() > 80
    assert dark[:, 0].mean() < 10
