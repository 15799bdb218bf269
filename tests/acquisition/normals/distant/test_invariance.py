"""Normals and σ do not depend on how images are stored, ordered, turned or cut out, and are numbers for any mask."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.result import NormalMap
from acquisition.normals import distant
from acquisition.normals.images.image_set import FULL_WELL_E, ImageSet
from tests.acquisition.normals.distant.ball_scenes import SIZE, ball, few_lights, image_set, lambert
from tests.acquisition.normals.distant.gloss_scenes import Rows

ROUNDED_DEG = 1e-3
"""Another order of sums changes values by some 1e-7 of them, and normals by ten times that under eight lights or so:
1e-4°, largest at the rim."""

LIGHTS = few_lights()
NORMALS, BALL = ball()
NOISE = 0.002 * np.random.default_rng(0).standard_normal((len(LIGHTS), SIZE, SIZE))
VALUES = (lambert(NORMALS, LIGHTS) + NOISE).astype(np.float32)


def floats(values: np.ndarray, directions: np.ndarray = LIGHTS, mask: np.ndarray = BALL) -> ImageSet:
    """Float32 images without a level from which they clip, and the noise that the reader of folders assumes then."""
    images = replace(image_set(np.zeros_like(values), directions, mask), full_scale=1.0, saturated_from=1e30)
    exposed = float(np.max(values[:, mask]))
    return replace(images, rows=Rows(np.ascontiguousarray(values)), full_well_e=FULL_WELL_E / exposed)


@pytest.fixture(scope="module")
def usual() -> NormalMap:
    return distant.solve(floats(VALUES))


def assert_same(normals: np.ndarray, sigma_deg: np.ndarray, usual: NormalMap) -> None:
    """Compares maps turned to those of `usual`."""
    apart = np.degrees(np.linalg.norm(normals - usual.normals, axis=-1)[usual.mask])
    assert np.max(apart) < ROUNDED_DEG
    np.testing.assert_allclose(sigma_deg, usual.sigma_deg, rtol=1e-3)


@pytest.mark.parametrize("exponent", [-50, -30, -10, 1, 30])
def test_solve_scaled_float_images_has_same_normals(exponent: int, usual: NormalMap) -> None:
    """Whatever the unit of the values, down to 1e-15 of the usual ones. Powers of two are exact in float32."""
    result = distant.solve(floats(VALUES * np.float32(2.0) ** np.float32(exponent)))
    assert_same(result.normals, result.sigma_deg, usual)


@given(order=st.permutations(range(len(LIGHTS))))
@settings(max_examples=5, deadline=None)
def test_solve_images_in_another_order_has_same_normals(order: list[int], usual: NormalMap) -> None:
    result = distant.solve(floats(VALUES[order], LIGHTS[order]))
    assert_same(result.normals, result.sigma_deg, usual)


@given(lengths=st.lists(st.floats(1e-3, 1e3), min_size=len(LIGHTS), max_size=len(LIGHTS)))
@settings(max_examples=5, deadline=None)
def test_solve_directions_of_any_length_has_same_normals(lengths: list[float], usual: NormalMap) -> None:
    result = distant.solve(floats(VALUES, LIGHTS * np.array(lengths)[:, None]))
    assert_same(result.normals, result.sigma_deg, usual)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("turns", [0, 1, 2, 3])
def test_solve_turned_and_mirrored_scene_turns_normals(turns: int, mirrored: bool, usual: NormalMap) -> None:
    """Quarter turns of images and lights about the viewing axis, counterclockwise, after a mirror at a column."""
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    axes = np.linalg.matrix_power(quarter, turns) @ np.diag([-1.0 if mirrored else 1.0, 1.0, 1.0])

    def turned(image: np.ndarray) -> np.ndarray:
        return np.rot90(image[:, ::-1] if mirrored else image, turns)

    def back(image: np.ndarray) -> np.ndarray:
        upright = np.rot90(image, -turns)
        return upright[:, ::-1] if mirrored else upright

    values = np.stack([turned(image) for image in VALUES])
    result = distant.solve(floats(values, LIGHTS @ axes.T, turned(BALL)))
    assert_same(back(result.normals) @ axes, back(result.sigma_deg), usual)


def test_solve_larger_frame_has_same_normals(usual: NormalMap) -> None:
    """What is outside the mask does not count, not even whether it is a number."""
    frame = np.full((len(LIGHTS), SIZE + 20, SIZE + 30), np.nan, np.float32)
    mask = np.zeros(frame.shape[1:], np.bool_)
    frame[:, 7 : 7 + SIZE, 21 : 21 + SIZE], mask[7 : 7 + SIZE, 21 : 21 + SIZE] = VALUES, BALL
    result = distant.solve(floats(frame, mask=mask))
    inside = slice(7, 7 + SIZE), slice(21, 21 + SIZE)
    assert_same(result.normals[inside], result.sigma_deg[inside], usual)


@given(seed=st.integers(0, 1000), share=st.sampled_from([0.03, 0.1, 0.3, 0.9]), squares=st.integers(0, 3))
@settings(max_examples=12, deadline=None)
def test_solve_scattered_masks_give_numbers(seed: int, share: float, squares: int) -> None:
    """Pixels without neighbours, and a few squares of four."""
    rng = np.random.default_rng(seed)
    mask = rng.random((SIZE, SIZE)) < share
    for row, column in rng.integers(SIZE // 4, SIZE // 2, (squares, 2)):
        mask[row : row + 2, column : column + 2] = True
    result = distant.solve(floats(VALUES, mask=mask & BALL))
    assert np.array_equal(result.mask, mask & BALL)
    assert np.linalg.norm(result.normals[result.mask], axis=-1) == pytest.approx(1.0, abs=1e-5)
    for image in (result.sigma_deg, result.albedo):
        assert np.all(image[result.mask] > 0)
    assert np.all(np.isfinite(result.depth))


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("count", [4, 5])
def test_solve_steep_plane_that_one_light_reaches_well_is_refused(count: int) -> None:
    """All pixels are hardly lit, and none is left from which lamps or noise could be estimated."""
    normal = np.array([10.0, 0.0, 1.0]) / np.sqrt(101.0)
    directions = few_lights(count)
    plane = np.broadcast_to(normal, (SIZE, SIZE, 3))
    images = floats((lambert(plane, directions) + NOISE[:count]).astype(np.float32), directions, np.ones_like(BALL))
    with pytest.raises(RigError) as caught:
        distant.solve(images)
    assert caught.value.code == ErrorCode.NORMALS_INFEASIBLE


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_solve_pixels_without_neighbours_warns_of_nothing() -> None:
    apart = np.zeros_like(BALL)
    apart[::2, ::2] = True
    assert np.array_equal(distant.solve(floats(VALUES, mask=apart & BALL)).mask, apart & BALL)
