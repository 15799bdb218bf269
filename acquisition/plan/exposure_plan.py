"""Exposure plan: exposure times and numbers of frames of each light, for the least expected loss in a given time.

What a further light is worth sets the price of time: σ falls with the number of images as n^−0.63, so a session of
expected loss L and capture time T is as good as any that has the same L · T^0.63, and the exposures minimise this
product (for the exponent 1/2 the efficiency of a Monte Carlo estimate; Hammersley and Handscomb 1964). The loss is that
of the lights' choice, with the sensor's variance at each pixel by the frames that do not saturate there. Coordinate
descent over the lights, each time over all options of one, whose times are octaves so that lights share lamp-off
frames. Decision 0067.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from acquisition.models.base import FloatArray
from acquisition.models.light_plan import FrameExposure, LightExposure
from acquisition.models.recipe import Exposure
from acquisition.models.tuned import tuned
from acquisition.plan import planned_images
from acquisition.plan.design_problem import DesignProblem


@dataclass(frozen=True)
class ExposurePlanSettings:
    """Tuned numbers of the exposure plan."""

    time_exponent: float = tuned(0.63, "exponent")
    """Exponent of the capture time in the product that is minimised. Errors fall with n^−0.63 from 8 to 20 images, with
    the arm moving between them: 0.66, 0.50 and 0.37° by 8, 12 and 20, most of them planned, on seven simulated objects
    (three to six draws, November 2026)."""


SETTINGS = ExposurePlanSettings()

SHORTEST, LONGEST = -3, 6
"""Octaves of the exposure times, relative to the automatic one, among which a light's are chosen."""

FRAMES = (1, 2, 4)
"""Numbers of equal frames among which the shorter exposure's is chosen."""

RATIOS = (2, 3, 4, 5)
"""Octaves by which the longer of two exposure times exceeds the shorter."""

SWEEPS = 3
"""Most rounds of the coordinate descent; most plans are settled after two."""


@dataclass(frozen=True)
class CaptureTimes:
    """Limits and times of a capture, s: the camera's shortest and longest exposure, the time between two lights without
    their frames (path, settling, lamp), and that of a frame beside its exposure."""

    shortest_s: float
    longest_s: float
    move_s: float
    frame_s: float

    def of_light(self, exposures: Sequence[FrameExposure]) -> float:
        """Time of one light's frames, s."""
        return sum(one.frames * (one.exposure_s + self.frame_s) for one in exposures)

    def of_pass(self, lights: Sequence[Sequence[FrameExposure]]) -> float:
        """Time of a pass's lights with their moves and the lamp-off frames of all their exposure times, s."""
        times = {one.exposure_s for exposures in lights for one in exposures}
        return sum(self.move_s + self.of_light(one) for one in lights) + sum(times) + len(times) * self.frame_s


def choose(problem: DesignProblem, positions: FloatArray, times: CaptureTimes | None) -> list[LightExposure] | None:
    """The exposures of lights at positions (M, 3), each with its time, and with its gain at the held-out pixels.

    None where the recipe has fixed exposures, or nothing is known of the capture's `times`.
    """
    wanted = problem.recipe.exposure
    if wanted.plan == "fixed" or times is None:
        return None
    images, lights = problem.images, problem.lights(positions)
    shaded = planned_images.shading(problem.search_sample, lights, images.calibration, images.surface)
    usual_s = np.clip(images.automatic_seconds(shaded), times.shortest_s, times.longest_s).tolist()
    chosen = _descend(problem, positions, [options(one, wanted, times) for one in usual_s], times)
    planned_deg = problem.predict(positions, chosen).mean_deg
    found: list[LightExposure] = []
    for number, (frames, usual) in enumerate(zip(chosen, usual_s, strict=True)):
        others = [*chosen[:number], [FrameExposure(exposure_s=usual)], *chosen[number + 1 :]]
        gain = problem.predict(positions, others).mean_deg / planned_deg - 1
        found.append(LightExposure(frames=frames, seconds=times.of_light(frames), gain=gain))
    return found


def options(automatic_s: float, wanted: Exposure, times: CaptureTimes) -> list[list[FrameExposure]]:
    """All exposures that one light may get: equal frames of one time, or these and one longer frame, in octaves."""
    base = np.floor(np.log2(automatic_s) + 1e-9)

    def exposure(octave: int, frames: int = 1) -> FrameExposure:
        return FrameExposure(exposure_s=float(f"{2.0 ** (base + octave):.6g}"), frames=frames)

    def is_allowed(exposures: Sequence[FrameExposure]) -> bool:
        within = all(times.shortest_s <= one.exposure_s <= times.longest_s for one in exposures)
        few = sum(one.frames for one in exposures) <= wanted.max_frames_per_light
        return within and few and sum(one.frames * one.exposure_s for one in exposures) <= wanted.seconds_per_light

    found: list[list[FrameExposure]] = []
    for octave, frames in product(range(SHORTEST, LONGEST + 1), FRAMES):
        one = exposure(octave, frames)
        longer = [octave + ratio for ratio in RATIOS if octave <= 0 and octave + ratio <= LONGEST]
        found += [[one], *([one, exposure(further)] for further in longer)]
    return [one for one in found if is_allowed(one)] or [[FrameExposure(exposure_s=automatic_s)]]


def _descend(
    problem: DesignProblem, positions: FloatArray, choices: Sequence[list[list[FrameExposure]]], times: CaptureTimes
) -> list[list[FrameExposure]]:  # fmt: skip
    """Coordinate descent of loss · time^0.63 over the exposure options of each light."""
    sample, count = problem.search_sample, len(positions)
    spent_s = times.of_pass(problem.exposures) if problem.exposures else 0.0
    rows = [
        problem.rows(sample, np.repeat(position[None], len(some), axis=0), some)
        for position, some in zip(positions, choices, strict=True)
    ]
    chosen = [some[0] for some in choices]
    for sweep in range(SWEEPS):
        before = list(chosen)
        for number, some in enumerate(choices):
            others = [one for one in range(count) if one != number and (sweep > 0 or one < number)]
            known = [chosen[one] for one in others]
            losses = rows[number].scan(problem.rows(sample, positions[others], known).posterior())
            later_s = (count - 1 - len(others)) * times.move_s
            seconds = np.array([spent_s + later_s + times.of_pass([*known, one]) for one in some])
            chosen[number] = some[int(np.argmin(np.log(losses) + SETTINGS.time_exponent * np.log(seconds)))]
        if sweep > 0 and chosen == before:
            break
    return chosen


def sentence(exposures: Sequence[LightExposure]) -> str:
    """What the exposures are, for people."""
    times = sorted({frame.exposure_s for one in exposures for frame in one.frames})
    frames = sum(frame.frames for one in exposures for frame in one.frames)
    seconds = sum(one.seconds for one in exposures)
    return (
        f"{frames} frames of {len(times)} exposure times, {1e3 * times[0]:.3g} to {1e3 * times[-1]:.3g} ms, for "
        f"{len(exposures)} lights: {seconds:.1f} s in all"
    )
