"""Exposures while the arm arrives at a light and leaves it: when to begin one, and where the lamp was meanwhile.

The arm decelerates uniformly onto each light and accelerates uniformly from it. So for some tens of milliseconds around
its arrival the lamp stays within a fraction of a millimetre, and an exposure that begins there need not wait for rest.
The motion is measured afterwards: the controller's poses during the exposure give the lamp's position in the middle of
it and how far the lamp moved. A frame during which it moved by more than its calibrated 1 σ is rejected.

The controller stamps its poses with its own clock; the camera's driver states the middle of the exposure in this
machine's. A pose cannot arrive before it was measured, so the least delay over a second relates the two clocks. What is
left (the link's shortest delay, the driver's cycle, the trigger's delay) is below `CLOCK_S`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from acquisition.devices import TrackPoint
from acquisition.models.base import FloatArray
from acquisition.models.shot import ShotMotion

AIMED_SHARE = 0.5
"""Distance that the lamp may still have to move when an exposure begins, as a share of its position σ."""

MAX_SHARE = 1.0
"""Largest motion of the lamp during a frame, as a share of its position σ; a frame with more is rejected."""

CLOCK_S = 0.004
"""1 σ, s, of the time of an exposure in the controller's clock: half of a period of its data at 125 Hz."""

GAP_S = 0.04
"""Longest time, s, between two poses that are interpolated: five periods of data. In it an arm that accelerates at
1.4 rad/s² moves a lamp by half a millimetre."""

ARRIVED_RAD = 1.2e-3
"""Largest distance, rad, of a joint from the light at which the arm has arrived: a move ends within 1 mrad."""

WINDOW_S = 1.0
"""Time, s, over which the two clocks are related."""


@dataclass(frozen=True)
class LampTrack:
    """Times (K,), s of this machine's monotonic clock, ascending; joints (K, 6), rad; tool poses (K, 4, 4), base frame;
    the lamp's positions (K, 3), m, base frame; the controller's own times (K,), s."""

    times: FloatArray
    joints: FloatArray
    base_from_tool: FloatArray
    positions: FloatArray
    controller_times: FloatArray


@dataclass(frozen=True)
class Middle:
    """The arm in the middle of an exposure, and the lamp's motion during it."""

    joints: tuple[float, ...]
    base_from_tool: FloatArray
    controller_time: float
    motion: ShotMotion


def lamp_track(points: Sequence[TrackPoint], tool_from_lamp: FloatArray) -> LampTrack:
    """Returns the track of a lamp whose pose in the tool frame is `tool_from_lamp` (4, 4); needs at least one point."""
    stamps = np.array([point.timestamp for point in points])
    arrivals = np.array([point.received_at for point in points])
    poses = np.array([point.base_from_tool for point in points])
    recent = arrivals > arrivals[-1] - WINDOW_S
    delay = float(np.min((arrivals - stamps)[recent]))
    positions = (poses @ tool_from_lamp)[:, :3, 3]
    return LampTrack(stamps + delay, np.array([point.joints for point in points]), poses, positions, stamps)


def is_near(track: LampTrack, goal: Sequence[float], allowed_m: float, lead_s: float) -> bool:
    """Whether the lamp, `lead_s` after the newest pose, has at most `allowed_m` to go to joints `goal` (6,), rad.

    Assumes uniform deceleration, as at the end of a move; before that the arm has far more to go.
    """
    distance = float(np.max(np.abs(track.joints[-1] - np.array(goal))))
    if distance < ARRIVED_RAD:
        return True
    if len(track.times) < 2:
        return False
    turned = float(np.max(np.abs(track.joints[-1] - track.joints[-2])))
    moved = float(np.linalg.norm(track.positions[-1] - track.positions[-2]))
    passed_s = float(track.times[-1] - track.times[-2])
    if turned < 1e-6 or moved < 1e-7 or passed_s <= 0:
        return False  # it has not begun to move, or only turns
    left_m = distance * moved / turned
    left_s = 2 * left_m / (moved / passed_s)
    return left_m * max(0.0, 1 - lead_s / left_s) ** 2 <= allowed_m


def during(track: LampTrack, begin: float, end: float) -> Middle | None:
    """Interpolates the track linearly over an exposure from `begin` to `end`, s of this machine's monotonic clock.

    Returns None if the track does not cover the exposure and the clocks' uncertainty on both sides of it, or has a gap.
    """
    first, last = begin - CLOCK_S, end + CLOCK_S
    times = track.times
    if len(times) < 2 or times[0] > first or times[-1] < last:
        return None
    start, stop = int(np.searchsorted(times, first, "right")) - 1, int(np.searchsorted(times, last, "left"))
    if float(np.max(np.diff(times[start : stop + 1]))) > GAP_S:
        return None
    middle = (begin + end) / 2
    grid = np.linspace(first, last, 33)
    places = np.stack([np.interp(grid, times, track.positions[:, axis]) for axis in range(3)], axis=1)
    centre = np.array([np.interp(middle, times, track.positions[:, axis]) for axis in range(3)])
    inside = (grid >= begin) & (grid <= end)
    spread = float(np.mean(np.sum((places[inside] - centre) ** 2, axis=1)))
    early, late = (
        np.array([np.interp(middle + by, times, track.positions[:, axis]) for axis in range(3)])
        for by in (-CLOCK_S, CLOCK_S)
    )
    by_clock = float(np.sum((late - early) ** 2)) / 4
    apart = places[:, None] - places[None]
    motion = ShotMotion(
        moved_m=float(np.sqrt(np.max(np.sum(apart**2, axis=2)))), sigma_m=float(np.sqrt((spread + by_clock) / 3))
    )
    after = int(np.searchsorted(times, middle, "right"))
    share = float((middle - times[after - 1]) / (times[after] - times[after - 1]))
    joints = (1 - share) * track.joints[after - 1] + share * track.joints[after]
    pose = _between(track.base_from_tool[after - 1], track.base_from_tool[after], share)
    return Middle(tuple(joints.tolist()), pose, float(np.interp(middle, times, track.controller_times)), motion)


def _between(first: FloatArray, second: FloatArray, share: float) -> FloatArray:
    """Interpolates linearly between two near poses (4, 4) at `share`, with the rotation made orthogonal by the SVD."""
    mixed = (1 - share) * first + share * second
    left, _, right = np.linalg.svd(mixed[:3, :3])
    mixed[:3, :3] = left @ right
    return mixed
