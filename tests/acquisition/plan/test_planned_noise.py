"""What planned images are expected to be wrong by: gloss, surface that bends within a pixel, noise weighed anew."""

from dataclasses import replace

import numpy as np
import pytest

from acquisition import pilot
from acquisition.models.recipe import Recipe
from acquisition.models.result import HIGHLIGHT, LIT, NormalMap
from acquisition.plan import criterion, planned_noise, visibility
from acquisition.plan.fallback import Doubts
from tests.acquisition import scenes
from tests.acquisition.plan import cases


@pytest.fixture(scope="module")
def ball() -> scenes.Scene:
    return scenes.scene(scenes.sphere, scenes.calibration(128))


def piloted(true: scenes.Scene) -> NormalMap:
    lights = pilot.pattern(Recipe(), scenes.Dome(refused=0))
    found = cases.known_map(true, lights)
    return replace(found, flags=np.where(true.mask, LIT, 0)[None].repeat(4, axis=0).astype(np.uint8))


def test_highlights_in_some_images_make_a_surface_glossy_and_a_few_do_not(ball: scenes.Scene) -> None:
    normal_map = piloted(ball)
    rows, columns = np.nonzero(ball.mask)
    for share, glossy in ((0.01, False), (0.06, True)):
        flags = normal_map.flags.copy()
        some = slice(0, int(share * len(rows)))
        flags[1, rows[some], columns[some]] |= HIGHLIGHT
        assert (planned_noise.gloss(replace(normal_map, flags=flags)).sigma > 0) == glossy
    lobe = {"lobe": {"strength": 0.15, "exponent": 35.0}}
    assert planned_noise.gloss(replace(normal_map, notes=lobe)) == planned_noise.Gloss(0.2 * 0.15, 35.0)
    assert (
        planned_noise.gloss(replace(normal_map, notes={"lobe": {"strength": 0.0, "exponent": 120.0}}))
        == planned_noise.MATT
    )


def test_gloss_takes_the_worth_of_a_light_where_its_highlight_falls(ball: scenes.Scene) -> None:
    normal_map = piloted(ball)
    sample = criterion.samples(normal_map, ball.calibration, np.arange(len(normal_map.information.rows)))
    surface = visibility.surface(normal_map, ball.calibration)
    light = scenes.ring(1, 40.0)
    matt, glossy = (
        np.sum(criterion.candidates(sample, light, surface, ball.calibration, Recipe(), gloss).row[0, :3] ** 2, axis=0)
        for gloss in (planned_noise.MATT, planned_noise.Gloss(0.1, 30.0))
    )
    half = np.array([np.sin(np.radians(20)), 0.0, np.cos(np.radians(20))])  # camera on +z, light at 40° towards +x
    near = half @ sample.normal > np.cos(np.radians(6))
    far = half @ sample.normal < np.cos(np.radians(45))
    assert np.sum(near) > 5
    assert np.all(glossy[near] < 0.1 * matt[near])
    np.testing.assert_allclose(glossy[far], matt[far], rtol=1e-3)


def test_a_flat_surface_mirrors_one_lamp_nearly_everywhere_and_a_ball_in_a_spot(ball: scenes.Scene) -> None:
    gloss = planned_noise.Gloss(0.03, 30.0)
    plate = scenes.scene(lambda x, y: np.where(np.hypot(x, y) < 0.06, 0.01, 0.0), scenes.calibration(64))
    shares: dict[str, float] = {}
    for name, true in {"ball": ball, "plate": plate}.items():
        normal_map = piloted(true)
        sample = criterion.samples(normal_map, true.calibration, np.arange(len(normal_map.information.rows)))
        units = criterion.directions(scenes.ring(12, 15.0))
        shares[name] = criterion.mirrored(sample, units, gloss)
        assert criterion.mirrored(sample, units, planned_noise.MATT) == 0
    assert shares["plate"] > 0.5
    assert 0 < shares["ball"] < 0.2


def test_two_rings_are_taken_where_a_plan_is_not_to_be_trusted() -> None:
    assert Doubts(unexplained=0.004, mirrored=0.1, gain=0.1).fallback is None
    for doubts, why in (
        (Doubts(0.006, 0.1, 0.1), "steps"), (Doubts(0.004, 0.8, 0.1), "mirrors"), (Doubts(0.004, 0.1, 0.0), "only"),
    ):  # fmt: skip
        assert why in (doubts.fallback or "")


def test_only_surface_that_bends_keeps_a_variance_and_by_how_far_it_bends(ball: scenes.Scene) -> None:
    normal_map = piloted(ball)
    rows, columns = np.nonzero(ball.graded)
    assert np.quantile(planned_noise.unresolved(normal_map, rows, columns), 0.95) < np.radians(0.1) ** 2
    bent = normal_map.normals.copy()
    turn = np.radians(20.0)
    bent[60:68, 64] = [np.sin(turn), 0, np.cos(turn)]  # a column of pixels on the ball's top that leans by 20°
    kept = planned_noise.unresolved(replace(normal_map, normals=bent), np.array([64]), np.array([64]))
    # The second difference across is twice the step of 2 sin 10°, along it is nothing.
    square = (2 * 2 * np.sin(turn / 2)) ** 2 / 2 - planned_noise.NOISE_OF_BEND**2
    square -= (planned_noise.NOISE_OF_SIGMA * np.radians(1.0)) ** 2  # σ is 1° in this map
    np.testing.assert_allclose(kept, planned_noise.MIXED**2 * square, rtol=0.15)


def test_pixels_at_the_edge_of_image_and_object_or_not_numbers_are_no_trouble(ball: scenes.Scene) -> None:
    normal_map = piloted(ball)
    normal_map.normals[63, 64] = np.nan
    everywhere = replace(normal_map, mask=np.ones_like(normal_map.mask))
    rows, columns = np.array([0, 0, 127, 127, 64]), np.array([0, 127, 0, 127, 64])
    assert np.all(np.isfinite(planned_noise.unresolved(everywhere, rows, columns)))


def test_information_is_scaled_to_the_expected_noise(ball: scenes.Scene) -> None:
    """What a solver has weighted by ten times the noise in all terms counts for a hundred times more than it said."""
    lights = pilot.pattern(Recipe(), scenes.Dome(refused=0))
    taken = scenes.capture(ball, lights)
    normal_map = piloted(ball)
    told = {}
    for times in (1.0, 10.0):
        assumed = replace(normal_map, noise={"intensity": times * 0.05, "direction": times * 0.05})
        sample = criterion.samples(assumed, ball.calibration, np.arange(100))
        anew = criterion.reweighed(sample, assumed, taken, ball.calibration)
        told[times] = np.trace(anew.information - anew.weak, axis1=1, axis2=2)
        np.testing.assert_array_equal(sample.weak, anew.weak)
    np.testing.assert_allclose(told[10.0] / told[1.0], 100.0, rtol=0.05)


@pytest.mark.parametrize("cautious", [False, True])
def test_bounced_light_adds_two_fifths_of_itself_whatever_the_lamp_gives(ball: scenes.Scene, *, cautious: bool) -> None:
    value, cosine, strength, distance = np.random.default_rng(3).uniform(0.1, 0.9, (4, 2, 3))
    bounced = np.array([0.0, 0.05, 0.5], np.float32)
    with_it, without = (
        planned_noise.variance(
            value, cosine, strength, distance, np.array([0.4, 0.8]), ball.calibration, light, cautious=cautious
        )
        for light in (bounced, np.zeros(3, np.float32))
    )
    np.testing.assert_allclose(with_it - without, np.tile([0.0, 0.0004, 0.04], (2, 1)), rtol=1e-5, atol=1e-12)


def test_a_solver_weighs_by_a_tenth_of_bounced_light(ball: scenes.Scene) -> None:
    value, strength = np.random.default_rng(3).uniform(0.1, 0.9, (2, 2, 3)).astype(np.float32)
    bounced = np.array([0.0, 0.05, 0.5], np.float32)
    with_it, without = (
        planned_noise.solved_variance(
            value, strength, 0.45, np.array([0.4, 0.8]), ball.calibration, piloted(ball), light
        )
        for light in (bounced, np.zeros(3, np.float32))
    )
    np.testing.assert_allclose(with_it - without, np.tile([0.0, 0.000025, 0.0025], (2, 1)), rtol=1e-4, atol=1e-12)


def test_how_bright_bounced_light_is_follows_from_its_share_of_the_images(ball: scenes.Scene) -> None:
    """What share i of all light is, is i / (1 − i) of what the lamps gave; more than half is not believed."""
    lights = pilot.pattern(Recipe(), scenes.Dome(refused=0))
    normal_map = piloted(ball)
    normal_map.flags[2] = 0  # the third light reaches nothing
    share = np.zeros(ball.mask.shape, np.float32)
    share[:, 50:64], share[:, 64:80], share[:, 80:] = 0.2, 0.5, 0.9
    found = replace(normal_map, indirect=share)
    sample = criterion.samples(found, ball.calibration, np.arange(len(found.information.rows)))
    taken = scenes.capture(ball, lights)
    told = criterion.reweighed(sample, found, taken, ball.calibration)
    plain = criterion.reweighed(sample, normal_map, taken, ball.calibration)
    np.testing.assert_array_equal(plain.bounced, 0)

    rows, columns = sample.row, sample.column
    given = np.zeros(len(rows))
    for number in (0, 1, 3):
        s = cases.vectors_by_hand(ball, lights[number], rows, columns)
        cosine = np.sum(s * sample.normal, axis=0) / np.linalg.norm(s, axis=0)
        given += sample.albedo * np.linalg.norm(s, axis=0) * np.maximum(cosine, criterion.LEAST_COSINE) / 4
    times = np.select([columns < 50, columns < 64], [0.0, 0.25], 1.0)
    assert set(times) == {0.0, 0.25, 1.0}
    np.testing.assert_allclose(told.bounced, times * given, rtol=1e-3)

    # Where it is as bright as what the lamps give, it decides: four tenths of it are left where a tenth was weighed.
    left = np.trace(told.information - told.weak, axis1=1, axis2=2)
    left /= np.trace(sample.information - sample.weak, axis1=1, axis2=2)
    np.testing.assert_allclose(left[times == 1], 1 / 16, rtol=0.25)
    np.testing.assert_array_equal(told.information[times == 0], plain.information[times == 0])
