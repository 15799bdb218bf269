"""The Basler camera driver against the emulated camera of the vendor's library."""

import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from acquisition.devices import StopToken
from acquisition.devices.camera_pylon import PylonCamera
from acquisition.models.camera_config import PylonCameraConfig
from acquisition.models.errors import ErrorCode, Halted, RigError

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
