"""An alternative to the model of the images, and the rule by which its solution replaces the one before.

How good the fit has to be depends on what demands the alternative. A test that is surer than the fit needs no better
one. A term that a score promises has to be found in about that amount. What only a poor fit calls for has to fit far
better. Changed images are judged by the loss, which counts every measurement, and not by the misfit, a median.
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
    """Another model: kind, message and value of its finding, the hypothesis to solve, and when its fit is accepted.

    - `worse_at_most`: misfit over that before, up to which it is accepted. Some kinds have rules of their own
      (`accepted`). A value above `better_at_least` marks an alternative that a test demands (`demanded`).
    - `coding`: exponent by which it changes the values; 1: it does not.
    - `term`: the field of `ImageTerms` that it estimates; empty: none.
    - `step`: value of the term that one Newton step of the score test predicts; 0: no score demands it. If the estimate
      exceeds half of it, the misfit may rise to 1/`slightly_better` of that before if the loss falls, and not at all if
      not. Otherwise it has to fall to `better`. Where values at black have been taken for censored ones, misfits are
      not comparable: any sound fit is accepted whose estimate exceeds half of the step.
    - `unreported`: it corrects the solver, not the capture, so there is no finding.
    - `independently_tested`: a test demands it that does not use residuals; any sound fit is accepted.
    - `least_images`: number of images from which residuals tell it from other models.
    - `decisive`: once it is by far the best so far, only other decisive ones are tried.
    - `leaves_out`: it leaves an image out; `by_loss`: it is accepted by the loss, not by the misfit.
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
        """Returns whether so many images tell it from other models; a test without residuals needs no minimum."""
        return self.independently_tested or images >= self.least_images

    def accepted(self, before: Solution, trial: Solution) -> bool:
        """Returns whether a trial replaces the solution before it. The object has to be in its place, or nearer to it
        than before: next to the lamps most measurements are in shadow, and anything fits the rest. Ambient and stray
        light must not exceed what is measured. After a solution that could not be judged, the fit has to be sound;
        otherwise the rule of the alternative decides."""
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
            # Light between the walls of a matt vessel scores as gloss, but gloss does not lower its relative residuals.
            return self.term != "gloss" or after.relative_residual <= before_fit.relative_residual
        return (
            after.probability > model_trial.SETTINGS.min_probability
            and after.relative_residual <= self.worse_at_most * before_fit.relative_residual
        )

    def _ruled_out(self, before: Solution, trial: Solution) -> bool:
        """Returns whether a trial cannot be true, however well it fits."""
        if trial.out_of_place and abs(trial.moved_m) >= abs(before.moved_m):
            return True
        if self.leaves_out:  # without the worst image the loss falls a little even if the model is wrong
            sound = not trial.poor or trial.fit.misfit <= model_trial.SETTINGS.better_at_least * before.fit.misfit
            another_was_bad = before.intensities_scatter and trial.intensities_scatter
            return not sound or another_was_bad
        if self.coding != 1 and not trial.seems_linear:
            return True
        if self.term in ("gloss", "metal") and image_terms.nearly_diffuse(trial.state.shared.terms):
            return True
        return self.term in ("ambient", "offset") and trial.more_subtracted_than_measured

    def _linearises(self, before: Solution, trial: Solution) -> bool:
        """Returns whether linearised values fit so much better that they were coded.

        The fainter the exponent's score, the better the fit has to be. Undoing a coding multiplies relative noise by
        its exponent, and no more. In dark images, as of smooth metal, it brings most values near zero, where any model
        fits them, and relative residuals rise by factors of 4 to 100. Where the score does not point to a coding,
        relative residuals have to fall, because a wrong shape may fit linearised values that were linear before.
        """
        least, before_fit, after = model_trial.SETTINGS.better_at_least, before.fit, trial.fit
        loss, share = after.loss / before_fit.loss, after.relative_residual / before_fit.relative_residual
        sound = after.probability > model_trial.SETTINGS.min_probability
        if before.hypothesis.term_sigma.from_elsewhere and max(loss, share) <= model_trial.SETTINGS.better:
            return True  # it replaces ambient or stray light, which explained the same shadows less well
        if before.seems_coded:
            most = model_trial.SETTINGS.better if sound or loss <= least**2 else least
            return loss <= model_trial.SETTINGS.better and share <= most * self.coding
        if before.scores is not None and before.scores.exponent.step < 0:
            return loss <= (least if before.may_be_coded else least**2) and share <= least * self.coding
        return sound and after.misfit <= least * before_fit.misfit and share <= 1

    def convincing(self, before: Solution, trial: Solution) -> bool:
        """Returns whether an accepted trial puts the images right; only metal may be accepted without. Metal whose
        residuals stay high, as a share of the values or in units of the noise, of which the loss is the square, is
        there, but its shape is not found (decision 80). Where the fit could not be judged before, metal is accepted
        only if it fits soundly, which is enough."""
        if self.term != "metal" or before.unjudged:
            return True
        most, before_fit, after = model_trial.SETTINGS.better_at_least, before.fit, trial.fit
        return (
            after.relative_residual <= most * before_fit.relative_residual and after.loss <= most**2 * before_fit.loss
        )

    def finding(self, terms: ImageTerms, *, convincing: bool = True) -> ModelFinding:
        """Returns the finding of an accepted trial, with the amount that was estimated in the end."""
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
    """Returns the alternatives marked as decisive. Measured: in 751 captures, sound and with faults, where a scored
    term or sure axes halve the misfit, neither gloss, metal nor a coding ever fits better."""
    return [replace(alternative, decisive=True) for alternative in alternatives]
