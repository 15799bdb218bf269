"""Forecasts for lights that a person places agree with the plan's own, and show what a light brings."""

from typing import Any

import cv2
import numpy as np
import pytest

from acquisition import pilot, plan
from acquisition.models.light_plan import LightPlan
from acquisition.models.recipe import Recipe
from acquisition.plan import explain
from acquisition.plan.explain import Basis, PlacedForecast
from tests.acquisition import scenes
from tests.acquisition.plan import cases


@pytest.fixture(scope="module")
def prepared() -> tuple[Basis, LightPlan]:
    """The basis of a piloted scene, and a plan made from the same."""
    reach, scene = scenes.Dome(seed=1, count=150), scenes.scene(scenes.bumps, scenes.calibration(128))
    known = cases.known_map(scene, pilot.pattern(Recipe(), reach))
    problem = plan.Problem.of(known, cases.NO_OBSERVATIONS, Recipe(), reach, scene.calibration)
    basis = explain.basis(problem, known, cases.NO_OBSERVATIONS, scene.calibration)
    return basis, plan.choose(problem, 4, certify=False)


def forecast(basis: Basis, positions: Any) -> PlacedForecast:
    return explain.evaluate(basis, np.array(positions).reshape(-1, 3))


def brightness(picture: bytes) -> float:
    image = cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    return float(image.mean())


def test_evaluate_own_lights_of_plan_gives_its_forecast(prepared: tuple[Basis, LightPlan]) -> None:
    basis, planned = prepared

    result = forecast(basis, [light.position for light in planned.lights])

    assert planned.predicted_sigma_deg is not None
    assert np.mean(result.sigma_deg) == pytest.approx(planned.predicted_sigma_deg, rel=1e-6)
    assert result.gains == pytest.approx(planned.gains, abs=1e-6)
    assert np.mean(basis.before_deg) > np.mean(result.sigma_deg)


def test_evaluate_fewer_lights_is_less_certain_and_brighter(prepared: tuple[Basis, LightPlan]) -> None:
    basis, planned = prepared
    positions = [light.position for light in planned.lights]

    every, fewer, none = (forecast(basis, positions[:count]) for count in (4, 1, 0))

    assert np.mean(every.sigma_deg) < np.mean(fewer.sigma_deg) < np.mean(none.sigma_deg)
    assert brightness(every.picture) < brightness(fewer.picture) < brightness(none.picture)
    assert none.gains == []
    assert np.allclose(none.sigma_deg, basis.before_deg)


def test_evaluate_same_light_twice_gains_less_than_each_of_two(prepared: tuple[Basis, LightPlan]) -> None:
    basis, planned = prepared
    one, other = (light.position for light in planned.lights[:2])

    twice, two = forecast(basis, [one, one]), forecast(basis, [one, other])

    assert twice.gains[0] == twice.gains[1] < two.gains[0]
    assert np.mean(two.sigma_deg) < np.mean(twice.sigma_deg)
