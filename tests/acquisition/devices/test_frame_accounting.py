"""The account of frames: a simulated camera over its port, with faults of the camera and its link."""

import itertools
import json
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import get_args

import numpy as np
import numpy.typing as npt
import pytest

from acquisition.capture import camera_fit
from acquisition.devices import CameraFault, StopToken
from acquisition.devices.camera_sim import SimCamera
from acquisition.devices.frame_accounting import RETAKES, AccountedCamera
from acquisition.models.camera import FaultKind
from acquisition.models.camera_config import SimCameraConfig
from acquisition.models.errors import ErrorCode, Halted, RigError
from hardware_sim import nominal
from hardware_sim.camera import CameraServer
from hardware_sim.shutter import CellState
from tests.acquisition.devices.camera_return import expose_when_back

CONFIG = SimCameraConfig(address="127.0.3.20", min_exposure_s=1e-6, timeout_s=60.0, reconnect_s=60.0)
CALIBRATION = nominal.calibration(8)
NEVER = StopToken()


class Clocked:
    """An arm at rest under a lit lamp, whose clock advances by reading it."""

    def __init__(self) -> None:
        self._times = itertools.count()

    def state(self) -> CellState:
        return CellState((0.0,) * 6, lamp_on=True, lamp_age_s=10.0, speed_factor=10.0, clock_s=next(self._times) * 1e-3)


def labelled(moments: object, exposure_s: float, attempt: int) -> npt.NDArray[np.uint16]:
    """A frame whose pixels are the exposure time in µs."""
    return np.full((8, 8), round(exposure_s * 1e6), np.uint16)


@pytest.fixture
def server() -> Iterator[CameraServer]:
    with CameraServer(CONFIG, CALIBRATION, labelled, Clocked()) as serving:
        yield serving


@pytest.fixture
def camera(server: CameraServer) -> AccountedCamera:
    opened = AccountedCamera(SimCamera(CONFIG), CONFIG)
    opened.connect()
    opened.heard = []  # type: ignore[attr-defined]
    opened.listen(opened.heard.append)  # type: ignore[attr-defined]
    return opened


def order(kind: str, count: int = 1) -> dict[str, object]:
    with socket.create_connection((CONFIG.address, CONFIG.port), 60) as connection:
        connection.sendall(json.dumps({"fault": kind, "count": count}).encode() + b"\n")
        with connection.makefile("rb") as lines:
            answer: dict[str, object] = json.loads(lines.readline())
            return answer


def heard(camera: AccountedCamera) -> list[CameraFault]:
    return camera.heard  # type: ignore[attr-defined, no-any-return]


@pytest.mark.parametrize("kind", ["lost", "late", "doubled", "damaged", "settings"])
def test_camera_fault_is_told_and_frame_retaken(camera: AccountedCamera, kind: str) -> None:
    for exposure_s in (1e-5, 2e-5):
        camera.expose(exposure_s, 0, NEVER)
    order(kind)
    frame = camera.expose(3e-5, 0, NEVER)
    assert np.all(frame.pixels == 30)
    told = heard(camera)
    assert [(fault.kind, fault.retaken) for fault in told] == [(kind, True)]
    assert camera.counts == {"good": 3, kind: 1, "retaken": 1}
    assert camera.expose(1e-5, 0, NEVER).pixels[0, 0] == 10


def test_camera_fault_that_persists_is_raised(camera: AccountedCamera) -> None:
    order("lost", RETAKES + 1)
    with pytest.raises(RigError) as raised:
        camera.expose(1e-5, 0, NEVER)
    assert raised.value.code is ErrorCode.CAMERA_TIMEOUT
    assert camera.counts["lost"] == RETAKES + 1
    assert not heard(camera)[-1].retaken
    assert camera.expose(2e-5, 0, NEVER).pixels[0, 0] == 20


def test_camera_gone_is_taken_up_when_it_returns(camera: AccountedCamera, server: CameraServer) -> None:
    order("gone", 3600)
    with pytest.raises(RigError):
        camera.expose(1e-5, 0, NEVER)
    assert camera.is_gone
    threading.Timer(0.2, setattr, (server.faults, "_away_until", 0.0)).start()
    camera.take_up(NEVER)
    assert not camera.is_gone
    assert camera.expose(2e-5, 0, NEVER).pixels[0, 0] == 20
    assert [fault.kind for fault in heard(camera)] == ["gone", "returned"]


def test_camera_gone_for_good_ends_the_wait(server: CameraServer) -> None:
    config = CONFIG.model_copy(update={"reconnect_s": 0.0})
    camera = AccountedCamera(SimCamera(config), config)
    camera.connect()
    order("gone", 3600)
    with pytest.raises(RigError) as raised:
        camera.take_up(NEVER)
    assert raised.value.code is ErrorCode.CAMERA_UNREACHABLE
    stop = StopToken()
    stop.set()
    with pytest.raises(Halted):
        camera.take_up(stop)


def test_camera_settings_fingerprint_leaves_exposure_out(camera: AccountedCamera) -> None:
    frames = [camera.expose(exposure_s, 0, NEVER) for exposure_s in (1e-5, 2e-5)]
    settings = [frame.settings for frame in frames]
    assert settings[0] is not None
    assert settings[1] is not None
    assert settings[0].fingerprint == settings[1].fingerprint
    other = settings[0].model_copy(update={"gain": 3.0})
    assert other.fingerprint != settings[0].fingerprint
    assert settings[0].differences(other) == ["gain: None → 3.0"]
    assert frames[1].number == (frames[0].number or 0) + 1


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"width": 9}, "9 × 8 pixels"),
        ({"bits": 16}, "16 bits"),
        ({"max_exposure_s": 0.5}, "exposure times"),
        ({"min_exposure_s": 0.01}, "exposure times"),
    ],
)
def test_camera_fit_names_what_differs(camera: AccountedCamera, change: dict[str, object], named: str) -> None:
    known = camera.capabilities
    assert known is not None
    assert camera_fit.require_fit(known, CALIBRATION, CONFIG) == []
    with pytest.raises(RigError, match=named) as raised:
        camera_fit.require_fit(known.model_copy(update=change), CALIBRATION, CONFIG)
    assert raised.value.code is ErrorCode.CONFIG_INVALID


def test_camera_fit_warns_of_eight_bits_with_the_loss(camera: AccountedCamera) -> None:
    known = camera.capabilities
    assert known is not None
    coarse = CALIBRATION.model_copy(update={"sensor": CALIBRATION.sensor.model_copy(update={"bits": 8})})
    (warning,) = camera_fit.require_fit(known.model_copy(update={"bits": 8}), coarse, CONFIG)
    assert "2.3 % (1 σ)" in warning


@contextmanager
def returning(server: CameraServer) -> Iterator[None]:
    """Ends absences soon after they have begun."""
    ending = threading.Event()

    def mend() -> None:
        while not ending.wait(0.05):
            server.faults._away_until = 0.0

    thread = threading.Thread(target=mend)
    thread.start()
    yield
    ending.set()
    thread.join()


@pytest.mark.long
def test_thousand_frames_with_faults_none_lost(camera: AccountedCamera, server: CameraServer) -> None:
    draw = np.random.default_rng(20)
    kinds = [kind for kind in get_args(FaultKind) if kind != "returned"]
    ordered: dict[str, int] = {}
    with returning(server):
        for number in range(1000):
            if draw.random() < 0.1:
                kind = str(draw.choice(kinds))
                ordered[kind] = ordered.get(kind, 0) + 1
                order(kind)
            exposure_s = 1e-6 * (10 + number)
            frame = expose_when_back(camera, exposure_s)
            assert np.all(frame.pixels == 10 + number)
    assert camera.counts["good"] == 1000
    told = {kind: sum(fault.kind == kind for fault in heard(camera)) for kind in ordered}
    for kind in ("lost", "late", "doubled", "damaged", "settings"):
        assert told[kind] == ordered[kind], kind
