"""Exposures that a light may get, within the limits of camera and recipe, and the time that they take."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from acquisition.models.light_plan import FrameExposure
from acquisition.models.recipe import Exposure
from acquisition.models.shot import Shot

Exposures = Sequence[FrameExposure]
"""The exposures of one light."""

SHORTEST, LONGEST = -3, 6
"""Octaves of the exposure times, relative to the automatic one, among which a light's are chosen."""

FRAMES = (1, 2, 4)
"""Numbers of equal frames among which the shorter exposure's is chosen."""

RATIOS = (2, 3, 4, 5)
"""Octaves by which the longer of two exposure times exceeds the shorter."""


@dataclass(frozen=True)
class CaptureTimes:
    """Limits and times of a capture, s: the camera's shortest and longest exposure, the time between two lights without
    their frames (path, settling, lamp), and that of a frame beside its exposure."""

    shortest_s: float
    longest_s: float
    move_s: float
    frame_s: float

    def of_light(self, exposures: Exposures) -> float:
        """Time of one light's frames, s."""
        return sum(one.frames * (one.exposure_s + self.frame_s) for one in exposures)

    def of_pass(self, lights: Sequence[Exposures]) -> float:
        """Time of a pass's lights with their moves and the lamp-off frames of all their exposure times, s."""
        times = {one.exposure_s for exposures in lights for one in exposures}
        return sum(self.move_s + self.of_light(one) for one in lights) + sum(times) + len(times) * self.frame_s


def of_frames(frames: Sequence[Shot]) -> list[FrameExposure]:
    """The exposures of one light's frames."""
    times = Counter(shot.exposure_s for shot in frames)
    return [FrameExposure(exposure_s=seconds, frames=count) for seconds, count in sorted(times.items())]


def options(automatic_s: float, wanted: Exposure, times: CaptureTimes) -> list[list[FrameExposure]]:
    """All exposures that one light may get: equal frames of one time, or these and one longer frame, in octaves."""
    base = np.floor(np.log2(automatic_s) + 1e-9)

    def exposure(octave: int, frames: int = 1) -> FrameExposure:
        return FrameExposure(exposure_s=round(float(2.0 ** (base + octave)), 6), frames=frames)

    def is_allowed(exposures: Exposures) -> bool:
        within = all(times.shortest_s <= one.exposure_s <= times.longest_s for one in exposures)
        few = sum(one.frames for one in exposures) <= wanted.max_frames_per_light
        return within and few and sum(one.frames * one.exposure_s for one in exposures) <= wanted.seconds_per_light

    found: list[list[FrameExposure]] = []
    for octave, frames in product(range(SHORTEST, LONGEST + 1), FRAMES):
        one = exposure(octave, frames)
        longer = [octave + ratio for ratio in RATIOS if octave <= 0 and octave + ratio <= LONGEST]
        found += [[one], *([one, exposure(further)] for further in longer)]
    return [one for one in found if is_allowed(one)] or [[FrameExposure(exposure_s=automatic_s)]]
