"""The highlight on the mirror sphere is found to a tenth of a pixel, and what else shines is not taken for it."""

import numpy as np
import pytest

from acquisition.calibrate import highlight
from acquisition.models import cell_config
from acquisition.models.base import FloatArray
from hardware_sim import nominal
from hardware_sim.targets import SPHERE_REFLECTANCE
from hardware_sim.world import ExposureInterval, World

CELL = cell_config.load(nominal.default_cell_file())
CALIBRATION = nominal.calibration(512)
LIT = (
    (-2.6641, -0.9534, 1.6785, 2.607, 1.8307, 2.423),
    (2.41032, -1.7197, 2.06456, -1.66193, 0.194985, -0.317444),
    (2.72918, -0.903802, 1.141, -2.76093, -0.222649, 1.40624),
)
"""Joints at which the lamp looks at the object's place, or beside it."""


def tool(made: World, joints: tuple[float, ...]) -> FloatArray:
    return made.base_from_flange(joints) @ CELL.arm.flange_from_tool.matrix


def frame(made: World, joints: tuple[float, ...], exposure_s: float, lamp: float = 1.0) -> np.ndarray:
    return made.frame([ExposureInterval(1.0, joints, lamp)], exposure_s, 0)


@pytest.fixture(scope="module")
def sphere() -> World:
    return World(CELL, CALIBRATION, "mirror-sphere", 3, "realistic")


@pytest.fixture(scope="module")
def empty() -> World:
    return World(CELL, CALIBRATION, "empty", 3, "realistic")


@pytest.mark.parametrize("joints", LIT)
def test_expected_spot_has_the_light_of_the_lamps_mirror_image(sphere: World, joints: tuple[float, ...]) -> None:
    exposure_s = 2e-4
    seen = frame(sphere, joints, exposure_s)
    spot = highlight.find(seen, 2.0**CALIBRATION.sensor.bits - 1)
    expected = highlight.expected_spot(tool(sphere, joints), exposure_s, CELL, CALIBRATION)
    assert not isinstance(spot, str)
    assert spot.light == pytest.approx(SPHERE_REFLECTANCE * expected.light, rel=0.15)
    assert not isinstance(highlight.find_of_lamp(seen, tool(sphere, joints), exposure_s, CELL, CALIBRATION), str)


@pytest.mark.parametrize("exposure_s", [0.003, 0.01, 0.03])
@pytest.mark.parametrize("joints", LIT)
def test_lit_table_is_no_mirror_image(empty: World, joints: tuple[float, ...], exposure_s: float) -> None:
    seen = frame(empty, joints, exposure_s)
    why = highlight.find_of_lamp(seen, tool(empty, joints), exposure_s, CELL, CALIBRATION)
    assert isinstance(why, str)
    assert highlight.NO_HIGHLIGHT in why


@pytest.mark.parametrize("exposure_s", [0.003, 0.1, 0.3, 1.0])
def test_room_in_the_sphere_is_no_mirror_image_of_the_lamp(sphere: World, exposure_s: float) -> None:
    seen = frame(sphere, LIT[0], exposure_s, lamp=0.0)
    why = highlight.find_of_lamp(seen, tool(sphere, LIT[0]), exposure_s, CELL, CALIBRATION)
    assert isinstance(why, str)
    assert highlight.NO_HIGHLIGHT in why


def spot(column: float, row: float, peak: float = 3000.0, black: float = 64.0) -> np.ndarray:
    """A highlight of 12 bits on a dark image, blurred over some pixels."""
    v, u = np.mgrid[:80, :100]
    return black + peak * np.exp(-((u - column) ** 2 + (v - row) ** 2) / (2 * 1.8**2))


def test_find_highlight_is_found_to_a_tenth_of_a_pixel() -> None:
    random = np.random.default_rng(0)
    for column, row in random.uniform(20, 60, (8, 2)):
        noisy = np.clip(spot(column, row) + 20 * random.standard_normal((80, 100)), 0, 4095).astype(np.uint16)
        found = highlight.find(noisy, 4095)
        assert not isinstance(found, str)
        np.testing.assert_allclose(found.pixel, [column, row], atol=0.1)


@pytest.mark.parametrize(
    ("image", "says"),
    [
        (np.full((80, 100), 64, np.uint16), "no highlight"),
        (np.where(np.arange(8000).reshape(80, 100) == 999, 4000, 64).astype(np.uint16), "no highlight"),
        (np.clip(spot(40, 30) + spot(70, 50), 0, 4095).astype(np.uint16), "several bright spots"),
        (np.clip(spot(40, 30, 90_000), 0, 4095).astype(np.uint16), "clipped"),
    ],
)
def test_find_highlight_bad_image_says_why(image: np.ndarray, says: str) -> None:
    found = highlight.find(image, 4095)
    assert isinstance(found, str)
    assert says in found
