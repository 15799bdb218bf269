"""A model of the images to be tried, and its solution with its fit.

Tests propose alternatives (`lamp_alternatives`, `term_alternatives`, `image_alternatives`) and a selection solves them
(`model_selection`); what both speak of is here, the hypothesis that a descent starts from and the solution, and in
`alternative`, what makes it accepted.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from acquisition import photometry
from acquisition.models.base import Float32Array, FloatArray
from acquisition.models.tuned import tuned
from acquisition.normals import alternation, final_solve
from acquisition.normals.alternation import AlternationResult
from acquisition.normals.alternatives import light_tests, registration
from acquisition.normals.alternatives.registration import Registration
from acquisition.normals.alternatives.term_tests import TermScores
from acquisition.normals.final_solve import SolvedSample
from acquisition.normals.images import image_set
from acquisition.normals.images.normalised_images import Images
from acquisition.normals.indirect_light import surface_diffusion, translucency
from acquisition.normals.indirect_light.translucency import Leak
from acquisition.normals.pixels.image_terms import LAMBERTIAN, ImageTerms
from acquisition.normals.pixels.pixel_solve import Scene
from acquisition.normals.pyramid import MaskedImages, PyramidLevel
from acquisition.normals.uncertainty.goodness_of_fit import Fit


@dataclass(frozen=True)
class TrialSettings:
    """Tuned numbers of the trial of a model."""

    min_gain: float = tuned(6.0, "1")
    """Gain of the log likelihood from which light from elsewhere, or a coding, is tried. Of 55 sound Lambertian
    captures (design seeds 100–129 of eight families, 8 and 14 lights by two rings) ambient or stray light gains more
    than 4 in ten, more than 6 in 6 and more than 8 in three. Of 18 with ambient light of 10 % and of 18 with stray
    light of 3 % it gains more than 6 in 15 and 16; the others err by 1.0–1.5 times as much as without it. A rough
    object of 32 pixels' width gains 6.2 (scratch evaluation, November 2026)."""
    better: float = tuned(0.88, "misfit ratio")
    """Misfit after over before, up to which what a test demands counts as better: other axes, registered images, the
    object in its stated place, a term. Mirrored axes leave 0.2–0.7. Interreflection that is not predicted scores as
    ambient light; the descent takes most of it back. Of true ambient light of 10 % a step promises up to 46 %, and
    misfits fall to 0.21–0.84; an offset that a sheet's interreflection resembled left 0.85 (design seeds 20–23, 30, 31,
    40 and 41; `python -m tests.unseen table FILE --trials`). Of relative residuals metal leaves 0.07–0.80 in 45 of 49
    trials, anything else 1.08 and more in 56, but a glossy sheet 0.79 and 0.82 (decision 81)."""
    better_at_least: float = tuned(0.55, "misfit ratio")
    """Misfit of a second start over that before, up to which it is accepted, and residual of least squares after over
    before two lamps are exchanged, or without an image over that without another one, below which that is tried. A fall
    by a hundredth once accepted ambient light on a gear, whose error rose from 3.9° to 8.3°. Of 210 captures, sound and
    with faults (design seeds 62, 63 and 101–112), second starts that leave 0.5–0.62 of misfit and relative residuals
    are two, both of metal, of which the one that no other beats is right. Without its worst image 0.72 is left of a
    sound capture at least, 0.32–0.72 of most with a flash in one image (design seeds 419–425)."""
    coded_exponent: float = tuned(0.25, "exponent")
    """Size of ε, the exponent's score (`TermScores`): values are tried as coded by all codings where it is below −0.25,
    by the usual one below half of that, and were coded where less than 0.25 of it is left once they are linearised. It
    is −0.05 to 0.23 then of nine Lambertian captures of coded values, 0.34–0.79 of 45 others, Lambertian, rough,
    glossy, with an offset or ambient light (design seeds 62 and 63, ten lights by two rings, eight families). It is
    below −0.125 of 12 of 906 sound captures, 10 of them rough, and of 38 of 52 that are coded with 1/2.2."""
    min_probability: float = tuned(0.05, "probability")
    """Probability of the misfit below which a solution counts as poor: then second starts, swaps and moves are tried.
    With 0.01 sound captures take a fifth less time and are solved alike (27 of design seeds 101–104), but swapped lamps
    of two of eight objects, an offset and a move are not found (seed 62, ten lights)."""
    min_sound_probability: float = tuned(0.01, "probability")
    """Probability of the misfit below which a result is named as badly fitting. The usual level of 1 %: one sound
    capture in a hundred is named, if misfits are distributed as `goodness_of_fit` says."""

    @property
    def max_intensity(self) -> float:
        """Noise component of intensities that no sound capture reaches: three times the 1 % by which lamps are known
        where nothing else is stated. With 0.05, the upper bound, a glossy vessel that is 25° off (design seed 102) is
        not named."""
        return photometry.SETTINGS.outlying_deviations * image_set.INTENSITY_SIGMA

    @property
    def slightly_better(self) -> float:
        """Misfit of a sample as rough over that as Lambertian, up to which roughness is tried whatever its score:
        halfway between better and as good. 0.71–0.93 of 16 of 32 rough captures, 0.93–1.4 of the others, 0.98 at least
        of 85 Lambertian, glossy and translucent ones (design seeds 201–213 and 350–359, 8 and 20 lights)."""
        return float(np.sqrt(self.better))

    @property
    def clearly_worse(self) -> float:
        """Factor that makes a fit clearly worse, the inverse of what makes it clearly better: misfit of sharpened
        images over that before, up to which they are accepted, which noise alone raises to 1.2–1.4, since where a
        pixel is lit, a residual does not know of blur; and noise of residuals over what the lights' stated σ explain,
        above which no model fits: 4 and 5 on lacquer and glaze, whose normals err by 8° in a fit that looks sound,
        0.4 on plastic and satin (`gloss_scenes`, balls)."""
        return 1 / self.better_at_least


SETTINGS = TrialSettings()

ROUGH = ImageTerms(roughness=0.2)
"""Roughness of which samples are solved again, of 0.28 rad: in the middle of what is common."""


@dataclass(frozen=True)
class Hypothesis:
    """What a descent starts from: images, coarse level, depth at its pixels (N,), nominal scene, 1 σ of the terms that
    are estimated, and of the object's shift in m; the kinds of faults that are already corrected in it, and the factors
    (F,) that its images were divided by. `thorough`: alternatives are tried that only a poor fit calls for, and
    translucency, which broad gloss under many lights resembles."""

    masked: MaskedImages
    level: PyramidLevel
    start_m: Float32Array
    nominal: Scene
    term_sigma: ImageTerms = LAMBERTIAN
    shift_sigma_m: float = field(default_factory=lambda: alternation.SETTINGS.shift_sigma_m)
    corrected: tuple[str, ...] = ()
    factors: FloatArray | float = 1.0
    thorough: bool = True

    def reread(self, images: Images) -> "Hypothesis":
        """The same object in changed images, with their sensor noise."""
        masked = replace(self.masked, images=images)
        count = int(np.count_nonzero(masked.mask))
        table = None if self.level.table is None else self.level.table.depth_m
        level = masked.level(self.level.factor, final_solve.noise_sample(count), table)
        noise = replace(self.nominal.noise, shot=images.shot, floor=images.floor)
        return replace(
            self,
            masked=masked,
            level=level,
            nominal=replace(self.nominal, noise=noise),
        )

    def with_axes(self, axes: FloatArray) -> "Hypothesis":
        """The same images under lamps whose axes are multiplied by a matrix (2, 2), and the errors they share."""
        lamps, common = light_tests.transformed(self.nominal.lamps, axes), self.nominal.common_lamp_errors_m
        if common is not None:
            common = np.concatenate([np.einsum("ij,fjc->fic", axes, common[:, :2]), common[:, 2:]], axis=1)
        return replace(self, nominal=replace(self.nominal, lamps=lamps, common_lamp_errors_m=common))

    def with_lamps_of(self, order: np.ndarray) -> "Hypothesis":
        """The same images, each under the lamp of the image of the number in `order` (F,)."""
        lamps, common = self.nominal.lamps[order], self.nominal.common_lamp_errors_m
        common = None if common is None else common[order]
        return replace(self, nominal=replace(self.nominal, lamps=lamps, common_lamp_errors_m=common))


@dataclass(frozen=True)
class Solution:
    """A descent's result with its scene (lamps, noise and terms as estimated), the sample of pixels that its fit is
    judged by, the fit, and the scores of terms."""

    hypothesis: Hypothesis
    state: AlternationResult
    scene: Scene
    sample: SolvedSample
    fit: Fit
    scores: TermScores | None

    @property
    def moved_m(self) -> float:
        """How far the object's mean depth is from where it was stated, m."""
        return float(np.mean(self.state.depth_m) - np.mean(self.hypothesis.start_m))

    @property
    def out_of_place(self) -> bool:
        """Whether the object is so far from where it was stated, within a step of the largest shift, that it must have
        drifted there: the shift is 50 mm at most over 96 Lambertian captures of design seeds by two rings."""
        return abs(self.moved_m) >= alternation.SETTINGS.max_shift_m - alternation.MAX_SHIFT_STEP_M

    @property
    def at_end_of_range(self) -> bool:
        """Whether the noise of intensities, or the object's place, is beyond what any sound capture needs. That of
        directions detail below a pixel raises to its bound, whether lamps are where they should be or 5 mm off."""
        return self.scene.noise.intensity >= SETTINGS.max_intensity or self.out_of_place

    @property
    def intensities_scatter(self) -> bool:
        """Whether the intensities' standard deviation is outlying: others than stated may fit a bad image."""
        stated, counts = self.hypothesis.nominal.calibration.intensity_sigma, np.isfinite(self.fit.images)
        return bool(np.std(self.state.shared.log_intensity[counts]) > photometry.SETTINGS.outlying_deviations * stated)

    @property
    def unjudged(self) -> bool:
        """Whether there are images enough, and yet hardly a pixel has four that count: of metal, its highlights."""
        return self.fit.redundant and not np.isfinite(self.fit.misfit)

    @property
    def seems_coded(self) -> bool:
        """Whether the score test finds an exponent well below 1, and no roughness that would gain more: of 126 sound
        captures of Lambertian, glossy and translucent surfaces it does of none (design seeds 40–63)."""
        return self._exponent_below(SETTINGS.coded_exponent)

    @property
    def may_be_coded(self) -> bool:
        """Whether the score test finds an exponent below 1, by half of what makes values seem coded, and no roughness
        that would gain more."""
        return self._exponent_below(SETTINGS.coded_exponent / 2)

    @property
    def seems_linear(self) -> bool:
        """Whether the values have no exponent far from 1, unless roughness explains it: above it are values that were
        linear before they were linearised, below it those of another coding."""
        if self.scores is None:
            return False
        return self._rather_rough or abs(self.scores.exponent.step) < SETTINGS.coded_exponent

    @property
    def _rather_rough(self) -> bool:
        """Whether roughness gains more than an exponent: a rough surface is bright near the terminator, as coded values
        are."""
        scores = self.scores
        return scores is not None and scores.roughness.step > 0 and scores.roughness.gain > scores.exponent.gain

    def _exponent_below(self, least: float) -> bool:
        if self.scores is None or self._rather_rough:
            return False
        return self.scores.exponent.gain > SETTINGS.min_gain and self.scores.exponent.step < -least

    @property
    def badly_fitting(self) -> bool:
        """Whether hardly a sound capture has a misfit as large."""
        return self.fit.redundant and self.fit.probability < SETTINGS.min_probability

    @cached_property
    def shading(self) -> Float32Array:
        """Shading (F, M) of the coarse pixels by lamps of nominal intensity, which the albedo multiplies."""
        calibration = self.hypothesis.nominal.calibration
        return translucency.shading(
            self.hypothesis.level.coarse, self.state.depth_m, self.state.normals, self.scene.lamps, calibration
        )

    @cached_property
    def registration(self) -> Registration:
        """The images registered with one another on the coarse grid."""
        return registration.register(
            self.hypothesis.level.coarse, self.state.depth_m, self.scene, self.state.shared.log_intensity
        )

    @cached_property
    def leak(self) -> Leak | None:
        """Light in cast shadows as from below the surface; none where there are too few of them."""
        coarse = self.hypothesis.level.coarse
        mask = coarse.image(np.ones(len(coarse.index), np.bool_))
        over = surface_diffusion.graph(mask, coarse.image(coarse.ray), coarse.image(self.state.depth_m))
        values = alternation.divide_intensity(coarse.values, self.state.shared.log_intensity)
        return translucency.leak(coarse, values, self.shading, over)

    @cached_property
    def rough_misfit(self) -> float:
        """Misfit of the sample solved again as `ROUGH` over that as Lambertian, with what pixels share as it is:
        that may have taken up so much of the roughness that no score is left."""
        again = (replace(self.scene, terms=terms) for terms in (None, ROUGH))
        stated = self.hypothesis.nominal.noise
        plain, rough = (self.sample.fit(self.sample.solved_again(scene), stated).misfit for scene in again)
        return rough / plain

    @property
    def more_subtracted_than_measured(self) -> bool:
        """Whether light from elsewhere, as estimated, leaves more measurements of an image clearly below zero, in the
        median, than a sound one does: no pixel is darker than what falls on it beside the lamps' light.

        Relief of the size of a pixel fits better where most of each image is ambient light. That leaves 13 and 1.1 %
        of two reliefs below zero, which erred by 13 and 21°; true ambient light of 3 and 10 % leaves 0.04 % of five
        captures at most (design seeds 371–386, eight lights by two rings). A single bad image may be darker."""
        solution, noise = self.sample.solution, self.hypothesis.nominal.noise.single_precision()
        elsewhere, shared = solution.estimate.beside_direct_diffuse, photometry.SETTINGS
        variance = noise.variance(np.maximum(solution.measured, 0), np.zeros_like(solution.measured))
        error = np.sqrt(variance + (np.float32(shared.predicted_light_sigma) * elsewhere) ** 2)
        below = solution.measured - elsewhere < -np.float32(shared.outlying_deviations) * error
        shares = np.mean(below, axis=1)
        return bool(np.median(shares) > SETTINGS.min_sound_probability)

    @property
    def well_fitting(self) -> bool:
        """Whether there are images enough to judge the fit, and more than a few sound captures fit as badly."""
        return self.fit.redundant and self.fit.probability >= SETTINGS.min_probability

    @property
    def poor(self) -> bool:
        """Whether the fit is so bad, or so little of it is left to judge, that costly alternatives are worth a
        trial."""
        return self.hypothesis.thorough and (self.unjudged or self.badly_fitting or self.at_end_of_range)
