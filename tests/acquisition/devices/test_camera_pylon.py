"""The Basler camera driver against the emulated camera of the vendor's library."""

import time
import types
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from acquisition.devices import StopToken, camera_pylon
from acquisition.devices.camera_pylon import PylonCamera
from acquisition.devices.frame_accounting import AccountedCamera
from acquisition.models.camera import CameraCapabilities
from acquisition.models.camera_config import PylonCameraConfig
from acquisition.models.errors import ErrorCode, Halted, RigError
from tests.acquisition.devices.camera_return import expose_when_back

EMULATED = PylonCameraConfig(kind="pylon", serial="0815-0000", pixel_format="Mono16", timeout_s=30.0)


@pytest.fixture(autouse=True)
def emulation(monkeypatch: pytest.MonkeyPatch) -> None:
    """The library looks for this when it is first loaded."""
    monkeypatch.setenv("PYLON_CAMEMU", "1")


@pytest.fixture
def camera() -> Iterator[PylonCamera]:
    opened = PylonCamera(EMULATED)
    opened.connect()
    yield opened
    opened.close()


def test_pylon_expose_returns_the_sensors_pixels_exactly(camera: PylonCamera, tmp_path: Path) -> None:
    pixels = np.random.default_rng(1).integers(0, 65536, (96, 128)).astype(np.uint16)
    cv2.imwrite(str(tmp_path / "seen.tiff"), pixels)
    device = camera._camera
    device.Width.Value, device.Height.Value = 128, 96
    device.TestImageSelector.Value = "Off"
    device.ImageFilename.Value = str(tmp_path)
    device.ImageFileMode.Value = "On"

    before = time.time()
    frame = camera.expose(0.02, 1, StopToken())

    np.testing.assert_array_equal(frame.pixels, pixels)
    assert frame.pixels.dtype == np.uint16
    assert frame.exposure_s == pytest.approx(0.02)
    assert before <= frame.taken_at <= time.time()


def test_pylon_connect_switches_automatic_functions_off(camera: PylonCamera) -> None:
    device = camera._camera
    assert device.ExposureAuto.Value == device.GainAuto.Value == "Off"
    assert device.Gamma.Value == 1.0
    assert device.Gain.Value == device.Gain.Min
    assert (device.TriggerMode.Value, device.TriggerSource.Value) == ("On", "Software")


def test_pylon_expose_broken_frame_raises_and_next_succeeds(camera: PylonCamera) -> None:
    camera._camera.ForceFailedBufferCount.Value = 1
    camera._camera.ForceFailedBuffer.Execute()
    with pytest.raises(RigError, match="broken") as raised:
        camera.expose(0.01, 1, StopToken())
    assert raised.value.code == ErrorCode.CAMERA_TIMEOUT
    assert camera.expose(0.01, 2, StopToken()).pixels.max() > 0


def test_pylon_expose_set_token_raises_halted(camera: PylonCamera) -> None:
    stop = StopToken()
    stop.set()
    with pytest.raises(Halted):
        camera.expose(0.01, 1, stop)


def test_pylon_expose_beyond_the_limits_is_refused(camera: PylonCamera) -> None:
    with pytest.raises(RigError, match="is not within") as raised:
        camera.expose(EMULATED.max_exposure_s * 2, 1, StopToken())
    assert raised.value.code == ErrorCode.REQUEST_INVALID


def test_pylon_connect_unknown_serial_lists_present_cameras() -> None:
    with pytest.raises(RigError, match="0815-0000") as raised:
        PylonCamera(EMULATED.model_copy(update={"serial": "40012345"})).connect()
    assert raised.value.code == ErrorCode.CAMERA_UNREACHABLE


def test_pylon_connect_invalid_gain_raises_config_invalid() -> None:
    camera = PylonCamera(EMULATED.model_copy(update={"gain": 4000.0}))
    with pytest.raises(RigError, match="refuses") as raised:
        camera.connect()
    assert raised.value.code == ErrorCode.CONFIG_INVALID
    with pytest.raises(RigError) as raised:
        camera.expose(0.01, 1, StopToken())
    assert raised.value.code == ErrorCode.DEVICE_DISCONNECTED


def test_pylon_connect_after_close_succeeds(camera: PylonCamera) -> None:
    camera.close()
    camera.close()
    camera.connect()
    assert camera.expose(0.01, 1, StopToken()).pixels.ndim == 2


def test_pylon_hardware_trigger_takes_the_lines_frame() -> None:
    """The emulated camera has no wire: a line is set and read back, and then the software trigger stands in for it."""
    line = EMULATED.model_copy(update={"trigger": "hardware", "trigger_output": 3, "timeout_s": 2.0})
    opened = PylonCamera(line, lambda: None)
    opened.connect()
    assert opened._camera.TriggerSource.Value == "Line1"
    opened.close()

    def pulse() -> None:
        wired._camera.ExecuteSoftwareTrigger()

    wired = PylonCamera(line.model_copy(update={"trigger_source": "Software"}), pulse)
    wired.connect()
    frame = wired.expose(0.01, 0, StopToken())
    wired.close()
    assert frame.settings is not None
    assert frame.settings.trigger == "hardware"


def test_pylon_chunk_exposure_is_the_frames_own(camera: PylonCamera) -> None:
    """The emulated camera has no chunk selector: a stand-in says what a frame with chunks does."""
    assert not camera._has_chunk
    node = types.SimpleNamespace
    enabled = node(Value=False)
    writable = {"IsWritable": lambda: True, "IsReadable": lambda: True}
    device = node(
        ChunkModeActive=node(Value=False, **writable),
        ChunkSelector=node(Value="", Symbolics=["Gain", "ExposureTime"], **writable),
        ChunkEnable=enabled,
    )
    assert camera_pylon._enable_chunk(device)
    assert (device.ChunkModeActive.Value, device.ChunkSelector.Value, enabled.Value) == (True, "ExposureTime", True)


class Shown(PylonCamera):
    """An emulated sensor of few pixels, which sees the image of a number."""

    def __init__(self, folder: Path) -> None:
        super().__init__(EMULATED)
        self._folder, self.number = folder, 0

    def connect(self) -> CameraCapabilities:
        known = super().connect()
        self.show(self.number)
        return known.model_copy(update={"width": 32, "height": 24})

    def show(self, number: int) -> None:
        folder, device, self.number = self._folder / f"{number}", self._camera, number
        folder.mkdir(exist_ok=True)
        cv2.imwrite(str(folder / "seen.tiff"), np.full((24, 32), number, np.uint16))
        device.Width.Value, device.Height.Value = 32, 24
        device.TestImageSelector.Value = "Off"
        device.ImageFilename.Value = str(folder)
        device.ImageFileMode.Value = "On"


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_pylon_thousand_frames_with_faults_none_lost(tmp_path: Path) -> None:
    shown = Shown(tmp_path)
    taking = AccountedCamera(shown, EMULATED)
    taking.connect()
    made: Counter[str] = Counter()
    draw = np.random.default_rng(20)
    for number in range(1000):
        shown.show(number)
        if draw.random() < 0.1:
            fault = str(draw.choice(["damaged", "gone", "settings"])) if number else "damaged"
            made[fault] += 1
            match fault:
                case "damaged":
                    frames = int(draw.integers(1, 4))
                    shown._camera.ForceFailedBufferCount.Value = frames
                    shown._camera.ForceFailedBuffer.Execute()
                    made["broken frames"] += frames
                case "gone":  # the session with the camera is over, as after a reset
                    shown.close()
                case _:
                    shown._camera.Gain.Value = shown._camera.Gain.Min + 1.0
        frame = expose_when_back(taking, 0.001 + 1e-6 * number)
        assert (frame.pixels == number).all(), number
    print(dict(taking.counts), dict(made))
    assert taking.counts["good"] == 1000
    assert taking.counts["gone"] == taking.counts["returned"] == made["gone"]
    assert taking.counts["settings"] == made["settings"]
    assert taking.counts["damaged"] == made["broken frames"]
