"""Outwardness of normals at the outline, and the tests for mirrored and two swapped lamps and for one bad image."""

from dataclasses import replace

import numpy as np
import pytest

from acquisition.normals.alternatives import light_tests
from acquisition.normals.pixels.pixel_solve import Pixels
from tests.acquisition.normals.shared_scene import MeasuredPixels, measured

SIZE = 64


def ball() -> tuple[Pixels, np.ndarray]:
    """Pixels and normals (3, N), view frame, of a ball that fills most of a square."""
    row, column = np.mgrid[:SIZE, :SIZE]
    x, y = (column - SIZE / 2 + 0.5) / (0.45 * SIZE), -(row - SIZE / 2 + 0.5) / (0.45 * SIZE)
    inside = x**2 + y**2 < 1
    index = np.flatnonzero(inside)
    normals = np.stack([x, y, np.sqrt(np.clip(1 - x**2 - y**2, 0, 1))])[:, inside].astype(np.float32)
    nothing = np.zeros((1, len(index)), np.float32)
    return Pixels((SIZE, SIZE), index, np.zeros((2, len(index)), np.float32), nothing, nothing > 0), normals


def sloping(slopes: np.ndarray) -> tuple[Pixels, np.ndarray]:
    """Pixels of a square and normals (3, N) of slopes (2, N)."""
    normals = np.stack([-slopes[0], -slopes[1], np.ones(SIZE**2)]).astype(np.float32)
    nothing = np.zeros((1, SIZE**2), np.float32)
    pixels = Pixels((SIZE, SIZE), np.arange(SIZE**2), np.zeros((2, SIZE**2), np.float32), nothing, nothing > 0)
    return pixels, normals / np.linalg.norm(normals, axis=0)


def saddle() -> np.ndarray:
    """Slopes (2, N) of a surface."""
    row, column = np.mgrid[:SIZE, :SIZE]
    x, y = (column / SIZE - 0.5).ravel(), -(row / SIZE - 0.5).ravel()
    return np.stack([x + 2 * y, 2 * x - 0.5 * y])


@pytest.mark.parametrize("turn_deg", [0.0, 90.0, 180.0, 270.0, 10.0, -23.0, 130.0])
@pytest.mark.parametrize("mirrored", [False, True])
def test_integrable_axes_of_transformed_saddle_are_the_inverse_or_its_opposite(turn_deg: float, mirrored: bool) -> None:
    axes = light_tests.turned_by(turn_deg) @ np.diag([-1.0 if mirrored else 1.0, 1.0])
    found = light_tests.integrable_axes(*sloping(axes @ saddle()))
    product = (found.best if found.turned else found.quarter) @ axes
    assert product * np.sign(product[0, 0]) == pytest.approx(np.eye(2), abs=0.02)
    assert bool(found.turned) == (turn_deg % 90 != 0)
    assert found.sure == (mirrored or turn_deg not in (0, 180))


def test_integrable_axes_of_a_noisy_plane_are_not_turned() -> None:
    """Its slopes are noise, which has as much circulation under any axes."""
    for seed in range(10):
        slopes = np.random.default_rng(seed).normal(0.3, 0.02, (2, SIZE**2))
        found = light_tests.integrable_axes(*sloping(slopes))
        assert not found.turned
        assert not found.sure


def test_outwardness_of_ball_is_near_one_and_negative_turned_over() -> None:
    pixels, normals = ball()
    turned_over = normals * np.array([-1, -1, 1], np.float32)[:, None]
    rim = light_tests.outline(pixels)
    outwards, inwards = light_tests.outwardness(normals, rim), light_tests.outwardness(turned_over, rim)
    assert outwards is not None
    assert inwards is not None
    assert outwards > 0.85
    assert inwards == pytest.approx(-outwards)


def test_outwardness_of_short_outline_is_unknown() -> None:
    pixels, normals = ball()
    few = pixels.subset(np.arange(20))
    assert light_tests.outwardness(normals[:, :20], light_tests.outline(few)) is None


def test_transformed_lamps_turn_places_and_optical_axes() -> None:
    lamps = np.array([[0.1, 0.2, -0.3, 0.6, 0.0, -0.8]], np.float32)
    out = light_tests.transformed(lamps, light_tests.turned_by(90))
    assert out == pytest.approx(np.array([[-0.2, 0.1, -0.3, 0.0, 0.6, -0.8]]))
    tilted = np.concatenate([lamps, np.array([[0.1, 0.0, 0.05]], np.float32)], axis=1)
    assert light_tests.transformed(tilted, light_tests.turned_by(90))[0, 6:] == pytest.approx([0.0, 0.1, 0.05])


@pytest.mark.parametrize(("first", "second"), [(0, 1), (2, 6), (3, 7)])
def test_swapped_pair_of_exchanged_lamps_names_both(first: int, second: int) -> None:
    made = measured()
    order = np.arange(8)
    order[[first, second]] = second, first
    swap = light_tests.swapped_pair(made.pixels, made.depth_m, made.lamp[order], made.calibration)
    assert {swap.first, swap.second} == {first, second}
    assert swap.residual_share < 0.1


def test_swapped_pair_among_many_lamps_names_both() -> None:
    made, order = measured(24), np.arange(24)
    order[[3, 15]] = 15, 3
    swap = light_tests.swapped_pair(made.pixels, made.depth_m, made.lamp[order], made.calibration)
    assert (swap.first, swap.second) == (3, 15)
    assert swap.residual_share < 0.1


def noisy(made: MeasuredPixels, added: float = 0.0) -> Pixels:
    """The pixels with noise, and light of a lamp at the camera in the third image."""
    values = made.values + np.random.default_rng(0).normal(0, 0.003, made.values.shape)
    values[2] += added * made.normals[2]
    return replace(made.pixels, values=values.astype(np.float32))


def test_swapped_pair_of_sound_lamps_leaves_residual() -> None:
    made = measured()
    assert light_tests.swapped_pair(noisy(made), made.depth_m, made.lamp, made.calibration).residual_share > 1


def test_relative_residual_tells_mirrored_lamps_of_light_from_near_but_not_from_far() -> None:
    made = measured()
    mirrored = light_tests.transformed(made.lamp, np.diag([-1.0, 1.0]))
    args = noisy(made), made.depth_m
    assert light_tests.relative_residual(*args, made.lamp, mirrored, made.calibration) > 1.5
    assert light_tests.relative_residual(*args, mirrored, made.lamp, made.calibration) < 1 / 1.5
    far, turned = made.lamp.copy(), mirrored.copy()
    far[:, :3] *= 1000
    turned[:, :3] *= 1000
    assert light_tests.relative_residual(*args, far, turned, made.calibration) == pytest.approx(1, abs=0.05)


def test_worst_image_names_the_one_with_a_flash() -> None:
    made = measured()
    worst = light_tests.worst_image(noisy(made, added=0.3), made.depth_m, made.lamp, made.calibration)
    assert worst is not None
    assert worst.number == 2
    assert worst.residual_share < 0.5


def test_worst_image_of_sound_ones_does_not_outlie() -> None:
    made = measured()
    worst = light_tests.worst_image(noisy(made), made.depth_m, made.lamp, made.calibration)
    assert worst is not None
    assert worst.residual_share > 0.8


def test_worst_image_of_four_is_unknown() -> None:
    made = measured(4)
    assert light_tests.worst_image(noisy(made), made.depth_m, made.lamp, made.calibration) is None
