"""Accuracy on order: how many lights are taken, when none is, and why."""

from dataclasses import replace

import numpy as np
import pytest

from acquisition import normals, photometry, pilot, plan
from acquisition.errors import ErrorCode, RigError
from acquisition.plan import target
from acquisition.types import Expected, LightPlan, NormalMap, Observations, Recipe, SolveSettings
from tests.acquisition import scenes

TRUE = scenes.scene(scenes.bumps, scenes.calibration(72))
REACH = scenes.Dome(refused=0, count=60)


def solved(observations: Observations) -> NormalMap:
    depth = scenes.TABLE_DEPTH - 0.04
    return normals.solve(observations, TRUE.calibration, SolveSettings(), initial_depth_m=depth)


@pytest.fixture(scope="module")
def known() -> tuple[NormalMap, Observations]:
    observations = scenes.capture(TRUE, pilot.pattern(Recipe(), REACH))
    return solved(observations), observations


def approach(known: tuple[NormalMap, Observations], **order: object) -> LightPlan:
    return plan.approach(*known, Recipe.model_validate({"max_lights": 8, **order}), REACH, TRUE.calibration)


def test_as_many_lights_as_the_forecast_asks_for(known: tuple[NormalMap, Observations]) -> None:
    reached = photometry.mean_sigma_deg(known[0], TRUE.calibration)
    curve = plan.forecast(*known, Recipe(), REACH, TRUE.calibration, [2, 3, 4])
    chosen = approach(known, target_sigma_deg=curve[1].sigma_deg * 1.0001)
    assert len(chosen.lights) == 3
    assert chosen.conclusion is None
    assert chosen.forecast[0].lights == 5
    assert chosen.predicted_sigma_deg is not None
    assert chosen.predicted_sigma_deg < reached
    assert "4 images" in chosen.notes[0]


def test_nothing_more_once_it_is_met(known: tuple[NormalMap, Observations]) -> None:
    reached = photometry.mean_sigma_deg(known[0], TRUE.calibration)
    chosen = approach(known, target_sigma_deg=reached)
    assert chosen.lights == []
    assert chosen.conclusion == f"target met with 4 images: mean σ {reached:.2f}° ≤ {reached:.3g}°"


def test_the_most_lights_allowed_are_the_end(known: tuple[NormalMap, Observations]) -> None:
    assert approach(known, target_sigma_deg=0.1, max_lights=4).conclusion is not None
    last = approach(known, target_sigma_deg=0.1, max_lights=6)
    assert len(last.lights) == 2
    assert any("may not be met" in note for note in last.notes)


def test_lights_that_bring_nothing_are_not_taken(known: tuple[NormalMap, Observations]) -> None:
    normal_map, observations = known
    # The images left less than one more light is expected to leave.
    sure = replace(normal_map, sigma_deg=np.where(normal_map.mask, 0.2, np.nan).astype(np.float32))
    order = Recipe(target_sigma_deg=0.1, max_lights=5)
    conclusion = plan.approach(sure, observations, order, REACH, TRUE.calibration).conclusion
    assert conclusion is not None
    assert conclusion.startswith("no light that the arm can reach brings mean σ 0.20° below")


def test_only_the_region_of_interest_counts(known: tuple[NormalMap, Observations]) -> None:
    normal_map, observations = known
    sigma = np.where(normal_map.mask, normal_map.sigma_deg, np.nan)
    easy = normal_map.mask & (sigma < np.nanquantile(sigma, 0.3))
    inside = photometry.mean_sigma_deg(normal_map, TRUE.calibration, easy)
    assert inside < 0.8 * photometry.mean_sigma_deg(normal_map, TRUE.calibration)
    order = Recipe(target_sigma_deg=inside * 1.01, max_lights=5)
    met = plan.approach(normal_map, observations, order, REACH, TRUE.calibration, region=easy)
    assert met.conclusion is not None
    assert plan.approach(normal_map, observations, order, REACH, TRUE.calibration).conclusion is None
    with pytest.raises(RigError) as nowhere:
        plan.approach(normal_map, observations, order, REACH, TRUE.calibration, region=np.zeros_like(easy))
    assert nowhere.value.code is ErrorCode.NORMALS_INFEASIBLE


def test_between_the_counts_of_the_curve_the_number_is_interpolated() -> None:
    curve = [Expected(added=added, lights=4 + added, sigma_deg=2 / (4 + added)) for added in (1, 4, 8)]
    first = target._first_that_meets  # pyright: ignore[reportPrivateUsage]
    assert first(curve, 2 / 5) == 1
    assert first(curve, 2 / 6) == 2
    assert first(curve, 2 / 6.5) == 3
    assert first(curve, 2 / 12) == 8
    assert first(curve, 0.01) == 8
