"""Light intensities found from images: recovered where lamps differ, as stated where they are right."""

from dataclasses import replace

import numpy as np
import pytest

from acquisition.normals import distant
from acquisition.normals.images.image_set import DistantLights
from tests.acquisition.normals.distant import few_light_scenes
from tests.acquisition.normals.distant.few_light_scenes import Scene


@pytest.fixture(scope="module")
def rabbit() -> Scene:
    return few_light_scenes.scene("rabbit", "matt", 12, 0, size=64, indirect=False)


def uneven(scene: Scene, sigma: float, seed: int) -> Scene:
    factors = np.exp(np.random.default_rng(seed).normal(0, sigma, len(scene.images)))
    return replace(scene, images=scene.images * factors[:, None, None], intensities=factors)


@pytest.mark.parametrize("sigma", [0.1, 0.3])
def test_solve_rabbit_under_unequal_lamps_is_as_under_equal(rabbit: Scene, sigma: float) -> None:
    equal = rabbit.errors_deg(distant.solve(rabbit.image_set()).normals).mean()
    unequal = uneven(rabbit, sigma, 1)
    result = distant.solve(unequal.image_set())
    assert unequal.errors_deg(result.normals).mean() < 1.3 * equal + 0.1
    left = np.log(result.intensity_factors) - np.log(unequal.intensities)
    assert np.std(left) < 0.02


def test_solve_exact_intensities_are_hardly_changed(rabbit: Scene) -> None:
    assert np.std(np.log(distant.solve(rabbit.image_set()).intensity_factors)) < 0.005


def test_solve_least_squares_takes_intensities_as_stated(rabbit: Scene) -> None:
    assert np.all(distant.solve(uneven(rabbit, 0.2, 1).image_set(), "ls").intensity_factors == 1)


def test_solve_stated_intensities_are_multiplied_by_factors(rabbit: Scene) -> None:
    """The same images with the true intensities stated give the same normals as with none."""
    scene = uneven(rabbit, 0.2, 1)
    images = scene.image_set()
    stated = replace(images, lights=DistantLights(scene.directions, scene.intensities[:, None]))
    one, two = (distant.solve(each) for each in (images, stated))
    assert np.std(np.log(two.intensity_factors)) < 0.005
    angle = np.degrees(np.arccos(np.clip(np.sum(one.normals * two.normals, axis=-1)[scene.mask], -1, 1)))
    assert np.median(angle) < 0.5
