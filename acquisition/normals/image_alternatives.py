"""Other images on trial: one left out, later ones moved back, some scaled; and the object held in its place.

Every function looks at a solution and gives alternatives (`model_trial.Alternative`), none where no test demands any.
Intensities come late among all alternatives, because they absorb other faults.
"""

from dataclasses import dataclass, replace

import numpy as np

from acquisition import mosaic, photometry
from acquisition.models.base import BoolArray, FloatArray
from acquisition.normals import changed_images, model_trial, self_calibration
from acquisition.normals.goodness_of_fit import Fit
from acquisition.normals.model_trial import Alternative, Solution

MOVED = "moved object"
"""Kind of the finding of images that are moved back."""


def moved_object(present: Solution) -> list[Alternative]:
    """Later images moved back, where the registration says that object or camera moved.

    In a sound fit, too, where residuals are smaller then: a cluster and a vessel that moved by 2 pixels under ten
    planned lights fit soundly, 2.8 and 4.1 times as far off (design seed 64). Registered residuals are 0.55–0.94 of six
    moved captures there, 1.0–1.2 of three that did not move and of two benchmarks. Where registration alone makes them
    clearly smaller, as in none of 42 sound captures of design seeds 205–225, the descent after it need not, in which
    another surface made up for a part of it before.
    """
    problem = present.problem
    # Registration takes time: not of what would not be tried.
    if MOVED in problem.corrected or len(present.scene.lamps) < photometry.REDUNDANT or not problem.thorough:
        return []
    if not present.poor and present.registration.residual_ratio >= 1:
        return []
    moves = problem.level.factor * present.registration.translations
    distance = float(np.max(np.linalg.norm(moves, axis=1)))
    if distance <= 0.5:  # an image's own translation is uncertain by half a pixel
        return []
    message = f"object or camera moved by {distance:.1f} pixels: later images are moved back"
    spacing = 1 if problem.masked.channel is None else mosaic.CELL
    registered = problem.reread(changed_images.translated(problem.masked.images, moves, spacing))
    better = model_trial.SETTINGS.better
    most = 1.0 if present.registration.residual_ratio < better else better
    return [Alternative(MOVED, message, registered, most, distance)]


def bad_image(present: Solution) -> list[Alternative]:
    """One image left out that fits far worse than the others; in a poor fit, or once it has been scaled, the worst,
    where the others fit better without it, and not poorly.

    Of 28 poor captures without a fault (design seeds 100–113, every reflectance) it leaves 0.81 of the misfit and more
    but for three of metal, which fit still better as metal; of ten with a flash in one image 0.26–0.72.
    """
    problem, worst = present.problem, worst_image(present.fit)
    if worst is None:
        return []
    scaled = np.broadcast_to(problem.factors, len(present.fit.images))[worst.number] != 1
    if not (worst.outlying or present.poor or scaled):
        return []
    message = f"image {worst.number + 1} does not fit the others: it is left out"
    rest = problem.reread(changed_images.without(problem.masked.images, worst.number))
    most = 1.0 if worst.outlying else model_trial.SETTINGS.better
    return [
        Alternative(
            "bad image", message, rest, most, worst.number + 1, decisive=worst.outlying, never_poor=not worst.outlying
        )
    ]


@dataclass(frozen=True)
class WorstImage:
    """The image that fits worst, and whether that is far worse than the others do."""

    number: int
    outlying: bool


def worst_image(fit: Fit) -> WorstImage | None:
    """The image that fits worst; none: there are too few others."""
    if np.count_nonzero(np.isfinite(fit.images)) <= photometry.OVERDETERMINED:
        return None
    worst = int(np.nanargmax(fit.images))
    usual = float(np.nanmedian(np.delete(fit.images, worst)))
    return WorstImage(worst, bool(fit.images[worst] > photometry.SETTINGS.outlying_deviations * usual))


def other_intensities(present: Solution) -> list[Alternative]:
    """Images scaled whose intensity is far from what is stated, unless most are."""
    far = _far_intensities(present)
    if not np.any(far):
        return []
    factors = np.where(far, np.exp(_log_intensity(present)), 1.0)
    names = ", ".join(f"image {n + 1} ({factors[n] - 1:+.0%})" for n in np.flatnonzero(far))
    scaled = present.problem.reread(changed_images.scaled(present.problem.masked.images, factors))
    scaled = replace(scaled, factors=factors)
    message = f"brighter or darker than stated, and scaled: {names}"
    # The descent before has put most of the factors right already: noise decides which of the two fits better.
    return [Alternative("intensities", message, scaled, 1 / model_trial.SETTINGS.better, float(factors[far][0]))]


def _far_intensities(present: Solution) -> BoolArray:
    """Images (F,) whose intensity is outlying under the widest prior that it has; none where most are."""
    widest = self_calibration.SIGMA_FACTORS[-1] * present.problem.nominal.calibration.intensity_sigma
    far = np.abs(_log_intensity(present)) > photometry.SETTINGS.outlying_deviations * widest
    return far & (np.count_nonzero(far) <= len(far) // 2)


def _log_intensity(present: Solution) -> FloatArray:
    """Logarithms (F,) of the intensities over their median."""
    return present.state.shared.log_intensity - np.median(present.state.shared.log_intensity)


def held_shift(present: Solution) -> list[Alternative]:
    """The object held where it was stated to be, where its shift may have run away: on a strongly curved sheet close to
    the camera it drifted by 70 mm, and the misfit rose from 1.3 to 2.5."""
    if not present.poor:
        return []
    held = replace(present.problem, shift_sigma_m=0.0)
    return [
        Alternative("shift", "the object is held at its stated place", held, model_trial.SETTINGS.better, silent=True)
    ]
