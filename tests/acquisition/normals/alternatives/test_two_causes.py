"""Two things that are otherwise at once: gloss beside light from elsewhere, and under mirrored lamps."""

from dataclasses import replace

import numpy as np
import pytest

from acquisition import photometry
from acquisition.normals import Images
from acquisition.normals.alternatives import lamp_alternatives, model_selection
from acquisition.normals.alternatives.model_trial import Hypothesis, Solution
from hardware_sim.reflectance import Reflectance
from tests.acquisition import scenes
from tests.acquisition.normals.alternatives.selection_cases import (
    Trial,
    images_of,
    kinds,
    mean_deg,
    object_of,
    recorded_trials,
    reflected,
    relit,
    solved,
)

SIZE = 64


@pytest.fixture(scope="module")
def glossy() -> Images:
    return reflected(object_of(scenes.bumps, SIZE), images_of(scenes.bumps, SIZE), Reflectance("ggx", 0.4))


@pytest.fixture(scope="module")
def glossy_error_deg(glossy: Images) -> float:
    made = object_of(scenes.bumps, SIZE)
    return mean_deg(made, solved(made, glossy))


@pytest.fixture(scope="module")
def mirrored(glossy: Images) -> list[Trial]:
    """What is tried of the glossy images under mirrored lamps."""
    with recorded_trials() as tried:
        result = solved(object_of(scenes.bumps, SIZE), replace(glossy, lights=relit(glossy.lights, range(8), (-1, 1))))
    assert set(kinds(result)) == {(lamp_alternatives.AXES, True), ("gloss", True)}
    return tried


def test_solve_glossy_surface_beside_stray_light_is_solved_as_both(glossy: Images, glossy_error_deg: float) -> None:
    """Once light from elsewhere was estimated, gloss was tried no more: a glossy knot under ambient light was 4.0° off
    in place of 1.1°."""
    made = object_of(scenes.bumps, SIZE)
    result = solved(made, scenes.with_values(glossy, glossy.whole.values + np.float32(0.05)))
    assert set(kinds(result)) == {("gloss", True), ("stray light", True)}
    assert mean_deg(made, result) < 1.3 * glossy_error_deg


def test_best_trial_is_other_axes_where_gloss_fits_better_under_them(mirrored: list[Trial]) -> None:
    """Of a glossy profile under mirrored lamps gloss alone left fewer residuals than the right axes alone, 53° off."""
    before = mirrored[0][1]
    accepted = [one for one in mirrored if one[1] is before and one[0].accepted(one[1], one[2])]
    axes, _, righted = next(one for one in accepted if one[0].kind == lamp_alternatives.AXES)
    gloss, _, unrighted = next(one for one in mirrored if one[0].kind == "gloss" and one[1] is before)

    def choice(share: float, kind: str = gloss.kind) -> object:
        """What is chosen where gloss under mirrored lamps leaves so much of the residuals of the right axes alone."""
        fit = replace(unrighted.fit, misfit=righted.fit.misfit, relative_residual=share * righted.fit.relative_residual)
        best = replace(gloss, kind=kind), replace(unrighted, fit=fit)
        chosen = model_selection._better_with_another([(axes, righted), best], best)  # pyright: ignore[reportPrivateUsage]
        return chosen and chosen[0]

    assert choice(0.9) is axes
    assert choice(0.01) is None
    assert choice(0.9, photometry.METAL) is None


def test_best_trial_is_roughness_where_with_stray_light_it_fits_better_than_other_axes() -> None:
    """A rough profile in stray light fitted turned lamps better than either of the two alone, 51° off."""
    made = object_of(scenes.bumps, SIZE)
    rough_images = reflected(made, images_of(scenes.bumps, SIZE), Reflectance("oren-nayar", 0.5))
    with recorded_trials() as tried:
        solved(made, scenes.with_values(rough_images, rough_images.whole.values + np.float32(0.02)))
    before = tried[0][1]
    rough, _, alone = next(one for one in tried if one[0].kind == "rough surface" and one[1] is before)
    both = next(one[2] for one in tried if one[0].kind == "stray light" and one[1] is alone)
    left = both.fit.misfit * both.fit.relative_residual / (alone.fit.misfit * alone.fit.relative_residual)

    def choice(share: float) -> object:
        """What is chosen where other axes leave so much of the residuals that are left with roughness."""
        axes = replace(rough, kind=lamp_alternatives.AXES, term="", step=0.0)
        best = (
            axes,
            replace(alone, fit=replace(alone.fit, relative_residual=share * alone.fit.relative_residual), scores=None),
        )
        chosen = model_selection._better_with_another([(rough, alone), best], best)  # pyright: ignore[reportPrivateUsage]
        return chosen and chosen[0]

    assert left < 0.95
    assert choice(1.01 * left) is rough
    assert choice(0.99 * left) is None


def test_selection_takes_other_axes_before_gloss_that_fits_better_without_them(
    mirrored: list[Trial], monkeypatch: pytest.MonkeyPatch
) -> None:
    before = mirrored[0][1]
    righted = next(one[2] for one in mirrored if one[1] is before and one[0].kind == lamp_alternatives.AXES)
    solve = model_selection.solve

    def with_better_gloss(hypothesis: Hypothesis) -> Solution:
        """Gloss under mirrored lamps leaves a little less than the right axes alone."""
        trial = solve(hypothesis)
        if hypothesis.corrected != ("gloss",):
            return trial
        return replace(
            trial,
            fit=replace(trial.fit, misfit=righted.fit.misfit, relative_residual=0.9 * righted.fit.relative_residual),
        )

    monkeypatch.setattr(model_selection, "solve", with_better_gloss)
    chosen = model_selection._best_trial(before, set())  # pyright: ignore[reportPrivateUsage]
    assert chosen is not None
    assert chosen[0].kind == lamp_alternatives.AXES
