"""Complete plans on scenes of known truth, and errors for invalid input."""

import re
from dataclasses import replace

import numpy as np
import pytest

from acquisition import lamp_pose, photometry, pilot, plan
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import LightPlan
from acquisition.models.recipe import Recipe
from acquisition.models.result import CAST, LIT, FisherInformation, NormalMap
from acquisition.plan import baselines, sample_pixels
from tests.acquisition import scenes
from tests.acquisition.plan import cases

SIZE = 96

# ---------------------------------------------------------------------------------------------------- complete plans


@pytest.fixture(scope="module")
def reach() -> scenes.Dome:
    return scenes.Dome(seed=1, count=150)


@pytest.fixture(scope="module")
def cushion() -> scenes.Scene:
    return scenes.scene(scenes.bumps, scenes.calibration(SIZE))


@pytest.fixture(scope="module")
def piloted(cushion: scenes.Scene, reach: scenes.Dome) -> NormalMap:
    return cases.known_map(cushion, pilot.pattern(Recipe(), reach))


def planned(
    normal_map: NormalMap, true: scenes.Scene, reach: scenes.Dome, count: int = 4, *, certify: bool = False
) -> LightPlan:
    return plan.choose(
        plan.DesignProblem.of(normal_map, cases.NO_OBSERVATIONS, Recipe(), reach, true.calibration),
        count,
        certify=certify,
    )


def test_choose_same_input_gives_same_plan(piloted: NormalMap, cushion: scenes.Scene, reach: scenes.Dome) -> None:
    assert planned(piloted, cushion, reach) == planned(piloted, cushion, reach)


def test_choose_lights_are_distinct_reachable_and_explained(
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
    changes = [re.search(r"from (\S+)° to (\S+)°", reason) for reason in chosen.reasons]
    assert any(changes)
    assert all(float(change[2]) < float(change[1]) for change in changes if change is not None)
    assert any("expected with these lights" in note for note in chosen.notes)


def test_choose_more_lights_lowers_predicted_sigma(
    piloted: NormalMap, cushion: scenes.Scene, reach: scenes.Dome
) -> None:
    sigma = [planned(piloted, cushion, reach, count).predicted_sigma_deg or np.nan for count in (0, 2, 4, 8)]
    assert sigma == sorted(sigma, reverse=True)
    assert sigma[0] > 1.2 * sigma[-1]


def test_choose_plan_is_predicted_better_than_two_rings(
    piloted: NormalMap, cushion: scenes.Scene, reach: scenes.Dome
) -> None:
    chosen = planned(piloted, cushion, reach).lights
    rings = plan.baseline("two-rings", 4, Recipe(method="two-rings"), reach).lights
    sample = sample_pixels.samples(piloted, cushion.calibration, sample_pixels.usable(piloted, cushion.calibration))
    ours, theirs = (
        cases.design_rows(sample, lights, piloted, cushion.calibration).posterior().loss for lights in (chosen, rings)
    )
    assert ours < theirs


def test_choose_side_unlit_by_pilot_gets_light(cushion: scenes.Scene, reach: scenes.Dome) -> None:
    """After pilot lights from the right only, most of the added lights are on the left."""
    right = [light for light in scenes.ring(12, 55.0) if light.position[0] > 0.15]
    assert len(right) >= 3
    normal_map = replace(cases.known_map(cushion, right), flags=np.full((len(right), SIZE, SIZE), LIT, np.uint8))
    observations = replace(
        cases.NO_OBSERVATIONS, shots=[cases.shot_of(light, number) for number, light in enumerate(right)]
    )
    added = plan.choose(
        plan.DesignProblem.of(normal_map, observations, Recipe(), reach, cushion.calibration), 4, certify=False
    ).lights
    assert sum(light.position[0] < -0.05 for light in added) >= 2
    assert np.mean([light.position[0] for light in added]) < -0.05


def test_choose_by_normals_of_other_images_is_refused(
    piloted: NormalMap, cushion: scenes.Scene, reach: scenes.Dome
) -> None:
    observations = scenes.capture(cushion, scenes.ring(8, 45.0))
    with pytest.raises(RigError, match="from 4 images, the session has 8"):
        plan.DesignProblem.of(piloted, observations, Recipe(), reach, cushion.calibration)


def test_choose_recipe_fulfilled_gives_no_lights_but_forecast(
    piloted: NormalMap, cushion: scenes.Scene, reach: scenes.Dome
) -> None:
    observations = scenes.capture(cushion, scenes.ring(4, 45.0))
    recipe = Recipe(pilot_lights=4, planned_lights=0)
    chosen = plan.choose(plan.DesignProblem.of(piloted, observations, recipe, reach, cushion.calibration))
    assert chosen.lights == []
    assert (chosen.predicted_sigma_deg or 0) > 0
    assert "all lights of the recipe have been captured" in chosen.notes


@pytest.mark.parametrize("kept", [0, 1, 5])
def test_choose_fewer_candidates_than_lights_is_refused(kept: int, piloted: NormalMap, cushion: scenes.Scene) -> None:
    few = scenes.Dome(refused=0)
    few.candidates = np.array([light.position for light in scenes.ring(5, 45.0)])[:kept]
    with pytest.raises(RigError) as caught:
        planned(piloted, cushion, few, count=8)
    assert caught.value.code == ErrorCode.PLAN_INFEASIBLE
    assert caught.value.context["reachable"] == kept


def test_choose_candidates_on_one_side_is_refused(piloted: NormalMap, cushion: scenes.Scene) -> None:
    half = scenes.Dome(refused=0)
    half.candidates = half.candidates[half.candidates[:, 1] < 0]
    with pytest.raises(RigError, match="one side") as caught:
        planned(piloted, cushion, half)
    assert caught.value.code == ErrorCode.PLAN_INFEASIBLE


def test_choose_empty_normal_map_is_refused(piloted: NormalMap, cushion: scenes.Scene, reach: scenes.Dome) -> None:
    nothing = np.zeros(0, np.int64)
    empty = replace(
        piloted,
        mask=np.zeros_like(piloted.mask),
        information=FisherInformation(rows=nothing, columns=nothing, matrices=np.zeros((0, 4, 4))),
    )
    with pytest.raises(RigError, match="only 0 sample pixels") as caught:
        planned(empty, cushion, reach)
    assert caught.value.code == ErrorCode.PLAN_INFEASIBLE


@pytest.mark.parametrize("name", ["normals", "depth", "albedo"])
def test_choose_non_finite_normal_map_is_refused(
    name: str, piloted: NormalMap, cushion: scenes.Scene, reach: scenes.Dome
) -> None:
    broken = replace(piloted, **{name: np.full_like(getattr(piloted, name), np.nan)})
    with pytest.raises(RigError) as caught:
        planned(broken, cushion, reach)
    assert caught.value.code == ErrorCode.PLAN_INFEASIBLE


def test_choose_some_non_finite_pixels_are_left_out(
    piloted: NormalMap, cushion: scenes.Scene, reach: scenes.Dome
) -> None:
    normals, depth = piloted.normals.copy(), piloted.depth.copy()
    normals[60:64] = np.nan
    depth[:, 70:73] = np.nan
    chosen = planned(replace(piloted, normals=normals, depth=depth), cushion, reach)
    reference = planned(piloted, cushion, reach)
    assert len(chosen.lights) == 4
    assert chosen.predicted_sigma_deg == pytest.approx(reference.predicted_sigma_deg, rel=0.15)


def test_choose_unexplained_steps_keeps_planned_lights(reach: scenes.Dome) -> None:
    """A block that the depth map lacks: the lights are still those of least loss given that map, and say their σ."""

    def height(x: np.ndarray, y: np.ndarray, top: float = 0.0) -> np.ndarray:
        return np.where(np.hypot(x, y) < 0.06, 0.01, 0.0) + np.where(np.maximum(abs(x), abs(y)) < 0.015, top, 0.0)

    flat = scenes.scene(height, scenes.calibration(112))
    stepped = scenes.scene(lambda x, y: height(x, y, 0.03), scenes.calibration(112))
    lights = pilot.pattern(Recipe(), reach)
    dark = np.stack([scenes.lit(stepped, light) == 0 for light in lights])
    assert np.mean(dark[:, flat.mask]) > 0.02
    normal_map = replace(cases.known_map(flat, lights), flags=np.where(dark, CAST, LIT).astype(np.uint8))
    chosen = plan.choose(
        plan.DesignProblem.of(normal_map, scenes.capture(stepped, lights), Recipe(), reach, flat.calibration)
    )
    assert chosen.method == "optimal"
    assert chosen.fallback is None
    assert chosen.efficiency is not None
    assert chosen.two_rings_efficiency is not None
    assert chosen.efficiency >= chosen.two_rings_efficiency


@pytest.mark.parametrize(("evenly", "count"), [(True, 1), (True, 4), (False, 4)])
def test_choose_never_predicts_more_loss_than_completed_rings(
    cushion: scenes.Scene, reach: scenes.Dome, count: int, *, evenly: bool
) -> None:
    """Completed rings are a start of the search: also where eighty lights leave next to nothing to gain."""
    lights = [*scenes.ring(27, 25.0), *scenes.ring(53, 55.0, turn=0.1)] if evenly else scenes.ring(4, 45.0)
    normal_map = replace(cases.known_map(cushion, lights), flags=np.full((len(lights), SIZE, SIZE), LIT, np.uint8))
    observations = replace(
        cases.NO_OBSERVATIONS, shots=[cases.shot_of(light, number) for number, light in enumerate(lights)]
    )
    recipe = Recipe()
    chosen = plan.choose(plan.DesignProblem.of(normal_map, observations, recipe, reach, cushion.calibration), count)
    usable = sample_pixels.usable(normal_map, cushion.calibration)
    offset_sigma_m = photometry.SETTINGS.integrated_depth_sigma_m
    sample = sample_pixels.samples(normal_map, cushion.calibration, usable, offset_sigma_m)
    sample = sample_pixels.reweight(sample, normal_map, observations, cushion.calibration)
    units = (reach.candidates - reach.center) / reach.radius_m
    rings = baselines.two_ring_completions(-np.array([light.axis for light in lights]), units, count)
    positions = [[lamp_pose.light_at(reach.candidates[one], reach.center) for one in numbers] for numbers in rings]
    planned_loss, *ring_losses = (
        cases.design_rows(sample, some, normal_map, cushion.calibration).posterior().loss
        for some in (chosen.lights, *positions)
    )
    assert chosen.fallback is None
    assert planned_loss <= 1.01 * min(ring_losses)  # on all pixels, of which the search has seen some


def test_choose_certificate_bounds_plan_and_pattern(
    piloted: NormalMap, cushion: scenes.Scene, reach: scenes.Dome
) -> None:
    chosen = planned(piloted, cushion, reach, count=6, certify=True)
    assert chosen.efficiency is not None
    assert chosen.two_rings_efficiency is not None
    assert chosen.relaxation_gap is not None
    assert 0.8 < chosen.efficiency <= 1.0
    assert 0.5 < chosen.two_rings_efficiency < chosen.efficiency
    assert 0 <= chosen.relaxation_gap <= 0.001
    assert f"{chosen.lower_bound_sigma_deg:.2f}°" in (chosen.certificate_note or "")
    assert len(chosen.gains) == 6
    assert all(gain > 0 for gain in chosen.gains)


def test_choose_region_of_interest_moves_lights(cushion: scenes.Scene, reach: scenes.Dome) -> None:
    """Lights for the left flank are on the left, for the right flank on the right."""
    normal_map = cases.known_map(cushion, scenes.ring(3, 15.0), step=1)
    columns = np.arange(SIZE)[None, :] * np.ones((SIZE, 1))
    share: dict[str, float] = {}
    for side, region in (("left", columns < 0.375 * SIZE), ("right", columns > 0.625 * SIZE)):
        observations = cases.NO_OBSERVATIONS
        chosen = plan.choose(
            plan.DesignProblem.of(normal_map, observations, Recipe(), reach, cushion.calibration, region=region),
            3,
            certify=False,
        )
        share[side] = float(np.mean([light.position[0] for light in chosen.lights]))
    assert share["left"] < 0 < share["right"]


@pytest.mark.parametrize("empty", [True, False])
def test_choose_empty_or_misshapen_region_is_refused(
    empty: bool, piloted: NormalMap, cushion: scenes.Scene, reach: scenes.Dome
) -> None:
    region = np.zeros((SIZE, SIZE) if empty else (SIZE // 2, SIZE // 2), np.bool_)
    with pytest.raises(RigError, match="region") as caught:
        plan.choose(
            plan.DesignProblem.of(piloted, cases.NO_OBSERVATIONS, Recipe(), reach, cushion.calibration, region=region),
            4,
        )
    assert caught.value.code == ErrorCode.PLAN_INFEASIBLE


def test_forecast_falls_with_lights_and_agrees_with_plan(
    piloted: NormalMap, cushion: scenes.Scene, reach: scenes.Dome
) -> None:
    arguments = (piloted, cases.NO_OBSERVATIONS, Recipe(), reach, cushion.calibration)
    points = plan.forecast(plan.DesignProblem.of(*arguments), [0, 1, 2, 4, 8])
    assert [(point.added, point.lights) for point in points] == [(n, n) for n in (0, 1, 2, 4, 8)]
    sigma = [point.sigma_deg for point in points]
    assert sigma == sorted(sigma, reverse=True)
    chosen = plan.choose(plan.DesignProblem.of(*arguments), 4, certify=False, forecast_counts=(1, 2, 4, 8))
    assert points[3].sigma_deg == pytest.approx(chosen.predicted_sigma_deg, rel=0.03)
    assert [point.added for point in chosen.forecast] == [1, 2, 4, 8]
    assert [point.sigma_deg for point in chosen.forecast] == pytest.approx(sigma[1:], rel=0.03)


def test_choose_few_candidates_shortens_forecast_only(piloted: NormalMap, cushion: scenes.Scene) -> None:
    few = scenes.Dome(refused=0)
    few.candidates = few.candidates[:: len(few.candidates) // 9][:10]
    known = (piloted, cases.NO_OBSERVATIONS, Recipe(), few, cushion.calibration)
    chosen = plan.choose(plan.DesignProblem.of(*known), 4, certify=False, forecast_counts=(1, 8, 16))
    assert len(chosen.lights) == 4
    assert [point.added for point in chosen.forecast] == [1, 8]


def test_choose_one_usable_pilot_light_warns(cushion: scenes.Scene, reach: scenes.Dome) -> None:
    lights = pilot.pattern(Recipe(), reach)
    flags = np.zeros((4, SIZE, SIZE), np.uint8)
    flags[0] = LIT
    normal_map = replace(cases.known_map(cushion, lights[:1]), flags=flags)
    chosen = plan.choose(
        plan.DesignProblem.of(normal_map, scenes.capture(cushion, lights), Recipe(), reach, cushion.calibration)
    )
    assert len(chosen.lights) == 4
    assert any("lit by fewer than 3 lights" in note for note in chosen.notes)
    assert len({round(float(np.arctan2(*light.position[:2])), 1) for light in chosen.lights}) >= 3
