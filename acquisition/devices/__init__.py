"""Interfaces (protocols) of the devices: arm, lamp, camera and clock.

Device calls are synchronous and run in the runner's one thread. Only `Arm.halt`, `Arm.reading` and `Rig.halt` may be
called from any thread at any time; none of them takes a lock or blocks. Classes for real devices import this module,
never the other way round.
"""

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np
import numpy.typing as npt

from acquisition.models.base import FloatArray, Vector3
from acquisition.models.camera import CameraCapabilities, CameraSettings, FaultKind
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import Halted

RecoveryStep = Literal["unlock", "power", "brakes"]
"""Unlock a protective stop, switch the power on, release the brakes."""

DriverPriority = Literal["real-time", "niceness", "ordinary"]
"""Scheduling of the driver's process that the machine has granted, best first."""

UNKNOWN = "unknown"
"""Stands for a model, serial number or software version that the controller does not report."""

StopToken = threading.Event
"""Cancellation token of the runner's present step. Every device call that waits checks it."""


@dataclass(frozen=True)
class ArmIdentity:
    """Model, serial number and software of the controller at the arm's address; each may be UNKNOWN."""

    model: str
    serial: str
    software: str


@dataclass(frozen=True)
class ArmReading:
    """Newest values from the controller; `received_at` is time.monotonic() at their arrival."""

    connected: bool
    joints: tuple[float, ...]  # rad
    joint_speeds: tuple[float, ...]  # rad/s
    base_from_tool: FloatArray  # (4, 4), as the controller measures it
    timestamp: float  # the controller's own clock, s
    robot_mode: int
    safety_bits: int
    runtime_state: int
    program_running: bool
    speed_fraction: float
    digital_outputs: int  # bits: 0–7 standard, 8–15 configurable, 16–17 tool
    received_at: float
    lost: str = ""  # why it is not connected
    taking_control: bool = False  # the driver is in a constructor, which may keep it silent for seconds; nothing moves
    driver_priority: DriverPriority | None = None  # None without a driver process


@dataclass(frozen=True)
class TrackPoint:
    """The arm's position at a time of the controller's own clock, s; `received_at` is time.monotonic() at arrival."""

    timestamp: float
    received_at: float
    joints: tuple[float, ...]  # rad
    base_from_tool: FloatArray  # (4, 4), as the controller measures it


@dataclass(frozen=True)
class Finding:
    """One disagreement found by preflight, and its remedy."""

    what: str
    remedy: str


@dataclass(frozen=True)
class MotionLimits:
    """Limits of the leading joint of each segment."""

    speed_rad_s: float
    acceleration_rad_s2: float


@dataclass(frozen=True)
class Frame:
    """One exposure: linear (H, W) uint16, row 0 at the top."""

    pixels: npt.NDArray[np.uint16]
    exposure_s: float
    taken_at: float  # seconds since 1970, UTC
    number: int | None = None  # serial number since the camera was connected; None if the camera does not number frames
    settings: CameraSettings | None = None  # read back before the trigger; None if the camera cannot report them
    temperature_c: float | None = None


@dataclass(frozen=True)
class CameraFault:
    """A fault of the camera, or its return after one."""

    kind: FaultKind
    detail: str
    retaken: bool  # whether the frame is taken again


FaultListener = Callable[[CameraFault], None]


class Arm(Protocol):
    """An arm that follows checked joint paths."""

    @property
    def reading(self) -> ArmReading:
        """The newest reading. It is cached, never blocks, and may be read from any thread."""
        ...

    def track(self, seconds: float) -> Sequence[TrackPoint]:
        """Returns the arm's positions of the newest `seconds`, oldest first. Cached, never blocks, any thread."""
        ...

    def connect(self, *, take_control: bool = True) -> ArmIdentity:
        """Starts the driver and connects; without `take_control` the arm is only read, and no program is started.

        Raises RigError arm.unreachable within 3 s if nobody listens.
        """
        ...

    def prepare(self) -> None:
        """Takes control: the explicit step that makes moves possible (again); moves nothing, harmless while in control.

        Raises RigError arm.not_ready, arm.protective_stop, arm.emergency_stop, arm.in_use, driver.lost.
        """
        ...

    def set_payload(self, mass_kg: float, center_m: Vector3) -> None:
        """States the payload, in the flange frame, for `prepare` to set and `preflight` to compare, without a call to
        any device; until it is stated, that of the cell file's `[arm]` is used."""
        ...

    def preflight(self) -> Sequence[Finding]:
        """Compares the arm with the cell file; moves nothing."""
        ...

    def recover(self, step: RecoveryStep) -> None:
        """Carries out one step out of a stop, which a person has asked for; moves nothing by itself.

        Raises RigError safety.recovery_refused with the controller's answer, arm.unreachable.
        """
        ...

    def move(self, path: Sequence[Sequence[float]], limits: Sequence[MotionLimits], stop: StopToken) -> None:
        """Moves through joint configurations, one straight joint segment each, with a limit for each segment.

        Returns when the arm is at rest at the last one. Raises Halted if the token was set, RigError otherwise; in
        either case the arm is at rest or braking. No command is ever sent twice.
        """
        ...

    def halt(self) -> None:
        """Stops the arm and switches the lamp off by both halt paths; any thread, at once, harmless at rest."""
        ...

    def close(self) -> None:
        """Ends the driver; the arm stands still, the lamp is off."""
        ...


class Lamp(Protocol):
    """A lamp that is on or off."""

    def connect(self) -> None:
        """Ensures that the lamp is off."""
        ...

    def set(self, on: bool) -> None:
        """Sets the level (it does not toggle) and returns when it is read back. Raises RigError lamp.not_confirmed."""
        ...

    def close(self) -> None:
        """Leaves the lamp off."""
        ...


class CameraDriver(Protocol):
    """One kind of camera: one trigger, one frame. `frame_accounting` alone decides whether that frame counts."""

    def connect(self) -> CameraCapabilities:
        """Opens the camera, or reopens it, and makes all settings but the exposure time.

        Raises RigError camera.unreachable within 3 s, config.invalid for settings that the camera refuses.
        """
        ...

    def expose(self, exposure_s: float, attempt: int, stop: StopToken) -> Frame:
        """Sets the exposure time, reads the settings back, triggers, and returns the frame of that trigger.

        `attempt` selects the noise that a simulated camera draws. Raises BadFrameError, RigError camera.timeout,
        device.disconnected, camera.unreachable, config.invalid; Halted as soon as the token is set.
        """
        ...

    def restart(self) -> None:
        """Discards whatever is still under way after a bad frame. Raises RigError device.disconnected."""
        ...

    def close(self) -> None:
        """Releases the camera; harmless when it is not open."""
        ...


class Camera(Protocol):
    """A camera with linear pixels, each of whose frames is checked by frame accounting."""

    @property
    def capabilities(self) -> CameraCapabilities | None:
        """What the camera reported at the last connection; None if it was never connected."""
        ...

    @property
    def is_gone(self) -> bool:
        """Whether the camera failed to answer at the last exposure."""
        ...

    def connect(self) -> None:
        """Opens the camera. Raises RigError camera.unreachable within 3 s, config.invalid."""
        ...

    def expose(self, exposure_s: float, attempt: int, stop: StopToken) -> Frame:
        """Takes one frame; takes it again if it is lost or bad.

        Raises RigError camera.timeout, device.disconnected, camera.unreachable; Halted.
        """
        ...

    def take_up(self, stop: StopToken) -> None:
        """Waits until a camera that is gone is back, and connects it.

        Raises RigError camera.unreachable if it is not back in time, Halted.
        """
        ...

    def listen(self, listener: FaultListener) -> None:
        """Adds a listener, which is called with every fault, in the thread that exposes."""
        ...

    def close(self) -> None:
        """Releases the camera."""
        ...


class Clock(Protocol):
    """Time, with waits that can be interrupted."""

    def now(self) -> float:
        """Seconds since 1970, UTC."""
        ...

    def wait(self, seconds: float, stop: StopToken) -> None:
        """Waits, or raises Halted as soon as the token is set."""
        ...


class WallClock:
    """The real clock."""

    def now(self) -> float:
        """Seconds since 1970, UTC."""
        return time.time()

    def wait(self, seconds: float, stop: StopToken) -> None:
        """Waits, or raises Halted as soon as the token is set."""
        if stop.wait(seconds):
            raise Halted


@dataclass(frozen=True)
class Rig:
    """All devices of a cell."""

    arm: Arm
    lamp: Lamp
    camera: Camera
    cell: CellConfig
    clock: Clock = field(default_factory=WallClock)

    def halt(self) -> None:
        """Stops the arm and switches the lamp off; any thread."""
        self.arm.halt()
