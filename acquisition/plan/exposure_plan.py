"""Exposure plan: exposure times and numbers of frames of each light, for the least expected loss in a given time.

What a further light is worth sets the price of time: the angular variance of a session falls with the number of images
as n^−1.26, so a session of expected loss L and capture time T is as good as any that has the same L · T^1.26, and the
exposures minimise this product (for the exponent 1 the efficiency of a Monte Carlo estimate; Hammersley and Handscomb
1964). The loss is that of the lights' choice, with the sensor's variance at each pixel by the frames that do not
saturate there. Coordinate descent over the lights, each time over all options of one (`exposure_options`), whose times
are octaves so that lights share lamp-off frames. Decision 0067.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from acquisition.models.base import FloatArray
from acquisition.models.light_plan import FrameExposure, LightExposure
from acquisition.models.shot import Observations
from acquisition.models.tuned import tuned
from acquisition.plan import criterion, exposure_options
from acquisition.plan.criterion import Candidates, Samples
from acquisition.plan.design_problem import Problem
from acquisition.plan.exposure_options import CaptureTimes
from acquisition.plan.objective import Loss


@dataclass(frozen=True)
class ExposurePlanSettings:
    """Tuned numbers of the exposure plan."""

    time_exponent: float = tuned(1.26, "exponent")
    """Exponent of the capture time in the product that is minimised: minus that of the number of images in the angular
    variance (errors fall with n^−0.63 from 8 to 20 images, with the arm moving between them)."""


SETTINGS = ExposurePlanSettings()

SWEEPS = 3
"""Most rounds of the coordinate descent; most plans are settled after two."""


@dataclass(frozen=True)
class LightOptions:
    """Options of one light, and its design rows with each of them at the sample pixels."""

    exposures: list[list[FrameExposure]]
    rows: Candidates


def choose(
    problem: Problem, positions: FloatArray, loss: Loss, times: CaptureTimes | None, observations: Observations
) -> list[LightExposure] | None:
    """The exposures of lights at positions (M, 3), each with its time, and with its gain at the held-out pixels.

    None where the recipe has fixed exposures, or nothing is known of the capture's `times`.
    """
    wanted, sample = problem.recipe.exposure, problem.search_sample
    if wanted.plan == "fixed" or times is None:
        return None
    usual_s = np.clip(problem.automatic_seconds(positions), times.shortest_s, times.longest_s)
    choices: list[LightOptions] = []
    for position, seconds in zip(positions, usual_s, strict=True):
        allowed = exposure_options.options(float(seconds), wanted, times)
        places = np.repeat(position[None], len(allowed), axis=0)
        choices.append(LightOptions(allowed, problem.design_rows(sample, places, allowed)))
    chosen = descend(choices, sample, loss, times, times.so_far(observations))
    planned = problem.holdout_candidates(positions, chosen)
    usual = problem.holdout_candidates(positions, [[FrameExposure(exposure_s=float(one))] for one in usual_s])
    return [
        LightExposure(frames=one, seconds=times.of_light(one), gain=gain)
        for one, gain in zip(chosen, problem.gains(planned, usual), strict=True)
    ]


def descend(
    light_options: Sequence[LightOptions], sample: Samples, loss: Loss, times: CaptureTimes, spent_s: float
) -> list[list[FrameExposure]]:
    """Coordinate descent of loss · time^1.26 over the options of all lights, after `spent_s` of capture."""
    chosen = [0] * len(light_options)
    for sweep in range(SWEEPS):
        before = list(chosen)
        for number, light in enumerate(light_options):
            others = [one for one in range(len(chosen)) if one != number and (sweep > 0 or one < number)]
            known = [light_options[one].exposures[chosen[one]] for one in others]
            present = criterion.joined(sample, [light_options[one].rows.only([chosen[one]]) for one in others])
            losses = loss.scan(sample, criterion.posterior(sample, present), light.rows)
            later = (len(chosen) - 1 - len(others)) * times.move_s
            seconds = np.array([spent_s + later + times.of_pass([*known, one]) for one in light.exposures])
            chosen[number] = int(np.argmin(np.log(losses) + SETTINGS.time_exponent * np.log(seconds)))
        if sweep > 0 and chosen == before:
            break
    return [light.exposures[index] for light, index in zip(light_options, chosen, strict=True)]


def sentence(exposures: Sequence[LightExposure]) -> str:
    """What the exposures are, for people."""
    times = sorted({frame.exposure_s for one in exposures for frame in one.frames})
    frames = sum(frame.frames for one in exposures for frame in one.frames)
    seconds = sum(one.seconds for one in exposures)
    return (
        f"{frames} frames of {len(times)} exposure times, {1e3 * times[0]:.3g} to {1e3 * times[-1]:.3g} ms, for "
        f"{len(exposures)} lights: {seconds:.1f} s in all"
    )
