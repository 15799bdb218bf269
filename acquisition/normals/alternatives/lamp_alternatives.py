"""Alternatives with other lamps: two exchanged, or all mirrored, exchanged or turned about the viewing axis.

Every function takes a solution and returns alternatives (`alternative.Alternative`), none where no test demands any. In
a poor fit other axes compete with other images and image formation, as each can resemble the others (decision 72).
"""

from dataclasses import replace

import numpy as np

from acquisition import photometry
from acquisition.models.base import FloatArray
from acquisition.normals import self_calibration
from acquisition.normals.alternatives import image_alternatives, light_tests, model_trial, term_alternatives
from acquisition.normals.alternatives.alternative import AS_GOOD, Alternative, Limits, decisive
from acquisition.normals.alternatives.light_tests import IntegrableAxes
from acquisition.normals.alternatives.model_trial import Hypothesis, Solution

AXES, TURNED, SCORED, REFINED = "axes of the lamps", "turned lamps", "scored turn", "angle of turned lamps"
"""Kind of the finding; marks of a hypothesis whose lamps were turned by an angle, by a score's angle, and once more."""

REFINEMENTS, REFINED_DEG = 2, 0.5
"""Largest number of refinements of such an angle, each leaving a fifth of it, and the angle, degrees, that ends
them."""


def other_axes(present: Solution) -> list[Alternative]:
    """Proposes other axes of the lamps: mirrored, exchanged, turned or opposite.

    Mirrored, exchanged and turned axes are proposed where the normals are closer to those of a surface under them, or
    where a score demands a turn. Opposite axes are proposed where the outline's normals point inwards, unless a good
    fit under near light confirms a hollow object, and in a bad fit, in which they have to fit far better.

    What a score demands competes with them (gloss where it gains most), and in a poor fit also other images, metal and
    coded values. A wrong reflectance can leave normals of any circulation, and coded values of a dome fit a bowl under
    opposite lamps better. Metal that fits is tried under other axes only where the circulation is significant, because
    highlights alone fit a surface under other axes as well. Near light that redundant images judge does not fit worse
    under axes that are right, however sure the circulation is of them (decision 102).
    """
    hypothesis, coarse, normals = present.hypothesis, present.hypothesis.level.coarse, present.state.normals
    found, scored = light_tests.integrable_axes(coarse, normals), _scored_axes(present)
    if photometry.METAL in hypothesis.corrected and not (present.badly_fitting or found.sure):
        return []
    if TURNED in hypothesis.corrected:
        # Normals turn by a little less than the lamps do, because near light fits turned normals worse.
        again = sum(kind.startswith(REFINED) for kind in hypothesis.corrected) + 1
        left_deg = light_tests.turn_deg(found.unmirrored)
        if SCORED in hypothesis.corrected and present.scores is not None:
            # Any gain is enough here, because there is evidence of a turn already.
            left_deg = float(np.degrees(present.scores.turn.step))
        if again > REFINEMENTS or abs(left_deg) < REFINED_DEG:
            return []
        axes = light_tests.turned_by(left_deg)
        return [_relit(hypothesis, f"{REFINED} {again}", axes, 1.0, independently_tested=True, unreported=True)]
    turned = replace(hypothesis, corrected=(*hypothesis.corrected, TURNED))
    judged = len(present.scene.lamps) >= photometry.REDUNDANT and _near(present)
    alternatives = [
        _relit(
            turned, AXES, sign * axes, 1.0 if sure else model_trial.SETTINGS.better,
            independently_tested=sure and not judged,
        )
        for axes, sure in ((one, found.sure and one is found.best) for one in found.turned)
        for sign in _signs(present, axes)
    ]  # fmt: skip
    if scored is not None:
        alternatives.append(_relit(replace(turned, corrected=(*turned.corrected, SCORED)), AXES, scored, 1.0))
    sure = found.sure or scored is not None
    quarters = [] if found.sure and found.turned else _quarter_turns(present, found)
    alternatives += quarters
    if not alternatives:
        return []
    others = _others(present, unscored=present.poor and (sure or bool(quarters)))
    return [*(decisive(alternatives) if sure else alternatives), *others]


def _quarter_turns(present: Solution, found: IntegrableAxes) -> list[Alternative]:
    """Proposes axes that are mirrored or turned by quarters, or opposite to those stated.

    Not proposed are axes under which least squares at the start leaves more than 1 / `better` of the residual under the
    stated ones. Measured: in 30 captures under mirrored lamps (design seeds 460 and 463, eight lights in two rings) it
    leaves 0.27–1.08 under the axes that were accepted, 1.00–1.80 under others; 1.4–2.3 of a sound groove.
    """
    hypothesis, coarse = present.hypothesis, present.hypothesis.level.coarse
    if not _near(present):
        return _quarter_turns_of_far_lamps(present, found)
    trials, most = (found.quarter, -found.quarter), model_trial.SETTINGS.better
    if np.array_equal(found.quarter, light_tests.STATED_AXES):
        trials = trials[1:]
        outwards = light_tests.outwardness(present.state.normals, light_tests.outline(coarse))
        if outwards is None or outwards > -photometry.SETTINGS.min_view_cosine:
            if not present.badly_fitting:
                return []
            # Under opposite lamps a hollow object is solved as a raised one, whose normals point outwards.
            most = model_trial.SETTINGS.better_at_least
        elif present.well_fitting:
            # Near light does not fit a raised object as a hollow one.
            return []
    return [_relit(hypothesis, AXES, axes, most) for axes in trials if _likely(hypothesis, axes)]


def _near(present: Solution) -> bool:
    """Returns whether lamps are so near that their light distinguishes hollow from raised."""
    hypothesis = present.hypothesis
    return light_tests.near(hypothesis.level.coarse, hypothesis.start_m, hypothesis.nominal.lamps)


def _signs(present: Solution, axes: FloatArray) -> tuple[int, ...]:
    """Returns the signs of axes (2, 2) to try: both where near light distinguishes hollow from raised. Elsewhere it is
    the sign under which the outline's normals point outwards, or that of the axes if there is no outline."""
    if _near(present):
        return (1, -1)
    outwards = _outwardness(present, axes)
    return (1,) if outwards is None or outwards >= 0 else (-1,)


def _outwardness(present: Solution, axes: FloatArray) -> float | None:
    """Returns the outwardness of the normals under distant lamps of other axes (2, 2), with which the normals turn."""
    normals = present.state.normals.copy()
    normals[:2] = axes.astype(np.float32) @ normals[:2]
    return light_tests.outwardness(normals, light_tests.outline(present.hypothesis.level.coarse))


def _quarter_turns_of_far_lamps(present: Solution, found: IntegrableAxes) -> list[Alternative]:
    """Proposes mirrored, quarter-turned or opposite axes of distant lamps, under which residuals are all the same.

    Mirrored or turned axes are proposed where the circulation is sure of them, opposite ones where all of the outline's
    normals point inwards. Measured: in 140 solved objects (design seeds 460–479; near light, 4 and 8 lights) the
    circulation is never sure of other axes, and the outwardness is at least −0.42, of bowls.
    """
    axes = found.quarter
    if np.array_equal(axes, light_tests.STATED_AXES):
        outwards = _outwardness(present, axes)
        if outwards is None or outwards > light_tests.INWARDS:
            return []
    elif not found.sure:
        return []
    (sign,) = _signs(present, axes)
    return [_relit(present.hypothesis, AXES, sign * axes, 1.0, independently_tested=True)]


def _likely(hypothesis: Hypothesis, axes: FloatArray) -> bool:
    """Returns whether the start does not fit far worse under axes that are multiplied by a matrix (2, 2)."""
    nominal = hypothesis.nominal
    others = light_tests.transformed(nominal.lamps, axes)
    residual = light_tests.relative_residual(
        hypothesis.level.coarse, hypothesis.start_m, nominal.lamps, others, nominal.calibration
    )
    return residual <= 1 / model_trial.SETTINGS.better


def _scored_axes(present: Solution) -> FloatArray | None:
    """Returns the lamps' axes (2, 2) turned as the score of a turn says. None where there is no strong evidence of a
    turn, the turn is below `REFINED_DEG`, or another term gains more."""
    scores = present.scores
    if scores is None or scores.turn.gain <= self_calibration.STRONG_EVIDENCE or not scores.gains_most(scores.turn):
        return None
    turn_deg = float(np.degrees(scores.turn.step))
    return light_tests.turned_by(turn_deg) if abs(turn_deg) > REFINED_DEG else None


def _others(present: Solution, *, unscored: bool) -> list[Alternative]:
    """Returns the alternatives that compete with other axes. They are what a score demands, with gloss where it gains
    more than what is tried of ambient and stray light. With `unscored` they are also all else that a poor fit may be:
    other images, metal and coded values."""
    scores, gain = present.scores, term_alternatives.tried_gain
    most_gained = scores is not None and scores.gloss.gain > max(gain(scores, "offset"), gain(scores, "ambient"))
    gloss = term_alternatives.gloss(present) if most_gained else []
    scored = [] if present.unjudged else term_alternatives.scored_terms(present)
    if not unscored:
        coded = term_alternatives.coded(present) if present.seems_coded else []
        return [*(one for one in gloss if one.demanded), *scored, *coded]
    return [
        *gloss,
        *scored,
        *image_alternatives.bad_image(present),
        *image_alternatives.moved_object(present),
        *term_alternatives.metal(present),
        *term_alternatives.coded(present),
    ]


def _relit(
    hypothesis: Hypothesis,
    kind: str,
    axes: FloatArray,
    most: float,
    *,
    independently_tested: bool = False,
    unreported: bool = False,
) -> Alternative:
    """Returns the alternative with the lamps' axes multiplied by a matrix (2, 2). `most` is the largest loss that may
    be left; relative residuals must not rise."""
    relit = hypothesis.with_axes(axes)
    return Alternative(
        kind,
        _axes_sentence(axes),
        relit,
        (Limits(most, 1.0),),
        independently_tested=independently_tested,
        demanded=most > model_trial.SETTINGS.better_at_least,
        unreported=unreported,
    )


def _axes_sentence(axes: FloatArray) -> str:
    """Returns the message of the finding that the lamps' axes (2, 2) are not as stated."""
    names = {(1, 0): "x", (-1, 0): "−x", (0, 1): "y", (0, -1): "−y"}
    rows = [names.get((round(row[0]), round(row[1]))) for row in axes if np.max(np.abs(row)) == 1]
    if len(rows) == 2:
        return f"the lamps' axes differ from the camera's: {rows[0]} and {rows[1]} are used as their x and y"
    first = "they are mirrored in x, then " if np.linalg.det(axes) < 0 else "they are "
    return f"the lamps' axes differ from the camera's: {first}turned by {light_tests.turn_deg(axes):+.0f}°"


def swapped_lamps(present: Solution) -> list[Alternative]:
    """Proposes to exchange two lamps where least squares fits far better then; any lamps explain four images."""
    hypothesis, nominal = present.hypothesis, present.hypothesis.nominal
    doubted = present.poor or image_alternatives.one_outlies(present)
    if not doubted or len(nominal.lamps) < photometry.REDUNDANT:
        return []
    swap = min(
        (
            light_tests.swapped_pair(hypothesis.level.coarse, depth_m, nominal.lamps, nominal.calibration)
            for depth_m in (hypothesis.start_m, present.state.depth_m)
        ),
        key=lambda one: one.residual_share,
    )
    if swap.residual_share >= model_trial.SETTINGS.better_at_least:
        return []
    order = np.arange(len(nominal.lamps))
    order[[swap.first, swap.second]] = swap.second, swap.first
    first, second = (hypothesis.masked.images.label(number) for number in (swap.first, swap.second))
    message = f"the lamps of images {first} and {second} were swapped: they are exchanged back"
    return [Alternative("swapped lamps", message, hypothesis.with_lamps_of(order), AS_GOOD)]
