"""Protocol between the service and the arm's driver process: messages on a socket pair, and shared memory.

Requests and replies are pickled values, one at a time, numbered by the time of the request in ns: a halt requested
later than a move ends it even if the driver sees the halt first. What must not block (the halt, the lease, the newest
reading) is in shared memory. A halt is one store of one field, so that a signal handler may make it; a reader never
blocks and never delays a writer. Clocks: time.monotonic, the same in both processes.
"""

import bisect
import math
import mmap
import os
import struct
import time
import zlib
from dataclasses import dataclass
from enum import IntEnum

from acquisition.models.errors import RigError

TICK_S = 0.004
"""Period, s, of the driver's loop, which checks for a halt each time (250 Hz)."""

LEASE_RENEWAL_S = 0.02
LEASE_S = 0.2
"""Period and time-out, s, of the lease that the service renews during a move; an expired lease stops the arm."""

WATCHDOG_HZ = 4.0
KICK_S = 0.04
"""Frequency of the controller's watchdog, Hz, and period of kicks, s: the program ends after 1/4 s without a kick."""

STOP_WITHIN_S = 0.2
"""Longest synchronous stop from the highest speed, s: it sends no kicks and must end within the watchdog's period."""

ACKNOWLEDGE_S = 0.1
"""Time limit, s, for the driver to accept a halt; after it the second path stops the arm."""

LINK_S, LINK_AT_MOST_S = 0.8, 1.8
"""Age, s, of data that means a lost link: normally, and if the driver has just slept; ur-rtde would reconnect by
itself, and move again, after 2.5 s."""

HEARTBEAT_S = 1.0
"""Age, s, of the heartbeat at which the driver counts as lost."""

GOAL_TOLERANCE_RAD = 1e-3
REST_SPEED_RAD_S = 5e-3
"""Largest distance of a joint from the goal, rad, and largest joint speed, rad/s, at the end of a move."""

Vector6 = tuple[float, float, float, float, float, float]


# ------------------------------------------------------------------------------------------------------------- messages


@dataclass(frozen=True)
class Open:
    """Connect the receive and output interfaces and switch the lamp off; takes no control, stops no program."""

    address: str
    lamp_output: int
    stop_deceleration_rad_s2: float


@dataclass(frozen=True)
class TakeControl:
    """Upload the control program unless it runs, set TCP and payload, arm the controller's watchdog."""

    flange_from_tool: Vector6
    payload_kg: float
    payload_center_m: tuple[float, float, float]


@dataclass(frozen=True)
class Move:
    """Straight joint segments, each with speed (rad/s) and acceleration (rad/s²) of its leading joint."""

    path: tuple[tuple[float, ...], ...]
    limits: tuple[tuple[float, float], ...]

    def seconds(self, start: tuple[float, ...], speed_fraction: float) -> float:
        """Returns the time, s, of the trapezoids from `start` (rad) at this position of the speed slider."""
        seconds, here = 0.0, start
        for goal, (speed, acceleration) in zip(self.path, self.limits, strict=True):
            length = max(abs(b - a) for a, b in zip(here, goal, strict=True))
            seconds += length / speed + speed / acceleration
            here = goal
        return seconds / max(speed_fraction, 0.01)


@dataclass(frozen=True)
class SetLamp:
    """Set the lamp's output and wait until it is read back."""

    on: bool


@dataclass(frozen=True)
class PulseOutput:
    """Raise an output, wait until it is read back, and lower it: the trigger of a camera."""

    output: int


@dataclass(frozen=True)
class Inspect:
    """Ask the controller for what preflight compares with the cell file."""


@dataclass(frozen=True)
class Shutdown:
    """Stop, switch the lamp off, end the process."""


Request = Open | TakeControl | Move | SetLamp | PulseOutput | Inspect | Shutdown


@dataclass(frozen=True)
class Inspection:
    """Tool, payload and kinematics as the controller holds them; poses as (x, y, z, rotation vector)."""

    flange_from_tool: Vector6
    payload_kg: float
    payload_center_m: tuple[float, float, float]
    base_from_tool_forward: Vector6  # its forward kinematics at the present joints
    base_from_tool_measured: Vector6


@dataclass(frozen=True)
class Done:
    """The request was fulfilled."""

    value: Inspection | None = None


@dataclass(frozen=True)
class Failed:
    """The request failed; the arm is at rest or braking, the lamp is off."""

    error: RigError


@dataclass(frozen=True)
class Interrupted:
    """A halt ended the request; the stop has been carried out.

    `program_runs`: the control program is alive and has ended its move. One that is paused (by a safety stop, or at the
    pendant) still holds the move, and would go on with it.
    """

    program_runs: bool


Reply = Done | Failed | Interrupted


# ------------------------------------------------------------------------------------------------------- shared memory


class Link(IntEnum):
    """State of the link to the controller; for a lost link, the evidence."""

    OK = 0
    SILENT = 1
    READING_CLOSED = 2
    CONTROL_CLOSED = 3


_LOST = {
    Link.OK: "the driver does not respond",  # a living driver would have reported another state
    Link.SILENT: "the controller sends nothing",
    Link.READING_CLOSED: "the data connection is closed",
    Link.CONTROL_CLOSED: "the command connection is closed",
}


@dataclass(frozen=True)
class Sample:
    """The newest values of the receive interface; `received_at` is time.monotonic() at their arrival."""

    joints: tuple[float, ...]
    joint_speeds: tuple[float, ...]
    base_from_tool: tuple[float, ...]
    timestamp: float
    speed_fraction: float
    received_at: float
    robot_mode: int
    safety_bits: int
    runtime_state: int
    digital_outputs: int
    program_running: bool
    link: Link

    @property
    def lost(self) -> str:
        """The evidence that the link, or the driver, is lost, and the age of the newest data now."""
        return f"{_LOST[self.link]}; the newest data are {time.monotonic() - self.received_at:.2f} s old"


class Field(IntEnum):
    """Indices of the 64-bit fields, each with one writer; times in ns of time.monotonic_ns."""

    HALT_REQUESTED = 0  # service: time of the newest halt request
    HALT_ACCEPTED = 1  # driver: the newest halt request that it has begun to carry out
    HALT_DONE = 2  # driver: the newest halt request that it has carried out
    LEASE = 3  # service: time of the last renewal of the lease
    HEARTBEAT = 4  # driver: time of the last iteration of its loop
    TRACKED = 6  # driver: number of points of the track that it has written
    PRIORITY = 5  # driver: its granted scheduling, a `process_priority.Priority`; 0 before the first driver


LATENESS_BOUNDS_S = (0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, math.inf)
"""Upper bounds, s, of the classes in which the driver counts its late wake-ups; the watchdog's period is 0.25 s."""

_SAMPLE = struct.Struct("<21d6q")
_SAMPLE_AT = 64
_CHECKSUM = struct.Struct("<I")
_POINT = struct.Struct("<14d")
_POINT_SIZE = _POINT.size + 8  # with its checksum
_TRACK_AT = mmap.PAGESIZE
TRACK_LENGTH = 512
"""Points of the track that are kept: 4 s at 125 Hz."""

_SIZE = mmap.PAGESIZE * (2 + TRACK_LENGTH * _POINT_SIZE // mmap.PAGESIZE)
_LATENESS = 256  # index of the first counter of wake-ups, far behind the sample


class SharedMemory:
    """Shared memory: 64-bit fields with atomic access, the newest sample, and a ring of the track's last points.

    Sample and points have a checksum each. A sample that is copied while it is being written does not match its
    checksum and is copied again; this needs no lock and holds on any memory order.
    """

    def __init__(self, descriptor: int) -> None:
        self.descriptor = descriptor
        self._page = mmap.mmap(descriptor, _SIZE)
        self._fields = memoryview(self._page).cast("q")
        self._tracked_at = -1.0  # the controller's time of the last point written

    @classmethod
    def create(cls) -> "SharedMemory":
        """Creates an empty shared memory."""
        descriptor = os.memfd_create("lightpose-arm")
        os.ftruncate(descriptor, _SIZE)
        return cls(descriptor)

    def read(self, field: Field) -> int:
        """Returns the value of one field."""
        return self._fields[field]

    def write(self, field: Field, value: int) -> None:
        """Sets one field; safe in a signal handler."""
        self._fields[field] = value

    def age_s(self, field: Field) -> float:
        """Returns the age, s, of the time that a field holds."""
        return (time.monotonic_ns() - self.read(field)) * 1e-9

    def count_wakeup(self, late_s: float) -> None:
        """Counts a wake-up of the driver's loop that was late by `late_s`."""
        self._fields[_LATENESS + bisect.bisect_left(LATENESS_BOUNDS_S, late_s)] += 1

    def wakeups(self) -> tuple[int, ...]:
        """Returns how many wake-ups were late by at most each of LATENESS_BOUNDS_S and more than the bound before."""
        return tuple(self._fields[_LATENESS : _LATENESS + len(LATENESS_BOUNDS_S)])

    def halt_state(self, requested: int) -> tuple[bool, bool]:
        """Returns whether the halt requested at this time (ns) has been accepted, and carried out.

        While the driver carries out one halt it sees no other: that one also serves later requests.
        """
        accepted, done = self.read(Field.HALT_ACCEPTED), self.read(Field.HALT_DONE)
        return accepted >= requested or accepted > done, done >= requested

    def publish(self, sample: Sample) -> None:
        """Replaces the sample."""
        data = _SAMPLE.pack(
            *sample.joints,
            *sample.joint_speeds,
            *sample.base_from_tool,
            sample.timestamp,
            sample.speed_fraction,
            sample.received_at,
            sample.robot_mode,
            sample.safety_bits,
            sample.runtime_state,
            sample.digital_outputs,
            sample.program_running,
            sample.link,
        )
        self._page[_SAMPLE_AT : _SAMPLE_AT + len(data) + _CHECKSUM.size] = data + _CHECKSUM.pack(zlib.crc32(data))
        if sample.timestamp != self._tracked_at:
            self._tracked_at = sample.timestamp
            self._add_point(sample)

    def _add_point(self, sample: Sample) -> None:
        count = self.read(Field.TRACKED)
        data = _POINT.pack(sample.timestamp, sample.received_at, *sample.joints, *sample.base_from_tool)
        at = _TRACK_AT + count % TRACK_LENGTH * _POINT_SIZE
        self._page[at : at + len(data) + _CHECKSUM.size] = data + _CHECKSUM.pack(zlib.crc32(data))
        self.write(Field.TRACKED, count + 1)

    def track(self, seconds: float) -> list[tuple[float, ...]]:
        """Returns the points of the newest `seconds`, oldest first: controller's time, time of arrival, joints and
        pose; leaves out one that is being overwritten."""
        count, points = self.read(Field.TRACKED), list[tuple[float, ...]]()
        for number in range(count - 1, max(count - TRACK_LENGTH, -1), -1):
            at = _TRACK_AT + number % TRACK_LENGTH * _POINT_SIZE
            data = self._page[at : at + _POINT.size + _CHECKSUM.size]
            if zlib.crc32(data[: _POINT.size]) != _CHECKSUM.unpack_from(data, _POINT.size)[0]:
                continue
            point = _POINT.unpack(data[: _POINT.size])
            if points and point[1] < points[0][1] - seconds:
                break
            points.append(point)
        return points[::-1]

    def sample(self) -> Sample | None:
        """Returns the newest sample; None before the first one, or if its writer died in mid-write."""
        for _ in range(100):
            data = self._page[_SAMPLE_AT : _SAMPLE_AT + _SAMPLE.size + _CHECKSUM.size]
            body, checksum = data[: _SAMPLE.size], _CHECKSUM.unpack_from(data, _SAMPLE.size)[0]
            if zlib.crc32(body) == checksum:
                values = _SAMPLE.unpack(body)
                timestamp, speed_fraction, received_at, mode, safety_bits, state, outputs, running, link = values[18:]
                return Sample(
                    joints=values[0:6],
                    joint_speeds=values[6:12],
                    base_from_tool=values[12:18],
                    timestamp=timestamp,
                    speed_fraction=speed_fraction,
                    received_at=received_at,
                    robot_mode=mode,
                    safety_bits=safety_bits,
                    runtime_state=state,
                    digital_outputs=outputs,
                    program_running=bool(running),
                    link=Link(link),
                )
        return None
