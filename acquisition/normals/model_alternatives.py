"""Alternative models of the images: what most often is otherwise than the plain model says, each on a test's demand.

Every function looks at a solution and gives the alternatives of one kind of fault, none where no test demands any. An
alternative is another problem to solve (other lamps, other images, another term of image formation) with the rule by
which its fit is accepted. `ALTERNATIVES` lists them, the surest tests first; intensities come late, because they absorb
other faults.
"""

from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, fields, replace

import numpy as np

from acquisition import mosaic, photometry
from acquisition.models.base import Float32Array, FloatArray
from acquisition.models.tuned import tuned
from acquisition.normals import (
    alternation,
    changed_images,
    image_terms,
    light_tests,
    model_trial,
    registration,
    self_calibration,
    surface_diffusion,
    translucency,
)
from acquisition.normals.goodness_of_fit import Fit
from acquisition.normals.image_terms import LAMBERTIAN, ImageTerms
from acquisition.normals.model_trial import Alternative, Problem, Solution
from acquisition.normals.surface_diffusion import SurfaceGraph
from acquisition.normals.term_tests import TermScore, TermScores


@dataclass(frozen=True)
class AlternativeSettings:
    """Tuned numbers of the choice between models."""

    term_sigma: ImageTerms = tuned(
        ImageTerms(roughness=0.3, ambient=0.1, offset=0.05, gloss=1.0, metal=1.0, strength=1.0), "term"
    )
    """1 σ of the priors of terms that are estimated, which say next to nothing; what is below a tenth of it, by one step
    from zero, is not tried. Less is not harmless but hard to
    tell: ambient light of 1 % takes a blob from 0.39 to 0.85°, a roughness of 0.2 rad, b of 0.15, to 1.76° (audit of an
    earlier solver, November 2026). b of 0.03 is a roughness of 0.08 rad. Of gloss the value is the amount, of 1 that a
    dielectric has: 0.11–1.3 of 84 of 95 glossy captures (α 0.12–0.5), 0.09 at most of 174 others (design seeds 20–22,
    40–43, 50, 51, 60–63; 6–20 lights by two rings), above it in three of 106 sound Lambertian and translucent ones of
    seeds 45–129, all translucent. It tells gloss by itself, so that strong evidence is enough of a gain: of a small
    glossy image, or one of a pilot, it is 3–8."""

    @property
    def min_step(self) -> ImageTerms:
        """Values of the terms, by one step from zero, below which they are not tried."""
        return ImageTerms(*(one / 10 for one in astuple(self.term_sigma)))


SETTINGS = AlternativeSettings()

CODED_EXPONENTS = (1.4, 1.8, 2.2)
"""Exponents that undo codings of eight-bit images, the usual one last. As a free parameter it would explain metal."""

METAL_START = 0.3
"""Roughness α from which a metal's is estimated in a poor fit."""

SECOND_STARTS = (("ambient", 0.05), ("ambient", 0.15), ("offset", 0.03), ("offset", 0.1))
"""Ambient and stray light of further starts: from zero the descent stops in a wrong shape where there is much."""


def other_axes(present: Solution) -> list[Alternative]:
    """Axes of the lamps mirrored, exchanged or turned, where the normals are closer to those of a surface then; or
    opposite, where the normals of the outline point inwards and neither fit nor light from near says that they do, or
    where the images fit badly and far better then.

    In a poor fit metal and coded values compete with them: a wrong reflectance can leave normals whose circulation says
    anything, and coded values of a dome fit a bowl under opposite lamps better. Of metal that fits they are tried only
    where the circulation is significant, because highlights alone fit a surface under other axes as well.
    """
    problem, coarse, normals = present.problem, present.problem.level.coarse, present.state.normals
    found, scored = light_tests.integrable_axes(coarse, normals), _scored_axes(present)
    if photometry.METAL in problem.corrected and not (present.badly_fitting or found.sure):
        return []
    if TURNED in problem.corrected:
        # The normals of turned lamps are not turned by quite as much, since light from near fits others worse.
        again = sum(kind.startswith(REFINED) for kind in problem.corrected) + 1
        left_deg = light_tests.turn_deg(found.unmirrored)
        if SCORED in problem.corrected and present.scores is not None:  # by likelihood alone: evidence is there already
            left_deg = float(np.degrees(present.scores.turn.step))
        if again > REFINEMENTS or abs(left_deg) < REFINED_DEG:
            return []
        axes = light_tests.turned_by(left_deg)
        return [_relit(problem, f"{REFINED} {again}", axes, 1.0, sound_enough=True, silent=True)]
    turned = replace(problem, corrected=(*problem.corrected, TURNED))
    alternatives = [
        _relit(turned, AXES, sign * axes, 1.0 if sure else model_trial.SETTINGS.better, sound_enough=sure)
        for axes, sure in ((one, found.sure and one is found.best) for one in found.turned)
        for sign in (1, -1)
    ]
    if scored is not None and abs(light_tests.turn_deg(scored)) > REFINED_DEG:
        alternatives.append(_relit(replace(turned, corrected=(*turned.corrected, SCORED)), AXES, scored, 1.0))
        return [*_decisive(alternatives), *_others(present)]
    if found.sure and found.turned:
        return [*_decisive(alternatives), *_others(present)]
    trials, most = (found.quarter, -found.quarter), model_trial.SETTINGS.better
    if np.array_equal(found.quarter, light_tests.STATED_AXES):
        trials = trials[1:]
        outwards = light_tests.outwardness(normals, light_tests.outline(coarse))
        if outwards is None or outwards >= 0:
            if not present.badly_fitting:
                return alternatives
            # A hollow object under opposite lamps is taken for a raised one, whose normals point outwards.
            most = model_trial.SETTINGS.better_at_least
        elif present.well_fitting and light_tests.near(coarse, problem.start_m, problem.nominal.lamps):
            # Light from near does not fit a raised object for a hollow one.
            return alternatives
    alternatives += [_relit(problem, AXES, axes, most) for axes in trials]
    return [*(_decisive(alternatives) if found.sure else alternatives), *_others(present)]


def _scored_axes(present: Solution) -> FloatArray | None:
    """The lamps' axes (2, 2) turned as the score of a turn says; none: there is no strong evidence of one, or another
    term gains more."""
    scores = present.scores
    if scores is None or scores.turn.gain <= self_calibration.STRONG_EVIDENCE or not scores.gains_most(scores.turn):
        return None
    return light_tests.turned_by(float(np.degrees(scores.turn.step)))


def _decisive(alternatives: Sequence[Alternative]) -> list[Alternative]:
    """The alternatives, of which the best may decide: of 751 captures, sound and with faults, none in which a term that
    a score demands, or sure axes, halve the misfit is fitted better by gloss, metal or a coding."""
    return [replace(alternative, decisive=True) for alternative in alternatives]


def _others(present: Solution) -> list[Alternative]:
    """What else a poor fit may be than other axes; gloss where it gains more than ambient and stray light."""
    if not present.poor:
        return []
    scores = present.scores
    most_gained = scores is not None and scores.gloss.gain > max(scores.offset.gain, scores.ambient.gain)
    gloss = _gloss(present) if most_gained else []
    scored = [] if present.unjudged else _scored_terms(present)
    return [*gloss, *scored, *bad_image(present), *moved_object(present), *_metal(present), *_coded(present)]


def _relit(
    problem: Problem, kind: str, axes: FloatArray, most: float, *, sound_enough: bool = False, silent: bool = False
) -> Alternative:
    """The lamps' axes multiplied by a matrix (2, 2)."""
    relit = problem.relit(light_tests.transformed(problem.nominal.lamps, axes))
    return Alternative(kind, _axes_sentence(axes), relit, most, sound_enough=sound_enough, silent=silent)


def _axes_sentence(axes: FloatArray) -> str:
    """What is said of lamps' axes (2, 2) that were others than stated."""
    names = {(1, 0): "x", (-1, 0): "−x", (0, 1): "y", (0, -1): "−y"}
    rows = [names.get((round(row[0]), round(row[1]))) for row in axes if np.max(np.abs(row)) == 1]
    if len(rows) == 2:
        return f"the lamps' axes are mirrored or turned: {rows[0]}, {rows[1]} are taken for their x, y"
    first = "their x is mirrored, and then they are " if np.linalg.det(axes) < 0 else "they are "
    return f"the lamps' axes are others than the camera's: {first}turned by {light_tests.turn_deg(axes):+.0f}°"


def swapped_lamps(present: Solution) -> list[Alternative]:
    """Two lamps exchanged, where least squares fits much better then; four images are explained by any lamps."""
    problem, nominal = present.problem, present.problem.nominal
    if not present.poor or len(nominal.lamps) < photometry.REDUNDANT:
        return []
    swap = min(
        (
            light_tests.swapped_pair(problem.level.coarse, depth_m, nominal.lamps, nominal.calibration)
            for depth_m in (problem.start_m, present.state.depth_m)
        ),
        key=lambda one: one.residual_share,
    )
    if swap.residual_share >= model_trial.SETTINGS.better_at_least:
        return []
    order = np.arange(len(nominal.lamps))
    order[[swap.first, swap.second]] = swap.second, swap.first
    message = f"the lamps of images {swap.first + 1} and {swap.second + 1} are swapped: they are exchanged"
    return [Alternative("swapped lamps", message, problem.relit(nominal.lamps[order]), 1.0)]


def translucent_surface(present: Solution) -> list[Alternative]:
    """Images sharpened, where light leaks into shadows as from below the surface.

    Not where one image fits far worse, which alone may be blurred, nor after gloss, which is mirrored into shadows, nor
    after ambient or stray light, which falls there, too, nor of a surface that has drifted away, whose shadows fall
    elsewhere.
    """
    problem, level = present.problem, present.problem.level
    others = {translucency.KIND, *(TERMS[name][0] for name in ("gloss", "metal", "ambient", "offset"))}
    worst = _worst_image(present.fit)
    if others & set(problem.corrected) or (worst is not None and worst.outlying):
        return []
    if present.out_of_place or not problem.thorough:
        return []
    leak = present.leak
    if leak is None or not leak.sought:
        return []
    length_px = level.factor * leak.length_px
    # Noise of neighbours alike: what a block of the coarse grid has, not a pixel's own.
    gain = max(surface_diffusion.noise_gain(length_px), surface_diffusion.noise_gain(leak.length_px))
    sharpened = changed_images.sharpened(problem.masked.images, *_full_surface(present), length_px, gain)
    length_mm = (
        1000 * length_px * float(np.mean(present.state.depth_m)) / problem.nominal.calibration.camera_matrix[0][0]
    )
    message = f"light spreads by {length_mm:.1f} mm below the surface, or images are out of focus: they are sharpened"
    return [
        Alternative(
            translucency.KIND, message, problem.reread(sharpened), model_trial.SETTINGS.worse_at_most, length_mm
        )
    ]


def _full_surface(present: Solution) -> tuple[SurfaceGraph, Float32Array]:
    """Graph and albedo (h, w) of all object pixels, from the coarse solution."""
    masked, level, state = present.problem.masked, present.problem.level, present.state
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


CODED = "coded values"
"""Kind of the finding of values that are not linear."""

AXES, TURNED, SCORED, REFINED = "axes of the lamps", "turned lamps", "scored turn", "angle of turned lamps"
"""Kind of the finding, and marks of a problem whose lamps were turned by an angle, by that of a score, and turned once
more."""

REFINEMENTS, REFINED_DEG = 2, 0.5
"""Times that such an angle is measured again, a fifth of it being left each time, and what is left, degrees, that ends
it."""

TERMS = {
    "roughness": ("rough surface", "the surface is rough: it is solved with Oren and Nayar's reflectance, roughness"),
    "ambient": ("ambient light", "light from elsewhere falls on the object: it is estimated and subtracted"),
    "offset": (
        "stray light",
        "a black level or stray light is in the images, or too much was subtracted: it is estimated and subtracted",
    ),
    "metal": (
        photometry.METAL,
        "the surface has no diffuse light: it is solved as metal, less surely, of roughness α",
    ),
    "gloss": ("gloss", "the surface is glossy: it is solved with microfacets, of roughness α"),
}
"""Kind and sentence of the finding for each of `ImageTerms`."""


def other_formation(present: Solution) -> list[Alternative]:
    """Terms, and a coding, that the score tests demand; in a poor fit also the coding, metal, and ambient and stray
    light from other starts."""
    problem = present.problem
    if problem.nominal.terms is not None:
        return _coded(present)
    alternatives = [*_gloss(present), *_scored_terms(present), *_metal(present), *_coded(present)]
    if present.poor:
        for name, start in SECOND_STARTS:
            terms = replace(LAMBERTIAN, **{name: start})
            alternatives.append(_with_term(problem, name, terms, model_trial.SETTINGS.better_at_least))
    return alternatives


def _scored_terms(present: Solution) -> list[Alternative]:
    """Roughness, ambient and stray light that the score tests demand; none beside another term."""
    problem, scores = present.problem, present.scores
    if problem.nominal.terms is not None or scores is None:
        return []
    demanded: list[Alternative] = []
    for name in ("roughness", "ambient", "offset"):
        score: TermScore = getattr(scores, name)
        if score.gain > model_trial.SETTINGS.min_gain and score.step > getattr(SETTINGS.min_step, name):
            demanded.append(_with_term(problem, name, LAMBERTIAN, 1.0, score.step))
    if _excess_subtracted(scores):
        demanded.append(_with_term(problem, "offset", LAMBERTIAN, 1.0, scores.offset.step))
    return _decisive(demanded)


def _coded(present: Solution) -> list[Alternative]:
    """Codings undone: the usual one in a poor fit, all where the score test finds an exponent well below 1."""
    exponents = CODED_EXPONENTS if present.seems_coded else CODED_EXPONENTS[-1:] if present.poor else ()
    images, most = present.problem.masked.images, model_trial.SETTINGS.better_at_least
    return [
        Alternative(
            CODED, f"the images are not linear: values are taken to the power of {exponent}",
            present.problem.reread(changed_images.linearised(images, exponent)), most, exponent, coding=exponent,
        )
        for exponent in exponents
    ]  # fmt: skip


def _excess_subtracted(scores: TermScores) -> bool:
    """Whether the score test finds an offset below zero that gains more than any other term: gloss and roughness leave
    one in half of their captures, a sound Lambertian surface in one of 201 (design seeds 40–64)."""
    offset = scores.offset
    demanded = offset.gain > model_trial.SETTINGS.min_gain and offset.step < -SETTINGS.min_step.offset
    return demanded and scores.gains_most(offset)


def _gloss(present: Solution) -> list[Alternative]:
    """Gloss of a dielectric, and of any strength, where the score test finds it; in a poor fit anyway, since the wrong
    normals that sharp highlights make leave no score.

    A dielectric that halves the misfit decides: of 115 matt captures with a fault (gamma, ambient and stray light,
    mirrored lamps, a flash, moved; design seeds 70, 71 and 73, eight lights) it leaves 0.60 at least.
    """
    if present.problem.nominal.terms is not None or present.scores is None:
        return []
    score = present.scores.gloss
    found = score.gain > self_calibration.STRONG_EVIDENCE and score.step > SETTINGS.min_step.gloss
    if not found and not present.poor:
        return []
    most = 1.0 if found else model_trial.SETTINGS.better_at_least
    start = image_terms.SETTINGS.middle_gloss
    starts = ImageTerms(gloss=start), ImageTerms(gloss=start, strength=1.0)
    dielectric, other = (_with_term(present.problem, "gloss", one, most) for one in starts)
    return [replace(dielectric, least_images=photometry.OVERDETERMINED, decisive=True), other]


def _metal(present: Solution) -> list[Alternative]:
    """Metal, in a poor fit of a surface that no other term describes yet."""
    if present.problem.nominal.terms is not None or not present.poor:
        return []
    start = ImageTerms(metal=METAL_START)
    return [_with_term(present.problem, "metal", start, model_trial.SETTINGS.better_at_least)]


def _with_term(problem: Problem, name: str, start: ImageTerms, most: float, step: float = 0.0) -> Alternative:
    """One of `TERMS` estimated from a start, with what else the start has, accepted up to `most` of the misfit."""
    estimated = {name} | {field.name for field in fields(start) if getattr(start, field.name) > 0}
    sigma = replace(LAMBERTIAN, **{one: getattr(SETTINGS.term_sigma, one) for one in estimated})
    changed = replace(problem, nominal=replace(problem.nominal, terms=start), term_sigma=sigma)
    return Alternative(*TERMS[name], changed, most, step=step)


def moved_object(present: Solution) -> list[Alternative]:
    """Later images moved back, where the registration says that object or camera moved."""
    if not present.poor:
        return []
    problem = present.problem
    moves = problem.level.factor * registration.translations(
        problem.level.coarse, present.state.depth_m, present.scene, present.state.shared.log_intensity
    )
    distance = float(np.max(np.linalg.norm(moves, axis=1)))
    if distance <= 0.5:  # an image's own translation is uncertain by half a pixel
        return []
    message = f"object or camera moved by {distance:.1f} pixels: later images are moved back"
    spacing = 1 if problem.masked.channel is None else mosaic.CELL
    registered = problem.reread(changed_images.translated(problem.masked.images, moves, spacing))
    return [Alternative("moved object", message, registered, model_trial.SETTINGS.better, distance)]


def bad_image(present: Solution) -> list[Alternative]:
    """One image left out that fits far worse than the others; in a poor fit the worst, where the others fit far better
    without it.

    Of 26 poor captures without a fault (design seeds 100–113, every reflectance) it leaves 0.85 of the misfit and more
    in 20, more than half or a poor fit in the others; of ten with a flash in one image 0.26–0.6 in seven.
    """
    problem, worst = present.problem, _worst_image(present.fit)
    if worst is None or not (worst.outlying or present.poor):
        return []
    message = f"image {worst.number + 1} does not fit the others: it is left out"
    rest = problem.reread(changed_images.without(problem.masked.images, worst.number))
    most = 1.0 if worst.outlying else model_trial.SETTINGS.better_at_least
    return [Alternative("bad image", message, rest, most, worst.number + 1, decisive=worst.outlying)]


@dataclass(frozen=True)
class _WorstImage:
    """The image that fits worst, and whether that is far worse than the others do."""

    number: int
    outlying: bool


def _worst_image(fit: Fit) -> _WorstImage | None:
    """The image that fits worst; none: there are too few others."""
    if np.count_nonzero(np.isfinite(fit.images)) <= photometry.OVERDETERMINED:
        return None
    worst = int(np.nanargmax(fit.images))
    usual = float(np.nanmedian(np.delete(fit.images, worst)))
    return _WorstImage(worst, bool(fit.images[worst] > photometry.SETTINGS.outlying_deviations * usual))


def other_intensities(present: Solution) -> list[Alternative]:
    """Images scaled whose intensity is far from what is stated, unless most are."""
    stated = present.problem.nominal.calibration.intensity_sigma
    log: FloatArray = present.state.shared.log_intensity - np.median(present.state.shared.log_intensity)
    far = np.abs(log) > photometry.SETTINGS.outlying_deviations * self_calibration.SIGMA_FACTORS[-1] * stated
    if not np.any(far) or np.count_nonzero(far) > len(log) // 2:
        return []
    factors = np.where(far, np.exp(log), 1.0)
    names = ", ".join(f"image {n + 1} ({factors[n] - 1:+.0%})" for n in np.flatnonzero(far))
    scaled = present.problem.reread(changed_images.scaled(present.problem.masked.images, factors))
    scaled = replace(scaled, factors=factors)
    message = f"brighter or darker than stated, and scaled: {names}"
    return [Alternative("intensities", message, scaled, 1 / model_trial.SETTINGS.better, float(factors[far][0]))]


def held_shift(present: Solution) -> list[Alternative]:
    """The object held where it was stated to be, where its shift may have run away: on a strongly curved sheet close to
    the camera it drifted by 70 mm, and the misfit rose from 1.3 to 2.5."""
    if not present.poor:
        return []
    held = replace(present.problem, shift_sigma_m=0.0)
    return [
        Alternative("shift", "the object is held at its stated place", held, model_trial.SETTINGS.better, silent=True)
    ]


ALTERNATIVES: tuple[Callable[[Solution], list[Alternative]], ...] = (
    swapped_lamps,
    other_axes,
    translucent_surface,
    other_formation,
    moved_object,
    bad_image,
    other_intensities,
    held_shift,
)
"""All kinds of alternatives in the order in which they are tried."""
