"""GigE Vision camera over loopback that shows the simulated cell: Aravis' own simulated camera, fed with its frames.

Run beside a simulated cell as `python -m hardware_sim.gige_camera CELL_FILE [--serial NAME] [--trigger-output N]`, with
the simulated cell's own cell file. It answers GigE Vision clients at 127.0.0.1 (UDP 3956). Each frame that a client
triggers is taken from the simulated camera. With `--trigger-output`, a rising edge of that output triggers a frame
while the client has selected the line as trigger source. Prints one JSON line when it is ready. Then it obeys lines on
its standard input and answers each with one line: `lost 0.001` (share of packets lost), `off 2` (seconds without
power), `trigger` (an edge on the line). It ends when its standard input ends.

A GigE client cannot state the attempt of a frame. If scene and exposure time were seen before, the frame is counted as
another attempt, so that repeated frames have independent noise.
"""

import argparse
import ctypes
import hashlib
import importlib
import json
import socket
import sys
import threading
import time
from collections import Counter
from pathlib import Path
from typing import Any

from acquisition.models import cell_config
from acquisition.models.camera_config import SimCameraConfig
from acquisition.models.errors import RigError
from hardware_sim.controller.control import ControlClient

INTERFACE = "127.0.0.1"
POLL_S = 0.002
"""Period, s, at which the trigger output is read."""

FRAME_S = 120.0
"""Time limit, s, for a frame of the simulated camera."""

TRIGGER_MODE, TRIGGER_SOURCE, TRIGGER_SOFTWARE = 0x300, 0x304, 0x30C
"""Registers of Aravis' simulated camera (arvfakecamera.h)."""
SOFTWARE, LINE = 1, 0
"""Values of its trigger source (arv-fake-camera.xml)."""

_Fill = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_uint32, ctypes.c_uint32, ctypes.c_uint32)


class GigeCamera:
    """Aravis' simulated GigE Vision camera, whose pixels are the simulated cell's."""

    def __init__(self, camera: SimCameraConfig, serial: str) -> None:
        gi: Any = importlib.import_module("gi")
        gi.require_version("Aravis", "0.8")
        self._aravis: Any = importlib.import_module("gi.repository.Aravis")
        self._library = ctypes.CDLL("libaravis-0.8.so.0")
        self._library.arv_buffer_get_data.restype = ctypes.c_void_p
        self._library.arv_buffer_get_data.argtypes = [ctypes.c_void_p, ctypes.c_void_p]
        self._library.arv_fake_camera_set_fill_pattern.argtypes = [ctypes.c_void_p, _Fill, ctypes.c_void_p]
        self._fill = _Fill(self._fill_buffer)  # held here: the library keeps no reference
        self._source, self._serial = (camera.address, camera.port), serial
        self._seen: Counter[str] = Counter()
        self._lost = 0.0
        self._device: Any = None
        self.power_on()

    def power_on(self) -> None:
        """Starts to answer, with all settings as after a power cycle."""
        self._device = self._aravis.GvFakeCamera.new(INTERFACE, self._serial)
        if not self._device.is_running():
            raise OSError(f"cannot start a GigE Vision camera at {INTERFACE}: is another one running?")
        self._device.set_property("gvsp-lost-ratio", self._lost)
        # PyGObject's hash of an object is the address of its C structure.
        self._library.arv_fake_camera_set_fill_pattern(hash(self._memory), self._fill, None)

    def power_off(self) -> None:
        """Stops answering at once, like a camera whose cable is pulled."""
        self._device = None

    def lose(self, share: float) -> None:
        """Loses a share of the stream's packets from now on."""
        self._lost = share
        if self._device is not None:
            self._device.set_property("gvsp-lost-ratio", share)

    def trigger(self) -> None:
        """An edge on the line: a frame, if the client waits for the line."""
        if self._device is None:
            return
        memory = self._memory
        if _value(memory.read_register(TRIGGER_MODE)) == 1 and _value(memory.read_register(TRIGGER_SOURCE)) == LINE:
            # The simulated camera knows only the software trigger, which stands for the edge during one frame.
            memory.write_register(TRIGGER_SOURCE, SOFTWARE)
            memory.write_register(TRIGGER_SOFTWARE, 1)
            while _value(memory.read_register(TRIGGER_SOFTWARE)) == 1:
                time.sleep(POLL_S)
            memory.write_register(TRIGGER_SOURCE, LINE)

    @property
    def _memory(self) -> Any:
        return self._device.get_fake_camera()

    def _fill_buffer(self, buffer: int, _: int, exposure_us: int, gain: int, pixel_format: int) -> None:
        device = self._device
        if device is None:
            return
        try:
            pixels = self._frame(round(exposure_us * 1e-6, 6))
        except (OSError, ValueError) as error:  # sends nothing: old pixels would be a wrong frame
            sys.stderr.write(f"the simulated camera gave no frame: {error}\n")
            device.set_property("gvsp-lost-ratio", 1.0)
            return
        device.set_property("gvsp-lost-ratio", self._lost)
        if pixel_format == self._aravis.PIXEL_FORMAT_MONO_8:
            pixels = pixels[1::2]  # the upper bytes
        size = min(len(pixels), int(self._memory.get_payload()))
        ctypes.memmove(self._library.arv_buffer_get_data(buffer, None), pixels, size)

    def _frame(self, exposure_s: float) -> bytes:
        """The simulated camera's frame, of the next attempt if this one was sent before."""
        pixels = self._request(exposure_s, 0)
        name = hashlib.sha256(pixels).hexdigest()
        attempt = self._seen[name]
        self._seen[name] += 1
        return pixels if attempt == 0 else self._request(exposure_s, attempt)

    def _request(self, exposure_s: float, attempt: int) -> bytes:
        with socket.create_connection(self._source, FRAME_S) as connection, connection.makefile("rb") as answer:
            connection.sendall(json.dumps({"exposure_s": exposure_s, "attempt": attempt}).encode() + b"\n")
            header = json.loads(answer.readline())
            if "error" in header:
                raise ValueError(header["error"])
            return answer.read(2 * header["width"] * header["height"])


def _value(read: Any) -> int:
    """The value of a register; PyGObject returns success and value."""
    return int(read[1])


def watch_output(address: str, output: int, camera: GigeCamera) -> None:
    """Triggers a frame at each rising edge of a controller's output, until the process ends."""
    with ControlClient(address) as client:
        was_high = True
        while True:
            is_high = bool(client.state()["digital_outputs"] >> output & 1)
            if is_high and not was_high:
                camera.trigger()
            was_high = is_high
            time.sleep(POLL_S)


def obey(camera: GigeCamera, line: str) -> None:
    """Carries out one line of standard input. Raises ValueError for an invalid line."""
    match line.split():
        case ["lost", share]:
            camera.lose(float(share))
        case ["off", seconds]:
            camera.power_off()
            time.sleep(float(seconds))
            camera.power_on()
        case ["trigger"]:
            camera.trigger()
        case _:
            raise ValueError(f"unknown command: {line.strip()}")


def main() -> None:
    """Serves until standard input ends."""
    parser = argparse.ArgumentParser(description="A GigE Vision camera that shows the simulated cell.")
    parser.add_argument("cell", type=Path)
    parser.add_argument("--serial", default="lightpose")
    parser.add_argument("--trigger-output", type=int)
    given = parser.parse_args()
    try:
        cell = cell_config.load(given.cell)
    except RigError as error:
        parser.error(error.detail)
    if not isinstance(cell.camera, SimCameraConfig):
        parser.error(f"{given.cell} has no camera of kind 'sim'")
    try:
        camera = GigeCamera(cell.camera, given.serial)
    except (ImportError, ValueError, OSError) as error:
        parser.error(f"{error}; docs/how-to/aravis-camera.md says how to install Aravis and its bindings")
    if given.trigger_output is not None:
        watching = (cell.arm.address, given.trigger_output, camera)
        threading.Thread(target=watch_output, args=watching, daemon=True).start()
    print(json.dumps({"ready": True}), flush=True)
    for line in sys.stdin:
        try:
            obey(camera, line)
        except (ValueError, OSError) as error:
            print(json.dumps({"error": str(error)}), flush=True)
        else:
            print(json.dumps({"done": line.strip()}), flush=True)


if __name__ == "__main__":
    main()
