"""Stopping rule for a target σ: how many lights are planned, and the conclusion when there are none."""

from dataclasses import replace

import numpy as np
import pytest

from acquisition import normals, photometry, pilot, plan
from acquisition.models.base import BoolArray
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import ForecastPoint, LightPlan
from acquisition.models.recipe import Recipe
from acquisition.models.result import NormalMap, SolveSettings
from acquisition.models.shot import Observations
from acquisition.plan import stopping_rule
from tests.acquisition import scenes

TRUE = scenes.scene(scenes.bumps, scenes.calibration(72))
REACH = scenes.Dome(refused=0, count=60)


def solved(observations: Observations) -> NormalMap:
    depth = scenes.TABLE_DEPTH - 0.04
    return normals.solve(observations, TRUE.calibration, SolveSettings(), normals.ObjectPlace(depth))


@pytest.fixture(scope="module")
def known() -> tuple[NormalMap, Observations]:
    observations = scenes.capture(TRUE, pilot.pattern(Recipe(), REACH))
    return solved(observations), observations


def planned(
    normal_map: NormalMap, observations: Observations, recipe: Recipe, region: BoolArray | None = None
) -> LightPlan:
    achieved_deg = photometry.mean_sigma_deg(normal_map, TRUE.calibration, region)
    problem = plan.DesignProblem.of(normal_map, observations, recipe, REACH, TRUE.calibration, region=region)
    return plan.plan_to_target(problem, achieved_deg)


def plan_to(known: tuple[NormalMap, Observations], **order: object) -> LightPlan:
    return planned(*known, Recipe.model_validate({"max_lights": 8, **order}))


def test_plan_to_target_within_reach_plans_forecast_count(known: tuple[NormalMap, Observations]) -> None:
    reached = photometry.mean_sigma_deg(known[0], TRUE.calibration)
    curve = plan.forecast(plan.DesignProblem.of(*known, Recipe(), REACH, TRUE.calibration), [2, 3, 4])
    chosen = plan_to(
        known, target_sigma_deg=curve[1].sigma_deg / (1 + stopping_rule.SETTINGS.first_slack) * 1.0001, max_lights=12
    )
    assert len(chosen.lights) == 3
    assert chosen.conclusion is None
    assert chosen.forecast[0].lights == 5
    assert chosen.predicted_sigma_deg is not None
    assert chosen.predicted_sigma_deg < reached
    assert "4 images" in chosen.notes[0]


def test_plan_to_target_target_met_concludes(known: tuple[NormalMap, Observations]) -> None:
    reached = photometry.mean_sigma_deg(known[0], TRUE.calibration)
    for wanted in (reached, reached / 1.029):
        chosen = plan_to(known, target_sigma_deg=wanted, pilot_lights=3)
        assert chosen.lights == []
        assert chosen.conclusion == f"target met with 4 images: mean σ {reached:.2f}°, target {wanted:.3g}°"
    assert plan_to(known, target_sigma_deg=reached / 1.031, pilot_lights=3).conclusion is None


def test_plan_to_target_pilot_only_needs_first_slack(known: tuple[NormalMap, Observations]) -> None:
    reached = photometry.mean_sigma_deg(known[0], TRUE.calibration)
    assert len(plan_to(known, target_sigma_deg=reached * 1.19).lights) == 1
    assert plan_to(known, target_sigma_deg=reached * 1.21).lights == []


def test_plan_to_target_max_lights_captured_concludes(known: tuple[NormalMap, Observations]) -> None:
    assert plan_to(known, target_sigma_deg=0.1, max_lights=4).conclusion is not None
    last = plan_to(known, target_sigma_deg=0.1, max_lights=6, pilot_lights=3)
    assert len(last.lights) == 2
    assert any("may not be met" in note for note in last.notes)


def test_plan_to_target_negligible_gain_concludes(known: tuple[NormalMap, Observations]) -> None:
    normal_map, observations = known
    # The σ of the images is already below that expected after one more light.
    sure = replace(normal_map, sigma_deg=np.where(normal_map.mask, 0.2, np.nan).astype(np.float32))
    order = Recipe(target_sigma_deg=0.1, max_lights=5)
    conclusion = planned(sure, observations, order).conclusion
    assert conclusion is not None
    left = photometry.mean_sigma_deg(sure, TRUE.calibration)
    assert conclusion.startswith(
        f"further lights would hardly lower σ after 4 images: mean σ {left:.2f}°, target 0.1°; "
    )
    assert conclusion.endswith("is expected even with all 5 lights allowed")


def test_plan_to_target_unreachable_spares_last_lights(known: tuple[NormalMap, Observations]) -> None:
    normal_map, _ = known
    # Errors of a badly fitting model, which images share, leave a negligible gain for many lights.
    rough = replace(normal_map, noise=normal_map.noise | {"misfit": 10.0})
    order = Recipe(target_sigma_deg=0.1, max_lights=40)
    chosen = planned(rough, known[1], order)
    least = min(point.sigma_deg for point in chosen.forecast)
    predicted = next(point for point in chosen.forecast if point.added >= len(chosen.lights))
    assert len(chosen.lights) < 36
    assert (
        predicted.sigma_deg <= (1 + stopping_rule.SETTINGS.tolerance) * (1 + stopping_rule.SETTINGS.first_slack) * least
    )


def test_plan_to_target_first_pass_has_slack_later_is_rescaled(
    known: tuple[NormalMap, Observations],
) -> None:
    curve = plan.forecast(plan.DesignProblem.of(*known, Recipe(), REACH, TRUE.calibration), [2, 3])
    between = curve[1].sigma_deg / 1.19
    assert len(plan_to(known, target_sigma_deg=between, max_lights=12).lights) == 3
    assert len(plan_to(known, target_sigma_deg=curve[1].sigma_deg / 1.21, max_lights=12).lights) > 3
    # The same images in a session whose pilot is complete.
    later = plan_to(known, target_sigma_deg=between, pilot_lights=3)
    now = plan.forecast(plan.DesignProblem.of(*known, Recipe(), REACH, TRUE.calibration), [0])[0].sigma_deg
    factor = photometry.mean_sigma_deg(known[0], TRUE.calibration) / now
    assert later.forecast[2].sigma_deg == pytest.approx(curve[1].sigma_deg * factor, rel=1e-6)


def test_plan_to_target_region_only_its_pixels_count(known: tuple[NormalMap, Observations]) -> None:
    normal_map, observations = known
    sigma = np.where(normal_map.mask, normal_map.sigma_deg, np.nan)
    easy = normal_map.mask & (sigma < np.nanquantile(sigma, 0.3))
    inside = photometry.mean_sigma_deg(normal_map, TRUE.calibration, easy)
    assert inside < 0.8 * photometry.mean_sigma_deg(normal_map, TRUE.calibration)
    order = Recipe(target_sigma_deg=inside * 1.21, max_lights=5)
    met = planned(normal_map, observations, order, easy)
    assert met.conclusion is not None
    assert planned(normal_map, observations, order).conclusion is None
    with pytest.raises(RigError) as nowhere:
        planned(normal_map, observations, order, np.zeros_like(easy))
    assert nowhere.value.code is ErrorCode.NORMALS_INFEASIBLE


def test_fewest_lights_between_counts_is_interpolated() -> None:
    curve = [ForecastPoint(added=added, lights=4 + added, sigma_deg=2 / (4 + added)) for added in (1, 4, 8)]
    first = stopping_rule._fewest_lights_meeting  # pyright: ignore[reportPrivateUsage]
    assert first(curve, 2 / 5) == 1
    assert first(curve, 2 / 6) == 2
    assert first(curve, 2 / 6.5) == 3
    assert first(curve, 2 / 12) == 8
    assert first(curve, 0.01) == 8
