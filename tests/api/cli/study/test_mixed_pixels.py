"""Mixed pixels are detected from the shape alone; smooth surfaces stay graded."""

import numpy as np
import pytest

from api.cli.study.scene_geometry import Geometry
from api.cli.study.simulated_scene import Scene

PIXELS = 128


@pytest.fixture(scope="module")
def part() -> Geometry:
    return Geometry("part", 1, PIXELS)


def test_graded_pixels_all_samples_lie_on_surface_of_centre(part: Geometry) -> None:
    fine = part.views[0].surface
    graded = Scene(part).graded.ravel()[fine.pixels]
    normals = np.zeros((PIXELS**2, 3), np.float32)
    normals[part.centres.pixels] = part.centres.normals
    cosine = np.sum(fine.normals * normals[fine.pixels], axis=1)
    assert np.min(cosine[graded]) > np.cos(np.radians(45))
    straddling = Scene(part).mixed.ravel()[fine.pixels]
    assert np.mean(cosine[straddling] < np.cos(np.radians(45))) > 0.05


def test_graded_and_mixed_pixels_partition_facing_pixels(part: Geometry) -> None:
    scene = Scene(part)
    assert not np.any(scene.graded & scene.mixed)
    np.testing.assert_array_equal(scene.graded | scene.mixed, part.facing)
    assert 0.02 < np.mean(part.one_surface[part.facing]) < 0.98


def test_one_surface_smooth_object_keeps_all_facing_pixels() -> None:
    ball = Geometry("sphere", 1, PIXELS)
    assert np.all(ball.one_surface[ball.facing])
