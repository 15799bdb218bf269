"""Leave-one-out gains of lights: never negative, zero where a light does not reach, and gain images."""

import cv2
import numpy as np
import pytest

from acquisition import pilot
from acquisition.models.recipe import Recipe
from acquisition.plan import explain
from acquisition.plan.explain import Basis, Gains
from tests.acquisition import scenes
from tests.acquisition.plan import cases

TRUE = scenes.scene(scenes.sphere, scenes.calibration(96))
PILOT_LIGHTS = pilot.pattern(Recipe(), scenes.Dome(refused=0))
LIGHTS = [*scenes.ring(3, 62.0, turn=0.4), scenes.ring(1, 20.0)[0]]


@pytest.fixture(scope="module")
def basis() -> Basis:
    known = cases.known_map(TRUE, PILOT_LIGHTS)
    return explain.basis(known, cases.NO_OBSERVATIONS, Recipe(), scenes.Dome(refused=0), TRUE.calibration, None)


@pytest.fixture(scope="module")
def gains(basis: Basis) -> Gains:
    return explain.gains(basis, LIGHTS)


def test_gains_all_lights_are_not_negative(basis: Basis, gains: Gains) -> None:
    assert gains.gain_deg.shape == (len(LIGHTS), len(basis.shown.row))
    assert np.min(gains.gain_deg) > -1e-6
    assert np.all(np.max(gains.gain_deg, axis=1) > 0.02)


@pytest.mark.parametrize("light", range(3))
def test_gains_grazing_light_is_on_its_own_side(basis: Basis, gains: Gains, light: int) -> None:
    place = np.array(LIGHTS[light].position)
    towards = place - TRUE.points[:, basis.shown.row, basis.shown.column].T
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    cosine = np.einsum("kc,kc->k", TRUE.normals[basis.shown.row, basis.shown.column], towards)
    gain = gains.gain_deg[light]
    assert np.max(gain[cosine < -0.15]) < 1e-6
    assert np.mean(gain[cosine > 0.3]) > 0.01


def test_gains_duplicate_light_is_small(basis: Basis, gains: Gains) -> None:
    twice = explain.gains(basis, [*LIGHTS, LIGHTS[0]])
    assert np.mean(twice.gain_deg[0]) < 0.8 * np.mean(gains.gain_deg[0])


def test_gain_image_shows_object_on_common_scale(gains: Gains) -> None:
    pictures = [
        cv2.imdecode(np.frombuffer(gains.image(light), np.uint8), cv2.IMREAD_COLOR) for light in range(len(LIGHTS))
    ]
    rows, columns = np.flatnonzero(TRUE.mask.any(axis=1)), np.flatnonzero(TRUE.mask.any(axis=0))
    for picture in pictures:
        assert picture is not None
        assert picture.shape == (np.ptp(rows) + 1, np.ptp(columns) + 1, 3)
        assert tuple(picture[0, 0]) == explain.OUTSIDE
    brightness = [float(np.mean(picture)) for picture in pictures if picture is not None]
    assert np.argmax(brightness) == np.argmax(np.mean(gains.gain_deg, axis=1))
