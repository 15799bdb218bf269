"""Driver of a DSLR or mirrorless camera on USB through libgphoto2 (LGPL): RAW files, read without development.

Such cameras are set in thirds of a stop and display rounded numbers: "1/60" is 1/64 s. An exposure time is therefore a
step, 2^(k/3) s, and the step that the camera reads back counts. A dial may be bumped between two images; hence all
settings are made and read back before each. The camera reports each file as an event: a file reported before the
trigger is refused, the JPEG beside a RAW file is discarded, and a trigger without a RAW file is lost.
"""

import hashlib
import importlib
import math
import time
from contextlib import suppress
from pathlib import PurePath
from typing import Any

from acquisition.devices import Frame, StopToken, image_file
from acquisition.devices.frame_accounting import BadFrameError
from acquisition.devices.image_file import ImageFile, IncompleteFileError
from acquisition.models.camera import CameraCapabilities, CameraSettings
from acquisition.models.camera_config import GphotoCameraConfig
from acquisition.models.errors import ErrorCode, Halted, RigError

STEPS_PER_STOP = 3
STEP_TOLERANCE = 0.02
"""Largest relative deviation of an exposure time from a third of a stop."""

NOMINAL_TOLERANCE = 0.1
"""Largest relative deviation of a displayed number from the step that it stands for ("1/60" is 1/64 s: 7 %)."""

POLL_MS, QUIET_MS = 50, 5
"""Waits, ms, for an event after a trigger, and for events that have come already."""

EXPOSURE_NAMES = ("shutterspeed", "shutterspeed2", "exptime")
"""Names of the exposure time by maker (Canon and Nikon; Nikon's fractions; others)."""

_MAKING_THE_IMAGE = ("iso", "f-number", "aperture", "imageformat", "imagequality")
_JPEG_SUFFIXES = frozenset({".jpg", ".jpeg"})


class GphotoCamera:
    """One camera; see the Protocol `CameraDriver`. Raises RigError config.invalid without the extra `dslr`."""

    def __init__(self, config: GphotoCameraConfig) -> None:
        self._config = config
        try:
            self._gp: Any = importlib.import_module("gphoto2")
            importlib.import_module("rawpy")
        except ImportError as error:
            detail = "The cell file names a 'gphoto' camera, but gphoto2 or rawpy is missing: install the extra `dslr`"
            raise RigError(ErrorCode.CONFIG_INVALID, detail) from error
        self._camera: Any = None
        self._exposure_name = ""
        self._steps: dict[int, str] = {}
        self._readable: tuple[str, ...] = ()
        self._digest = ""

    def connect(self) -> CameraCapabilities:
        """Opens the camera and makes all settings but the exposure time.

        Raises RigError camera.unreachable if there is no camera or another program holds it, config.invalid for a
        setting that the camera does not know.
        """
        self.close()
        gp = self._gp
        self._camera = camera = gp.Camera()
        try:
            self._choose(camera)
            camera.init()
            present = self._names(camera)
            self._exposure_name = next((name for name in EXPOSURE_NAMES if name in present), "")
            if not self._exposure_name:
                raise RigError(
                    ErrorCode.CONFIG_INVALID,
                    "The camera's exposure time cannot be set: set the camera to manual exposure",
                )
            self._steps = _steps(self._choices(camera, self._exposure_name))
            for name, value in self._config.settings.items():
                self._set(camera, name, value)
            summary = str(camera.get_abilities().model)
            self._readable = self._readable_names(camera, present)
            self._drain()
        except gp.GPhoto2Error as error:
            self.close()
            detail = f"The camera cannot be opened: {error}; does the desktop or another program hold it?"
            raise RigError(ErrorCode.CAMERA_UNREACHABLE, detail) from error
        except RigError:
            self.close()
            raise
        config = self._config
        return CameraCapabilities(
            name=summary,
            width=config.width,
            height=config.height,
            bits=config.bits,
            mosaic=config.mosaic,
            triggers=("software",),
            min_exposure_s=_seconds(min(self._steps)),
            max_exposure_s=_seconds(max(self._steps)),
        )

    def expose(self, exposure_s: float, attempt: int, stop: StopToken) -> Frame:
        """Takes one image; a real camera ignores `attempt`.

        Raises RigError request.invalid for an exposure time that is not a step of the camera, config.invalid for JPEG,
        camera.timeout, device.disconnected; BadFrameError; Halted as soon as the token is set.
        """
        if self._camera is None:
            raise RigError(ErrorCode.DEVICE_DISCONNECTED, "The camera is not open")
        if stop.is_set():
            raise Halted
        try:
            return self._expose(self._camera, exposure_s, stop)
        except self._gp.GPhoto2Error as error:
            if error.code in (self._gp.GP_ERROR_CAMERA_BUSY, self._gp.GP_ERROR_TIMEOUT):
                raise RigError(ErrorCode.CAMERA_TIMEOUT, f"The camera is busy: {error}") from error
            self.close()
            raise RigError(ErrorCode.DEVICE_DISCONNECTED, f"The camera does not answer: {error}") from error

    def restart(self) -> None:
        """Discards files that have come."""
        if self._camera is not None:
            with suppress(self._gp.GPhoto2Error):
                self._drain()

    def close(self) -> None:
        """Releases the camera."""
        camera, self._camera = self._camera, None
        if camera is not None:
            with suppress(self._gp.GPhoto2Error):
                camera.exit()

    # ---------------------------------------------------------------------------------------------------------- pieces

    def _choose(self, camera: Any) -> None:
        """Selects model and port if the cell file names the model."""
        if not self._config.model:
            return
        gp = self._gp
        found = gp.Camera.autodetect()
        known = {found.get_name(number): found.get_value(number) for number in range(found.count())}
        if self._config.model not in known:
            there = ", ".join(sorted(known)) or "none"
            detail = f"There is no camera {self._config.model}; present: {there}"
            raise RigError(ErrorCode.CAMERA_UNREACHABLE, detail)
        ports, abilities = gp.PortInfoList(), gp.CameraAbilitiesList()
        ports.load()
        abilities.load()
        camera.set_port_info(ports[ports.lookup_path(known[self._config.model])])
        camera.set_abilities(abilities[abilities.lookup_model(self._config.model)])

    def _expose(self, camera: Any, exposure_s: float, stop: StopToken) -> Frame:
        step = _step(exposure_s)
        if abs(exposure_s / _seconds(step) - 1) > STEP_TOLERANCE or step not in self._steps:
            nearest = _seconds(min(self._steps, key=lambda known: abs(known - math.log2(exposure_s) * STEPS_PER_STOP)))
            raise RigError(
                ErrorCode.REQUEST_INVALID, f"The camera has no exposure time of {exposure_s:g} s: use {nearest:g} s"
            )
        for name, value in self._config.settings.items():
            self._set(camera, name, value)
        self._set(camera, self._exposure_name, self._steps[step])
        settings = self._settings(camera)
        strangers = self._drain()
        if strangers:
            raise BadFrameError("late", f"{', '.join(strangers)} arrived without a trigger: refused")
        triggered_at = time.time()
        camera.trigger_capture()
        image = self._await_image(time.monotonic() + self._config.timeout_s + exposure_s, stop)
        digest = hashlib.sha256(image.pixels.tobytes()).hexdigest()
        if digest == self._digest:
            raise BadFrameError("doubled", "A file has exactly the same pixels as the previous one")
        self._digest = digest
        return Frame(image.pixels, settings.exposure_s, triggered_at + settings.exposure_s / 2, None, settings)

    def _await_image(self, deadline: float, stop: StopToken) -> ImageFile:
        while not stop.is_set():
            path = self._next_file(POLL_MS)
            if path is not None:
                content = self._take(path)
                if PurePath(path.name).suffix.lower() in _JPEG_SUFFIXES and self._has_companion(path):
                    continue
                try:
                    return image_file.read_raw(content, path.name, self._config.mosaic)
                except IncompleteFileError as error:
                    raise BadFrameError("damaged", str(error)) from error
            if time.monotonic() > deadline:
                detail = f"The camera gave no file within {self._config.timeout_s:.0f} s after the exposure"
                raise RigError(ErrorCode.CAMERA_TIMEOUT, detail)
        raise Halted

    def _has_companion(self, path: Any) -> bool:
        """Tells whether a RAW file of the same name lies beside a JPEG; it follows as an event of its own."""
        stem = PurePath(path.name).stem
        files = self._camera.folder_list_files(path.folder)
        names = [files.get_name(number) for number in range(files.count())]
        return any(PurePath(name).stem == stem and name != path.name for name in names)

    def _next_file(self, wait_ms: int) -> Any:
        """Returns the path of the next file that the camera reports; None if it reports none within the time."""
        gp = self._gp
        until = time.monotonic() + wait_ms * 1e-3
        while True:
            kind, data = self._camera.wait_for_event(wait_ms)
            if kind == gp.GP_EVENT_FILE_ADDED:
                return data
            if kind == gp.GP_EVENT_TIMEOUT or time.monotonic() > until:
                return None

    def _take(self, path: Any) -> bytes:
        """Copies a file and deletes it on the camera."""
        file = self._camera.file_get(path.folder, path.name, self._gp.GP_FILE_TYPE_NORMAL)
        # The file owns the memory, so it must live until the bytes are copied.
        content = bytes(memoryview(file.get_data_and_size()))
        self._camera.file_delete(path.folder, path.name)
        return content

    def _drain(self) -> list[str]:
        """Discards files that no trigger of ours caused; returns the names of all but JPEGs beside a RAW file."""
        names: list[str] = []
        while (path := self._next_file(QUIET_MS)) is not None:
            self._take(path)
            if PurePath(path.name).suffix.lower() not in _JPEG_SUFFIXES:
                names.append(str(path.name))
        return names

    def _settings(self, camera: Any) -> CameraSettings:
        """Returns the settings as the camera reads them back."""
        nominal = str(camera.get_single_config(self._exposure_name).get_value())
        step = next((step for step, choice in self._steps.items() if choice == nominal), None)
        other = [(name, str(camera.get_single_config(name).get_value())) for name in self._readable]
        return CameraSettings(
            exposure_s=0.0 if step is None else _seconds(step),
            pixel_format="RAW",
            width=self._config.width,
            height=self._config.height,
            other=tuple(other),
        )

    def _readable_names(self, camera: Any, present: set[str]) -> tuple[str, ...]:
        """Returns the settings of the fingerprint: the cell file's and those that affect the image, if readable.

        Models list some settings that they cannot read.
        """
        names: list[str] = []
        for name in sorted({*self._config.settings, *_MAKING_THE_IMAGE} & present):
            with suppress(self._gp.GPhoto2Error):
                camera.get_single_config(name)
                names.append(name)
        return tuple(names)

    def _names(self, camera: Any) -> set[str]:
        known = camera.list_config()
        return {known.get_name(number) for number in range(known.count())}

    def _choices(self, camera: Any, name: str) -> list[str]:
        return [str(choice) for choice in camera.get_single_config(name).get_choices()]

    def _set(self, camera: Any, name: str, value: str) -> None:
        """Raises RigError config.invalid for a name or value that the camera does not know."""
        if name not in self._names(camera):
            raise RigError(ErrorCode.CONFIG_INVALID, f"The camera has no setting {name!r}")
        widget = camera.get_single_config(name)
        if widget.get_type() in (self._gp.GP_WIDGET_RADIO, self._gp.GP_WIDGET_MENU):
            choices = [str(choice) for choice in widget.get_choices()]
            if value not in choices:
                detail = f"The camera's setting {name} does not allow {value!r}; allowed: {', '.join(choices)}"
                raise RigError(ErrorCode.CONFIG_INVALID, detail)
        widget.set_value(value)
        camera.set_single_config(name, widget)


def _step(exposure_s: float) -> int:
    return round(STEPS_PER_STOP * math.log2(exposure_s))


def _seconds(step: int) -> float:
    return float(2 ** (step / STEPS_PER_STOP))


def _steps(choices: list[str]) -> dict[int, str]:
    """Maps each step to the camera's choice; leaves out what is not a number ("bulb") or not a third of a stop.

    Raises RigError config.invalid if none is left.
    """
    known: dict[int, str] = {}
    for choice in choices:
        above, _, below = choice.removesuffix("s").partition("/")
        with suppress(ValueError, ZeroDivisionError):
            exposure_s = float(above) / float(below or 1)
            if exposure_s > 0 and abs(exposure_s / _seconds(_step(exposure_s)) - 1) < NOMINAL_TOLERANCE:
                known.setdefault(_step(exposure_s), choice)
    if not known:
        raise RigError(ErrorCode.CONFIG_INVALID, f"The camera's exposure times cannot be read: {', '.join(choices)}")
    return known
