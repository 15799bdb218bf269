"""Exposure as a sum of intervals of constant pose and light, sampled from the controller's state.

The lamp follows its output as a first-order low-pass. A moving arm smears its shadows, so its joints over the exposure
become a few intervals that are rendered one by one. An arm at rest with the lamp at a constant level is one interval,
whatever the clock says, so that a repeated exposure gives the same frame.
"""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

from hardware_sim.world import ExposureInterval

LAMP_TIME_CONSTANT_S = 0.003
"""Time constant, s, of the lamp: full light within about 10 ms."""
FULL_LEVEL_TOLERANCE = 2e-3
STILL_RAD = 1e-4
MAX_INTERVALS = 8


@dataclass(frozen=True)
class CellState:
    """Joints (6,) in rad, whether the lamp's output is on, seconds since it changed by the controller's clock, the
    cell's time per wall time, and the controller's clock in s."""

    joints: tuple[float, ...]
    lamp_on: bool
    lamp_age_s: float
    speed_factor: float
    clock_s: float


class StateSource(Protocol):
    """Source of the cell's state: the controller's control port, or a fixed state in tests."""

    def state(self) -> CellState:
        """The state now. Raises RigError device.disconnected."""
        ...


def expose(source: StateSource, exposure_s: float) -> list[ExposureInterval]:
    """Keeps the shutter open for `exposure_s` of the cell's time and returns its intervals, whose shares sum to 1.

    Only the controller's clock times the intervals. On a busy machine it lags behind this process's clock, and a lamp's
    age by one clock within a duration by the other would make the lamp seem to have come on late.
    """
    begun = time.monotonic()
    states = [source.state()]
    duration = exposure_s / states[0].speed_factor
    pause = max(0.002, duration / (2 * MAX_INTERVALS))
    while time.monotonic() - begun < duration or states[-1].clock_s <= states[0].clock_s:
        time.sleep(min(pause, max(0.001, begun + duration - time.monotonic())))
        states.append(source.state())
    return exposure_intervals(states)


def exposure_intervals(states: Sequence[CellState]) -> list[ExposureInterval]:
    """Intervals between states whose clock has advanced; merged where the arm rests, and to at most MAX_INTERVALS."""
    total_s = states[-1].clock_s - states[0].clock_s
    parts: list[ExposureInterval] = []
    for before, after in pairwise(states):
        passed_s = after.clock_s - before.clock_s
        if passed_s <= 0:
            continue
        level = _mean_level(after, passed_s * after.speed_factor)
        still = max(abs(a - b) for a, b in zip(before.joints, after.joints, strict=True)) < STILL_RAD
        middle = tuple((a + b) / 2 for a, b in zip(before.joints, after.joints, strict=True))
        parts.append(ExposureInterval(passed_s / total_s, before.joints if still else middle, level))
    merged: list[ExposureInterval] = []
    most = math.ceil(len(parts) / MAX_INTERVALS)
    members = 0
    for part in parts:
        last = merged[-1] if merged else None
        if last is not None and (_greatest_joint_difference(last, part) < STILL_RAD or members < most):
            share = last.share + part.share
            level = (last.share * last.lamp_level + part.share * part.lamp_level) / share
            merged[-1] = ExposureInterval(share, last.joints, level)
            members += 1
        else:
            merged.append(part)
            members = 1
    return [ExposureInterval(part.share, part.joints, _snapped(part.lamp_level)) for part in merged]


def _greatest_joint_difference(first: ExposureInterval, second: ExposureInterval) -> float:
    return max(abs(a - b) for a, b in zip(first.joints, second.joints, strict=True))


def _snapped(level: float) -> float:
    return float(round(level)) if abs(level - round(level)) < FULL_LEVEL_TOLERANCE else level


def _mean_level(state: CellState, duration_s: float) -> float:
    """Mean lamp level over the `duration_s` (cell's time) before `state`; settled before the output's last change."""
    age = state.lamp_age_s * state.speed_factor
    since = min(duration_s, age)
    start = age - since
    falling = LAMP_TIME_CONSTANT_S * (
        math.exp(-start / LAMP_TIME_CONSTANT_S) - math.exp(-(start + since) / LAMP_TIME_CONSTANT_S)
    )  # ∫ exp(−t/τ), the level of a lamp that goes out
    before = duration_s - since
    lit_s = (since - falling) if state.lamp_on else (before + falling)
    return lit_s / duration_s if duration_s > 0 else float(state.lamp_on)
