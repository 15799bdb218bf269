"""Roughness on trial: demanded by its score, or by a sample that fits better as rough, and when it is accepted."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from acquisition.normals.alternatives import model_selection, model_trial, term_alternatives
from acquisition.normals.alternatives.model_trial import Solution
from acquisition.normals.alternatives.term_tests import TermScore
from hardware_sim.reflectance import Reflectance
from tests.acquisition import scenes
from tests.acquisition.normals.alternatives.selection_cases import (
    images_of,
    object_of,
    recorded_solutions,
    reflected,
    solved,
)

SIZE = 48
NO_SCORE = TermScore(gain=0.0, step=0.0)
Plain = Callable[[Reflectance], Solution]


@pytest.fixture
def plain(monkeypatch: pytest.MonkeyPatch) -> Plain:
    """Solves the cushion of a reflectance by the plain model alone."""
    made = object_of(scenes.bumps, SIZE)
    monkeypatch.setattr(model_selection, "ALTERNATIVES", ())

    def solution(reflectance: Reflectance) -> Solution:
        with recorded_solutions() as found:
            solved(made, reflected(made, images_of(scenes.bumps, SIZE), reflectance))
        return found[0]

    return solution


def unscored(solution: Solution) -> Solution:
    """The solution as if no term had a score."""
    assert solution.scores is not None
    return replace(solution, scores=replace(solution.scores, roughness=NO_SCORE, ambient=NO_SCORE, offset=NO_SCORE))


def test_rough_surface_without_a_score_is_tried_where_its_sample_fits_better_as_rough(plain: Plain) -> None:
    """Of a rough relief lamps and shape took up the roughness, 0.43 rad, until its score gained 0.03."""
    rough, matt = (plain(Reflectance("oren-nayar", sigma)) for sigma in (0.4, 0.0))
    assert rough.rough_misfit < model_trial.SETTINGS.slightly_better < 1 < matt.rough_misfit
    proposed = [term_alternatives.scored_terms(unscored(one)) for one in (rough, matt)]
    assert [[one.kind for one in each] for each in proposed] == [["rough surface"], []]
    alternative = proposed[0][0]
    trial = model_selection.solve(alternative.hypothesis)
    assert alternative.accepted(rough, trial)
    assert trial.state.shared.terms.roughness_rad == pytest.approx(0.4, abs=0.05)
    refused = replace(trial, fit=replace(trial.fit, loss=1.01 * rough.fit.loss))
    assert not alternative.accepted(rough, refused)


def test_rough_surface_is_accepted_where_loss_falls_and_half_of_what_was_promised_is_found(plain: Plain) -> None:
    """The median residual, the misfit, rose to 1.23 of that of a matt vessel as rough, whose loss fell to 0.54."""
    rough = plain(Reflectance("oren-nayar", 0.4))
    (alternative,) = term_alternatives.scored_terms(rough)
    trial = model_selection.solve(alternative.hypothesis)

    def verdict(misfit: float, loss: float, promised: float = 1.0) -> bool:
        fit = replace(trial.fit, misfit=misfit * rough.fit.misfit, loss=loss * rough.fit.loss)
        asked = replace(alternative, step=promised * alternative.step)
        return asked.accepted(rough, replace(trial, fit=fit))

    assert [verdict(1.23, 0.54), verdict(1.23, 1.01), verdict(0.8, 0.54, promised=4.0)] == [True, False, False]
