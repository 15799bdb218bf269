"""Selection of the image model: the plain model, unless a test demands another one whose fit is then better.

The plain model solves a sound capture: Lambert's law, light from other surfaces, lamps where the calibration says.
Cheap tests look for the most frequent deviations (`lamp_alternatives`, `term_alternatives`, `image_alternatives`). Only
what a test demands is tried, by another descent from its own start, and it replaces the model only if its fit is
accepted (`alternative`). What remains wrong is reported in a finding that is not corrected, and raises σ
(`error_variance`).
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from acquisition import photometry
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.result import ModelFinding
from acquisition.models.rounding import figure, percent
from acquisition.normals import alternation, pixel_solution
from acquisition.normals.alternatives import (
    image_alternatives,
    lamp_alternatives,
    model_trial,
    term_alternatives,
    term_tests,
)
from acquisition.normals.alternatives.alternative import Alternative
from acquisition.normals.alternatives.model_trial import Hypothesis, Solution
from acquisition.normals.self_calibration import Priors

ALTERNATIVES: tuple[Callable[[Solution], list[Alternative]], ...] = (
    lamp_alternatives.swapped_lamps,
    lamp_alternatives.other_axes,
    term_alternatives.translucent_surface,
    term_alternatives.darker_than_black,
    term_alternatives.other_formation,
    image_alternatives.moved_object,
    image_alternatives.bad_image,
    image_alternatives.other_intensities,
    image_alternatives.held_shift,
)
"""Functions that propose alternatives, in the order in which they are tried, the surest tests first."""


def select(hypothesis: Hypothesis) -> tuple[Solution, list[ModelFinding]]:
    """Solves the coarse level by the plain model, and by alternatives as tests demand them. Returns the solution and
    findings about the images, corrected ones first. Raises RigError normals.infeasible where no pixel is lit by two
    lamps."""
    present = _first(hypothesis)
    accepted: list[tuple[Alternative, bool]] = []
    no_better: set[str] = set()
    while (trial := _best_trial(present, no_better)) is not None:
        alternative, solution = trial
        accepted = [one for one in accepted if one[0].kind in alternative.hypothesis.corrected]  # others are undone
        accepted.append((alternative, alternative.convincing(present, solution)))
        present = solution
    terms = present.state.shared.terms
    reported = [one for one in accepted if not (one[0].unreported or term_alternatives.vanished(one[0], terms))]
    findings = [one.finding(terms, convincing=convincing) for one, convincing in reported]
    faults = list(dict.fromkeys(one.kind for one, _ in reported if not one.of_surface))
    findings += remaining(present) or several_faults(faults)
    return present, sorted(findings, key=lambda one: not one.corrected)


def _first(hypothesis: Hypothesis) -> Solution:
    """Solves by the plain model, or if that lights no pixel, with the object held where it is stated to be. No pixel is
    lit where the object's shift has run away, as to behind the camera."""
    try:
        return solve(hypothesis)
    except RigError as error:
        if error.code is not ErrorCode.NORMALS_INFEASIBLE:
            raise
        held = (*hypothesis.corrected, image_alternatives.SHIFT)
        return solve(replace(hypothesis, shift_sigma_m=0.0, corrected=held))


def solve(hypothesis: Hypothesis) -> Solution:
    """Solves a hypothesis: descent on the coarse level, noise of single pixels from a sample, fit and scores. Raises
    RigError normals.infeasible where no pixel is lit by two lamps."""
    level, nominal = hypothesis.level, hypothesis.nominal
    stated = nominal.calibration
    priors = Priors(
        stated.intensity_sigma, stated.lamp_position_sigma_m, hypothesis.shift_sigma_m, hypothesis.term_sigma,
        nominal.common_lamp_errors_m,
    )  # fmt: skip
    state = alternation.refine(level, hypothesis.start_m, nominal, priors)
    scene = replace(nominal, lamps=state.shared.lamps(nominal.lamps), terms=nominal.terms and state.shared.terms)
    scene, sample = pixel_solution.with_residual_noise(level.sample, state.resampled(level.interpolate_sample), scene)
    if not np.any(np.count_nonzero(sample.solution.estimate.usable, axis=0) > 1):
        raise RigError(
            ErrorCode.NORMALS_INFEASIBLE,
            "with the stated positions of lamps and object, no pixel of the object is lit by two lamps: check the "
            "lamps' positions, the object's rough depth and their units"
            if hypothesis.masked.images.metric
            else "with the stated directions, no pixel of the object is lit by two lights and not clipped: check the "
            "directions, the intensities, the mask and the images' values",
        )
    fit = sample.fit(sample.solution, nominal.noise)
    priors = replace(priors, shadows=state.shadows)
    scores = term_tests.scores(sample.solution.estimate, sample.solution.values, scene, state.shared, priors)
    return Solution(hypothesis, state, scene, sample, fit, scores)


def remaining(solution: Solution) -> list[ModelFinding]:
    """Returns what is still wrong: intensities or place at the end of their range, coded values, light that a score
    demands and no accepted trial has, a bad fit."""
    findings: list[ModelFinding] = []
    noise, fit = solution.scene.noise, solution.fit
    if solution.at_end_of_range:
        what, moved = "directions or intensities of the lamps differ", ""
        if solution.hypothesis.masked.images.metric:
            what = "lamp positions, lamp intensities or the object's distance differ"
            moved = f", object by {figure(1000 * abs(solution.moved_m), 0)} mm"
        findings.append(
            ModelFinding(
                kind="lamps",
                message=f"{what} from the stated values (intensities by {percent(noise.intensity)}{moved}): do not "
                "trust the normals",
                corrected=False,
            )
        )
    if solution.seems_coded:
        findings.append(
            ModelFinding(
                kind=term_alternatives.CODED,
                message="the pixel values do not seem to be linear, and none of the usual gamma curves explains them "
                "(a tone curve?): take linear images, do not trust the normals",
                corrected=False,
            )
        )
    terms = solution.state.shared.terms
    # Beside gloss, a lobe that differs from the model's scores as light from elsewhere.
    judged = solution.fit.redundant and not terms.specular
    if judged and (light := term_alternatives.light_from_elsewhere(solution)):
        findings.append(_unexplained(solution, light))
    if solution.unjudged:
        findings.append(
            ModelFinding(
                kind="misfit",
                message="too few pixels have four usable images to judge the fit "
                "(metal, sharp gloss, underexposed images?): do not trust the normals",
                corrected=False,
            )
        )
    elif fit.redundant and fit.probability < model_trial.SETTINGS.min_sound_probability:
        findings.append(
            ModelFinding(
                kind="misfit",
                message=f"the images fit the model badly: residuals are {fit.misfit:.1f} times the stated noise; only "
                f"{percent(fit.probability)} of sound captures fit as badly (metal, strong gloss, moving shadows?): "
                "do not trust the normals",
                corrected=False,
                value=fit.probability,
            )
        )
    return findings


def _unexplained(solution: Solution, names: list[str]) -> ModelFinding:
    """Returns the finding of ambient or stray light, by names of `ImageTerms`, that scores demand, but that may be
    indirect light, or with which the images fit no better. It is the one whose score gains more.

    Measured: of 992 sound captures seven would have it and no other one, of which four err by 14°; of 864 others none.
    Of 813 captures with a fault 17 would, 12 of them lit by ambient light of 1 or 3 % (design seeds 41–593, report
    seeds 1260–1279; decision 108). Beside gloss it is not given: a sheet, 0.4° off, would have it under planned lights.
    """
    light = max(names, key=lambda name: getattr(solution.scores, name).gain)
    kind, value = term_alternatives.TERMS[light][0], float(getattr(solution.scores, light).step)
    return ModelFinding(
        kind=kind,
        message=f"there seems to be {kind} ({percent(value)} of white), but it may be light from the object itself, or "
        "another fault: compare a frame with the lamp off; until then, do not trust the normals",
        corrected=False,
        value=value,
    )


def several_faults(kinds: list[str]) -> list[ModelFinding]:
    """Returns the finding that the capture has two or more kinds of faults, all corrected; none: it has fewer.

    Faults are rare and independent, so that two at once are less likely than one that no alternative describes, or that
    another one fits nearly as well. Measured: of 545 captures with one fault in which a fault was corrected and nothing
    is named, seven have a second one corrected that is not there; normals of six err by 5–24°. Of 2255 sound captures
    two have as many, which err by 11° (design seeds 502–584; decision 106).
    """
    if len(kinds) < 2:
        return []
    message = (
        f"several faults at once are rare ({', '.join(kinds)}), and another one may explain the images: check the "
        "capture for each of them; until then, do not trust the normals"
    )
    return [ModelFinding(kind="misfit", message=message, corrected=False)]


def _best_trial(present: Solution, no_better: set[str]) -> tuple[Alternative, Solution] | None:
    """Returns the best accepted trial of the first of `ALTERNATIVES` that has one; none: the model stays.

    Kinds whose trial fits no better, or lights no pixel, are added to `no_better`; a poor fit alone does not call for
    them again.
    """
    tried = set(present.hypothesis.corrected)
    for propose in ALTERNATIVES:
        alternatives = [
            alternative
            for alternative in propose(present)
            if alternative.kind not in tried
            and (alternative.demanded or alternative.kind not in no_better)
            and alternative.has_enough_images(len(present.scene.lamps))
        ]
        losses_without: list[float] = []
        accepted: list[tuple[Alternative, Solution]] = []
        best: tuple[Alternative, Solution] | None = None
        for alternative in alternatives:
            if best and best[0].decisive and not alternative.decisive and _decides(present, best[1]):
                break
            trial = _trial(alternative)
            if trial is None:
                no_better.add(alternative.kind)
                continue
            if alternative.leaves_out:
                losses_without.append(trial.fit.loss)
            if alternative.accepted(present, trial):
                accepted.append((alternative, trial))
                best = min(accepted, key=_residuals)
            elif not alternative.demanded and trial.fit.misfit >= present.fit.misfit:
                no_better.add(alternative.kind)
        accepted = _without_ambiguous_images(_without_codings_of_roughness(accepted), losses_without)
        if accepted:
            best = min(accepted, key=_residuals)
            return _better_with_another(accepted, best) or best
        tried |= {alternative.kind for alternative in alternatives}
    return None


def _trial(alternative: Alternative) -> Solution | None:
    """Returns the solution of an alternative; none: it leaves no pixel that is lit by two lamps."""
    hypothesis = alternative.hypothesis
    try:
        return solve(replace(hypothesis, corrected=(*hypothesis.corrected, alternative.kind)))
    except RigError as error:
        if error.code is not ErrorCode.NORMALS_INFEASIBLE:
            raise
        return None


def _without_codings_of_roughness(accepted: list[tuple[Alternative, Solution]]) -> list[tuple[Alternative, Solution]]:
    """Drops accepted codings that fit hardly better than an accepted roughness, which an exponent resembles.

    A coding is kept if it leaves at most `better_at_least` of the loss of the rough surface, or a smaller residual as a
    share of the values. Measured: this keeps it in 18 of 20 captures of coded values in which both are accepted, and in
    two of ten others, under mirrored lamps and with a flash (design seeds 401–448, eight lights in two rings).
    """
    rough = next((trial.fit for alternative, trial in accepted if alternative.term == "roughness"), None)
    if rough is None:
        return accepted
    most = model_trial.SETTINGS.better_at_least
    return [
        (alternative, trial)
        for alternative, trial in accepted
        if alternative.coding == 1
        or trial.fit.loss <= most * rough.loss
        or trial.fit.relative_residual <= rough.relative_residual
    ]


def _without_ambiguous_images(
    accepted: list[tuple[Alternative, Solution]], losses_without: list[float]
) -> list[tuple[Alternative, Solution]]:
    """Drops trials that leave an image out, unless one of them has clearly the least loss (decision 96). Where several
    images can be left out with similar losses, the model fits badly, not an image. `losses_without` are the losses of
    all such trials, accepted or not."""
    least = sorted(losses_without)[:2]
    if len(least) < 2 or least[0] <= model_trial.SETTINGS.better * least[1]:
        return accepted
    return [(alternative, trial) for alternative, trial in accepted if not alternative.leaves_out]


def _better_with_another(
    accepted: list[tuple[Alternative, Solution]], best: tuple[Alternative, Solution]
) -> tuple[Alternative, Solution] | None:
    """Returns the accepted trial that fits better than the best one when both are corrected further; none: none does.

    Its rivals are trials of other axes, or where these are the best, of terms that a score demands. Each rival is
    solved again with what its scores then demand, or with the correction of the best trial, and the best trial with
    what its scores demand. Metal has no rivals: its highlights alone fit a surface under other axes as well. Measured:
    under mirrored lamps gloss of any strength fitted a glossy profile better than the right axes without gloss, 53°
    off, and once it was accepted, the right axes fitted no better than the mirrored ones. A coding fitted a rough sheet
    better than the right axes without roughness, 63° off. A rough profile in stray light fitted turned lamps better
    than stray light or roughness alone, 51° off.
    """
    axes = lamp_alternatives.AXES
    rivals = [one for one in accepted if (one[0].step != 0 if best[0].kind == axes else one[0].kind == axes)]
    if not rivals or best[0].kind == photometry.METAL:
        return None
    same = best[0].kind, best[0].term
    residuals = min(_residuals(best), _residuals_with(best[1], term_alternatives.scored_terms(best[1])))
    for rival in rivals:
        formation = term_alternatives.other_formation(rival[1])
        others = [one for one in formation if one.step != 0 or (one.kind, one.term) == same]
        if _residuals_with(rival[1], others) < residuals:
            return rival
    return None


def _residuals_with(present: Solution, alternatives: list[Alternative]) -> float:
    """Returns the least `_residuals` of those alternatives that are accepted; infinite: none is."""
    trials = ((alternative, _trial(alternative)) for alternative in alternatives)
    solved = ((alternative, trial) for alternative, trial in trials if trial is not None)
    return min((_residuals(one) for one in solved if one[0].accepted(present, one[1])), default=np.inf)


def _decides(before: Solution, trial: Solution) -> bool:
    """Returns whether an accepted trial is so much better that it need not be compared with others. Its misfit and its
    relative residual are both at most `better_at_least`, about half, of those before."""
    most = model_trial.SETTINGS.better_at_least
    return (
        not trial.poor
        and trial.fit.misfit <= most * before.fit.misfit
        and trial.fit.relative_residual <= most * before.fit.relative_residual
    )


def _residuals(accepted: tuple[Alternative, Solution]) -> float:
    """Returns misfit × relative residual of a trial, over its coding's exponent, which multiplies relative noise."""
    alternative, trial = accepted
    return trial.fit.misfit * trial.fit.relative_residual / alternative.coding
