"""Whole plans on scenes of known truth, and what they say of bad input."""

from dataclasses import replace

import numpy as np
import pytest

from acquisition import pilot, plan
from acquisition.errors import ErrorCode, RigError
from acquisition.plan import criterion
from acquisition.plan.objective import CAPPED
from acquisition.types import CAST, LIT, Information, NormalMap, Recipe
from tests.acquisition import scenes
from tests.acquisition.plan import cases

# ------------------------------------------------------------------------------------------------------- whole plans


@pytest.fixture(scope="module")
def reach() -> scenes.Dome:
    return scenes.Dome(seed=1)


@pytest.fixture(scope="module")
def cushion() -> scenes.Scene:
    return scenes.scene(scenes.bumps, scenes.calibration(128))


@pytest.fixture(scope="module")
def piloted(cushion: scenes.Scene, reach: scenes.Dome) -> NormalMap:
    return cases.known_map(cushion, pilot.pattern(Recipe(), reach))


def planned(normal_map: NormalMap, true: scenes.Scene, reach: scenes.Dome, count: int = 4, seed: int = 0):
    return plan.choose(normal_map, cases.NOTHING_TAKEN, Recipe(seed=seed), reach, true.calibration, count)


def test_a_plan_is_the_same_each_time(piloted: NormalMap, cushion: scenes.Scene, reach: scenes.Dome) -> None:
    assert planned(piloted, cushion, reach) == planned(piloted, cushion, reach)


def test_lights_are_distinct_reachable_and_explained(
    piloted: NormalMap, cushion: scenes.Scene, reach: scenes.Dome
) -> None:
    chosen = planned(piloted, cushion, reach, count=6)
    positions = np.array([light.position for light in chosen.lights])
    assert all(reach.allows(position) is None for position in positions)
    np.testing.assert_allclose(np.linalg.norm(positions - reach.center, axis=1), reach.radius_m)
    apart = np.linalg.norm(positions[:, None] - positions[None], axis=-1) + np.eye(6)
    assert apart.min() > 0.005
    assert chosen.method == "optimal"
    assert len(chosen.reasons) == 6
    assert all("slant" in reason and "pixels" in reason for reason in chosen.reasons)
    assert any("expected with these lights" in note for note in chosen.notes)


def test_more_lights_are_predicted_to_be_better(piloted: NormalMap, cushion: scenes.Scene, reach: scenes.Dome) -> None:
    sigma = [planned(piloted, cushion, reach, count).predicted_sigma_deg for count in (0, 2, 4, 8)]
    assert sigma == sorted(sigma, reverse=True)
    assert sigma[0] > 1.2 * sigma[-1]


def test_a_plan_is_predicted_better_than_two_rings(
    piloted: NormalMap, cushion: scenes.Scene, reach: scenes.Dome
) -> None:
    chosen = planned(piloted, cushion, reach).lights
    rings = plan.baseline("two-rings", 4, Recipe(method="two-rings"), reach).lights
    sample = criterion.samples(piloted, cushion.calibration, criterion.usable(piloted, cushion.calibration))
    ours, theirs = (
        CAPPED.of(criterion.expect(sample, cases.told(sample, lights, piloted, cushion.calibration)))
        for lights in (chosen, rings)
    )
    assert ours < theirs


def test_a_blind_side_of_the_pilot_is_lit(cushion: scenes.Scene, reach: scenes.Dome) -> None:
    """After pilot lights from the right only, most of the lights that are added come from the left."""
    right = [light for light in scenes.ring(12, 55.0) if light.position[0] > 0.15]
    assert len(right) >= 3
    added = planned(cases.known_map(cushion, right), cushion, reach, count=4).lights
    assert sum(light.position[0] < -0.05 for light in added) >= 2
    assert np.mean([light.position[0] for light in added]) < -0.05


def test_what_is_fulfilled_needs_no_lights_but_is_forecast(
    piloted: NormalMap, cushion: scenes.Scene, reach: scenes.Dome
) -> None:
    lights = scenes.ring(8, 45.0)
    taken = scenes.capture(cushion, lights)
    chosen = plan.choose(piloted, taken, Recipe(), reach, cushion.calibration)
    assert chosen.lights == []
    assert chosen.predicted_sigma_deg > 0
    assert "all lights of the recipe have been taken" in chosen.notes


@pytest.mark.parametrize("kept", [0, 1, 5])
def test_fewer_candidates_than_lights_are_refused(kept: int, piloted: NormalMap, cushion: scenes.Scene) -> None:
    few = scenes.Dome(refused=0)
    few.candidates = few.candidates[:: len(few.candidates) // 6][:kept]
    with pytest.raises(RigError) as caught:
        planned(piloted, cushion, few, count=8)
    assert caught.value.code == ErrorCode.PLAN_INFEASIBLE
    assert caught.value.context["reachable"] == kept


def test_candidates_on_one_side_are_refused(piloted: NormalMap, cushion: scenes.Scene) -> None:
    half = scenes.Dome(refused=0)
    half.candidates = half.candidates[half.candidates[:, 1] < 0]
    with pytest.raises(RigError, match="one side") as caught:
        planned(piloted, cushion, half)
    assert caught.value.code == ErrorCode.PLAN_INFEASIBLE


def test_an_empty_map_is_refused(piloted: NormalMap, cushion: scenes.Scene, reach: scenes.Dome) -> None:
    nothing = np.zeros(0, np.int64)
    empty = replace(
        piloted,
        mask=np.zeros_like(piloted.mask),
        information=Information(rows=nothing, columns=nothing, matrices=np.zeros((0, 4, 4))),
    )
    with pytest.raises(RigError, match="only 0 sample pixels") as caught:
        planned(empty, cushion, reach)
    assert caught.value.code == ErrorCode.PLAN_INFEASIBLE


@pytest.mark.parametrize("name", ["normals", "depth", "albedo"])
def test_maps_that_are_no_numbers_are_refused(
    name: str, piloted: NormalMap, cushion: scenes.Scene, reach: scenes.Dome
) -> None:
    broken = replace(piloted, **{name: np.full_like(getattr(piloted, name), np.nan)})
    with pytest.raises(RigError) as caught:
        planned(broken, cushion, reach)
    assert caught.value.code == ErrorCode.PLAN_INFEASIBLE


def test_some_pixels_that_are_no_numbers_are_left_out(
    piloted: NormalMap, cushion: scenes.Scene, reach: scenes.Dome
) -> None:
    normals, depth = piloted.normals.copy(), piloted.depth.copy()
    normals[60:64] = np.nan
    depth[:, 70:73] = np.nan
    chosen = planned(replace(piloted, normals=normals, depth=depth), cushion, reach)
    whole = planned(piloted, cushion, reach)
    assert len(chosen.lights) == 4
    assert chosen.predicted_sigma_deg == pytest.approx(whole.predicted_sigma_deg, rel=0.15)


@pytest.mark.parametrize(("height_m", "warned"), [(0.0, False), (0.03, True)])
def test_shadows_of_a_step_that_the_depth_map_lacks_are_noted(
    height_m: float, warned: bool, reach: scenes.Dome
) -> None:
    """The images are those of a plate with a block on it, the depth map that of the bare plate."""

    def plate(x: np.ndarray, y: np.ndarray, top: float = 0.0) -> np.ndarray:
        return np.where(np.hypot(x, y) < 0.06, 0.01, 0.0) + np.where(np.maximum(abs(x), abs(y)) < 0.015, top, 0.0)

    flat = scenes.scene(plate, scenes.calibration(112))
    stepped = scenes.scene(lambda x, y: plate(x, y, height_m), scenes.calibration(112))
    lights = pilot.pattern(Recipe(), reach)
    dark = np.stack([scenes.lit(stepped, light) == 0 for light in lights])
    normal_map = replace(cases.known_map(flat, lights), flags=np.where(dark, CAST, LIT).astype(np.uint8))
    taken = scenes.capture(stepped, lights)
    chosen = plan.choose(normal_map, taken, Recipe(), reach, flat.calibration)
    assert any("steps that its depth map does not show" in note for note in chosen.notes) == warned
