"""A model of the images on trial: the hypothesis that a descent starts from, and its solution with its fit.

Tests propose alternatives (`lamp_alternatives`, `term_alternatives`, `image_alternatives`), and `model_selection`
solves them. Both use the classes of this module. `alternative` says when a trial is accepted.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from acquisition import photometry
from acquisition.models.base import Float32Array, FloatArray
from acquisition.models.tuned import tuned
from acquisition.normals import alternation, pixel_solution
from acquisition.normals.alternation import AlternationResult
from acquisition.normals.alternatives import light_tests, registration
from acquisition.normals.alternatives.registration import Registration
from acquisition.normals.alternatives.term_tests import TermScores
from acquisition.normals.images import image_set
from acquisition.normals.images.normalised_images import Images
from acquisition.normals.indirect_light import surface_diffusion, translucency
from acquisition.normals.indirect_light.translucency import Leak
from acquisition.normals.pixel_solution import SolvedSample
from acquisition.normals.pixels.image_terms import LAMBERTIAN, ImageTerms
from acquisition.normals.pixels.pixel_solve import Scene
from acquisition.normals.pyramid import MaskedImages, PyramidLevel
from acquisition.normals.uncertainty.goodness_of_fit import Fit


@dataclass(frozen=True)
class TrialSettings:
    """Tuned numbers of the trial of a model."""

    min_gain: float = tuned(6.0, "1")
    """Gain of the log-likelihood from which ambient light, stray light or a coding is tried. A lower value tries more
    models on sound captures, a higher one misses weak light. Measured: of 55 sound Lambertian captures (design
    seeds 100–129 of eight families, 8 and 14 lights in two rings) ambient or stray light gains more than 4 in ten, more
    than 6 in six and more than 8 in three. It gains more than 6 in 15 of 18 captures with ambient light of 10 %, and in
    16 of 18 with stray light of 3 %; errors of the others are 1.0–1.5 times those without that light (scratch
    evaluation, November 2026)."""
    better: float = tuned(0.88, "loss ratio")
    """Loss after over before, up to which an alternative is clearly better: other axes, registered images, one image
    left out, the object at its stated place, a term of which less is found than half of what its score predicts, and
    light from elsewhere where an exponent gains more. Also the relative residuals that metal may leave. Measured:
    captures that moved by 2 pixels keep at most 0.88 of the loss in 80 of 84 trials, others in one of 149 (decision
    92). Of relative residuals metal leaves 0.07–0.80 in 45 of 49 trials, anything else 1.08 and more in 56 trials,
    except a glossy sheet, 0.79 and 0.82 (decision 81)."""
    better_at_least: float = tuned(0.55, "loss ratio")
    """Loss and relative residuals after over before, up to which a trial is accepted that only a poor fit calls for;
    also the ratio of least-squares residuals below which two lamps are exchanged, or an image is left out, on trial. If
    a fall by a hundredth is enough, ambient light is accepted on a gear, whose error rises from 3.9° to 8.3°. Measured:
    of 282 trials of gloss, ambient and stray light in poor fits, sound and with faults, ten leave as little, whose
    errors are 0.71–0.89 of those before (design seeds 502 and 503, eight lights by two rings; decision 98). Without
    its worst image a sound capture keeps at least 0.72 of the residual, most captures with a flash in one image
    0.32–0.72 (seeds 419–425)."""
    coded_exponent: float = tuned(0.25, "exponent")
    """Size of the exponent ε of the score test (`TermScores`) from which values count as coded. All codings are tried
    where ε is below −0.25, the usual one where it is below half of that, and linearised values are accepted where less
    than 0.25 of it is left. Measured: once linearised, ε is −0.05 to 0.23 of nine Lambertian captures of coded values,
    and 0.34–0.79 of 45 others, Lambertian, rough, glossy, with an offset or ambient light (design seeds 62 and 63, ten
    lights in two rings). ε is below −0.125 in 12 of 906 sound captures, 10 of them rough, and in 38 of 52 that are
    coded with 1/2.2."""
    min_probability: float = tuned(0.05, "probability")
    """Probability of the misfit below which a solution counts as poor, so that metal, a coding, swaps and moves
    are tried. Measured: with 0.01 sound captures take a fifth less time and are solved alike (27 of design seeds
    101–104), but swapped lamps of two of eight objects, an offset and a move are not found (seed 62, ten lights)."""
    min_sound_probability: float = tuned(0.01, "probability")
    """Probability of the misfit below which a result is reported as badly fitting. It is the usual level of 1 %: one
    sound capture in a hundred is reported, if misfits are distributed as `goodness_of_fit` says."""

    @property
    def max_intensity(self) -> float:
        """Noise component of intensities that no sound capture reaches. It is three times the 1 % to which lamps are
        known where nothing else is stated. With 0.05, the component's upper bound, a glossy vessel that is 25° off
        (design seed 102) is not reported."""
        return photometry.SETTINGS.outlying_deviations * image_set.INTENSITY_SIGMA

    @property
    def slightly_better(self) -> float:
        """Misfit of a sample as rough over that as Lambertian, up to which roughness is tried whatever its score; also
        the relative residuals that may be left without a bad image (decision 102). It is halfway between `better` and
        1. Measured: 0.71–0.93 of 16 of 32 rough captures, 0.93–1.4 of the others, at least 0.98 of 85 Lambertian,
        glossy and translucent ones (design seeds 201–213 and 350–359, 8 and 20 lights)."""
        return float(np.sqrt(self.better))

    @property
    def clearly_worse(self) -> float:
        """Ratio from which a fit is clearly worse, the inverse of `better_at_least`: no model fits if the noise of
        residuals is this factor above what the lights' stated σ explain. It is 4 and 5 on lacquer and glaze, whose
        normals err by 8° in a fit that looks sound, 0.4 on plastic and satin (`gloss_scenes`, balls)."""
        return 1 / self.better_at_least


SETTINGS = TrialSettings()

ROUGH = ImageTerms(roughness=0.2)
"""Terms as which samples are solved again: a roughness of 0.28 rad, in the middle of what is common."""


@dataclass(frozen=True)
class Hypothesis:
    """What a descent starts from.

    - `masked`, `level`, `start_m`: images, coarse level and depth (N,) of its pixels; `nominal`: the nominal scene.
    - `term_sigma`, `shift_sigma_m`: 1 σ of the terms that are estimated, and of the object's shift in m.
    - `corrected`: kinds of faults that are corrected already; `factors` (F,): what the images were divided by.
    - `thorough`: also try what only a poor fit calls for, and translucency, which gloss under many lights resembles.
    """

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
        """Returns the hypothesis for changed images of the same object, with their sensor noise."""
        masked = replace(self.masked, images=images)
        count = int(np.count_nonzero(masked.mask))
        table = None if self.level.table is None else self.level.table.depth_m
        level = masked.level(self.level.factor, pixel_solution.noise_sample(count), table)
        noise = replace(self.nominal.noise, shot=images.shot, floor=images.floor)
        return replace(
            self,
            masked=masked,
            level=level,
            nominal=replace(self.nominal, noise=noise),
        )

    def with_axes(self, axes: FloatArray) -> "Hypothesis":
        """Returns the hypothesis with the axes of lamps and of their common errors multiplied by a matrix (2, 2)."""
        lamps, common = light_tests.transformed(self.nominal.lamps, axes), self.nominal.common_lamp_errors_m
        if common is not None:
            common = np.concatenate([np.einsum("ij,fjc->fic", axes, common[:, :2]), common[:, 2:]], axis=1)
        return replace(self, nominal=replace(self.nominal, lamps=lamps, common_lamp_errors_m=common))

    def with_lamps_of(self, order: np.ndarray) -> "Hypothesis":
        """Returns the hypothesis with each image under the lamp of the image that `order` (F,) states."""
        lamps, common = self.nominal.lamps[order], self.nominal.common_lamp_errors_m
        common = None if common is None else common[order]
        return replace(self, nominal=replace(self.nominal, lamps=lamps, common_lamp_errors_m=common))


@dataclass(frozen=True)
class Solution:
    """A descent's result and scene (lamps, noise and terms as estimated), with sample, fit and scores to judge it."""

    hypothesis: Hypothesis
    state: AlternationResult
    scene: Scene
    sample: SolvedSample
    fit: Fit
    scores: TermScores | None

    @property
    def moved_m(self) -> float:
        """Shift of the object's mean depth from where it was stated, m."""
        return float(np.mean(self.state.depth_m) - np.mean(self.hypothesis.start_m))

    @property
    def out_of_place(self) -> bool:
        """Whether the object is within a step of the largest shift, so that it must have drifted there. Shifts are
        50 mm at most over 96 Lambertian captures of design seeds in two rings."""
        largest = alternation.SETTINGS.max_shift_m(float(np.min(self.hypothesis.start_m)))
        return abs(self.moved_m) >= max(largest - alternation.MAX_SHIFT_STEP_M, largest / 2)

    @property
    def at_end_of_range(self) -> bool:
        """Whether the noise of intensities, or the object's place, is beyond what any sound capture needs. The noise of
        directions does not count: detail below a pixel raises it to its bound, whether lamps are in place or 5 mm
        off."""
        return self.scene.noise.intensity >= SETTINGS.max_intensity or self.out_of_place

    @property
    def intensities_scatter(self) -> bool:
        """Whether the standard deviation of the intensities is outlying: such intensities may make a bad image fit."""
        stated, counts = self.hypothesis.nominal.calibration.intensity_sigma, np.isfinite(self.fit.images)
        if not np.any(counts):
            return False
        return bool(np.std(self.state.shared.log_intensity[counts]) > photometry.SETTINGS.outlying_deviations * stated)

    @property
    def unjudged(self) -> bool:
        """Whether there are enough images, but hardly any pixel has four usable ones (of metal only its highlights)."""
        return self.fit.redundant and not np.isfinite(self.fit.misfit)

    @property
    def seems_coded(self) -> bool:
        """Whether the score test finds an exponent well below 1, and no roughness that gains more. Measured: in none of
        126 sound captures of Lambertian, glossy and translucent surfaces (design seeds 40–63)."""
        return self._exponent_below(SETTINGS.coded_exponent)

    @property
    def may_be_coded(self) -> bool:
        """Whether the same holds as for `seems_coded` with half of its threshold."""
        return self._exponent_below(SETTINGS.coded_exponent / 2)

    @property
    def seems_linear(self) -> bool:
        """Whether the score test finds no exponent far from 1, or roughness explains it. Linearised values have an
        exponent well above 1 if they were linear before, and one well below 1 if another coding applies."""
        if self.scores is None:
            return False
        return self._rather_rough or abs(self.scores.exponent.step) < SETTINGS.coded_exponent

    @property
    def _rather_rough(self) -> bool:
        """Whether roughness, which also brightens a surface near the terminator, gains more than an exponent."""
        scores = self.scores
        return scores is not None and scores.roughness.step > 0 and scores.roughness.gain > scores.exponent.gain

    def _exponent_below(self, least: float) -> bool:
        if self.scores is None or self._rather_rough:
            return False
        return self.scores.exponent.gain > SETTINGS.min_gain and self.scores.exponent.step < -least

    @property
    def badly_fitting(self) -> bool:
        """Whether hardly any sound capture has a misfit as large."""
        return self.fit.redundant and self.fit.probability < SETTINGS.min_probability

    @cached_property
    def shading(self) -> Float32Array:
        """Shading (F, M) of the coarse pixels under lamps of nominal intensity, without the albedo."""
        calibration = self.hypothesis.nominal.calibration
        return translucency.shading(
            self.hypothesis.level.coarse, self.state.depth_m, self.state.normals, self.scene.lamps, calibration
        )

    @cached_property
    def registration(self) -> Registration:
        """Registration of the images with one another on the coarse grid."""
        return registration.register(
            self.hypothesis.level.coarse, self.state.depth_m, self.scene, self.state.shared.log_intensity
        )

    @cached_property
    def leak(self) -> Leak | None:
        """Light that leaks into cast shadows as from below the surface; none: there are too few shadows."""
        coarse = self.hypothesis.level.coarse
        mask = coarse.image(np.ones(len(coarse.index), np.bool_))
        over = surface_diffusion.graph(mask, coarse.image(coarse.ray), coarse.image(self.state.depth_m))
        values = alternation.divide_intensity(coarse.values, self.state.shared.log_intensity)
        return translucency.leak(coarse, values, self.shading, self.state.indirect_irradiance, over)

    @cached_property
    def rough_misfit(self) -> float:
        """Misfit of the sample solved again as `ROUGH` over that as Lambertian, with the shared parameters as they are.
        The shared parameters may have absorbed so much of the roughness that its score is small."""
        again = (replace(self.scene, terms=terms) for terms in (None, ROUGH))
        stated = self.hypothesis.nominal.noise
        plain, rough = (self.sample.fit(self.sample.solved_again(scene), stated).misfit for scene in again)
        return rough / plain

    @property
    def more_subtracted_than_measured(self) -> bool:
        """Whether the estimated ambient or stray light is more than what is measured.

        No pixel is darker than the light that falls on it beside the lamps'. Tested is the share of measurements
        clearly below zero without that light, in the median over images: a single bad image may be darker. Measured:
        relief of the size of a pixel fits better if most of each image is ambient light, which leaves 13 and 1.1 % of
        two reliefs below zero (13 and 21° off). True ambient light of 3 and 10 % leaves 0.04 % at most in five captures
        (design seeds 371–386, eight lights in two rings).
        """
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
        """Whether costly alternatives are worth a trial: a bad or unjudged fit, or values at the end of their range."""
        return self.hypothesis.thorough and (self.unjudged or self.badly_fitting or self.at_end_of_range)
