"""Axes of distant lamps that are not the camera's: every residual stays as it is; circulation and outline tell."""

import numpy as np
import pytest

from acquisition.models.errors import RigError
from acquisition.normals import distant
from acquisition.normals.alternatives import lamp_alternatives
from tests.acquisition.normals.distant import few_light_scenes
from tests.acquisition.normals.distant.ball_scenes import ball, errors, few_lights, image_set, lambert

MIRRORED_X, MIRRORED_Y = np.diag([-1.0, 1.0, 1.0]), np.diag([1.0, -1.0, 1.0])
EXCHANGED, OPPOSITE = np.eye(3)[[1, 0, 2]], np.diag([-1.0, -1.0, 1.0])
QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
AXES = [
    pytest.param(axes, id=name)
    for name, axes in {
        "x mirrored": MIRRORED_X, "y mirrored": MIRRORED_Y, "exchanged": EXCHANGED, "a quarter turn": QUARTER,
        "opposite": OPPOSITE,
    }.items()
]  # fmt: skip


@pytest.mark.parametrize("axes", AXES)
def test_ball_under_lamps_of_other_axes_is_solved_as_under_the_right_ones(axes: np.ndarray) -> None:
    truth, mask = ball()
    directions = few_lights()
    rng = np.random.default_rng(0)
    brightness = lambert(truth, directions) * rng.normal(1, 0.003, (len(directions), *mask.shape))
    right = distant.solve(image_set(brightness, directions, mask))
    solved = distant.solve(image_set(brightness, directions @ axes.T, mask))
    assert [(one.kind, one.corrected) for one in solved.findings] == [(lamp_alternatives.AXES, True)]
    assert errors(solved.normals, truth, mask).mean() <= 1.3 * errors(right.normals, truth, mask).mean()


@pytest.mark.parametrize("shape", few_light_scenes.SHAPES)
def test_sound_shapes_keep_the_stated_axes(shape: str) -> None:
    scene = few_light_scenes.scene(shape, "matt", 12, size=64, indirect=False)
    found = distant.solve(scene.image_set()).findings
    assert lamp_alternatives.AXES not in [one.kind for one in found]


def test_bowl_keeps_the_stated_axes() -> None:
    truth, mask = ball()
    steep = np.arccos(truth[..., 2]) > np.radians(25)
    truth, mask = truth * [-1, -1, 1] * ~steep[..., None], mask & ~steep
    solved = distant.solve(image_set(lambert(truth, few_lights()), few_lights(), mask))
    assert solved.findings == ()
    assert errors(solved.normals, truth, mask).mean() < 1


def test_lights_behind_the_object_are_refused() -> None:
    truth, mask = ball()
    with pytest.raises(RigError, match="behind the object"):
        distant.solve(image_set(lambert(truth, few_lights()), -few_lights(), mask))
