"""Driver of a Basler camera through the maker's own library: one trigger per frame, all automatic functions off.

Each exposure starts and stops the grabbing of exactly one frame. That costs about a millisecond, and a frame that was
given up can never be taken for the next one. A frame's number is the count of acquisitions plus the frame's place in
its own acquisition: a frame that is not the first of its acquisition shows as a gap. Whatever the camera could do to
the pixels by itself (automatic exposure and gain, gamma, white balance) is switched off if the model has it, because
photometric stereo needs linear pixels. The library is loaded only if a cell file asks for it.
"""

import importlib
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from acquisition.devices import Frame, StopToken, genicam
from acquisition.devices.frame_accounting import BadFrameError
from acquisition.models.camera import CameraCapabilities, CameraSettings
from acquisition.models.camera_config import PylonCameraConfig
from acquisition.models.colour import mosaic_of
from acquisition.models.errors import ErrorCode, Halted, RigError

POLL_MS = 50  # within which a stop token is seen
READY_S = 2.0  # after which a camera that is not ready for its trigger counts as stuck
_CHUNK = "ExposureTime"  # which each frame carries if the model has such a chunk


class PylonCamera:
    """One Basler camera; see the Protocol `CameraDriver`. Raises RigError config.invalid without the extra `basler`."""

    def __init__(self, config: PylonCameraConfig, pulse: Callable[[], None] | None = None) -> None:
        """`pulse` raises and lowers the line that is wired to the camera; without it, the trigger is by software."""
        self._config = config
        self._pulse = pulse if config.trigger == "hardware" else None
        self._has_chunk = False
        try:
            self._pylon: Any = importlib.import_module("pypylon.pylon")
        except ImportError as error:
            detail = "The cell file names a Basler camera, but pypylon is missing: install the extra `basler`."
            raise RigError(ErrorCode.CONFIG_INVALID, detail) from error
        self._camera: Any = None
        self._acquisitions = 0
        self._first_block: int | None = None  # number that this model gives to the first frame of an acquisition

    def connect(self) -> CameraCapabilities:
        """Opens the camera and makes all settings but the exposure time.

        Raises RigError camera.unreachable if no camera has this serial number or another program holds it,
        config.invalid if the camera does not know the pixel format or the gain.
        """
        self.close()
        factory = self._pylon.TlFactory.GetInstance()
        serials = {device.GetSerialNumber(): device for device in factory.EnumerateDevices()}
        if self._config.serial not in serials:
            present = ", ".join(sorted(serials)) or "none"
            detail = f"No Basler camera with serial number {self._config.serial} answers; present: {present}."
            raise RigError(ErrorCode.CAMERA_UNREACHABLE, detail)
        try:
            camera = self._pylon.InstantCamera(factory.CreateDevice(serials[self._config.serial]))
            camera.Open()
        except self._pylon.GenericException as error:
            detail = f"The camera {self._config.serial} cannot be opened: {error}"
            raise RigError(ErrorCode.CAMERA_UNREACHABLE, detail) from error
        try:
            self._set_up(camera)
        except self._pylon.GenericException as error:
            camera.Close()
            detail = f"The camera {self._config.serial} refuses a setting of the cell file: {error}"
            raise RigError(ErrorCode.CONFIG_INVALID, detail) from error
        except RigError:
            camera.Close()
            raise
        self._camera = camera
        known = self._capabilities(camera, f"Basler {camera.GetDeviceInfo().GetModelName()} {self._config.serial}")
        return known.model_copy(update={"chunk_exposure": self._has_chunk})

    def expose(self, exposure_s: float, attempt: int, stop: StopToken) -> Frame:
        """Takes one frame; a real camera ignores `attempt`.

        Raises RigError request.invalid for an exposure time beyond the cell file's limits, camera.timeout,
        device.disconnected; Halted as soon as the token is set.
        """
        self._config.require_exposure(exposure_s)
        if self._camera is None:
            raise RigError(ErrorCode.DEVICE_DISCONNECTED, "The camera is not open.")
        if stop.is_set():
            raise Halted
        try:
            return self._expose(self._camera, exposure_s, stop)
        except self._pylon.GenericException as error:
            if self._camera.IsCameraDeviceRemoved():
                self.close()
                raise RigError(
                    ErrorCode.DEVICE_DISCONNECTED, f"The connection to the camera is lost: {error}"
                ) from error
            raise RigError(ErrorCode.CAMERA_TIMEOUT, f"The camera took no frame: {error}") from error

    def restart(self) -> None:
        """Does nothing: each exposure ends its own acquisition, so nothing is under way."""

    def close(self) -> None:
        """Releases the camera, so that others can open it."""
        if self._camera is not None:
            self._camera.Close()
            self._camera = None

    def _set_up(self, camera: Any) -> None:
        config, features = self._config, _Features(camera)
        genicam.reset(features, config.settings)
        camera.PixelFormat.Value = config.pixel_format
        genicam.set_region(features, config.width, config.height, config.settings)
        gain = camera.Gain if _present(camera, "Gain") else camera.GainRaw
        gain.Value = gain.Min if config.gain is None else type(gain.Value)(config.gain)
        camera.AcquisitionMode.Value = "Continuous"
        genicam.set_trigger(features, "Software" if self._pulse is None else config.trigger_source)
        self._has_chunk = _enable_chunk(camera)
        wrong = genicam.disagreements(features, config.settings)
        if wrong:
            detail = f"The camera {config.serial} does not fit the cell file: {'; '.join(wrong)}"
            raise RigError(ErrorCode.CONFIG_INVALID, detail)

    def _expose(self, camera: Any, exposure_s: float, stop: StopToken) -> Frame:
        _exposure_node(camera).Value = exposure_s * 1e6
        settings = self._settings(camera)
        self._acquisitions += 1
        camera.StartGrabbingMax(1)
        try:
            if not camera.WaitForFrameTriggerReady(int(READY_S * 1000), self._pylon.TimeoutHandling_Return):
                detail = f"The camera was not ready for its trigger within {READY_S:g} s."
                raise RigError(ErrorCode.CAMERA_TIMEOUT, detail)
            taken_at = time.time()
            if self._pulse is None:
                camera.ExecuteSoftwareTrigger()
            else:
                self._pulse()
            pixels, place, had_s = self._retrieve(camera, time.monotonic() + self._config.timeout_s + exposure_s, stop)
        finally:
            camera.StopGrabbing()
        taken_at += settings.exposure_s / 2
        number = self._acquisitions + place
        return Frame(pixels, had_s or settings.exposure_s, taken_at, number, settings, _temperature(camera))

    def _retrieve(
        self, camera: Any, deadline: float, stop: StopToken
    ) -> tuple[npt.NDArray[np.uint16], int, float | None]:
        """Returns the frame, its place in its acquisition from 0, and the exposure time, s, that it reports."""
        while not stop.is_set():
            result = camera.RetrieveResult(POLL_MS, self._pylon.TimeoutHandling_Return)
            if result.IsValid():
                with result:
                    if not result.GrabSucceeded():
                        detail = f"The camera's frame is broken: {result.GetErrorDescription()}"
                        raise BadFrameError("damaged", detail)
                    block = int(result.GetBlockID())
                    if self._first_block is None:
                        self._first_block = block
                    had_s = float(result.ChunkExposureTime.Value) * 1e-6 if self._has_chunk else None
                    return np.array(result.Array, dtype=np.uint16), block - self._first_block, had_s
            if time.monotonic() > deadline:
                detail = f"The camera sent no complete frame within {self._config.timeout_s:.0f} s after the exposure."
                raise RigError(ErrorCode.CAMERA_TIMEOUT, detail)
        raise Halted

    def _capabilities(self, camera: Any, name: str) -> CameraCapabilities:
        settings, exposure = self._settings(camera), _exposure_node(camera)
        digits = "".join(filter(str.isdigit, settings.pixel_format))
        return CameraCapabilities(
            name=name,
            width=settings.width,
            height=settings.height,
            bits=int(digits or 8),
            mosaic=mosaic_of(settings.pixel_format),
            triggers=("software", "hardware"),
            min_exposure_s=float(exposure.Min) * 1e-6,
            max_exposure_s=float(exposure.Max) * 1e-6,
            black_level=settings.black_level is not None,
            temperature=_temperature(camera) is not None,
            frame_numbers=True,
        )

    def _settings(self, camera: Any) -> CameraSettings:
        """Returns the settings as the camera reads them back."""
        gain, black = (_number(camera, names) for names in (("Gain", "GainRaw"), ("BlackLevel", "BlackLevelRaw")))
        return CameraSettings(
            exposure_s=float(_exposure_node(camera).Value) * 1e-6,
            pixel_format=str(camera.PixelFormat.Value),
            width=int(camera.Width.Value),
            height=int(camera.Height.Value),
            gain=gain,
            black_level=black,
            trigger="software" if self._pulse is None else "hardware",
            other=genicam.report(_Features(camera), self._config.settings),
        )


class _Features:
    """The camera's nodes as `genicam.Features`."""

    def __init__(self, camera: Any) -> None:
        self._camera = camera

    def readable(self, name: str) -> bool:
        """Whether the model has the node and states its value."""
        return _readable(self._camera, name)

    def writable(self, name: str) -> bool:
        """Whether the node can be set now."""
        return _present(self._camera, name)

    def get(self, name: str) -> str:
        """Returns the value."""
        return str(getattr(self._camera, name).ToString()) if self.readable(name) else ""

    def set(self, name: str, value: str) -> None:
        """Sets the value. Raises GenericException."""
        getattr(self._camera, name).FromString(value)

    def choices(self, name: str) -> Sequence[str]:
        """Returns the values of an enumeration."""
        return [str(choice) for choice in getattr(self._camera, name).Symbolics]


def _enable_chunk(camera: Any) -> bool:
    """Makes each frame carry the exposure time that it had; False if the model has no such chunk."""
    if not (_present(camera, "ChunkModeActive") and _readable(camera, "ChunkSelector")):
        return False
    if _CHUNK not in camera.ChunkSelector.Symbolics:
        return False
    camera.ChunkModeActive.Value = True
    camera.ChunkSelector.Value = _CHUNK
    camera.ChunkEnable.Value = True
    return True


def _temperature(camera: Any) -> float | None:
    return _number(camera, ("DeviceTemperature", "TemperatureAbs"))


def _number(camera: Any, names: tuple[str, ...]) -> float | None:
    """Returns the value of the first node that the model has; None if it has none."""
    return next((float(getattr(camera, name).Value) for name in names if _readable(camera, name)), None)


def _exposure_node(camera: Any) -> Any:
    return camera.ExposureTime if _present(camera, "ExposureTime") else camera.ExposureTimeAbs


def _readable(camera: Any, name: str) -> bool:
    return bool(getattr(camera, name).IsReadable())


def _present(camera: Any, name: str) -> bool:
    """Tells whether the model has this node; a missing one reads as a placeholder that cannot be written."""
    return bool(getattr(camera, name).IsWritable())
