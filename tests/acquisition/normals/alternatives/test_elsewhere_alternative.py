"""Ambient and stray light on trial: no more of it is accepted than what shadows hold, nor an object that drifts."""

from dataclasses import replace

import numpy as np
import pytest

from acquisition.models.base import Float32Array
from acquisition.normals.alternatives import alternative, model_selection, term_alternatives
from acquisition.normals.alternatives.model_trial import Solution
from acquisition.normals.pixels import image_terms
from acquisition.normals.pixels.image_terms import ImageTerms
from tests.acquisition import scenes
from tests.acquisition.normals.alternatives.selection_cases import images_of, object_of, recorded_solutions, solved

SIZE = 48
STRAY = 0.05
AMBIENT, TRIED = (term_alternatives.TERMS[name][0] for name in ("ambient", "offset"))


def plain(added: Float32Array | float, least: float = -np.inf) -> Solution:
    """The solution by the plain model of a cushion's images with values (h, w) added, none below `least`."""
    made, images = object_of(scenes.bumps, SIZE), images_of(scenes.bumps, SIZE)
    values = np.maximum(images.whole.values + np.float32(added), np.float32(least))
    with pytest.MonkeyPatch.context() as monkeypatch, recorded_solutions() as found:
        monkeypatch.setattr(model_selection, "ALTERNATIVES", ())
        solved(made, scenes.with_values(images, values))
    (solution,) = found
    return solution


@pytest.fixture(scope="module")
def solutions() -> tuple[Solution, Solution]:
    """A cushion's images with stray light by the plain model, and with the stray light that its score demands."""
    before = plain(STRAY)
    return before, model_selection.solve(demanded(before).hypothesis)


def demanded(before: Solution, kind: str = TRIED) -> term_alternatives.Alternative:
    (alternative,) = (one for one in term_alternatives.scored_terms(before) if one.kind == kind)
    return alternative


def test_ambient_light_is_demanded_unless_errors_of_the_indirect_light_may_be_as_large() -> None:
    """The inside of a vessel reflects light that no camera sees coming, and was solved as lit from elsewhere."""
    made, images = object_of(scenes.bumps, SIZE), images_of(scenes.bumps, SIZE)
    before = plain(STRAY * made.albedo[images.rows, images.columns])
    assert demanded(before, AMBIENT).step == pytest.approx(STRAY, rel=0.2)
    for indirect, tried in ((STRAY / 0.8, True), (STRAY / 0.4, False)):
        shadows = replace(before.state.shadows, indirect=indirect)
        again = replace(before, state=replace(before.state, shadows=shadows))
        assert (AMBIENT in {one.kind for one in term_alternatives.scored_terms(again)}) is tried


def test_stray_light_that_a_score_demands_is_named_until_it_is_estimated(solutions: tuple[Solution, Solution]) -> None:
    """Not beside gloss, whose lobe may differ from the model's, nor of four images, which tell models not apart."""
    before, estimated = solutions

    def named(solution: Solution) -> list[float | None]:
        return [one.value for one in model_selection.remaining(solution) if one.kind == TRIED and not one.corrected]

    assert named(before) == [pytest.approx(demanded(before).step)]
    assert named(estimated) == []
    shared = replace(before.state.shared, terms=ImageTerms(gloss=0.3))
    assert named(replace(before, state=replace(before.state, shared=shared))) == []
    assert named(replace(before, fit=replace(before.fit, images=before.fit.images[:4]))) == []


def test_ambient_light_has_to_fit_clearly_better_where_an_exponent_gains_more() -> None:
    """Relief of the size of a pixel fitted a little better in ambient light of 10–20 % that was not there."""
    before = plain(STRAY)
    assert before.scores is not None
    gain = before.scores.offset.gain
    for rival, limits in ((0.9 * gain, alternative.AS_GOOD), (1.1 * gain, alternative.clearly_better())):
        exponent = replace(before.scores.exponent, gain=rival)
        again = replace(before, scores=replace(before.scores, exponent=exponent))
        assert demanded(again).limits == limits


def test_shadows_censored_at_black_say_nothing_of_indirect_light_nor_of_an_offset() -> None:
    """Cushions reflect light onto themselves; where too much was subtracted, their shadows show none of it."""
    before = plain(-STRAY, least=0.0)
    nominal = replace(before.hypothesis.nominal, shadows_informative=False)
    without = model_selection.solve(replace(before.hypothesis, nominal=nominal))
    assert [one.state.indirect_irradiance is None for one in (before, without)] == [True, False]
    assert [one.state.shadows.has_measurements for one in (before, without)] == [True, False]


def darker(solution: Solution, by: float) -> Solution:
    """The solution as if its measurements had been darker than what it was solved from."""
    of_sample = solution.sample.solution
    measured = of_sample.measured - np.float32(by)
    return replace(solution, sample=replace(solution.sample, solution=replace(of_sample, measured=measured)))


def test_stray_light_that_shadows_hold_is_accepted(solutions: tuple[Solution, Solution]) -> None:
    before, trial = solutions
    assert trial.state.shared.terms.offset == pytest.approx(STRAY, rel=0.1)
    assert not trial.more_subtracted_than_measured
    assert demanded(before).accepted(before, trial)


def test_trial_whose_fit_cannot_be_judged_is_not_accepted(solutions: tuple[Solution, Solution]) -> None:
    before, trial = solutions
    unjudged = replace(trial, fit=replace(trial.fit, misfit=np.nan))
    assert unjudged.unjudged
    assert not demanded(before).accepted(before, unjudged)


def test_losses_are_not_compared_where_values_at_black_are_newly_censored(
    solutions: tuple[Solution, Solution],
) -> None:
    """Of a censored blob the loss rose to 3.3 times that before, and the error fell from 3.4 to 0.7°."""
    before, trial = solutions
    higher = replace(trial, fit=replace(trial.fit, loss=3 * before.fit.loss))
    found = replace(demanded(before), step=trial.state.shared.terms.offset)

    def censored(solution: Solution) -> Solution:
        nominal = replace(solution.hypothesis.nominal, shadows_informative=False)
        return replace(solution, hypothesis=replace(solution.hypothesis, nominal=nominal))

    newly = replace(found, hypothesis=censored(higher).hypothesis)
    assert not found.accepted(before, higher)
    assert newly.accepted(before, censored(higher))
    assert not newly.accepted(censored(before), censored(higher))
    assert not replace(newly, step=3 * newly.step).accepted(before, censored(higher))


def test_stray_light_that_leaves_shadows_below_zero_is_not_accepted(solutions: tuple[Solution, Solution]) -> None:
    """Reliefs of the size of a pixel fitted better with a third of white as ambient light, at three times the error."""
    before, trial = solutions
    over = darker(trial, STRAY)
    assert over.more_subtracted_than_measured
    assert not demanded(before).accepted(before, over)
    assert replace(demanded(before), term="gloss").accepted(before, over)


@pytest.mark.parametrize("term", ["gloss", "metal"])
def test_lobe_whose_roughness_runs_to_the_end_of_its_range_is_not_accepted(
    solutions: tuple[Solution, Solution], term: str
) -> None:
    """Glossy objects under mirrored lamps were solved as metal of α 0.7, 16–36° off."""
    before, trial = solutions
    lobe = replace(demanded(before), term=term, independently_tested=True)

    def with_alpha(alpha: float) -> Solution:
        shared = replace(trial.state.shared, terms=ImageTerms(**{term: alpha}))
        return replace(trial, state=replace(trial.state, shared=shared))

    end = image_terms.SETTINGS.gloss_range[1]
    assert [lobe.accepted(before, with_alpha(alpha)) for alpha in (0.5 * end, end)] == [True, False]


def test_trial_of_an_object_far_from_its_place_is_accepted_only_if_it_was_farther_before(
    solutions: tuple[Solution, Solution],
) -> None:
    """A relief of metal was solved as matt, 18° off and 90 mm from its place, because as metal it was 77 mm from it."""
    before, trial = solutions

    def moved(solution: Solution, by_m: float) -> Solution:
        start = np.full_like(solution.state.depth_m, solution.state.depth_m.mean() - by_m)
        return replace(solution, hypothesis=replace(solution.hypothesis, start_m=start))

    pairs = [(0.0, 0.077), (0.09, 0.077), (-0.077, 0.09), (0.09, 0.0)]
    verdicts = [demanded(before).accepted(moved(before, one), moved(trial, other)) for one, other in pairs]
    assert [moved(trial, other).out_of_place for _, other in pairs] == [True, True, True, False]
    assert verdicts == [False, True, False, True]
