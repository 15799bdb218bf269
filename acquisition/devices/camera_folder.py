"""Driver of any camera whose tethering program writes files into a folder: one new file for each trigger.

Nothing in a folder tells which trigger a file belongs to. Files that lie there before a trigger are surplus and
refused. After a trigger exactly one file may come; if two have come, both are refused. A file counts only if it can be
read to its end. A trigger whose file does not come in time is given up, and its file is waited for (`late_s`) before
the next trigger. If names end in a counter, as cameras' do, the counter is the frame's number, and a gap or a step back
is noticed. A file with the same pixels as the one before is the same image under another name: no two exposures have
the same noise.

Without a counter, a file that comes later than `timeout_s` and `late_s` together after its trigger could be taken for
the next image's: set both generously.
"""

import hashlib
import re
import shlex
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

from acquisition.devices import Frame, StopToken, image_file
from acquisition.devices.frame_accounting import BadFrameError
from acquisition.devices.image_file import ImageFile, IncompleteFileError
from acquisition.models.camera import CameraCapabilities, CameraSettings
from acquisition.models.camera_config import FolderCameraConfig
from acquisition.models.errors import ErrorCode, Halted, RigError

POLL_S = 0.02
"""Period, s, of checks of the folder and of the stop token."""

STABLE_S = 0.2
"""Time, s, without a change of size or modification time after which a file counts as written: some programs reserve
the whole file first, which reads as black pixels."""

COMMAND_S = 20.0
"""Time limit, s, of the trigger command beyond the exposure time."""


class FolderCamera:
    """A folder and a trigger; see the Protocol `CameraDriver`."""

    def __init__(self, config: FolderCameraConfig, pulse: Callable[[], None] | None = None) -> None:
        """`pulse` raises and lowers the line that releases the camera; without it, the command does.

        Raises RigError config.invalid if there is neither.
        """
        if pulse is None and not config.trigger_command:
            detail = "A camera of kind 'folder' without an arm needs `trigger_command`: nothing else releases it"
            raise RigError(ErrorCode.CONFIG_INVALID, detail)
        self._config, self._pulse = config, pulse
        self._folder = Path(config.folder)
        self._seen: set[str] = set()
        self._owed = False  # a trigger was given up, and its file may still come
        self._digest = ""

    def connect(self) -> CameraCapabilities:
        """Looks for the folder and ignores the files that are already in it.

        Raises RigError camera.unreachable if there is no such folder.
        """
        if not self._folder.is_dir():
            raise RigError(ErrorCode.CAMERA_UNREACHABLE, f"There is no folder {self._folder}")
        self._seen, self._owed, self._digest = self._names(), False, ""
        config = self._config
        return CameraCapabilities(
            name=f"folder {self._folder}",
            width=config.width,
            height=config.height,
            bits=config.bits,
            mosaic=config.mosaic,
            triggers=("software",) if config.trigger_command else ("hardware",),
            min_exposure_s=config.min_exposure_s,
            max_exposure_s=config.max_exposure_s,
        )

    def expose(self, exposure_s: float, attempt: int, stop: StopToken) -> Frame:
        """Triggers and returns the file that comes.

        Raises BadFrameError for files that nobody requested, two at once, the same one twice, or one that is cut short;
        RigError camera.timeout if none comes, device.disconnected without the folder, config.invalid for files of a
        wrong kind; Halted as soon as the token is set.
        """
        if stop.is_set():
            raise Halted
        surplus = sorted(self._names() - self._seen)
        if surplus:
            self._seen.update(surplus)
            raise BadFrameError("late", f"{', '.join(surplus)} arrived without a trigger: refused")
        triggered_at = time.time()
        self._owed = True
        self._trigger(exposure_s)
        name, image = self._await_file(time.monotonic() + self._config.timeout_s + exposure_s, stop)
        self._owed = False
        self._refuse_twice(name, image)
        if image.bits < self._config.bits:
            detail = f"{name} has {image.bits} bits, the cell file says {self._config.bits}: correct one of them"
            raise RigError(ErrorCode.CONFIG_INVALID, detail)
        stated_s = exposure_s if image.exposure_s is None else image.exposure_s
        settings = CameraSettings(
            exposure_s=stated_s,
            pixel_format=f"{Path(name).suffix.lower()} {image.bits}",
            width=image.pixels.shape[1],
            height=image.pixels.shape[0],
            trigger="hardware" if self._pulse is not None else "software",
        )
        return Frame(image.pixels, stated_s, triggered_at + exposure_s / 2, _counter(name), settings)

    def restart(self) -> None:
        """Waits for the file of a trigger that was given up, and refuses every file that has come."""
        deadline = time.monotonic() + (self._config.late_s if self._owed else 0.0)
        while not self._names() - self._seen and time.monotonic() < deadline:
            time.sleep(POLL_S)
        self._seen |= self._names()
        self._owed = False

    def close(self) -> None:
        """Does nothing: no resource is held."""

    # ---------------------------------------------------------------------------------------------------------- pieces

    def _trigger(self, exposure_s: float) -> None:
        if self._pulse is not None:
            self._pulse()
            return
        command = [
            part.replace("{exposure_s}", f"{exposure_s:g}") for part in shlex.split(self._config.trigger_command)
        ]
        try:
            subprocess.run(  # noqa: S603 - the cell file's own command, without a shell
                command, check=True, timeout=COMMAND_S + exposure_s, capture_output=True
            )
        except FileNotFoundError as error:
            raise RigError(ErrorCode.CONFIG_INVALID, f"`trigger_command`: there is no program {command[0]}") from error
        except (OSError, subprocess.SubprocessError) as error:
            raise RigError(ErrorCode.CAMERA_TIMEOUT, f"`trigger_command` failed: {error}") from error

    def _await_file(self, deadline: float, stop: StopToken) -> tuple[str, ImageFile]:
        why, before, since = "", (0, 0), time.monotonic()
        while not stop.is_set():
            new = sorted(self._names() - self._seen)
            if len(new) > 1:
                self._seen.update(new)
                raise BadFrameError("doubled", f"One trigger produced several files, all refused: {', '.join(new)}")
            state = self._state(new[0]) if new else before
            if state != before:
                before, since = state, time.monotonic()
            if new and time.monotonic() >= since + STABLE_S:
                try:
                    image = image_file.read(self._folder / new[0], self._config.mosaic)
                except IncompleteFileError as error:  # the file is still being written, or was cut short
                    why = str(error)
                else:
                    self._seen.add(new[0])
                    return new[0], image
            if time.monotonic() > deadline:
                self._seen.update(new)
                if new:
                    why = why or f"{new[0]}: is still being written"
                    raise BadFrameError("damaged", f"{why} ({self._config.timeout_s:.0f} s after the exposure)")
                detail = f"No file arrived within {self._config.timeout_s:.0f} s after the exposure"
                raise RigError(ErrorCode.CAMERA_TIMEOUT, detail)
            time.sleep(POLL_S)
        raise Halted

    def _refuse_twice(self, name: str, image: ImageFile) -> None:
        digest = hashlib.sha256(image.pixels.tobytes()).hexdigest()
        if digest == self._digest:
            raise BadFrameError("doubled", f"{name} has exactly the same pixels as the previous file")
        self._digest = digest

    def _state(self, name: str) -> tuple[int, int]:
        """Returns size and modification time; (−1, 0) for a file that has been removed again."""
        try:
            found = (self._folder / name).stat()
        except FileNotFoundError:
            return -1, 0
        return found.st_size, found.st_mtime_ns

    def _names(self) -> set[str]:
        """Returns the names of the matching files; a program's temporary names must not match."""
        if not self._folder.is_dir():
            raise RigError(ErrorCode.DEVICE_DISCONNECTED, f"The folder {self._folder} no longer exists")
        return {path.name for path in self._folder.glob(self._config.pattern) if path.is_file()}


def _counter(name: str) -> int | None:
    """Returns the number at the end of a name, as cameras count; None if there is none."""
    found = re.search(r"(\d+)$", Path(name).stem)
    return None if found is None else int(found.group(1))
