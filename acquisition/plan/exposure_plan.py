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
from acquisition.models.tuned import tuned
from acquisition.plan import exposure_options
from acquisition.plan.design_problem import Problem
from acquisition.plan.exposure_options import CaptureTimes


@dataclass(frozen=True)
class ExposurePlanSettings:
    """Tuned numbers of the exposure plan."""

    time_exponent: float = tuned(1.26, "exponent")
    """Exponent of the capture time in the product that is minimised: minus that of the number of images in the angular
    variance (errors fall with n^−0.63 from 8 to 20 images, with the arm moving between them)."""


SETTINGS = ExposurePlanSettings()

SWEEPS = 3
"""Most rounds of the coordinate descent; most plans are settled after two."""


def choose(
    problem: Problem, positions: FloatArray, inverse_cap: float, times: CaptureTimes | None
) -> list[LightExposure] | None:
    """The exposures of lights at positions (M, 3), each with its time, and with its gain at the held-out pixels.

    None where the recipe has fixed exposures, or nothing is known of the capture's `times`.
    """
    wanted = problem.recipe.exposure
    if wanted.plan == "fixed" or times is None:
        return None
    automatic_s = problem.images.automatic_seconds(problem.search_sample, problem.lights(positions))
    usual_s = np.clip(automatic_s, times.shortest_s, times.longest_s).tolist()
    chosen = _descend(
        problem, positions, [exposure_options.options(one, wanted, times) for one in usual_s], inverse_cap, times
    )
    count, usual = len(positions), [[FrameExposure(exposure_s=one)] for one in usual_s]
    both = problem.rows(problem.holdout_sample, np.concatenate([positions, positions]), [*chosen, *usual])

    def mean_deg(numbers: Sequence[int]) -> float:
        return float(np.mean(problem.expected.sigma_deg(both.posterior(numbers))))

    with_all = mean_deg(range(count))
    swapped = [mean_deg([*(other for other in range(count) if other != one), count + one]) for one in range(count)]
    return [
        LightExposure(frames=frames, seconds=times.of_light(frames), gain=without / with_all - 1)
        for frames, without in zip(chosen, swapped, strict=True)
    ]


def _descend(
    problem: Problem, positions: FloatArray, options: Sequence[list[list[FrameExposure]]], inverse_cap: float,
    times: CaptureTimes,
) -> list[list[FrameExposure]]:  # fmt: skip
    """Coordinate descent of loss · time^1.26 over the exposure options of each light."""
    sample, count = problem.search_sample, len(positions)
    spent_s = times.of_pass(problem.exposures) if problem.exposures else 0.0
    rows = [
        problem.rows(sample, np.repeat(position[None], len(some), axis=0), some)
        for position, some in zip(positions, options, strict=True)
    ]
    chosen = [some[0] for some in options]
    for sweep in range(SWEEPS):
        before = list(chosen)
        for number, some in enumerate(options):
            others = [one for one in range(count) if one != number and (sweep > 0 or one < number)]
            known = [chosen[one] for one in others]
            losses = rows[number].scan(problem.rows(sample, positions[others], known).posterior(), inverse_cap)
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
