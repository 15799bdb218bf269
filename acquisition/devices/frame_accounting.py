"""Frame accounting: each trigger gives one frame with the requested settings, or none.

A frame under the wrong label is worse than no frame: it is solved with the wrong light, and nothing looks wrong. So the
frames of every driver are checked here by the same rules: size, serial number, settings as read back, exposure time.
Every failure is reported (to the log and to the listeners), counted, and the frame is taken again. Before that the
driver discards what is still under way, because a frame that was given up may still arrive. A camera that is gone is
not a lost frame: it is waited for (`take_up`), and its settings are made and read back anew.
"""

import logging
import time
from collections import Counter

from acquisition.devices import CameraDriver, CameraFault, FaultListener, Frame, StopToken
from acquisition.models.camera import CameraCapabilities, CameraSettings, FaultKind
from acquisition.models.camera_config import CameraConfig
from acquisition.models.errors import ErrorCode, Halted, RigError

_log = logging.getLogger(__name__)

RETAKES = 5
"""How often a frame is taken again before the session is interrupted. At a loss of one frame in four (a GigE link that
loses one packet in a thousand) six in a row are lost once in 4,000 frames, and then the link needs a person."""

RECONNECT_EVERY_S = 1.0
"""Period, s, of attempts to connect a camera that is gone."""

EXPOSURE_TOLERANCE, EXPOSURE_STEP_S = 0.02, 1e-6
"""Tolerance of the exposure time read back: relative, and in addition one step of a camera's clock, s. Cameras round to
lines of 5–40 µs; 2 % is the least deviation of the lamp's intensity from image to image."""

GONE = frozenset({ErrorCode.DEVICE_DISCONNECTED, ErrorCode.CAMERA_UNREACHABLE})
"""Codes by which a driver reports that the camera itself is not there."""


class BadFrameError(RigError):
    """A frame that does not count: camera.timeout with the kind of fault."""

    def __init__(self, kind: FaultKind, detail: str) -> None:
        super().__init__(ErrorCode.CAMERA_TIMEOUT, detail, fault=kind)
        self.kind: FaultKind = kind


class AccountedCamera:
    """A camera whose every frame is checked; see the Protocol `Camera`. Used by one thread at a time."""

    def __init__(self, driver: CameraDriver, config: CameraConfig) -> None:
        self.driver = driver
        self._config = config
        self._listeners: list[FaultListener] = []
        self._capabilities: CameraCapabilities | None = None
        self._settings: CameraSettings | None = None  # of the first good frame; later frames must have the same
        self._number: int | None = None  # of the last good frame; None if any number may be next
        self._connected = self._gone = False
        self._under_way = False  # a trigger was sent whose frame may still come
        self.counts: Counter[str] = Counter()

    @property
    def capabilities(self) -> CameraCapabilities | None:
        """What the camera reported at the last connection; None if it was never connected."""
        return self._capabilities

    @property
    def is_gone(self) -> bool:
        """Whether the camera failed to answer at the last exposure."""
        return self._gone

    def listen(self, listener: FaultListener) -> None:
        """Adds a listener, which is called with every fault."""
        self._listeners.append(listener)

    def connect(self) -> None:
        """Opens the camera; the settings of earlier frames no longer bind later ones.

        Raises RigError camera.unreachable, config.invalid.
        """
        self._settings = None
        self._open()

    def expose(self, exposure_s: float, attempt: int, stop: StopToken) -> Frame:
        """Takes one frame, again if it is lost or bad; a camera that was gone is tried once.

        Raises RigError request.invalid for an exposure time beyond the cell file's limits, camera.timeout,
        device.disconnected, camera.unreachable, config.invalid; Halted as soon as the token is set.
        """
        self._config.require_exposure(exposure_s)
        for remaining in range(RETAKES, -1, -1):
            try:
                return self._expose(exposure_s, attempt, stop)
            except RigError as error:
                if error.code in GONE:
                    self._lose(error)
                    raise
                if error.code is not ErrorCode.CAMERA_TIMEOUT:
                    raise
                kind: FaultKind = error.kind if isinstance(error, BadFrameError) else "lost"
                self._announce(kind, error.detail, retaken=remaining > 0)
                self._connected = self._connected and kind != "settings"  # connecting makes all settings anew
                if not remaining:
                    raise
        raise AssertionError("the last frame returns or raises")

    def take_up(self, stop: StopToken) -> None:
        """Tries to connect a camera that is gone until it is back.

        Raises RigError camera.unreachable if it is not back within the cell file's `reconnect_s`, Halted.
        """
        deadline = time.monotonic() + self._config.reconnect_s
        while True:
            if stop.is_set():
                raise Halted
            try:
                self._open()
            except RigError as error:
                if error.code not in GONE or time.monotonic() > deadline:
                    raise
            else:
                return
            if stop.wait(RECONNECT_EVERY_S):
                raise Halted

    def close(self) -> None:
        """Releases the camera."""
        self._connected = False
        self.driver.close()

    # ---------------------------------------------------------------------------------------------------------- pieces

    def _open(self) -> None:
        self._connected = self._under_way = False
        self._number = None
        self._capabilities = self.driver.connect()
        self._connected = True
        if self._gone:
            self._gone = False
            self._announce("returned", f"{self._capabilities.name} answers again", retaken=True)

    def _expose(self, exposure_s: float, attempt: int, stop: StopToken) -> Frame:
        if not self._connected:
            self._open()
        if self._under_way:
            self._number = None
            self.driver.restart()
        self._under_way = True
        frame = self.driver.expose(exposure_s, attempt, stop)
        self._check_size(frame)
        self._check_number(frame)
        self._check_settings(frame, exposure_s)
        if self._settings is None:
            self._settings = frame.settings
        self._number, self._under_way = frame.number, False
        self.counts["good"] += 1
        return frame

    def _check_size(self, frame: Frame) -> None:
        known = self._capabilities
        size = frame.pixels.shape
        if known is not None and size != (known.height, known.width):
            seen = " × ".join(map(str, reversed(size)))
            raise BadFrameError(
                "damaged", f"A frame has {seen} pixels instead of the camera's {known.width} × {known.height}"
            )

    def _check_number(self, frame: Frame) -> None:
        before, number = self._number, frame.number
        if before is None or number is None or number == before + 1:
            return
        if number == before:
            raise BadFrameError("doubled", f"Frame {number} arrived a second time")
        if number < before:
            raise BadFrameError(
                "late", f"Frame {number} arrived after frame {before}: it belongs to an earlier trigger"
            )
        raise BadFrameError(
            "lost", f"Frame {number} arrived after frame {before}, missing in between: {number - before - 1}"
        )

    def _check_settings(self, frame: Frame, wanted_s: float) -> None:
        settings = frame.settings
        if settings is None:
            return
        for what, exposure_s in (("camera", settings.exposure_s), ("frame", frame.exposure_s)):
            if abs(exposure_s - wanted_s) > EXPOSURE_TOLERANCE * wanted_s + EXPOSURE_STEP_S:
                raise BadFrameError(
                    "settings", f"Exposure time: {wanted_s} s was set, but the {what} reports {exposure_s} s"
                )
        if self._settings is not None and settings.fingerprint != self._settings.fingerprint:
            changed = "; ".join(self._settings.differences(settings))
            raise BadFrameError("settings", f"The camera's settings have changed since its first frame: {changed}")

    def _lose(self, error: RigError) -> None:
        self._connected = False
        if not self._gone:
            self._gone = True
            self._announce("gone", error.detail, retaken=False)

    def _announce(self, kind: FaultKind, detail: str, *, retaken: bool) -> None:
        self.counts[kind] += 1
        if retaken and kind != "returned":
            self.counts["retaken"] += 1
        _log.log(logging.INFO if kind == "returned" else logging.WARNING, "camera: %s: %s", kind, detail)
        for listener in self._listeners:
            listener(CameraFault(kind, detail, retaken))
