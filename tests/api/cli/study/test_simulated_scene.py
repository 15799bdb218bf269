"""The study's scenes equal the simulated cell's images and truth; errors depend on draw and position only."""

import numpy as np
import pytest

from acquisition import geometry
from acquisition.capture import check, exposure
from acquisition.models import cell_config
from acquisition.models.base import FloatArray
from acquisition.models.recipe import Exposure, Recipe
from acquisition.models.shot import Observations
from api.cli.study import simulated_scene
from api.cli.study.scene_geometry import Geometry
from api.cli.study.simulated_scene import Scene
from hardware_sim import nominal, render
from hardware_sim.render import Lamp
from hardware_sim.world import World

PIXELS = 64


@pytest.fixture(scope="module")
def shared() -> Geometry:
    return Geometry("part", 3, PIXELS)


def test_scene_images_and_truth_equal_simulated_cell(shared: Geometry) -> None:
    scene = Scene(shared)
    cell, known = cell_config.load(nominal.default_cell_file()), nominal.calibration(PIXELS)
    world = World(cell, known, "part", 3, "direct")
    true = world.truth()
    np.testing.assert_array_equal(shared.truth.mask, true.mask)
    np.testing.assert_allclose(shared.truth.normals, true.normals, atol=1e-6)
    np.testing.assert_allclose(shared.truth.depth, true.depth, atol=1e-6)
    light = scene.run(Recipe(method="two-rings", pilot_lights=3, planned_lights=0)).plan.lights[1]
    observations = scene.capture([light])
    shot = observations.shots[0]
    frame = observations.frames.rows(shot.frame, 0, PIXELS).astype(float) - known.sensor.black_level_dn
    lamp = Lamp(
        geometry.transform(shared.object_from_view, np.array(light.position)),
        geometry.rotate(shared.object_from_view, np.array(light.axis)),
        known.lamp_intensity * shot.exposure_s * known.sensor.full_scale_dn,
        known.reference_m,
        known.lobe_exponent,
    )
    ideal = world.lamp_image(lamp)
    bright = true.mask & (ideal > 0.3 * ideal.max())
    ratio = frame[bright] / ideal[bright]
    assert np.median(ratio) == pytest.approx(1.0, abs=0.04)  # the image's own error of intensity and place
    assert np.mean(np.abs(ratio / np.median(ratio) - 1) < 0.1) > 0.9


def test_scene_image_depends_on_draw_and_position_only(shared: Geometry) -> None:
    lights = Scene(shared).run(simulated_scene.recipe("ring", 3)).plan.lights
    one, other = Scene(shared).capture(lights), Scene(shared).capture([*reversed(lights)])
    for shot in one.shots:
        (same,) = [item for item in other.shots if item.light == shot.light]
        np.testing.assert_array_equal(one.frames.rows(shot.frame, 0, PIXELS), other.frames.rows(same.frame, 0, PIXELS))
    twice = Scene(shared).capture([lights[0], lights[0]])
    first, second = (twice.frames.rows(shot.frame, 0, PIXELS).astype(float) for shot in twice.shots)
    assert np.std((first - second)[shared.truth.mask]) > 1  # a second image has errors of its own


def levels(scene: Scene, observations: Observations) -> FloatArray:
    """Bright level of each image (F,), as a share of the target."""
    known, region = scene.calibration, scene.geometry.region
    frames = [observations.frames.rows(shot.frame, 0, PIXELS)[region] for shot in observations.shots]
    bright = np.array([np.percentile(frame, check.BRIGHT_PERCENTILE) for frame in frames])
    return (bright - known.sensor.black_level_dn) / known.sensor.full_scale_dn / Exposure().target


def test_capture_unpredicted_exposes_below_target_predicted_nearest(shared: Geometry) -> None:
    scene, step, noise = Scene(shared), exposure.STEP, 1.01
    pattern = scene.run(simulated_scene.recipe("two-rings", 8))
    lights = pattern.plan.lights
    images = {8: pattern.result.observations} | {count: scene.capture(lights, count) for count in (None, 3, 0)}
    for unpredicted, observations in images.items():
        measured = levels(scene, observations)
        first, later = measured[:unpredicted], measured[len(measured) if unpredicted is None else unpredicted :]
        assert np.all((first > 1 / step / noise) & (first < noise))
        assert np.all((later > step**-0.5 / noise) & (later < step**0.5 * noise))
        # Some images would have been exposed otherwise had they been the other kind.
        assert not len(first) or np.min(first) < step**-0.5 / noise
        assert not len(later) or np.max(later) > noise


def test_run_planned_recipe_exposes_only_pilot_unpredicted(shared: Geometry) -> None:
    scene, step, noise = Scene(shared), exposure.STEP, 1.01
    observations = scene.run(Recipe(pilot_lights=8, planned_lights=6)).result.observations
    measured = levels(scene, observations)
    assert np.all((measured[:8] > 1 / step / noise) & (measured[:8] < noise))
    assert np.all((measured[8:] > step**-0.5 / noise) & (measured[8:] < step**0.5 * noise))
    lights = [shot.light for shot in observations.shots if shot.light is not None]
    times = [shot.exposure_s for shot in observations.shots]
    for others in (None, 0):  # some images would have been exposed otherwise had they been the other kind
        assert times != [shot.exposure_s for shot in scene.capture(lights, others).shots]


def test_illuminated_few_shadow_rays_agrees_with_all_rays(shared: Geometry) -> None:
    """All that is missed are shadows narrower than a pixel that pass between centres: of pixels as coarse as these some
    thousandths, of the study's less than one in thousand."""
    for light in Scene(shared).run(simulated_scene.recipe("ring", 3)).plan.lights:
        position = geometry.transform(shared.object_from_view, np.array(light.position))
        lamp = Lamp(position, np.array([0.0, 0.0, -1.0]), 1.0, 0.45, 0.8)
        for view, reference in zip(shared.views, shared.illuminated(light.position, lamp), strict=True):
            for some, every in zip(
                reference, render.lit_samples(view, shared.glossy, shared.tracer, lamp), strict=True
            ):
                assert np.count_nonzero(some != every) <= 0.005 * len(every)


def test_scene_glossy_after_diffuse_equals_glossy_alone(shared: Geometry) -> None:
    """A glossy picture whose shadows the diffuse one had traced before is the one that it would be alone."""
    lights = Scene(shared).run(simulated_scene.recipe("ring", 3)).plan.lights
    after = Scene(shared, glossy=True).capture(lights)
    alone = Scene(Geometry("part", 3, PIXELS), glossy=True).capture(lights)
    matt = Scene(shared).capture(lights)
    for shot in after.shots:
        frame = after.frames.rows(shot.frame, 0, PIXELS)
        np.testing.assert_array_equal(frame, alone.frames.rows(shot.frame, 0, PIXELS))
        assert np.any(frame != matt.frames.rows(shot.frame, 0, PIXELS))
