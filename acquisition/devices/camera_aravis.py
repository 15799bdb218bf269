"""Driver of a GigE Vision or USB3 Vision camera of any maker through Aravis (LGPL), by its GObject introspection.

The acquisition runs continuously and each frame waits for its trigger: cameras take up to a second to start an
acquisition, and frame identifiers keep counting only within one. A frame that arrives before its own trigger belongs to
an earlier one, whatever its number is. Each buffer has a status; one whose packets do not all arrive within Aravis' own
time limits is rejected as damaged. After any doubt the acquisition is ended, pending frames are discarded, and a new
acquisition begins.

Aravis and GObject introspection come with the system (Debian: gir1.2-aravis-0.8, python3-gi). They are loaded only if a
cell file asks for them.
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
from acquisition.models.camera_config import AravisCameraConfig
from acquisition.models.colour import mosaic_of
from acquisition.models.errors import ErrorCode, Halted, RigError

POLL_US = 50_000
"""Period, µs, of checks of the stop token while waiting for a frame."""

BUFFERS = 4
"""Buffers of the stream. One frame is requested at a time; the other buffers hold frames that nobody requested."""

LAST_SHORT_ID = 65_535
"""Frame identifiers of GigE Vision 1 run from 1 to this value and start again at 1."""

GAIN_STEP = 0.1
"""Largest difference between the gain read back and the one set: makers step by 0.1 dB or less."""

_CHUNK = "ExposureTime"
_TEMPERATURE, _BLACK_LEVEL = "DeviceTemperature", "BlackLevel"


class AravisCamera:
    """One camera; see the Protocol `CameraDriver`. Raises RigError config.invalid without Aravis."""

    def __init__(self, config: AravisCameraConfig, pulse: Callable[[], None] | None = None) -> None:
        """`pulse` raises and lowers the line that is wired to the camera; without it, the trigger is by software."""
        self._config = config
        self._pulse = pulse if config.trigger == "hardware" else None
        try:
            gi: Any = importlib.import_module("gi")
            gi.require_version("Aravis", "0.8")
            self._aravis: Any = importlib.import_module("gi.repository.Aravis")
            self._error: Any = importlib.import_module("gi.repository.GLib").Error
        except (ImportError, ValueError) as error:
            detail = (
                "The cell file names a camera of kind 'aravis', but Aravis is missing:"
                " install gir1.2-aravis-0.8 and python3-gi (docs/how-to/aravis-camera.md)"
            )
            raise RigError(ErrorCode.CONFIG_INVALID, detail) from error
        self._camera: Any = None
        self._chunks: Any = None  # reads the chunks of a buffer; None if the camera does not send the exposure time
        self._stream: Any = None
        self._number = 0
        self._last_id: int | None = None

    def connect(self) -> CameraCapabilities:
        """Opens the camera, makes all settings but the exposure time, and starts the acquisition.

        Raises RigError camera.unreachable if no camera answers to this name or another program controls it,
        config.invalid for a pixel format, size, gain or trigger that the camera does not have.
        """
        self.close()
        try:
            camera = self._aravis.Camera.new(self._config.device)
        except self._error as error:
            raise RigError(ErrorCode.CAMERA_UNREACHABLE, self._absence(error)) from error
        device = camera.get_device()
        if isinstance(device, self._aravis.GvDevice) and not device.is_controller():
            detail = f"Another program controls the camera {self._config.device}: end that program"
            raise RigError(ErrorCode.CAMERA_UNREACHABLE, detail)
        try:
            self._camera = camera
            self._set_up(camera)
            self._begin()
            return self._capabilities(camera)
        except RigError:
            self.close()
            raise
        except self._error as error:
            self.close()
            raise RigError(
                ErrorCode.CONFIG_INVALID,
                f"The camera {self._config.device} refuses a setting of the cell file: {error.message}",
            ) from error

    def expose(self, exposure_s: float, attempt: int, stop: StopToken) -> Frame:
        """Takes one frame; a real camera ignores `attempt`.

        Raises BadFrameError, RigError camera.timeout, device.disconnected; Halted as soon as the token is set.
        """
        if self._camera is None:
            raise RigError(ErrorCode.DEVICE_DISCONNECTED, "The camera is not open")
        if stop.is_set():
            raise Halted
        try:
            self._camera.set_exposure_time(exposure_s * 1e6)
            settings = self._settings(self._camera)
            temperature = self._float(self._camera.get_device(), _TEMPERATURE)
            triggered_at = time.time()
            if self._pulse is not None:
                self._pulse()
            else:
                self._camera.software_trigger()
            pixels, had_s = self._receive(triggered_at, exposure_s, stop)
        except self._error as error:
            self.close()
            raise RigError(ErrorCode.DEVICE_DISCONNECTED, f"The camera does not answer: {error.message}") from error
        exposure_s = had_s or settings.exposure_s
        return Frame(pixels, exposure_s, triggered_at + exposure_s / 2, self._number, settings, temperature)

    def restart(self) -> None:
        """Ends the acquisition, discards pending frames, and begins anew. Raises RigError device.disconnected."""
        if self._camera is None:
            raise RigError(ErrorCode.DEVICE_DISCONNECTED, "The camera is not open")
        try:
            self._camera.stop_acquisition()
            self._begin()
        except self._error as error:
            self.close()
            raise RigError(ErrorCode.DEVICE_DISCONNECTED, f"The camera does not answer: {error.message}") from error

    def close(self) -> None:
        """Ends the acquisition and releases control of the camera."""
        camera, self._camera, self._stream = self._camera, None, None
        if camera is not None:
            device = camera.get_device()
            try:
                camera.stop_acquisition()
                # An error's traceback may keep the object alive, and with it the control of the camera.
                if isinstance(device, self._aravis.GvDevice):
                    device.leave_control()
            except self._error:
                return  # the camera is gone, and its acquisition with it

    # ---------------------------------------------------------------------------------------------------------- pieces

    def _set_up(self, camera: Any) -> None:
        config, device = self._config, camera.get_device()
        # Without this check Aravis writes values out of range, and their effect depends on the camera.
        device.set_range_check_policy(self._aravis.RangeCheckPolicy.ENABLE)
        features = _Features(device)
        genicam.reset(features, config.settings)
        camera.set_pixel_format_from_string(config.pixel_format)
        genicam.set_region(features, config.width, config.height, config.settings)
        if camera.is_gain_available():
            camera.set_gain(camera.get_gain_bounds()[0] if config.gain is None else config.gain)
        camera.set_acquisition_mode(self._aravis.AcquisitionMode.CONTINUOUS)
        genicam.set_trigger(features, config.trigger_source if self._pulse is not None else "Software")
        self._chunks = self._chunk_parser(camera)
        self._require_taken(camera)

    def _chunk_parser(self, camera: Any) -> Any:
        """Makes each frame carry the exposure time that it had; None if the camera has no such chunk."""
        if not camera.are_chunks_available():
            return None
        try:
            camera.set_chunks(_CHUNK)
        except self._error:
            return None
        return camera.create_chunk_parser()

    def _require_taken(self, camera: Any) -> None:
        """Raises RigError config.invalid for a setting that the camera has silently rounded or clipped."""
        config, settings = self._config, self._settings(camera)
        asked = (
            ("pixel_format", config.pixel_format, settings.pixel_format),
            ("width", config.width, settings.width),
            ("height", config.height, settings.height),
        )
        wrong = [
            f"{name}: {wanted} was set, but the camera reports {got}"
            for name, wanted, got in asked
            if wanted not in (None, got)
        ]
        if config.gain is not None and (settings.gain is None or abs(settings.gain - config.gain) > GAIN_STEP):
            wrong.append(f"gain: {config.gain} was set, but the camera reports {settings.gain}")
        wrong += genicam.disagreements(_Features(camera.get_device()), config.settings)
        if wrong:
            raise RigError(
                ErrorCode.CONFIG_INVALID,
                f"The camera {config.device} does not fit the cell file: {'; '.join(wrong)}",
            )

    def _begin(self) -> None:
        """Starts an acquisition with a new stream, so that no buffer of an earlier one can come out of it."""
        self._stream = None
        self._stream = stream = self._camera.create_stream(None, None)
        payload = self._camera.get_payload()
        for _ in range(BUFFERS):
            stream.push_buffer(self._aravis.Buffer.new_allocate(payload))
        self._last_id = None
        self._camera.start_acquisition()

    def _receive(
        self, triggered_at: float, exposure_s: float, stop: StopToken
    ) -> tuple[npt.NDArray[np.uint16], float | None]:
        """Returns the frame and the exposure time, s, that the frame reports."""
        deadline = time.monotonic() + self._config.timeout_s + exposure_s
        while not stop.is_set():
            buffer = self._stream.timeout_pop_buffer(POLL_US)
            if buffer is not None:
                try:
                    pixels = self._pixels(buffer, triggered_at)
                    had = None if self._chunks is None else self._chunks.get_float_value(buffer, f"Chunk{_CHUNK}")
                    return pixels, None if had is None else float(had) * 1e-6
                finally:
                    self._stream.push_buffer(buffer)
            if time.monotonic() > deadline:
                self._camera.get_exposure_time()  # fails if the camera itself is gone
                detail = f"The camera sent no frame within {self._config.timeout_s:.0f} s after the exposure"
                raise RigError(ErrorCode.CAMERA_TIMEOUT, detail)
        raise Halted

    def _pixels(self, buffer: Any, triggered_at: float) -> npt.NDArray[np.uint16]:
        """Returns the pixels of a complete buffer and counts the frame."""
        self._count(int(buffer.get_frame_id()))
        status = buffer.get_status()
        if status != self._aravis.BufferStatus.SUCCESS:
            raise BadFrameError("damaged", f"Frame {self._number} is incomplete: {status.value_nick}")
        begun_at = buffer.get_system_timestamp() * 1e-9
        if begun_at < triggered_at:
            early = triggered_at - begun_at
            raise BadFrameError("late", f"Frame {self._number} arrived {early:.3f} s before its trigger")
        width, height = buffer.get_image_width(), buffer.get_image_height()
        data = bytes(buffer.get_data())
        kind = np.dtype("<u2") if len(data) >= 2 * width * height else np.dtype("u1")
        if len(data) < width * height * kind.itemsize:
            raise BadFrameError(
                "damaged", f"Frame {self._number} has only {len(data)} bytes for {width} × {height} pixels"
            )
        pixels = np.frombuffer(data, kind, width * height).reshape(height, width)
        return pixels.astype(np.uint16)

    def _count(self, identifier: int) -> None:
        last = self._last_id
        step = 1 if last is None else identifier - last
        if step < 0 and last is not None and last <= LAST_SHORT_ID and step < -LAST_SHORT_ID // 2:
            step += LAST_SHORT_ID
        self._number, self._last_id = self._number + step, identifier

    def _settings(self, camera: Any) -> CameraSettings:
        """Returns the settings as the camera reads them back."""
        device = camera.get_device()
        _, _, width, height = _rectangle(camera.get_region())
        return CameraSettings(
            exposure_s=float(camera.get_exposure_time()) * 1e-6,
            pixel_format=str(camera.get_pixel_format_as_string()),
            width=width,
            height=height,
            gain=float(camera.get_gain()) if camera.is_gain_available() else None,
            black_level=self._float(device, _BLACK_LEVEL),
            trigger="software" if self._pulse is None else "hardware",
            other=genicam.report(_Features(device), self._config.settings),
        )

    def _capabilities(self, camera: Any) -> CameraCapabilities:
        settings, device = self._settings(camera), camera.get_device()
        shortest, longest = camera.get_exposure_time_bounds()
        digits = "".join(filter(str.isdigit, settings.pixel_format))
        who = (camera.get_vendor_name(), camera.get_model_name(), camera.get_device_serial_number())
        return CameraCapabilities(
            name=" ".join(str(part) for part in who if part),
            width=settings.width,
            height=settings.height,
            bits=self._config.bits or int(digits or 8),
            mosaic=mosaic_of(settings.pixel_format),
            triggers=("software", "hardware"),
            min_exposure_s=float(shortest) * 1e-6,
            max_exposure_s=float(longest) * 1e-6,
            black_level=settings.black_level is not None,
            temperature=_has(device, _TEMPERATURE),
            frame_numbers=True,
            chunk_exposure=self._chunks is not None,
        )

    def _float(self, device: Any, name: str) -> float | None:
        """Returns a value that is a floating-point or an integer feature, depending on the maker; None without it."""
        return float(device.get_feature(name).get_value_as_string()) if _has(device, name) else None

    def _absence(self, error: Any) -> str:
        present = [self._aravis.get_device_id(number) for number in range(self._aravis.get_n_devices())]
        names = ", ".join(sorted(present)) or "none"
        return f"No camera answers to {self._config.device}: {error.message}; present: {names}"


class _Features:
    """The device's features as `genicam.Features`."""

    def __init__(self, device: Any) -> None:
        self._device = device

    def readable(self, name: str) -> bool:
        """Whether the camera has the feature."""
        return _has(self._device, name)

    def writable(self, name: str) -> bool:
        """Whether the feature can be set now."""
        return _has(self._device, name) and not self._device.get_feature(name).is_locked()

    def get(self, name: str) -> str:
        """Returns the value."""
        return str(self._device.get_feature(name).get_value_as_string()) if self.readable(name) else ""

    def set(self, name: str, value: str) -> None:
        """Sets the value. Raises GLib.Error."""
        self._device.get_feature(name).set_value_from_string(value)

    def choices(self, name: str) -> Sequence[str]:
        """Returns the values of an enumeration."""
        return [str(choice) for choice in self._device.dup_available_enumeration_feature_values_as_strings(name)]


def _has(device: Any, name: str) -> bool:
    return bool(device.is_feature_available(name))


def _rectangle(region: Any) -> tuple[int, int, int, int]:
    """x, y, width and height of a region."""
    x, y, width, height = region
    return int(x), int(y), int(width), int(height)
