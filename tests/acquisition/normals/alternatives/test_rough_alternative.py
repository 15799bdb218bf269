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


def test_rough_surface_is_accepted_where_loss_falls_and_relative_residuals_with_it(plain: Plain) -> None:
    """A matt vessel was solved as rough, 8.9° off in place of 3.1°, with 0.98 of the loss and 1.06 times the relative
    residuals, and with 0.90 and 0.98–0.99. Of a rough vessel these rose to 1.2, while the loss fell to 0.54."""
    rough = plain(Reflectance("oren-nayar", 0.4))
    (alternative,) = term_alternatives.scored_terms(rough)
    trial = model_selection.solve(alternative.hypothesis)

    def verdict(share: float, loss: float, promised: float = 1.0) -> bool:
        fit = replace(trial.fit, relative_residual=share * rough.fit.relative_residual, loss=loss * rough.fit.loss)
        asked = replace(alternative, step=promised * alternative.step)
        return asked.accepted(rough, replace(trial, fit=fit))

    assert [verdict(0.99, 0.98), verdict(1.06, 0.98), verdict(1.2, 0.54), verdict(0.99, 1.01)] == [
        True, False, True, False,
    ]  # fmt: skip
    assert [verdict(share, 0.9) for share in (0.97, 0.98)] == [True, False]
    assert [verdict(0.99, loss, promised=4.0) for loss in (0.87, 0.89)] == [True, False]
