"""Exposure plan: exposure times and numbers of frames of each light, for the least expected loss in a given time.

The exposures minimise L · T^0.63, where L is the expected loss and T the capture time of the session. The exponent is
the rate at which further lights buy accuracy: σ falls with the number of images as n^−0.63, so all sessions with the
same product are equally good (with the exponent 1/2 it is the efficiency of a Monte Carlo estimate; Hammersley and
Handscomb 1964). The loss is the one by which lights are chosen. The sensor's variance at a pixel is that of the frames
that do not saturate there.

The search is a coordinate descent over the lights. Each step tries all options of one light. Exposure times are octaves
so that lights share lamp-off frames. Decision 0067.
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
    """Exponent of the capture time in the product that is minimised. A larger one gives shorter exposures. Measured:
    errors fall with n^−0.63 from 8 to 20 images, with the arm moving between them: 0.66, 0.50 and 0.37° by 8, 12 and
    20 images, most of them planned, on seven simulated objects (three to six draws, November 2026)."""


SETTINGS = ExposurePlanSettings()

SHORTEST, LONGEST = -3, 6
"""Range of the exposure times of a light, in octaves relative to the automatic one."""

FRAMES = (1, 2, 4)
"""Options for the number of equal frames of the shorter exposure time."""

RATIOS = (2, 3, 4, 5)
"""Options for the octaves by which the longer of two exposure times exceeds the shorter."""

SWEEPS = 3
"""Maximum number of rounds of the coordinate descent. Most plans settle after two."""


@dataclass(frozen=True)
class CaptureTimes:
    """Limits and times of a capture, s: the camera's shortest and longest exposure, `move_s` from one light to the next
    (path, settling, lamp) without their frames, and `frame_s` of a frame beside its exposure."""

    shortest_s: float
    longest_s: float
    move_s: float
    frame_s: float

    def of_light(self, exposures: Sequence[FrameExposure]) -> float:
        """Time of one light's frames, s."""
        return sum(one.frames * (one.exposure_s + self.frame_s) for one in exposures)

    def of_pass(self, lights: Sequence[Sequence[FrameExposure]]) -> float:
        """Time of the lights of a pass, with their moves and the lamp-off frames of all their exposure times, s."""
        times = {one.exposure_s for exposures in lights for one in exposures}
        return sum(self.move_s + self.of_light(one) for one in lights) + sum(times) + len(times) * self.frame_s


def choose(problem: DesignProblem, positions: FloatArray, times: CaptureTimes | None) -> list[LightExposure] | None:
    """Plans the exposures of lights at positions (M, 3), each with its time, and its gain at the held-out pixels.

    Returns None if the recipe has fixed exposures, or if the capture's `times` are not known.
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
    """Lists all exposures that one light may get: equal frames of one time, or these and one longer frame."""
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
    """Minimises loss · time^0.63 over the exposure options of each light by coordinate descent."""
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
    """Describes the exposures in one sentence, for people."""
    times = sorted({frame.exposure_s for one in exposures for frame in one.frames})
    frames = sum(frame.frames for one in exposures for frame in one.frames)
    seconds = sum(one.seconds for one in exposures)
    return (
        f"{frames} frames of {len(times)} exposure times, {1e3 * times[0]:.3g} to {1e3 * times[-1]:.3g} ms, for "
        f"{len(exposures)} lights: {seconds:.1f} s in all"
    )
