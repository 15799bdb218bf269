"""The DSLR driver against libgphoto2's virtual camera, which hands out the file that lies in its folder."""

import importlib.util
import json
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from acquisition.devices import StopToken, image_file
from acquisition.devices.camera_gphoto import GphotoCamera
from acquisition.devices.frame_accounting import RETAKES, AccountedCamera
from acquisition.devices.image_file import IncompleteFileError
from acquisition.models.errors import ErrorCode, RigError
from tests.acquisition.devices.raw_file import dng
from tests.acquisition.devices.virtual_dslr import CONFIG, FIFTIETH, Virtual

# The library looks for the virtual camera when it is first imported: that must not be here.
if not all(map(importlib.util.find_spec, ("gphoto2", "rawpy"))):
    pytest.skip("needs the extra dslr", allow_module_level=True)

NEVER = StopToken()


@pytest.fixture
def virtual(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Virtual:
    monkeypatch.setenv("VCAMERADIR", str(tmp_path))  # read when the camera is opened
    return Virtual(tmp_path)


@pytest.fixture
def camera(virtual: Virtual) -> Iterator[AccountedCamera]:
    opened = AccountedCamera(GphotoCamera(CONFIG), CONFIG)
    opened.connect()
    yield opened
    opened.close()


def device(camera: AccountedCamera) -> Any:
    return camera.driver._camera  # type: ignore[attr-defined]


def test_gphoto_expose_returns_the_green_sites(camera: AccountedCamera, virtual: Virtual) -> None:
    pixels = np.random.default_rng(3).integers(64, 4095, (64, 96)).astype(np.uint16)
    virtual.put(dng(pixels))
    frame = camera.expose(FIFTIETH, 0, NEVER)
    green = (pixels[0::2, 1::2].astype(int) + pixels[1::2, 0::2] + 1) // 2
    np.testing.assert_array_equal(frame.pixels, green)
    assert frame.exposure_s == pytest.approx(FIFTIETH)
    assert frame.settings is not None
    assert dict(frame.settings.other)["f-number"] == "f/8"


def test_gphoto_bumped_dial_is_set_again(camera: AccountedCamera, virtual: Virtual) -> None:
    prints = []
    for label, name, value in ((1, "f-number", "f/22"), (2, "shutterspeed", "1.0000s"), (3, "f-number", "f/4")):
        virtual.show(label)
        frame = camera.expose(FIFTIETH, 0, NEVER)
        assert frame.settings is not None
        prints.append(frame.settings.fingerprint)
        assert frame.exposure_s == pytest.approx(FIFTIETH)
        widget = device(camera).get_single_config(name)
        widget.set_value(value)
        device(camera).set_single_config(name, widget)
    assert len(set(prints)) == 1
    assert camera.counts == {"good": 3}


def test_gphoto_file_nobody_asked_for_is_refused(camera: AccountedCamera, virtual: Virtual) -> None:
    device(camera).trigger_capture()  # somebody has pressed the button
    virtual.show(9)
    assert (camera.expose(FIFTIETH, 0, NEVER).pixels[0] == 9).all()


def test_gphoto_damaged_and_doubled_files_are_told(camera: AccountedCamera, virtual: Virtual) -> None:
    virtual.show(1)
    camera.expose(FIFTIETH, 0, NEVER)
    with pytest.raises(RigError, match="exactly the same pixels"):
        camera.expose(FIFTIETH, 0, NEVER)
    assert camera.counts["doubled"] == RETAKES + 1
    content = dng(np.full((64, 96), 70, np.uint16))
    virtual.put(bytes(200) + content[200:])  # the virtual camera keeps to the size that it saw first
    with pytest.raises(RigError):
        camera.expose(FIFTIETH, 0, NEVER)
    assert camera.counts["damaged"] == RETAKES + 1


def test_gphoto_reset_camera_is_taken_up_again(camera: AccountedCamera, virtual: Virtual) -> None:
    virtual.show(4)
    camera.driver.close()
    with pytest.raises(RigError) as raised:
        camera.expose(FIFTIETH, 0, NEVER)
    assert raised.value.code is ErrorCode.DEVICE_DISCONNECTED
    camera.take_up(NEVER)
    assert (camera.expose(FIFTIETH, 0, NEVER).pixels[0] == 4).all()
    assert camera.counts == {"gone": 1, "returned": 1, "good": 1}


def test_gphoto_wrong_demands_are_named(camera: AccountedCamera, virtual: Virtual) -> None:
    with pytest.raises(RigError, match=r"use 0\.0196863 s"):
        camera.expose(0.018, 0, NEVER)
    jpeg = cv2.imencode(".jpg", np.zeros((64, 96), np.uint8))[1].tobytes()
    virtual.put(jpeg + bytes(len(dng(np.zeros((64, 96), np.uint16))) - len(jpeg)))
    with pytest.raises(RigError, match="JPEG") as raised:
        camera.expose(FIFTIETH, 0, NEVER)
    assert raised.value.code is ErrorCode.CONFIG_INVALID
    for values, named in (({"settings": {"f-number": "f/99"}}, "f/99"), ({"settings": {"zoom": "2"}}, "zoom")):
        camera.close()
        with pytest.raises(RigError, match=named):
            GphotoCamera(CONFIG.model_copy(update=values)).connect()
    started = time.monotonic()
    with pytest.raises(RigError, match="present: Nikon DSC D750") as raised:
        GphotoCamera(CONFIG.model_copy(update={"model": "Canon EOS 5D"})).connect()
    assert raised.value.code is ErrorCode.CAMERA_UNREACHABLE
    assert time.monotonic() - started < 30.0


def test_raw_file_is_read_without_development(tmp_path: Path) -> None:
    pixels = np.random.default_rng(5).integers(0, 4095, (40, 60)).astype(np.uint16)
    (tmp_path / "a.dng").write_bytes(dng(pixels))
    image = image_file.read(tmp_path / "a.dng")
    green = (pixels[0::2, 1::2].astype(int) + pixels[1::2, 0::2] + 1) // 2
    np.testing.assert_array_equal(image.pixels, green)
    assert image.bits == 12
    (tmp_path / "b.dng").write_bytes(dng(pixels)[:-100])
    with pytest.raises(IncompleteFileError):
        image_file.read(tmp_path / "b.dng")


def test_raw_file_of_a_stated_mosaic_keeps_its_sites(tmp_path: Path) -> None:
    pixels = np.random.default_rng(6).integers(0, 4095, (40, 60)).astype(np.uint16)
    (tmp_path / "a.dng").write_bytes(dng(pixels))
    np.testing.assert_array_equal(image_file.read(tmp_path / "a.dng", "rggb").pixels, pixels)
    with pytest.raises(RigError, match="a mosaic of rggb, the cell file says grbg") as raised:
        image_file.read(tmp_path / "a.dng", "grbg")
    assert raised.value.code is ErrorCode.CONFIG_INVALID


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_gphoto_thousand_frames_with_faults_none_lost() -> None:
    frames, each = 1000, 20  # the virtual camera takes about forty images
    counts: Counter[str] = Counter()
    made: Counter[str] = Counter()
    for first in range(0, frames, each):
        command = [sys.executable, "-m", "tests.acquisition.devices.gphoto_frames", str(first), str(each)]
        done = subprocess.run(command, check=True, stdout=subprocess.PIPE)
        told = json.loads(done.stdout)
        counts.update(told["counts"])
        made.update(told["made"])
    print(dict(counts), dict(made))
    assert counts["good"] == frames
    assert sum(made.values()) == frames // 10
    assert counts["gone"] == counts["returned"] == made["reset"]
    assert not counts["lost"]
    assert counts["doubled"] == made["doubled"]
