"""An alternative to the model of the images, and the rule by which its solution replaces the one before.

How good the fit has to be depends on what demands the alternative. A test that is surer than the fit needs no better
one. A term that a score promises has to be found in about that amount. What only a poor fit calls for has to fit far
better. One rule holds for all: each alternative states the largest loss, and the largest relative residual, that its
solution may leave (decision 98).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from acquisition import photometry
from acquisition.models.result import ModelFinding
from acquisition.models.rounding import figure, percent
from acquisition.normals.alternatives import model_trial
from acquisition.normals.alternatives.model_trial import Hypothesis, Solution
from acquisition.normals.indirect_light import translucency
from acquisition.normals.pixels import image_terms
from acquisition.normals.pixels.image_terms import ImageTerms
from acquisition.normals.uncertainty.goodness_of_fit import Fit

FOUND_SHARE = 0.5
"""Share of the amount that a score predicts, above which a term counts as found."""


class Limits(NamedTuple):
    """Largest loss of a trial, and largest relative residual, each over that of the solution before it; with `sound`
    its fit has to be sound, too, and with `throughout` relative residuals have to fall with the loss.

    A loss that counts every measurement tells more than the misfit, a median over pixels. Relative residuals are shares
    of the values: a model that makes the object darker lowers the loss, but not these. They are a median: if all pixels
    fit better alike, they fall as the root of the loss, a mean of squares. `throughout` asks for half of that, in
    logarithms.
    """

    loss: float
    relative_residual: float = np.inf
    sound: bool = False
    throughout: bool = False

    def met(self, before: Fit, after: Fit) -> bool:
        """Returns whether a fit is within the limits."""
        return (
            after.loss <= self.loss * before.loss
            and after.relative_residual <= self.relative_residual * before.relative_residual
            and (not self.sound or after.probability > model_trial.SETTINGS.min_probability)
            and (not self.throughout or _fits_throughout(before, after))
        )


def _fits_throughout(before: Fit, after: Fit) -> bool:
    """Returns whether relative residuals have fallen by half of what the loss makes expect, in logarithms."""
    power = FOUND_SHARE / 2
    return after.relative_residual * before.loss**power <= before.relative_residual * after.loss**power


AS_GOOD = (Limits(1.0),)
"""Limits of what a test demands and no score or residual contradicts: the loss does not rise."""


def clearly_better() -> tuple[Limits, ...]:
    """Returns the limits of what a test suggests, but the fit has to confirm."""
    return (Limits(model_trial.SETTINGS.better),)


def explains_more(*, throughout: bool = False) -> tuple[Limits, ...]:
    """Returns the limits of a reflectance that a score demands. Light between the walls of a matt vessel scores as
    gloss or roughness, but then neither lowers relative residuals, and the loss by little. `throughout`: as in
    `Limits`."""
    return Limits(1.0, 1.0, throughout=throughout), Limits(model_trial.SETTINGS.better_at_least)


def far_better() -> tuple[Limits, ...]:
    """Returns the limits of what only a poor fit calls for."""
    return (Limits(model_trial.SETTINGS.better_at_least, model_trial.SETTINGS.better_at_least),)


@dataclass(frozen=True)
class Alternative:
    """Another model: kind, message and value of its finding, the hypothesis to solve, and when its fit is accepted.

    - `limits`: how much of the loss and of the relative residuals before it may leave; one of them has to be met.
    - `demanded`: a test demands it, and not the poor fit alone.
    - `coding`: exponent by which it changes the values; 1: it does not.
    - `term`: the field of `ImageTerms` that it estimates; empty: none.
    - `step`: value of the term that one Newton step of the score test predicts; 0: no score demands it.
    - `unreported`: it corrects the solver, not the capture, so there is no finding.
    - `independently_tested`: a test demands it that does not use residuals; any sound fit is accepted.
    - `least_images`: number of images from which residuals tell it from other models.
    - `decisive`: once it is by far the best so far, only other decisive ones are tried.
    - `leaves_out`: it leaves an image out.
    """

    kind: str
    message: str
    hypothesis: Hypothesis
    limits: tuple[Limits, ...]
    value: float | None = None
    coding: float = 1.0
    term: str = ""
    step: float = 0.0
    unreported: bool = False
    independently_tested: bool = False
    least_images: int = photometry.REDUNDANT
    decisive: bool = False
    leaves_out: bool = False
    demanded: bool = True

    @property
    def of_surface(self) -> bool:
        """Whether it is a property of the object's surface; else a fault of the capture."""
        return self.term in ("roughness", "gloss", "metal") or self.kind == translucency.KIND

    def has_enough_images(self, images: int) -> bool:
        """Returns whether so many images tell it from other models; a test without residuals needs no minimum."""
        return self.independently_tested or images >= self.least_images

    def accepted(self, before: Solution, trial: Solution) -> bool:
        """Returns whether a trial replaces the solution before it.

        A fit that cannot be judged is not accepted; after a solution that could not be judged any sound fit is. Any
        sound fit is also accepted of an alternative that is independently tested, and where values at black are newly
        taken for censored ones, because losses are not comparable then. Otherwise the `limits` decide; a term of which
        less is found than half of what its score predicts has to fit clearly better.
        """
        if self._ruled_out(before, trial):
            return False
        if before.unjudged:
            return trial.fit.probability > model_trial.SETTINGS.min_probability
        if trial.unjudged:
            return False
        if self.independently_tested and not trial.badly_fitting:
            return True
        found = self.step == 0 or getattr(trial.state.shared.terms, self.term) / self.step > FOUND_SHARE
        if before.hypothesis.nominal.shadows_informative and not self.hypothesis.nominal.shadows_informative:
            return found and not trial.badly_fitting
        limits = self.limits if found else clearly_better()
        return any(one.met(before.fit, trial.fit) for one in limits)

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
            message += f" {figure(value, 2)} rad"
        elif self.term in ("gloss", "metal"):
            value = max(terms.gloss, terms.metal)
            message += f" {figure(value, 2)}"
            if terms.strength > 0:
                message += f" and {figure(terms.strength, 1)} times the strength of a dielectric's"
        elif self.term in ("ambient", "offset"):
            value = getattr(terms, self.term)
            message += f" ({percent(value)} of white)"
        message += "" if convincing else "; this explains the images only in part: do not trust the normals"
        return ModelFinding(kind=self.kind, message=message, corrected=convincing, value=value)


def decisive(alternatives: Sequence[Alternative]) -> list[Alternative]:
    """Returns the alternatives marked as decisive. Measured: in 751 captures, sound and with faults, where a scored
    term or sure axes halve the misfit, neither gloss, metal nor a coding ever fits better."""
    return [replace(alternative, decisive=True) for alternative in alternatives]
