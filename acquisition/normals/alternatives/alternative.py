"""An alternative to the model of the images, and the rule by which its solution replaces the one before.

What a fit has to be depends on what asks for it. A test that is surer than the fit needs no better one; a term that a
score promises needs to be found in about that amount; what nothing but a poor fit calls for needs a far better one.
Other images are judged by the loss, in which every measurement counts, rather than by the misfit, which is a median.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from acquisition import photometry
from acquisition.models.result import ModelFinding
from acquisition.normals.alternatives import model_trial
from acquisition.normals.alternatives.model_trial import Hypothesis, Solution
from acquisition.normals.pixels import image_terms
from acquisition.normals.pixels.image_terms import ImageTerms


@dataclass(frozen=True)
class Alternative:
    """Another model: kind, sentence and amount for its finding, the hypothesis to solve, and when its fit is accepted.

    - `worse_at_most`: the misfit over that before up to which it is accepted. Some kinds have rules of their own
      (`accepted`); above `better_at_least` it says that a test demands the alternative (`demanded`).
    - `coding`: the exponent by which it changes the values; 1: it does not.
    - `term`: the one of `ImageTerms` that it estimates; empty: none.
    - `step`: the value of the term that one Newton step of the score test predicts; 0: no score demands it. Accepted if
      the estimate exceeds half of it and the misfit is at most 1/`slightly_better` of that before (at most equal where
      the loss does not fall); otherwise only if the misfit falls to `better`. Where values at black have been taken for
      censored ones, their misfits do not compare: any sound fit is accepted that exceeds half of the step.
    - `unreported`: it corrects the solver, not the capture, and there is no finding of it.
    - `independently_tested`: a test demands it that does not look at residuals; any sound fit is accepted.
    - `least_images`: with fewer images residuals do not tell it from other models.
    - `decisive`: once it is by far the best so far, only other decisive ones are tried.
    - `leaves_out`: it leaves an image out.
    - `by_loss`: accepted by the loss, not the misfit.
    """

    kind: str
    message: str
    hypothesis: Hypothesis
    worse_at_most: float
    value: float | None = None
    coding: float = 1.0
    term: str = ""
    step: float = 0.0
    unreported: bool = False
    independently_tested: bool = False
    least_images: int = photometry.REDUNDANT
    decisive: bool = False
    leaves_out: bool = False
    by_loss: bool = False

    @property
    def demanded(self) -> bool:
        """Whether a test demands it, and not the poor fit alone."""
        return self.independently_tested or self.worse_at_most > model_trial.SETTINGS.better_at_least

    def has_enough_images(self, images: int) -> bool:
        """Whether so many images tell it from other models: a test that does not look at residuals needs none."""
        return self.independently_tested or images >= self.least_images

    def accepted(self, before: Solution, trial: Solution) -> bool:
        """Whether a trial replaces the solution before it: the object is in its place, or nearer to it than before
        (nearest to the lamps most measurements are in shadow, and anything fits the rest), the fit good enough, sound
        where none could be judged before, and light from elsewhere no more than what is measured.
        """
        before_fit, after, terms = before.fit, trial.fit, trial.state.shared.terms
        if self._ruled_out(before, trial):
            return False
        if before.unjudged:
            return after.probability > model_trial.SETTINGS.min_probability
        if self.independently_tested and not trial.badly_fitting:
            return True
        if self.by_loss:
            return after.loss <= self.worse_at_most * before_fit.loss
        if self.term == "roughness":
            return terms.roughness / self.step > 0.5 and after.loss < before_fit.loss
        if self.term == "metal":
            return (
                after.loss < before_fit.loss
                and after.relative_residual <= model_trial.SETTINGS.better * before_fit.relative_residual
            )
        if self.coding != 1:
            return self._linearises(before, trial)
        if self.step != 0:
            found = getattr(terms, self.term) / self.step > 0.5
            if not self.hypothesis.nominal.shadows_informative:
                return found and not trial.badly_fitting
            hardly_worse = 1 / model_trial.SETTINGS.slightly_better if after.loss < before_fit.loss else 1.0
            return after.misfit <= (hardly_worse if found else model_trial.SETTINGS.better) * before_fit.misfit
        if not after.misfit <= self.worse_at_most * before_fit.misfit:
            return False
        if self.worse_at_most > model_trial.SETTINGS.better_at_least:
            # Light between the walls of a matt vessel has a score as of gloss, which explains nothing of it.
            return self.term != "gloss" or after.relative_residual <= before_fit.relative_residual
        return (
            after.probability > model_trial.SETTINGS.min_probability
            and after.relative_residual <= self.worse_at_most * before_fit.relative_residual
        )

    def _ruled_out(self, before: Solution, trial: Solution) -> bool:
        """Whether what a trial says cannot be, however well it fits."""
        if trial.out_of_place and abs(trial.moved_m) >= abs(before.moved_m):
            return True
        if self.leaves_out:  # of a wrong model, too, the loss falls a little without the worst image
            sound = not trial.poor or trial.fit.misfit <= model_trial.SETTINGS.better_at_least * before.fit.misfit
            another_was_bad = before.intensities_scatter and trial.intensities_scatter
            return not sound or another_was_bad
        if self.coding != 1 and not trial.seems_linear:
            return True
        if self.term in ("gloss", "metal") and image_terms.nearly_diffuse(trial.state.shared.terms):
            return True
        return self.term in ("ambient", "offset") and trial.more_subtracted_than_measured

    def _linearises(self, before: Solution, trial: Solution) -> bool:
        """Whether linearised values fit so much better that they were coded: the more, the fainter the score says so.

        Undoing a coding multiplies relative noise by its exponent, and no more: of dark images, as of smooth metal, it
        brings most values near zero, where any model fits them, and relative residuals rise by 4 to 100. They have to
        fall where the score does not point to a coding, since a wrong shape may fit what is linear already.
        """
        least, before_fit, after = model_trial.SETTINGS.better_at_least, before.fit, trial.fit
        loss, share = after.loss / before_fit.loss, after.relative_residual / before_fit.relative_residual
        sound = after.probability > model_trial.SETTINGS.min_probability
        if before.hypothesis.term_sigma.from_elsewhere and max(loss, share) <= model_trial.SETTINGS.better:
            return True  # without light from elsewhere, which explained the same shadows, and worse
        if before.seems_coded:
            most = model_trial.SETTINGS.better if sound or loss <= least**2 else least
            return loss <= model_trial.SETTINGS.better and share <= most * self.coding
        if before.scores is not None and before.scores.exponent.step < 0:
            return loss <= (least if before.may_be_coded else least**2) and share <= least * self.coding
        return sound and after.misfit <= least * before_fit.misfit and share <= 1

    def convincing(self, before: Solution, trial: Solution) -> bool:
        """Whether an accepted trial puts the images right. Metal whose residuals stay higher, as a share of the values
        or in units of the noise, of which loss is the square, is there, but its shape is not found (decision 80); where
        nothing could be judged before, its fit is sound."""
        if self.term != "metal" or before.unjudged:
            return True
        most, before_fit, after = model_trial.SETTINGS.better_at_least, before.fit, trial.fit
        return (
            after.relative_residual <= most * before_fit.relative_residual and after.loss <= most**2 * before_fit.loss
        )

    def finding(self, terms: ImageTerms, *, convincing: bool = True) -> ModelFinding:
        """The finding of an accepted trial, with the amount that was estimated in the end."""
        message, value = self.message, self.value
        if self.term == "roughness":
            value = terms.roughness_rad
            message += f" of {value:.2f} rad"
        elif self.term in ("gloss", "metal"):
            value = max(terms.gloss, terms.metal)
            message += f" {value:.2f}"
            if terms.strength > 0:
                message += f" and {terms.strength:.1f} times a dielectric's strength"
        elif self.term in ("ambient", "offset"):
            value = getattr(terms, self.term)
            message += f" ({value:.1%} of white)"
        message += "" if convincing else ", which fits only in part: do not trust the normals"
        return ModelFinding(kind=self.kind, message=message, corrected=convincing, value=value)


def decisive(alternatives: Sequence[Alternative]) -> list[Alternative]:
    """The alternatives, of which the best may decide: of 751 captures, sound and with faults, none in which a term that
    a score demands, or sure axes, halve the misfit is fitted better by gloss, metal or a coding."""
    return [replace(alternative, decisive=True) for alternative in alternatives]
