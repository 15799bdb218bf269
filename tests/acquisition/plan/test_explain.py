"""Leave-one-out gains of lights: never negative, zero where a light does not reach, and gain images."""

import cv2
import numpy as np
import pytest

from acquisition import pilot, plan
from acquisition.models.base import FloatArray
from acquisition.models.recipe import Recipe
from acquisition.plan import explain
from acquisition.plan.explain import Basis
from tests.acquisition import scenes
from tests.acquisition.plan import cases

TRUE = scenes.scene(scenes.sphere, scenes.calibration(96))
PILOT_LIGHTS = pilot.pattern(Recipe(), scenes.Dome(refused=0))
LIGHTS = [*scenes.ring(3, 62.0, turn=0.4), scenes.ring(1, 20.0)[0]]
PLACES = np.array([light.position for light in LIGHTS])


@pytest.fixture(scope="module")
def basis() -> Basis:
    known = cases.known_map(TRUE, PILOT_LIGHTS)
    problem = plan.DesignProblem.of(known, cases.NO_OBSERVATIONS, Recipe(), scenes.Dome(refused=0), TRUE.calibration)
    return Basis.of(problem, known, cases.NO_OBSERVATIONS, TRUE.calibration)


@pytest.fixture(scope="module")
def gains(basis: Basis) -> FloatArray:
    return basis.gains_deg(PLACES)


def test_gains_all_lights_are_not_negative(basis: Basis, gains: FloatArray) -> None:
    assert gains.shape == (len(LIGHTS), len(basis.shown.row))
    assert np.min(gains) > -1e-6
    assert np.all(np.max(gains, axis=1) > 0.02)


@pytest.mark.parametrize("light", range(3))
def test_gains_grazing_light_is_on_its_own_side(basis: Basis, gains: FloatArray, light: int) -> None:
    towards = PLACES[light] - TRUE.points[:, basis.shown.row, basis.shown.column].T
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    cosine = np.einsum("kc,kc->k", TRUE.normals[basis.shown.row, basis.shown.column], towards)
    gain = gains[light]
    assert np.max(gain[cosine < -0.15]) < 1e-6
    assert np.mean(gain[cosine > 0.3]) > 0.01


def test_gains_duplicate_light_is_small(basis: Basis, gains: FloatArray) -> None:
    twice = basis.gains_deg(np.concatenate([PLACES, PLACES[:1]]))
    assert np.mean(twice[0]) < 0.8 * np.mean(gains[0])


def test_gain_image_shows_object_on_common_scale(basis: Basis, gains: FloatArray) -> None:
    images, _ = basis.gain_pictures(PLACES)
    pictures = [cv2.imdecode(np.frombuffer(image, np.uint8), cv2.IMREAD_COLOR) for image in images]
    rows, columns = np.flatnonzero(TRUE.mask.any(axis=1)), np.flatnonzero(TRUE.mask.any(axis=0))
    for picture in pictures:
        assert picture is not None
        assert picture.shape == (np.ptp(rows) + 1, np.ptp(columns) + 1, 3)
        assert tuple(picture[0, 0]) == explain.OUTSIDE
    brightness = [float(np.mean(picture)) for picture in pictures if picture is not None]
    assert np.argmax(brightness) == np.argmax(np.mean(gains, axis=1))
