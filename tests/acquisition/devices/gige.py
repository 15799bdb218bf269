"""The GigE Vision camera over loopback as tests use it: Aravis' simulated camera before a camera server of our own."""

import fcntl
import itertools
import subprocess
import sys
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from acquisition.models.camera_config import AravisCameraConfig
from hardware_sim import nominal
from hardware_sim.camera import CameraServer
from hardware_sim.shutter import CellState

PIXELS = 96
CONFIG = AravisCameraConfig(
    kind="aravis", device="127.0.0.1", pixel_format="Mono16", bits=12, width=PIXELS, height=PIXELS,
    min_exposure_s=1e-5, timeout_s=60.0, reconnect_s=120.0,
)  # fmt: skip


def has_aravis() -> bool:
    """Whether Aravis and its bindings are there."""
    try:
        import gi

        gi.require_version("Aravis", "0.8")
    except (ImportError, ValueError):
        return False
    return True


needs_aravis = pytest.mark.skipif(not has_aravis(), reason="needs Aravis: gir1.2-aravis-0.8 and python3-gi")


class Gige:
    """The process, to which lines are said."""

    def __init__(self, process: "subprocess.Popen[str]") -> None:
        self._process = process

    def say(self, line: str) -> str:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()
        return self._process.stdout.readline()


class Clocked:
    """An arm at rest under a lit lamp, whose clock advances by reading it."""

    def __init__(self) -> None:
        self._times = itertools.count()

    def state(self) -> CellState:
        return CellState((0.0,) * 6, lamp_on=True, lamp_age_s=10.0, speed_factor=10.0, clock_s=next(self._times) * 1e-3)


def labelled(moments: object, exposure_s: float, attempt: int) -> npt.NDArray[np.uint16]:
    """A frame whose pixels are the exposure time in units of 10 µs, below a pattern."""
    return (np.arange(PIXELS * PIXELS).reshape(PIXELS, PIXELS) % 7 * 4096 + round(exposure_s * 1e5)).astype(np.uint16)


@contextmanager
def gige_process(cell_file: Path, *options: str) -> Generator[Gige, None, None]:
    """The camera of a running simulated cell; GigE Vision has one port, so that there is one at a time on a machine."""
    with (Path(tempfile.gettempdir()) / "lightpose-gige.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        process = subprocess.Popen(
            [sys.executable, "-m", "hardware_sim.gige_camera", str(cell_file), *options],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        gige = Gige(process)
        assert process.stdout is not None
        assert "ready" in process.stdout.readline()
        yield gige
        process.communicate()


@contextmanager
def gige_camera(folder: Path, address: str) -> Generator[Gige, None, None]:
    """A GigE camera of labelled frames."""
    cell = nominal.write(folder, address, PIXELS, nominal.default_cell_file())
    assert cell.camera.kind == "sim"
    server = CameraServer(cell.camera, nominal.calibration(PIXELS), labelled, Clocked())
    with server, gige_process(folder / "cell.toml") as gige:
        yield gige
