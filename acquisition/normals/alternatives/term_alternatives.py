"""Alternatives with other image formation: terms that a score tests, codings, metal, and light below the surface.

Every function takes a solution and returns alternatives (`alternative.Alternative`), none where no test demands any:
terms where their scores do, codings and metal in a poor fit, sharpened images where light leaks into shadows.
"""

from dataclasses import astuple, dataclass, fields, replace

import numpy as np

from acquisition import photometry
from acquisition.models.base import Float32Array
from acquisition.models.tuned import tuned
from acquisition.normals import alternation, self_calibration
from acquisition.normals.alternatives import changed_images, image_alternatives, model_trial
from acquisition.normals.alternatives.alternative import (
    AS_GOOD,
    Alternative,
    Limits,
    clearly_better,
    decisive,
    explains_more,
    far_better,
)
from acquisition.normals.alternatives.model_trial import Hypothesis, Solution
from acquisition.normals.alternatives.term_tests import TermScore, TermScores
from acquisition.normals.indirect_light import surface_diffusion, translucency
from acquisition.normals.indirect_light.surface_diffusion import SurfaceGraph
from acquisition.normals.pixels.image_terms import LAMBERTIAN, ImageTerms


@dataclass(frozen=True)
class TermAlternativeSettings:
    """Tuned numbers of terms on trial."""

    term_sigma: ImageTerms = tuned(
        ImageTerms(roughness=0.3, ambient=0.15, offset=0.075, gloss=1.0, metal=1.0, strength=1.0), "term"
    )
    """1 σ of the priors of terms that are estimated; those of gloss, metal and strength are nearly flat. A term that is
    below a tenth of it after one step from zero is not tried. Less is not harmless but hard to tell: ambient light of
    1 % takes a blob from 0.39 to 0.85°, a roughness of 0.2 rad (b = 0.15) to 1.76° (audit of an earlier solver,
    November 2026); b = 0.03 is a roughness of 0.08 rad. Measured for ambient light and offset: where neither is there,
    shadows show 0.011 of ambient light at most in 44 sound captures, except a vessel (0.024), and 0.006 of an offset;
    where either is 0.03, they show 0.027 and more of it (`shadow_light`). Measured for gloss, whose value is the
    amount, 1 of a dielectric: 0.11–1.3 in 84 of 95 glossy captures (α 0.12–0.5), 0.09 at most in 174 others (design
    seeds 20–22, 40–43, 50, 51, 60–63; 6–20 lights in two rings), more in three of 106 sound Lambertian and translucent
    ones of seeds 45–129, all translucent. The amount identifies gloss by itself, so that strong evidence is enough of a
    gain: of a small glossy image, or a pilot's, it is 3–8."""

    @property
    def min_step(self) -> ImageTerms:
        """Values of the terms after one step from zero below which they are not tried."""
        return ImageTerms(*(one / 10 for one in astuple(self.term_sigma)))


SETTINGS = TermAlternativeSettings()

CODED_EXPONENTS = (1.4, 1.8, 2.2)
"""Exponents that undo codings of eight-bit images, the usual one last. A free exponent would explain metal."""

GLOSS_START = 0.2
"""Roughness α from which gloss is estimated. From 0.12 and 0.25 it ends alike (0.158 and 0.39, six families)."""

METAL_START = 0.3
"""Roughness α from which metal is estimated in a poor fit."""

CODED = "coded values"
"""Kind of the finding of values that are not linear."""

TERMS = {
    "roughness": ("rough surface", "the surface is rough: it is solved with Oren and Nayar's reflectance of roughness"),
    "ambient": ("ambient light", "ambient light falls on the object: it is estimated and subtracted"),
    "offset": (
        "stray light",
        "the images have a constant offset (black level, stray light, or too much subtracted): it is estimated and "
        "subtracted",
    ),
    "metal": (
        photometry.METAL,
        "the surface reflects no diffuse light: it is solved as metal, with a larger σ, of roughness α",
    ),
    "gloss": ("gloss", "the surface is glossy: it is solved with a specular lobe of roughness α"),
}
"""Kind and message of the finding for terms of `ImageTerms`."""

FROM_ELSEWHERE = frozenset(kind for name, (kind, _) in TERMS.items() if name in ("ambient", "offset"))
"""Kinds of the findings of ambient and stray light."""


def other_formation(present: Solution) -> list[Alternative]:
    """Proposes terms and codings that scores demand; in a poor fit also a coding and metal."""
    return [*gloss(present), *scored_terms(present), *metal(present), *coded(present)]


def scored_terms(present: Solution) -> list[Alternative]:
    """Proposes roughness, ambient and stray light that scores demand; none beside metal, no roughness beside gloss.

    Roughness needs strong evidence, which 94 % of 225 rough captures give and 2 % of 138 Lambertian and translucent
    ones (design seeds 11–129). Any gain is enough where values seem coded, which roughness resembles, and none is
    needed where the sample fits better as rough. It makes all pixels fit better; of a matt vessel it lowers the loss,
    but hardly the median residual (decision 105).

    Ambient and stray light need a gain of `min_gain`, because light between surfaces that is not predicted resembles
    them. Beside roughness strong evidence is enough, because the step separates them by itself: it is 0.010 of ambient
    light and 0.003 of an offset at most in 44 sound rough captures (design seeds 401–437). Where an exponent gains
    more, the fit has to confirm them (decision 102). Where shadows show which of the two it is, the other one is not
    tried, and no ambient light is tried where it may be indirect light.
    """
    hypothesis, scores = present.hypothesis, present.scores
    known = hypothesis.nominal.terms
    if scores is None:
        return []
    if known is not None and (known.metal > 0 or present.seems_coded):
        return []
    demanded: list[Alternative] = []
    if not (hypothesis.term_sigma.roughness > 0 or (known is not None and known.specular)):
        least = 0.0 if present.seems_coded else self_calibration.STRONG_EVIDENCE
        scored = tried_gain(scores, "roughness") > least
        if scored or (known is None and _fits_as_rough(present)):
            step = scores.roughness.step if scored else model_trial.ROUGH.roughness
            limits = explains_more(throughout=True)
            demanded.append(_with_term(hypothesis, "roughness", known or LAMBERTIAN, limits, step))
    for name in light_from_elsewhere(present):
        score: TermScore = getattr(scores, name)
        limits = clearly_better() if scores.exponent.gain > score.gain else AS_GOOD
        if not (_outdone(name, present) or _may_be_indirect(name, present)):
            demanded.append(_with_term(hypothesis, name, known or LAMBERTIAN, limits, score.step))
    return decisive(demanded)


def light_from_elsewhere(present: Solution) -> list[str]:
    """Returns which of ambient and stray light scores demand, of a surface that is no metal; none where either is
    estimated already. In a result it is named (`model_selection.remaining`)."""
    hypothesis, scores = present.hypothesis, present.scores
    known = hypothesis.nominal.terms
    if scores is None or hypothesis.term_sigma.from_elsewhere or (known is not None and known.metal > 0):
        return []
    rough = hypothesis.term_sigma.roughness > 0
    least = self_calibration.STRONG_EVIDENCE if rough else model_trial.SETTINGS.min_gain
    return [name for name in ("ambient", "offset") if tried_gain(scores, name) > least]


def darker_than_black(present: Solution) -> list[Alternative]:
    """Proposes an offset below zero: too much was subtracted from the images. None is proposed beside metal.

    It has to gain more than any other term that would be tried, by strong evidence. Measured: in 96 sound captures
    (design seeds 480–491, eight families, eight lights in two rings) it is tried once, of a glossy object, and rejected
    because a quarter of the step is found. Where values are left-censored at black, shadows count as dark as the
    offset, and are no evidence of it (decision 97).
    """
    hypothesis, scores = present.hypothesis, present.scores
    known = hypothesis.nominal.terms or LAMBERTIAN
    if scores is None or known.metal > 0 or hypothesis.term_sigma.from_elsewhere:
        return []
    excess = scores.excess
    rival = max(tried_gain(scores, one) for one in ("roughness", "gloss", "ambient", "offset"))
    least = max(model_trial.SETTINGS.min_gain, rival + self_calibration.STRONG_EVIDENCE)
    if excess.step > -SETTINGS.min_step.offset or excess.gain < least:
        return []
    if hypothesis.nominal.stores_black_as_zero:
        hypothesis = hypothesis.reread(changed_images.below_black(hypothesis.masked.images, excess.step))
        hypothesis = replace(hypothesis, nominal=replace(hypothesis.nominal, shadows_informative=False))
    return [_with_term(hypothesis, "offset", replace(known, offset=excess.step), AS_GOOD, excess.step)]


def tried_gain(scores: TermScores, name: str) -> float:
    """Returns the gain of the log-likelihood by one of `ImageTerms`, 0 where its step is too small to be tried."""
    score: TermScore = getattr(scores, name)
    return score.gain if score.step > getattr(SETTINGS.min_step, name) else 0.0


def _fits_as_rough(present: Solution) -> bool:
    """Returns whether the sample fits better as rough, whatever the score."""
    return present.fit.redundant and present.rough_misfit <= model_trial.SETTINGS.slightly_better


def _outdone(name: str, present: Solution) -> bool:
    """Returns whether shadows, not lit pixels, give strong evidence of the other one of ambient light and offset."""
    scores = present.scores
    if scores is None or not present.state.shadows.has_measurements:
        return False
    other = {"ambient": scores.offset, "offset": scores.ambient}.get(name)
    if other is None or other.step <= 0:
        return False
    return other.gain > getattr(scores, name).gain + self_calibration.STRONG_EVIDENCE


def _may_be_indirect(name: str, present: Solution) -> bool:
    """Returns whether ambient light may be an error of the predicted indirect light in shadows, because it is so weak.
    That error is one factor of all pixels: inside vessels, surfaces that the camera does not see send as much light."""
    shared, shadows = photometry.SETTINGS, present.state.shadows
    if name != "ambient" or present.scores is None:
        return False
    return present.scores.ambient.step < shared.outlying_deviations * shared.predicted_light_sigma * shadows.indirect


def vanished(accepted: Alternative, terms: ImageTerms) -> bool:
    """Returns whether an accepted term was mistaken for one that was estimated later. So little is left of it beside
    the later one that it would not have been tried."""
    left = abs(getattr(terms, accepted.term)) if accepted.term else np.inf
    return accepted.step != 0 and left < getattr(SETTINGS.min_step, accepted.term)


def coded(present: Solution) -> list[Alternative]:
    """Proposes to undo codings. The usual one is proposed in a poor fit, or where the score test finds an exponent
    below 1; all where it finds one well below."""
    usual = CODED_EXPONENTS[-1:] if present.poor or present.may_be_coded else ()
    exponents = CODED_EXPONENTS if present.seems_coded else usual
    hypothesis = _without_light_from_elsewhere(present.hypothesis)
    return [
        Alternative(
            CODED, f"the images are not linear: their values are raised to the power of {exponent}",
            hypothesis.reread(changed_images.linearised(hypothesis.masked.images, exponent)),
            _limits_of_coding(present, exponent), exponent, coding=exponent, demanded=present.may_be_coded,
        )
        for exponent in exponents
    ]  # fmt: skip


def _limits_of_coding(present: Solution, exponent: float) -> tuple[Limits, ...]:
    """Returns the limits of linearised values: the fainter the exponent's score, the better they have to fit.

    Undoing a coding multiplies relative noise by its exponent, and no more. In dark images, as of smooth metal, it
    brings most values near zero, where any model fits them, and relative residuals rise by factors of 4 to 100. A
    coding that replaces ambient or stray light, which explains the same shadows, has to explain them better.
    """
    better, least = model_trial.SETTINGS.better, model_trial.SETTINGS.better_at_least
    if present.hypothesis.term_sigma.from_elsewhere:
        return (Limits(better, better),)
    if present.seems_coded:
        if_sound = Limits(better, better * exponent, sound=True)
        return if_sound, Limits(better, least * exponent), Limits(least**2, better * exponent)
    return (Limits(least if present.may_be_coded else least**2, least * exponent),)


def _without_light_from_elsewhere(hypothesis: Hypothesis) -> Hypothesis:
    """Returns the hypothesis before ambient and stray light were estimated: a coding, too, lifts shadows."""
    terms, sigma = hypothesis.nominal.terms, hypothesis.term_sigma
    if not sigma.from_elsewhere:
        return hypothesis
    left = None if terms is None else replace(terms, ambient=0.0, offset=0.0)
    return replace(
        hypothesis,
        nominal=replace(hypothesis.nominal, terms=None if left == LAMBERTIAN else left),
        term_sigma=replace(sigma, ambient=0.0, offset=0.0),
        corrected=tuple(kind for kind in hypothesis.corrected if kind not in FROM_ELSEWHERE),
    )


def gloss(present: Solution) -> list[Alternative]:
    """Proposes gloss of a dielectric and gloss of any strength.

    It is proposed where the score test finds it, also beside ambient and stray light, and with any gain where the score
    finds roughness, which a few highlights resemble; in a poor fit always, because the wrong normals that sharp
    highlights make leave no score. A dielectric that halves the misfit decides. Measured: in 115 matt captures with a
    fault (gamma, ambient and stray light, mirrored lamps, a flash, moved; design seeds 70, 71 and 73, eight lights) it
    leaves 0.60 at least.
    """
    known = present.hypothesis.nominal.terms
    if present.scores is None or (
        known is not None and (known.specular or present.hypothesis.term_sigma.roughness > 0)
    ):
        return []
    rough = tried_gain(present.scores, "roughness") > self_calibration.STRONG_EVIDENCE
    found = tried_gain(present.scores, "gloss") > (0.0 if rough else self_calibration.STRONG_EVIDENCE)
    if not found and not (present.poor and known is None):
        return []
    known = known or LAMBERTIAN
    starts = replace(known, gloss=GLOSS_START), replace(known, gloss=GLOSS_START, strength=1.0)
    limits = explains_more() if found else far_better()
    dielectric, other = (
        replace(_with_term(present.hypothesis, "gloss", one, limits), demanded=found) for one in starts
    )
    return [replace(dielectric, least_images=photometry.OVERDETERMINED, decisive=True), other]


def metal(present: Solution) -> list[Alternative]:
    """Proposes metal, in a poor fit of a surface that no other term describes yet."""
    if present.hypothesis.nominal.terms is not None or not present.poor:
        return []
    start = ImageTerms(metal=METAL_START)
    limits = (Limits(1.0, model_trial.SETTINGS.better),)
    return [replace(_with_term(present.hypothesis, "metal", start, limits), demanded=False)]


def _with_term(
    hypothesis: Hypothesis, name: str, start: ImageTerms, limits: tuple[Limits, ...], step: float = 0.0
) -> Alternative:
    """Returns the alternative that estimates one of `TERMS`, beside other terms of the start and those estimated
    already, accepted within limits."""
    estimated = {name} | {field.name for field in fields(start) if getattr(start, field.name) > 0}
    sigma = replace(hypothesis.term_sigma, **{one: getattr(SETTINGS.term_sigma, one) for one in estimated})
    changed = replace(hypothesis, nominal=replace(hypothesis.nominal, terms=start), term_sigma=sigma)
    return Alternative(*TERMS[name], changed, limits, term=name, step=step)


def translucent_surface(present: Solution) -> list[Alternative]:
    """Proposes sharpened images, where light leaks into shadows as from below the surface.

    None are proposed where something else explains the leak: one image that fits far worse and alone may be blurred; a
    glossy surface, by its score or as it is solved, which mirrors lamps into shadows; ambient or stray light, which
    falls there, too; or a surface that has drifted away, so that its shadows fall elsewhere.
    """
    hypothesis, level = present.hypothesis, present.hypothesis.level
    others = {translucency.KIND, TERMS["gloss"][0], TERMS["metal"][0], *FROM_ELSEWHERE}
    if others & set(hypothesis.corrected):
        return []
    scores = present.scores if hypothesis.nominal.terms is None else None
    glossy = scores is not None and tried_gain(scores, "gloss") > model_trial.SETTINGS.min_gain
    if present.out_of_place or glossy or not hypothesis.thorough:
        return []
    leak = present.leak
    if leak is None or not leak.sought or image_alternatives.one_outlies(present):
        return []
    length_px = level.factor * leak.length_px
    # Noise that neighbours share is that of a block of the coarse grid, not a pixel's own.
    gain = max(surface_diffusion.noise_gain(length_px), surface_diffusion.noise_gain(leak.length_px))
    sharpened = changed_images.sharpened(hypothesis.masked.images, *_full_surface(present), length_px, gain)
    focal = hypothesis.nominal.calibration.camera_matrix[0][0]
    length_mm = 1000 * length_px * float(np.mean(present.state.depth_m)) / focal
    length, unit = (length_mm, "mm") if hypothesis.masked.images.metric else (length_px, "pixels")
    message = (
        f"light spreads by {length:.1f} {unit} below the surface, or the images are out of focus: they are sharpened"
    )
    return [Alternative(translucency.KIND, message, hypothesis.reread(sharpened), AS_GOOD, length)]


def _full_surface(present: Solution) -> tuple[SurfaceGraph, Float32Array]:
    """Returns graph and albedo (h, w) of all object pixels, from the coarse solution."""
    masked, level, state = present.hypothesis.masked, present.hypothesis.level, present.state
    albedo, depth = np.zeros(masked.mask.shape, np.float32), np.zeros(masked.mask.shape, np.float32)
    for rows in masked.blocks():
        pixels = masked.pixels(rows)
        if len(pixels.index) == 0:
            continue
        values = alternation.divide_intensity(pixels.values, state.shared.log_intensity)
        known, _ = translucency.albedo_and_lit(values, level.interpolate(present.shading, pixels, rows.start))
        albedo[rows] = pixels.image(known)
        depth[rows] = pixels.image(level.interpolate(state.depth_m, pixels, rows.start))
    return surface_diffusion.graph(albedo > 0, masked.ray, depth), albedo
