"""A GenICam camera that the previous program has left with settings of its own."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from acquisition.devices import StopToken
from acquisition.devices.camera_aravis import AravisCamera
from acquisition.devices.camera_pylon import PylonCamera
from acquisition.models.camera_config import AravisCameraConfig, PylonCameraConfig
from acquisition.models.errors import ErrorCode, RigError
from tests.acquisition.devices.gige import CONFIG, needs_aravis
from tests.acquisition.devices.used_camera import used_camera

SERIAL = "0815-0000"


def aravis(**values: Any) -> AravisCamera:
    return AravisCamera(AravisCameraConfig.model_validate(CONFIG.model_dump() | {"timeout_s": 5.0} | values))


@pytest.fixture
def basler(monkeypatch: pytest.MonkeyPatch) -> Iterator[PylonCamera]:
    monkeypatch.setenv("PYLON_CAMEMU", "1")
    camera = PylonCamera(PylonCameraConfig(kind="pylon", serial=SERIAL, pixel_format="Mono16"))
    camera.connect()
    yield camera
    camera.close()


@needs_aravis
def test_aravis_what_bends_values_or_trigger_is_switched_off(tmp_path: Path) -> None:
    left = {
        "GammaEnable": "true", "LUTEnable": "true", "DigitalShift": "2", "ExposureMode": "TriggerWidth",
        "AcquisitionFrameRateEnable": "true", "TriggerDelay": "500",
    }  # fmt: skip
    with used_camera(tmp_path, left, frame_triggers="On"):
        camera = aravis()
        camera.connect()
        frame = camera.expose(0.01, 0, StopToken())
        assert frame.settings is not None
        reported = dict(frame.settings.other)
        device = camera._camera.get_device()
        assert {reported[name] for name in ("GammaEnable", "LUTEnable", "AcquisitionFrameRateEnable")} == {"false"}
        assert (reported["DigitalShift"], reported["ExposureMode"]) == ("0", "Timed")
        assert device.get_feature("TriggerDelay").get_value_as_string() == "0"
        device.set_string_feature_value("TriggerSelector", "AcquisitionStart")
        assert device.get_string_feature_value("TriggerMode") == "Off"
        camera.close()


@needs_aravis
@pytest.mark.parametrize(("name", "value"), [("ReverseX", "true"), ("BinningHorizontal", "2"), ("OffsetX", "3")])
def test_aravis_what_moves_pixels_has_to_be_stated(tmp_path: Path, name: str, value: str) -> None:
    whole: dict[str, Any] = {} if name != "OffsetX" else {"width": None, "height": None}
    with used_camera(tmp_path, {name: value}):
        with pytest.raises(RigError, match=f"{name} is {value}: if the calibration was made so, state") as refused:
            aravis(**whole).connect()
        assert refused.value.code is ErrorCode.CONFIG_INVALID
        camera = aravis(settings={name: value}, **whole)
        camera.connect()
        frame = camera.expose(0.01, 0, StopToken())
        assert frame.settings is not None
        assert dict(frame.settings.other)[name] == value
        camera.close()


@needs_aravis
def test_aravis_region_begins_at_the_corner_or_as_stated(tmp_path: Path) -> None:
    with used_camera(tmp_path, {"OffsetX": "7", "OffsetY": "9"}):
        for settings, corner in (({}, (0, 0)), ({"OffsetX": "16", "OffsetY": "32"}, (16, 32))):
            camera = aravis(settings=settings)
            camera.connect()
            region = camera._camera.get_region()
            assert (region.x, region.y, region.width, region.height) == (*corner, CONFIG.width, CONFIG.height)
            camera.close()


@needs_aravis
def test_aravis_feature_that_is_missing_or_refused_is_named(tmp_path: Path) -> None:
    with used_camera(tmp_path, {}):
        for settings, named in (
            ({"Sharpness": "1"}, "no feature Sharpness"),
            ({"DigitalShift": "9999"}, "DigitalShift"),
        ):
            with pytest.raises(RigError, match=named) as refused:
                aravis(settings=settings).connect()
            assert refused.value.code is ErrorCode.CONFIG_INVALID


@needs_aravis
def test_aravis_black_level_may_be_an_integer_feature(tmp_path: Path) -> None:
    with used_camera(tmp_path, {}):
        camera = aravis(settings={"BlackLevel": "32"})
        camera.connect()
        settings = camera.expose(0.01, 0, StopToken()).settings
        assert settings is not None
        assert settings.black_level == 32.0
        camera.close()


def test_pylon_what_bends_values_or_trigger_is_switched_off(basler: PylonCamera) -> None:
    device = basler._camera
    device.Gamma.Value, device.DigitalShift.Value, device.ExposureMode.Value = 0.5, 2, "TriggerWidth"
    device.TriggerSelector.Value = "FrameBurstStart"
    device.TriggerMode.Value = "On"
    device.TriggerActivation.Value = "RisingEdge"

    basler._set_up(device)

    frame = basler.expose(0.01, 0, StopToken())
    assert frame.settings is not None
    reported = dict(frame.settings.other)
    assert (float(reported["Gamma"]), reported["DigitalShift"], reported["ExposureMode"]) == (1.0, "0", "Timed")
    device.TriggerSelector.Value = "FrameBurstStart"
    assert device.TriggerMode.Value == "Off"


@pytest.mark.parametrize(("name", "value"), [("ReverseX", True), ("BinningVertical", 2), ("OffsetY", 3)])
def test_pylon_what_moves_pixels_has_to_be_stated(basler: PylonCamera, name: str, value: bool | int) -> None:
    getattr(basler._camera, name).Value = value
    text = "true" if value is True else str(value)
    with pytest.raises(RigError, match=f"{name} is {text}: if the calibration was made so, state") as refused:
        basler._set_up(basler._camera)
    assert refused.value.code is ErrorCode.CONFIG_INVALID
    basler._config = basler._config.model_copy(update={"settings": {name: text}})
    basler._set_up(basler._camera)


def test_pylon_region_is_set(basler: PylonCamera) -> None:
    basler._camera.OffsetX.Value = 5
    basler._config = basler._config.model_copy(update={"width": 640, "height": 480})
    basler._set_up(basler._camera)
    device = basler._camera
    assert [node.Value for node in (device.OffsetX, device.OffsetY, device.Width, device.Height)] == [0, 0, 640, 480]


def test_settings_that_have_a_key_are_refused() -> None:
    for name in ("PixelFormat", "TriggerMode", "Gain"):
        with pytest.raises(ValueError, match=name):
            PylonCameraConfig(kind="pylon", serial=SERIAL, settings={name: "1"})
