"""The Micro-Manager driver against Micro-Manager's own demonstration camera."""

import importlib.util
from collections.abc import Iterator
from typing import Any

import pytest

from acquisition.devices import StopToken
from acquisition.devices.camera_micromanager import LABEL, MicromanagerCamera
from acquisition.devices.frame_accounting import AccountedCamera
from acquisition.models.camera_config import MicromanagerCameraConfig
from acquisition.models.errors import ErrorCode, RigError
from tests.acquisition.devices.camera_return import expose_when_back

if not all(map(importlib.util.find_spec, ("pymmcore", "mm_test_adapters"))):
    pytest.skip("needs the extra micromanager and mm-test-adapters", allow_module_level=True)

import mm_test_adapters

NEVER = StopToken()
CONFIG = MicromanagerCameraConfig(
    kind="micromanager", adapters=str(mm_test_adapters.device_adapter_path()), adapter="DemoCamera", device="DCam",
    properties={"PixelType": "16bit", "BitDepth": "12", "OnCameraCCDXSize": "96", "OnCameraCCDYSize": "64"},
    timeout_s=60.0, reconnect_s=60.0,
)  # fmt: skip


@pytest.fixture
def camera() -> Iterator[AccountedCamera]:
    opened = AccountedCamera(MicromanagerCamera(CONFIG), CONFIG)
    opened.connect()
    yield opened
    opened.close()


def core(camera: AccountedCamera) -> Any:
    return camera.driver._core  # type: ignore[attr-defined]


def test_micromanager_frame_has_its_settings(camera: AccountedCamera) -> None:
    known = camera.capabilities
    assert known is not None
    assert (known.width, known.height, known.bits, known.temperature) == (96, 64, 12, True)
    frames = [camera.expose(exposure_s, 0, NEVER) for exposure_s in (0.005, 0.01)]
    assert [frame.exposure_s for frame in frames] == pytest.approx([0.005, 0.01])
    assert frames[0].pixels.shape == (64, 96)
    settings = [frame.settings for frame in frames]
    assert settings[0] is not None
    assert settings[1] is not None
    assert settings[0].fingerprint == settings[1].fingerprint
    assert settings[0].pixel_format == "16bit"


def test_micromanager_changed_property_is_set_again(camera: AccountedCamera) -> None:
    camera.expose(0.005, 0, NEVER)
    core(camera).setProperty(LABEL, "BitDepth", "14")
    camera.expose(0.005, 0, NEVER)
    core(camera).setProperty(LABEL, "ScanMode", "2")  # the cell file does not set it: only connecting anew does
    camera.expose(0.005, 0, NEVER)
    assert camera.counts == {"good": 3, "settings": 1, "retaken": 1}


def test_micromanager_lost_device_is_taken_up_again(camera: AccountedCamera) -> None:
    core(camera).unloadAllDevices()
    with pytest.raises(RigError) as raised:
        camera.expose(0.005, 0, NEVER)
    assert raised.value.code is ErrorCode.DEVICE_DISCONNECTED
    camera.take_up(NEVER)
    camera.expose(0.005, 0, NEVER)
    assert camera.counts == {"gone": 1, "returned": 1, "good": 1}


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({"device": "Nothing"}, "no device"),
        ({"properties": {"PixelType": "3bit"}}, "3bit"),
        ({"properties": {"PixelType": "32bitRGB"}}, "grey pixel type"),
    ],
)
def test_micromanager_wrong_demands_are_named(values: dict[str, Any], named: str) -> None:
    with pytest.raises(RigError, match=named) as raised:
        MicromanagerCamera(CONFIG.model_copy(update=values)).connect()
    assert raised.value.code is ErrorCode.CONFIG_INVALID


@pytest.mark.long
def test_micromanager_thousand_frames_none_lost(camera: AccountedCamera) -> None:
    resets = 0
    for number in range(1000):
        if number % 100 == 50:
            core(camera).unloadAllDevices()
            resets += 1
        exposure_s = 1e-4 * (1 + number % 50)
        frame = expose_when_back(camera, exposure_s)
        assert frame.exposure_s == pytest.approx(exposure_s)
    print(dict(camera.counts))
    assert camera.counts["good"] == 1000
    assert camera.counts["gone"] == camera.counts["returned"] == resets
