"""Alternatives that change images: one left out, later ones moved back, some scaled; and the object held in its place.

Every function takes a solution and returns alternatives (`alternative.Alternative`), none where no test demands any.
Intensities come late among all alternatives, because they absorb other faults.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from acquisition import mosaic, photometry
from acquisition.models.base import BoolArray, FloatArray
from acquisition.models.rounding import percent
from acquisition.normals import alternation, self_calibration
from acquisition.normals.alternatives import changed_images, light_tests, model_trial
from acquisition.normals.alternatives.alternative import Alternative, Limits, clearly_better
from acquisition.normals.alternatives.model_trial import Hypothesis, Solution
from acquisition.normals.uncertainty import goodness_of_fit

MOVED, INTENSITIES, SHIFT = "moved object", "intensities", "shift"
"""Kinds of the findings of images that are moved back and of images that are scaled, and of an object that is held."""


def moved_object(present: Solution) -> list[Alternative]:
    """Proposes to move later images back where the registration says that object or camera moved.

    A move is proposed in a sound fit, too, if it lowers residuals: a cluster and a vessel that moved by 2 pixels under
    ten planned lights fit soundly, at 2.8 and 4.1 times the error (design seed 64). Measured there, registration leaves
    0.55–0.94 of the residual in six moved captures, 1.0–1.2 in three others and two benchmarks. The loss decides,
    because another surface may make up for a part of the move in most pixels: it falls to 0.88 at most in 80 of 84
    trials of captures that moved by 2 pixels, and in one of 149 others, with a flash (design seeds 419–474, eight
    lights in two rings).
    """
    hypothesis = present.hypothesis
    # Registration takes time, so it is not done where its result would not be tried.
    if MOVED in hypothesis.corrected or len(present.scene.lamps) < photometry.REDUNDANT or not hypothesis.thorough:
        return []
    if not present.poor and present.registration.residual_ratio >= 1:
        return []
    moves = hypothesis.level.factor * present.registration.translations
    distance = float(np.max(np.linalg.norm(moves, axis=1)))
    if distance <= 0.5:  # an image's own translation is uncertain by half a pixel
        return []
    message = f"object or camera moved by {distance:.1f} pixels: later images are moved back"
    spacing = 1 if hypothesis.masked.channel is None else mosaic.CELL
    registered = hypothesis.reread(changed_images.translated(hypothesis.masked.images, moves, spacing))
    return [Alternative(MOVED, message, registered, clearly_better(), distance)]


def bad_image(present: Solution) -> list[Alternative]:
    """Proposes to leave out one image that does not fit the others.

    An image is proposed if the others fit far better without it, or if it fits far worse than they do; if it was
    scaled, in a poor fit, or with unlikely intensities, also where it is the worst by less. Scaling is undone first,
    because a bad image makes others seem too dark or too bright.

    The loss has to fall, and further where only the poor fit or the intensities call for it. Lower limits lose flashes
    on rough surfaces, which then err by 7–10° (decision 98). Relative residuals have to fall, too: without any image of
    a sharp highlight the loss falls, but the others fit as before (decision 102).
    """
    hypothesis, unscaled, better = present.hypothesis, _unscaled(present.hypothesis), model_trial.SETTINGS.better
    share = model_trial.SETTINGS.slightly_better
    images = hypothesis.masked.images
    scaled = np.broadcast_to(hypothesis.factors, len(present.scene.lamps)) != 1
    doubted = {one: one.outlying or bool(scaled[one.number]) for one in _worst_images(present)}
    return [
        Alternative(
            "bad image", f"image {images.label(worst.number)} does not fit the others: it is left out",
            unscaled.reread(changed_images.without(unscaled.masked.images, worst.number)),
            (Limits(better if sure else better**2, share),), worst.number, leaves_out=True,
            decisive=worst.outlying,
        )
        for worst, sure in sorted(doubted.items(), key=lambda one: not one[0].outlying)
        if sure or present.poor or present.intensities_scatter
    ]  # fmt: skip


def one_outlies(present: Solution) -> bool:
    """Returns whether one image fits far worse than the others, or these fit far better without one."""
    return any(one.outlying for one in _worst_images(present))


class _WorstImage(NamedTuple):
    """The number of the worst image by one of its tests, and whether it is far worse than the others."""

    number: int
    outlying: bool


def _worst_images(present: Solution) -> list[_WorstImage]:
    """Returns the worst images, each once; none where too few would be left.

    They are the image with the largest misfit, the one that was scaled most, and the one without which the others fit
    best by least squares at the solution's depth. Least squares is done with the solution's intensities, which a bad
    image changes, and with the stated ones, which do not count for an image whose own is far from them. An image is far
    worse only if it fits worse than half of all sound captures do, or if its intensity is not as stated: ratios of
    residuals mean nothing without noise, and another intensity may fit a flash, which is nearly uniform on a sheet.
    """
    coarse, nominal = present.hypothesis.level.coarse, present.hypothesis.nominal
    log_intensity = _log_intensity(present)
    if np.count_nonzero(np.isfinite(present.fit.images)) <= photometry.OVERDETERMINED:
        return []
    misfits = present.fit.images
    worst = int(np.nanargmax(misfits))
    usual = float(np.nanmedian(np.delete(misfits, worst)))
    outlying = {worst: bool(misfits[worst] > photometry.SETTINGS.outlying_deviations * usual)}
    stated, none = np.zeros_like(log_intensity), np.zeros(len(log_intensity), np.bool_)
    for intensity, far in ((log_intensity, none), (stated, _far_intensities(present))):
        values = alternation.divide_intensity(coarse.values, intensity)
        found = light_tests.worst_image(
            replace(coarse, values=values), present.state.depth_m, nominal.lamps, nominal.calibration
        )
        if found is not None and not far[found.number]:
            by_far = found.residual_share <= model_trial.SETTINGS.better_at_least
            outlying[found.number] = by_far or outlying.get(found.number, False)
    if np.any(factors := np.abs(np.log(present.hypothesis.factors))):
        outlying.setdefault(int(np.argmax(factors)), False)
    most = photometry.SETTINGS.outlying_deviations * nominal.calibration.intensity_sigma
    doubtful = (misfits > goodness_of_fit.SETTINGS.median_misfit) | (np.abs(log_intensity) > most)
    return [_WorstImage(number, bool(by_far and doubtful[number])) for number, by_far in outlying.items()]


def _unscaled(hypothesis: Hypothesis) -> Hypothesis:
    """Returns the hypothesis before images were scaled."""
    if np.all(hypothesis.factors == 1):
        return hypothesis
    factors = np.broadcast_to(hypothesis.factors, len(hypothesis.nominal.lamps))
    before = hypothesis.reread(changed_images.scaled(hypothesis.masked.images, 1 / factors))
    return replace(before, factors=1.0, corrected=tuple(kind for kind in hypothesis.corrected if kind != INTENSITIES))


def other_intensities(present: Solution) -> list[Alternative]:
    """Proposes to scale images whose intensity is far from what is stated, unless most are."""
    far = _far_intensities(present)
    if not np.any(far):
        return []
    factors = np.where(far, np.exp(_log_intensity(present)), 1.0)
    images = present.hypothesis.masked.images
    names = ", ".join(
        f"image {images.label(int(n))} by {percent(factors[n] - 1, 0, signed=True)}" for n in np.flatnonzero(far)
    )
    scaled = present.hypothesis.reread(changed_images.scaled(images, factors))
    scaled = replace(scaled, factors=factors)
    message = f"these images are brighter or darker than stated, and are scaled to match: {names}"
    # The descent before has found most of the factors already, so that noise decides which of the two fits better.
    limits = (Limits(1 / model_trial.SETTINGS.better),)
    return [Alternative(INTENSITIES, message, scaled, limits, float(factors[far][0]))]


def _far_intensities(present: Solution) -> BoolArray:
    """Returns the images (F,) whose intensity is outlying under the widest prior that it has; none where most are."""
    widest = self_calibration.SIGMA_FACTORS[-1] * present.hypothesis.nominal.calibration.intensity_sigma
    far = np.abs(_log_intensity(present)) > photometry.SETTINGS.outlying_deviations * widest
    return far & (np.count_nonzero(far) <= len(far) // 2)


def _log_intensity(present: Solution) -> FloatArray:
    """Returns the logarithms (F,) of the intensities over their median."""
    return present.state.shared.log_intensity - np.median(present.state.shared.log_intensity)


def held_shift(present: Solution) -> list[Alternative]:
    """Proposes to hold the object where it was stated to be, in a poor fit: its shift may have run away. Measured: on a
    strongly curved sheet close to the camera it drifted by 70 mm; the misfit rose from 1.3 to 2.5."""
    if not present.poor:
        return []
    held = replace(present.hypothesis, shift_sigma_m=0.0)
    message = "the object is held at its stated place"
    return [Alternative(SHIFT, message, held, clearly_better(), unreported=True)]
