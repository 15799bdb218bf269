"""Noise model of planned images: indirect light, and the reweighting of information."""

from dataclasses import replace

import numpy as np
import pytest

from acquisition import pilot
from acquisition.models.recipe import Recipe
from acquisition.models.result import LIT, NormalMap
from acquisition.plan import planned_images, sample_pixels
from acquisition.plan.criterion import prior_information
from tests.acquisition import scenes
from tests.acquisition.plan import cases


@pytest.fixture(scope="module")
def ball() -> scenes.Scene:
    return scenes.scene(scenes.sphere, scenes.calibration(128))


def piloted(true: scenes.Scene) -> NormalMap:
    lights = pilot.pattern(Recipe(), scenes.Dome(refused=0))
    known = cases.known_map(true, lights)
    return replace(known, flags=np.where(true.mask, LIT, 0)[None].repeat(4, axis=0).astype(np.uint8))


def test_reweight_scales_information_to_expected_noise(ball: scenes.Scene) -> None:
    """Information that the solver weighted with ten times the noise is scaled up by a hundred."""
    lights = pilot.pattern(Recipe(), scenes.Dome(refused=0))
    observations = scenes.capture(ball, lights)
    normal_map = piloted(ball)
    ratios = {}
    for times in (1.0, 10.0):
        assumed = replace(normal_map, noise={"intensity": times * 0.05, "direction": times * 0.05})
        sample = sample_pixels.samples(assumed, ball.calibration, np.arange(100))
        anew = sample_pixels.reweight(sample, assumed, observations, ball.calibration)
        ratios[times] = np.trace(anew.information - prior_information(anew.albedo))
    np.testing.assert_allclose(ratios[10.0] / ratios[1.0], 100.0, rtol=0.05)


def random_shading() -> planned_images.Shading:
    """Three pixels under two lights."""
    value, cosine, strength, distance = np.random.default_rng(3).uniform(0.1, 0.9, (4, 2, 3)).astype(np.float32)
    return planned_images.Shading(np.zeros((2, 3, 3), np.float32), strength, distance, cosine, value, cosine > 0)


def test_variance_indirect_light_adds_its_fixed_share(ball: scenes.Scene) -> None:
    sample = cases.pixels_with(np.zeros((3, 3)), np.ones(3), np.zeros((4, 4, 3)))
    bounced = replace(sample, indirect=np.array([0.0, 0.05, 0.5], np.float32))
    with_it, without = (
        planned_images.variance(random_shading(), np.full((2, 3), 1e-4), ball.calibration, one)
        for one in (bounced, sample)
    )
    np.testing.assert_allclose(with_it - without, np.tile([0.0, 0.0004, 0.04], (2, 1)), rtol=1e-5, atol=1e-12)


def test_variance_of_sensor_falls_with_what_regression_leaves(ball: scenes.Scene) -> None:
    """Of a pilot whose noise regression halves, half of what the sensor adds to the variance is planned with."""
    shading, added = random_shading(), np.full((2, 3), 1e-4)
    normal_map = piloted(ball)
    normal_map.noise["regression_share"] = 0.5
    numbers = np.arange(len(normal_map.information.rows))
    halved = sample_pixels.samples(normal_map, ball.calibration, numbers[:3])
    whole = replace(halved, regression_share=1.0)
    of_half, of_whole = (
        planned_images.variance(shading, added, ball.calibration, one)
        - planned_images.variance(shading, 0 * added, ball.calibration, one)
        for one in (halved, whole)
    )
    np.testing.assert_allclose(of_whole, planned_images.INTEGRABILITY_SHARE * added)
    np.testing.assert_allclose(of_half, of_whole / 2)


def test_reweight_indirect_radiance_follows_share_of_images(ball: scenes.Scene) -> None:
    """An indirect share i of all light is i / (1 − i) of the direct light; shares are clipped at one half."""
    lights = pilot.pattern(Recipe(), scenes.Dome(refused=0))
    normal_map = piloted(ball)
    normal_map.flags[2] = 0  # the third light lights no pixel
    share = np.zeros(ball.mask.shape, np.float32)
    share[:, 50:64], share[:, 64:80], share[:, 80:] = 0.2, 0.5, 0.9
    with_indirect = replace(normal_map, indirect=share)
    sample = sample_pixels.samples(with_indirect, ball.calibration, np.arange(len(with_indirect.information.rows)))
    observations = scenes.capture(ball, lights)
    reweighted = sample_pixels.reweight(sample, with_indirect, observations, ball.calibration)
    plain = sample_pixels.reweight(sample, normal_map, observations, ball.calibration)
    np.testing.assert_array_equal(plain.indirect, 0)

    rows, columns = sample.row, sample.column
    given = np.zeros(len(rows))
    for number in (0, 1, 3):
        s = cases.vectors_by_hand(ball, lights[number], rows, columns)
        cosine = np.sum(s * sample.normal, axis=0) / np.linalg.norm(s, axis=0)
        given += sample.albedo * np.linalg.norm(s, axis=0) * np.maximum(cosine, planned_images.MIN_COSINE) / 4
    times = np.select([columns < 50, columns < 64], [0.0, 0.25], 1.0)
    assert set(times) == {0.0, 0.25, 1.0}
    np.testing.assert_allclose(reweighted.indirect, times * given, rtol=1e-3)

    # Where it is as bright as the direct light, it dominates: σ is 0.4 of it, where the solver assumed 0.1.
    prior = prior_information(sample.albedo)
    left = np.trace(reweighted.information - prior) / np.trace(sample.information - prior)
    np.testing.assert_allclose(left[times == 1], 1 / 16, rtol=0.25)
    np.testing.assert_array_equal(reweighted.information[..., times == 0], plain.information[..., times == 0])
