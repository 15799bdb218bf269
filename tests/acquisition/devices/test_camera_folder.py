"""The hot folder: a tethering program that is slow, writes twice, cuts files short, or writes what nobody asked for."""

import threading
import time
from collections import Counter, deque
from pathlib import Path

import numpy as np
import pytest
import tifffile

from acquisition.devices import StopToken
from acquisition.devices.camera_folder import FolderCamera
from acquisition.devices.frame_accounting import RETAKES, AccountedCamera
from acquisition.models.camera_config import FolderCameraConfig
from acquisition.models.errors import ErrorCode, Halted, RigError

NEVER = StopToken()
SIZE = 16


class Tethering:
    """Writes a file at each trigger, but for the faults that are ordered; its pixels tell what they are of."""

    def __init__(self, folder: Path, *, numbered: bool = True, late_s: float = 0.7) -> None:
        self.folder, self.numbered, self.late_s = folder, numbered, late_s
        self.label = self.written = 0
        self.faults: deque[str] = deque()
        self.threads: list[threading.Thread] = []

    def pulse(self) -> None:
        fault = self.faults.popleft() if self.faults else ""
        path, label = self.next_path(), self.label
        match fault:
            case "lost":
                return
            case "damaged":
                self.write(path, label)
                path.write_bytes(path.read_bytes()[:-40])
            case "doubled":
                self.write(path, label)
                self.write(self.next_path(), label)
            case "slow":
                self.later(0.15, path, label)
            case "late":
                self.later(self.late_s, path, label)
            case "surplus":
                self.write(path, label)
                self.later(0.5, self.next_path(), label)
            case _:
                self.write(path, label)

    def later(self, seconds: float, path: Path, label: int) -> None:
        thread = threading.Timer(seconds, self.write, (path, label))
        thread.start()
        self.threads.append(thread)

    def next_path(self) -> Path:
        self.written += 1
        name = f"DSC_{self.written:04}" if self.numbered else f"shot-{time.time_ns():x}x"
        return self.folder / f"{name}.tif"

    def write(self, path: Path, label: int) -> None:
        pixels = np.random.default_rng().integers(0, 50, (SIZE, SIZE)).astype(np.uint16)
        pixels[0] = label
        tifffile.imwrite(path, pixels)


def config(folder: Path, **values: float) -> FolderCameraConfig:
    given = {"min_exposure_s": 0.01, "max_exposure_s": 0.01, "timeout_s": 60.0, "late_s": 60.0} | values
    return FolderCameraConfig(
        kind="folder", folder=str(folder), width=SIZE, height=SIZE, bits=16, trigger_output=3, **given
    )


def camera(folder: Path, program: Tethering, **values: float) -> AccountedCamera:
    settings = config(folder, **values)
    made = AccountedCamera(FolderCamera(settings, program.pulse), settings)
    made.connect()
    return made


@pytest.mark.parametrize("numbered", [True, False])
def test_folder_each_trigger_yields_its_own_file(tmp_path: Path, numbered: bool) -> None:
    program = Tethering(tmp_path, numbered=numbered)
    program.write(tmp_path / "DSC_0900.tif", 900)  # of yesterday
    taking = camera(tmp_path, program)
    for program.label in (7, 8):
        frame = taking.expose(0.01, 0, NEVER)
        assert (frame.pixels[0] == program.label).all()
        assert (frame.number is not None) == numbered
    assert taking.counts == {"good": 2}


@pytest.mark.parametrize("fault", ["slow", "lost", "damaged", "doubled", "late", "surplus"])
def test_folder_fault_is_told_and_no_file_mislabelled(tmp_path: Path, fault: str) -> None:
    program = Tethering(tmp_path)
    waits = fault in {"lost", "damaged", "late"}
    taking = camera(tmp_path, program, timeout_s=0.4 if waits else 60.0, late_s=1.0)
    program.faults.append(fault)
    for program.label in (1, 2, 3):
        assert (taking.expose(0.01, 0, NEVER).pixels[0] == program.label).all()
        for thread in program.threads:
            thread.join()
    assert taking.counts["good"] == 3
    assert sum(taking.counts.values()) >= 3 + 2 * (fault != "slow")


def test_folder_same_pixels_twice_are_refused(tmp_path: Path) -> None:
    program = Tethering(tmp_path)
    taking = camera(tmp_path, program)
    first = taking.expose(0.01, 0, NEVER).pixels
    program.pulse = lambda: tifffile.imwrite(program.next_path(), first)  # type: ignore[method-assign]
    taking.driver._pulse = program.pulse  # type: ignore[attr-defined]
    with pytest.raises(RigError, match="exactly the same pixels"):
        taking.expose(0.01, 0, NEVER)
    assert taking.counts["doubled"] == RETAKES + 1


def test_folder_wrong_kinds_are_named(tmp_path: Path) -> None:
    program = Tethering(tmp_path)
    taking = camera(tmp_path, program)
    for pixels, named in ((np.zeros((SIZE, SIZE), np.uint8), "8 bits"), (np.zeros((4, 4, 3), np.uint16), "channel")):
        taking.driver._pulse = lambda pixels=pixels: tifffile.imwrite(program.next_path(), pixels)  # type: ignore[attr-defined]
        with pytest.raises(RigError, match=named) as raised:
            taking.expose(0.01, 0, NEVER)
        assert raised.value.code is ErrorCode.CONFIG_INVALID
    with pytest.raises(RigError, match="no folder") as raised:
        camera(tmp_path / "nowhere", program)
    assert raised.value.code is ErrorCode.CAMERA_UNREACHABLE


def test_folder_stated_exposure_time_is_compared(tmp_path: Path) -> None:
    program = Tethering(tmp_path)
    taking = camera(tmp_path, program)
    pixels = np.random.default_rng(1).integers(0, 50, (SIZE, SIZE)).astype(np.uint16)
    bumped = [(33434, "2I", 1, (1, 50), True)]
    taking.driver._pulse = lambda: tifffile.imwrite(program.next_path(), pixels, extratags=bumped)  # type: ignore[attr-defined]
    with pytest.raises(RigError, match=r"reports 0\.02 s"):
        taking.expose(0.01, 0, NEVER)


def test_folder_halt_ends_the_wait(tmp_path: Path) -> None:
    program = Tethering(tmp_path)
    taking = camera(tmp_path, program, late_s=0.0)
    program.faults.append("lost")
    stop = StopToken()
    threading.Timer(0.1, stop.set).start()
    with pytest.raises(Halted):
        taking.expose(0.01, 0, stop)
    program.label = 5
    assert (taking.expose(0.01, 0, NEVER).pixels[0] == 5).all()


def test_folder_config_without_release_is_refused() -> None:
    with pytest.raises(ValueError, match="releases"):
        FolderCameraConfig(kind="folder", folder="x", width=1, height=1)
    with pytest.raises(ValueError, match="exposure time"):
        FolderCameraConfig(kind="folder", folder="x", width=1, height=1, trigger_output=1)


def test_folder_config_with_two_releases_is_refused() -> None:
    """The output would release, and nothing would set the exposure times that the command stands for."""
    with pytest.raises(ValueError, match="either `trigger_command` or `trigger_output`, not both"):
        FolderCameraConfig(
            kind="folder", folder="x", width=1, height=1, trigger_command="release {exposure_s}", trigger_output=1
        )


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_folder_thousand_frames_with_faults_none_mislabelled(tmp_path: Path) -> None:
    """A surplus file comes before the next trigger: one that comes while the next image's own is lost is that image to
    every driver."""
    program = Tethering(tmp_path, late_s=1.6)
    taking = camera(tmp_path, program, timeout_s=1.0, late_s=2.0)
    draw = np.random.default_rng(20)
    ordered: Counter[str] = Counter()
    for number in range(1000):
        program.label = 100 + number
        if draw.random() < 0.1:
            program.faults.append(str(draw.choice(["slow", "lost", "damaged", "doubled", "late", "surplus"])))
            ordered[program.faults[-1]] += 1
        assert (taking.expose(0.01, 0, NEVER).pixels[0] == 100 + number).all(), number
        for thread in program.threads:
            thread.join()
        program.threads.clear()
    print(dict(taking.counts), dict(ordered))
    assert taking.counts["good"] == 1000
    told = {kind: taking.counts[kind] for kind in ("lost", "late", "doubled", "damaged")}
    assert sum(told.values()) >= sum(ordered.values()) - ordered["slow"]
    assert told["doubled"] >= ordered["doubled"]
    assert told["late"] >= ordered["surplus"]
    assert told["lost"] + told["damaged"] >= ordered["lost"] + ordered["damaged"]
