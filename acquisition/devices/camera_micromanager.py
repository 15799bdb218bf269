"""Driver of a camera through Micro-Manager's core (BSD and LGPL): one of its 300 device adapters, by name.

`snapImage` starts one exposure and waits for it, so that a frame cannot belong to another trigger; the adapter reads
its properties back itself. The core's library is `pymmcore`. The adapters are Micro-Manager's; the core checks on
loading that they have the same device interface version.
"""

import importlib
import time
from typing import Any, NoReturn

import numpy as np

from acquisition.devices import Frame, StopToken
from acquisition.devices.frame_accounting import BadFrameError
from acquisition.models.camera import CameraCapabilities, CameraSettings
from acquisition.models.camera_config import MicromanagerCameraConfig
from acquisition.models.errors import ErrorCode, Halted, RigError

LABEL = "camera"
"""Name of the device within the core."""

_TEMPERATURE = ("CCDTemperature RO", "CCDTemperature")
_UNFIXED = frozenset({"Exposure", "Binning", *_TEMPERATURE})
"""Properties that change by themselves, or that stand elsewhere in the settings."""


class MicromanagerCamera:
    """One device; see the Protocol `CameraDriver`. Raises RigError config.invalid without the extra `micromanager`."""

    def __init__(self, config: MicromanagerCameraConfig) -> None:
        self._config = config
        try:
            self._pymmcore: Any = importlib.import_module("pymmcore")
        except ImportError as error:
            detail = (
                "The cell file names a 'micromanager' camera, but pymmcore is missing: install the extra `micromanager`"
            )
            raise RigError(ErrorCode.CONFIG_INVALID, detail) from error
        self._core: Any = None
        self._number = 0

    def connect(self) -> CameraCapabilities:
        """Loads the adapter and sets the cell file's properties.

        Raises RigError camera.unreachable if the device does not answer, config.invalid for an adapter, device or
        property that does not exist.
        """
        self.close()
        config = self._config
        core = self._pymmcore.CMMCore()
        core.setDeviceAdapterSearchPaths([config.adapters])
        try:
            core.loadDevice(LABEL, config.adapter, config.device)
        except RuntimeError as error:
            detail = f"{config.adapters} has no device {config.adapter}, {config.device}: {error}"
            raise RigError(ErrorCode.CONFIG_INVALID, detail) from error
        try:
            core.initializeDevice(LABEL)
            core.setCameraDevice(LABEL)
            core.setTimeoutMs(int(1000 * config.timeout_s))
        except RuntimeError as error:
            detail = f"{config.adapter}, {config.device} does not answer: {error}"
            raise RigError(ErrorCode.CAMERA_UNREACHABLE, detail) from error
        self._core = core
        try:
            self._set(core)
        except RuntimeError as error:
            self.close()
            raise RigError(ErrorCode.CONFIG_INVALID, f"{config.device} refuses a property: {error}") from error
        # One frame fixes width, height and depth: adapters state them only after it.
        core.snapImage()
        pixels = core.getImage()
        if pixels.ndim != 2 or pixels.dtype not in (np.uint8, np.uint16):
            self.close()
            detail = f"{config.device} gives {pixels.dtype} of shape {pixels.shape}: set a grey pixel type"
            raise RigError(ErrorCode.CONFIG_INVALID, detail)
        return CameraCapabilities(
            name=f"{config.adapter} {config.device}",
            width=int(pixels.shape[1]),
            height=int(pixels.shape[0]),
            bits=int(core.getImageBitDepth()),
            mosaic=config.mosaic,
            triggers=("software",),
            min_exposure_s=config.min_exposure_s,
            max_exposure_s=config.max_exposure_s,
            temperature=self._temperature(core) is not None,
            frame_numbers=True,
        )

    def expose(self, exposure_s: float, attempt: int, stop: StopToken) -> Frame:
        """Takes one frame; a real camera ignores `attempt`. The stop token is checked before and after the exposure.

        Raises BadFrameError for a frame that the adapter gives up, RigError device.disconnected, Halted.
        """
        core = self._core
        if core is None:
            raise RigError(ErrorCode.DEVICE_DISCONNECTED, "The camera is not open")
        if stop.is_set():
            raise Halted
        try:
            self._set(core)
            core.setExposure(1000 * exposure_s)
            settings = self._settings(core)
            temperature = self._temperature(core)
            begun_at = time.time()
            core.snapImage()
            pixels = np.array(core.getImage())
        except RuntimeError as error:
            self._raise_fault(core, error)
        if stop.is_set():
            raise Halted
        self._number += 1
        taken_at = begun_at + settings.exposure_s / 2
        return Frame(pixels.astype(np.uint16), settings.exposure_s, taken_at, self._number, settings, temperature)

    def restart(self) -> None:
        """Does nothing: frames are requested and waited for in one call."""

    def close(self) -> None:
        """Unloads the adapter."""
        core, self._core = self._core, None
        if core is not None:
            core.unloadAllDevices()

    # ---------------------------------------------------------------------------------------------------------- pieces

    def _set(self, core: Any) -> None:
        """Sets the cell file's properties. Raises RuntimeError with name and value of a refused one."""
        for name, value in self._config.properties.items():
            try:
                core.setProperty(LABEL, name, value)
            except RuntimeError as error:
                raise RuntimeError(f"{name} = {value!r}: {error}") from error

    def _raise_fault(self, core: Any, error: RuntimeError) -> NoReturn:
        """Raises BadFrameError for a lost frame, RigError for a device that is gone: it states no exposure time."""
        try:
            core.getProperty(LABEL, "Name")
            core.getExposure()
        except RuntimeError:
            self.close()
            raise RigError(ErrorCode.DEVICE_DISCONNECTED, f"The camera does not answer: {error}") from error
        raise BadFrameError("lost", f"The adapter gave no frame: {error}") from error

    def _settings(self, core: Any) -> CameraSettings:
        """Returns the settings as the adapter reads them back."""
        names = [str(name) for name in core.getDevicePropertyNames(LABEL)]
        values = {name: str(core.getProperty(LABEL, name)) for name in names if name not in _UNFIXED}
        return CameraSettings(
            exposure_s=float(core.getExposure()) * 1e-3,
            pixel_format=values.pop("PixelType", f"{core.getImageBitDepth()} bits"),
            width=int(core.getImageWidth()),
            height=int(core.getImageHeight()),
            gain=float(values.pop("Gain")) if "Gain" in values else None,
            other=tuple(sorted(values.items())),
        )

    def _temperature(self, core: Any) -> float | None:
        name = next((name for name in _TEMPERATURE if core.hasProperty(LABEL, name)), None)
        return None if name is None else float(core.getProperty(LABEL, name))
