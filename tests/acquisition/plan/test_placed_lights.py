"""Forecasts for lights that a person places agree with the plan's own, and show what a light brings."""

from collections.abc import Sequence

import cv2
import numpy as np
import pytest

from acquisition import pilot, plan
from acquisition.models.base import FloatArray
from acquisition.models.light_plan import Light, LightPlan
from acquisition.models.recipe import Recipe
from acquisition.plan.explain import Basis
from tests.acquisition import scenes
from tests.acquisition.plan import cases


@pytest.fixture(scope="module")
def prepared() -> tuple[Basis, LightPlan]:
    """The basis of a piloted scene, and a plan made from the same."""
    reach, scene = scenes.Dome(seed=1, count=150), scenes.scene(scenes.bumps, scenes.calibration(128))
    known = cases.known_map(scene, pilot.pattern(Recipe(), reach))
    problem = plan.DesignProblem.of(known, cases.NO_OBSERVATIONS, Recipe(), reach, scene.calibration)
    basis = Basis.of(problem, known, cases.NO_OBSERVATIONS, scene.calibration)
    return basis, plan.choose(problem, 4, certify=False)


def places(lights: Sequence[Light]) -> FloatArray:
    return np.array([light.position for light in lights]).reshape(-1, 3)


def brightness(picture: bytes) -> float:
    image = cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    return float(image.mean())


def test_predict_own_lights_of_plan_gives_its_forecast(prepared: tuple[Basis, LightPlan]) -> None:
    basis, planned = prepared

    predicted, before = (basis.problem.predict(places(lights)) for lights in (planned.lights, []))

    assert predicted.mean_deg == pytest.approx(planned.predicted_sigma_deg, rel=1e-6)
    assert predicted.gains == pytest.approx(planned.gains, abs=1e-6)
    assert before.mean_deg > predicted.mean_deg
    assert before.gains == []


def test_fewer_lights_are_less_certain_and_brighter(prepared: tuple[Basis, LightPlan]) -> None:
    basis, planned = prepared
    some = [places(planned.lights[:count]) for count in (4, 1, 0)]

    every, fewer, none = (basis.problem.predict(one).mean_deg for one in some)
    pictures = [brightness(basis.sigma_picture(one)) for one in some]

    assert every < fewer < none
    assert pictures[0] < pictures[1] < pictures[2]


def test_predict_same_light_twice_gains_less_than_each_of_two(prepared: tuple[Basis, LightPlan]) -> None:
    basis, planned = prepared
    one, other = planned.lights[:2]

    twice, two = (basis.problem.predict(places(lights)) for lights in ([one, one], [one, other]))

    assert twice.gains[0] == twice.gains[1] < two.gains[0]
    assert two.lights.posterior().loss < twice.lights.posterior().loss
