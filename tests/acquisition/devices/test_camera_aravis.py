"""The Aravis driver against Aravis' simulated GigE Vision camera, over loopback."""

import re
import threading
import time
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from acquisition.devices import StopToken
from acquisition.devices.camera_aravis import AravisCamera
from acquisition.devices.frame_accounting import AccountedCamera
from acquisition.models import cell_config
from acquisition.models.camera import CameraCapabilities
from acquisition.models.camera_config import AravisCameraConfig
from acquisition.models.errors import ErrorCode, Halted, RigError
from hardware_sim import nominal
from tests.acquisition.devices.camera_return import expose_when_back
from tests.acquisition.devices.gige import CONFIG, Gige, gige_camera, labelled, needs_aravis

NEVER = StopToken()
CELL_FILE = Path(__file__).parents[2] / "data" / "cell.test.toml"


@pytest.fixture(scope="module")
def gige(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Gige]:
    with gige_camera(tmp_path_factory.mktemp("gige"), "127.0.3.30") as camera:
        yield camera


@pytest.fixture
def camera(gige: Gige) -> Iterator[AccountedCamera]:
    gige.say("lost 0")
    opened = AccountedCamera(AravisCamera(CONFIG), CONFIG)
    opened.connect()
    yield opened
    opened.close()


def changed(**values: Any) -> AravisCameraConfig:
    return CONFIG.model_copy(update=values)


@needs_aravis
def test_aravis_expose_returns_the_cells_pixels_exactly(camera: AccountedCamera) -> None:
    before = time.time()
    frames = [camera.expose(exposure_s, 0, NEVER) for exposure_s in (0.01, 0.02)]
    for frame, exposure_s in zip(frames, (0.01, 0.02), strict=True):
        np.testing.assert_array_equal(frame.pixels, labelled(None, exposure_s, 0))
        assert frame.exposure_s == pytest.approx(exposure_s)
        assert before <= frame.taken_at <= time.time()
        assert frame.settings is not None
        assert frame.settings.pixel_format == "Mono16"
        assert dict(frame.settings.other)["GainAuto"] == "Off"
    assert frames[1].number == (frames[0].number or 0) + 1
    known = camera.capabilities
    assert known is not None
    assert (known.width, known.height, known.bits, known.name) == (96, 96, 12, "Aravis Fake lightpose")


@needs_aravis
def test_aravis_lost_packets_are_noticed_and_retaken(camera: AccountedCamera, gige: Gige) -> None:
    gige.say("lost 0.02")
    for number in range(10):
        frame = camera.expose(1e-5 * (10 + number), 0, NEVER)
        np.testing.assert_array_equal(frame.pixels, labelled(None, 1e-5 * (10 + number), 0))
    assert camera.counts["good"] == 10
    assert camera.counts["retaken"] == camera.counts["damaged"] + camera.counts["lost"] + camera.counts["late"]


@needs_aravis
def test_aravis_hardware_trigger_takes_the_lines_frame(gige: Gige) -> None:
    config = changed(trigger="hardware", trigger_output=3)
    camera = AccountedCamera(AravisCamera(config, lambda: gige.say("trigger") and None), config)
    camera.connect()
    frame = camera.expose(0.003, 0, NEVER)
    np.testing.assert_array_equal(frame.pixels, labelled(None, 0.003, 0))
    assert frame.settings is not None
    assert (frame.settings.trigger, dict(frame.settings.other)["TriggerSource"]) == ("hardware", "Line0")
    camera.close()


@pytest.mark.parametrize("trigger", ['trigger = "software"\n', ""])
@pytest.mark.parametrize("kind", ['kind = "aravis"\ndevice = "192.168.3.20"', 'kind = "pylon"\nserial = "0815-0000"'])
def test_output_that_the_software_trigger_would_ignore_is_refused(kind: str, trigger: str, tmp_path: Path) -> None:
    """The camera would be released by software, although somebody has wired it to an output."""
    nominal.write(tmp_path, "127.0.3.32", 64, CELL_FILE)
    cell_file = tmp_path / "cell.toml"
    text = re.sub(r"\[camera\]\n(?:\w.*\n)*", f"[camera]\n{kind}\n{trigger}trigger_output = 3\n", cell_file.read_text())
    cell_file.write_text(text)

    with pytest.raises(RigError) as refused:
        cell_config.load(cell_file)

    assert refused.value.code is ErrorCode.CONFIG_INVALID
    assert 'set `trigger = "hardware"`, or leave out `trigger_output`' in refused.value.detail
    cell_file.write_text(text.replace("trigger_output = 3", 'trigger_source = "Line2"'))
    assert cell_config.load(cell_file).camera.kind in kind


@needs_aravis
def test_aravis_set_token_raises_halted_and_next_is_right(camera: AccountedCamera) -> None:
    stop = StopToken()
    stop.set()
    with pytest.raises(Halted):
        camera.expose(0.01, 0, stop)
    assert camera.expose(0.004, 0, NEVER).pixels[0, 0] == 400


@needs_aravis
@pytest.mark.parametrize(
    ("values", "code", "named"),
    [
        ({"device": "127.0.0.9"}, ErrorCode.CAMERA_UNREACHABLE, "127.0.0.9"),
        ({"pixel_format": "Mono12"}, ErrorCode.CONFIG_INVALID, "Mono12"),
        ({"width": 5000}, ErrorCode.CONFIG_INVALID, "refuses"),
    ],
)
def test_aravis_connect_names_what_is_wrong(gige: Gige, values: dict[str, Any], code: ErrorCode, named: str) -> None:
    with pytest.raises(RigError, match=named) as raised:
        AravisCamera(changed(**values)).connect()
    assert raised.value.code is code


@needs_aravis
def test_aravis_camera_of_another_program_is_refused(camera: AccountedCamera) -> None:
    with pytest.raises(RigError, match="nother program") as raised:
        AravisCamera(CONFIG).connect()
    assert raised.value.code is ErrorCode.CAMERA_UNREACHABLE


@needs_aravis
def test_aravis_chunk_exposure_is_compared_with_what_was_asked(gige: Gige) -> None:
    """Aravis' simulated camera has no chunks: a stand-in for its parser says what a frame with one does."""
    gige.say("lost 0")
    driver = AravisCamera(CONFIG)
    camera = AccountedCamera(driver, CONFIG)
    camera.connect()
    assert camera.capabilities is not None
    assert not camera.capabilities.chunk_exposure
    said = iter([8000.0, 4000.0])  # µs
    driver._chunks = types.SimpleNamespace(get_float_value=lambda _buffer, name: next(said) if name else 0.0)
    set_up = driver.connect

    def connect() -> CameraCapabilities:
        known, chunks = set_up(), types.SimpleNamespace(get_float_value=lambda _buffer, name: next(said))
        driver._chunks = chunks
        return known

    driver.connect = connect  # type: ignore[method-assign]
    frame = camera.expose(0.004, 0, NEVER)
    assert frame.exposure_s == pytest.approx(0.004)
    assert camera.counts["settings"] == 1
    camera.close()


@needs_aravis
@pytest.mark.long
def test_aravis_thousand_frames_with_faults_none_lost(gige: Gige) -> None:
    config = changed(timeout_s=3.0)
    camera = AccountedCamera(AravisCamera(config), config)
    told: list[str] = []
    camera.listen(lambda fault: told.append(fault.kind))
    camera.connect()
    gige.say("lost 0.002")
    resets = 0
    for number in range(1000):
        off = threading.Thread(target=gige.say, args=("off 1",))
        if number % 250 == 100:
            off.start()
            resets += 1
        exposure_s = 1e-5 * (10 + number)
        frame = expose_when_back(camera, exposure_s)
        if off.ident is not None:
            off.join()
        assert np.array_equal(frame.pixels, labelled(None, exposure_s, 0)), number
    gige.say("lost 0")
    camera.close()
    print(dict(camera.counts))
    assert camera.counts["good"] == 1000
    assert camera.counts["returned"] == camera.counts["gone"] == resets
    assert camera.counts["damaged"] > 10
    assert len(told) == sum(camera.counts[kind] for kind in set(told))
