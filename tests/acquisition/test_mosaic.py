"""Sites of a mosaic, balanced means, and interpolation to three channels."""

import numpy as np
import pytest

from acquisition import mosaic
from acquisition.models.colour import Mosaic

SIZE = 40
WHOLE = slice(0, SIZE)


def _scene() -> np.ndarray:
    """A smooth coloured image (SIZE, SIZE, 3)."""
    row, column = np.mgrid[:SIZE, :SIZE] / SIZE
    wave = 0.4 + 0.2 * np.sin(6 * row) * np.cos(5 * column)
    return np.stack([wave, 0.6 * wave + 0.1 * row, 0.3 * wave + 0.2 * column], axis=-1).astype(np.float32)


def _sampled(scene: np.ndarray, channel: np.ndarray) -> np.ndarray:
    return np.take_along_axis(scene, channel[..., None].astype(int), axis=-1)[..., 0]


@pytest.mark.parametrize(
    ("pattern", "corner"),
    [("rggb", [[0, 1], [1, 2]]), ("bggr", [[2, 1], [1, 0]]), ("grbg", [[1, 0], [2, 1]]), ("gbrg", [[1, 2], [0, 1]])],
)
def test_sites_of_a_window_keep_the_frames_pattern(pattern: Mosaic, corner: list[list[int]]) -> None:
    assert mosaic.sites(pattern, slice(0, 2), slice(0, 2)).tolist() == corner
    frame = mosaic.sites(pattern, WHOLE, WHOLE)
    np.testing.assert_array_equal(mosaic.sites(pattern, slice(3, 9), slice(5, 12)), frame[3:9, 5:12])


@pytest.mark.parametrize("pattern", ["rggb", "gbrg"])
def test_balanced_mean_of_an_even_colour_has_no_pattern(pattern: Mosaic) -> None:
    channel = mosaic.sites(pattern, WHOLE, WHOLE)
    even = np.array([0.2, 0.5, 0.9], np.float32)[channel]
    np.testing.assert_allclose(mosaic.balanced_mean(even), (0.2 + 2 * 0.5 + 0.9) / 4, atol=1e-6)


def test_least_cell_mean_ends_where_a_bright_region_ends() -> None:
    channel = mosaic.sites("grbg", WHOLE, WHOLE)
    object_, table = np.array([0.7, 0.4, 0.2], np.float32)[channel], np.array([0.05, 0.06, 0.04], np.float32)[channel]
    inside = np.zeros((SIZE, SIZE), bool)
    inside[7:30, 9:33] = True
    found = mosaic.least_cell_mean(np.where(inside, object_, table))
    np.testing.assert_allclose(found[~inside], (0.05 + 2 * 0.06 + 0.04) / 4, atol=1e-6)
    assert found[inside].min() > 1.5 * 0.0525  # a corner's least cell has three sites of the table


def test_cell_means_of_an_even_colour_are_even() -> None:
    channel = mosaic.sites("rggb", WHOLE, WHOLE)
    frame = np.array([100, 400, 900], np.uint16)[channel]
    np.testing.assert_array_equal(mosaic.cell_means(frame), np.full((SIZE // 2, SIZE // 2), 450.0))


def test_interpolated_keeps_sites_and_follows_smooth_colours() -> None:
    scene, channel = _scene(), mosaic.sites("grbg", WHOLE, WHOLE)
    inside = np.ones((SIZE, SIZE), bool)
    found = mosaic.interpolated(_sampled(scene, channel), channel, inside)
    np.testing.assert_allclose(_sampled(found, channel), _sampled(scene, channel), atol=1e-6)
    inner = (slice(2, -2), slice(2, -2))
    # A wave of 40 px interpolated over 2 px: amplitude 0.2 (6/40)²/8 · 2² in either direction at most.
    assert np.abs(found - scene)[inner].max() < 0.2 * (6 / SIZE) ** 2


def test_interpolated_takes_nothing_from_outside() -> None:
    scene, channel = _scene(), mosaic.sites("rggb", WHOLE, WHOLE)
    inside = np.zeros((SIZE, SIZE), bool)
    inside[7:30, 9:33] = True
    poisoned = np.where(inside, _sampled(scene, channel), np.float32(1e6))
    found = mosaic.interpolated(poisoned, channel, inside)
    assert np.abs(found - scene)[inside].max() < 0.05
    assert not found[~inside].any()


def test_interpolated_of_an_edge_of_brightness_keeps_hue_beside_it() -> None:
    channel = mosaic.sites("rggb", WHOLE, WHOLE)
    brightness = np.where(np.arange(SIZE) < SIZE // 2, 0.1, 0.8).astype(np.float32)[None, :, None]
    scene = np.broadcast_to(brightness * np.array([1.0, 1.0, 1.0], np.float32), (SIZE, SIZE, 3))
    found = mosaic.interpolated(_sampled(scene, channel), channel, np.ones((SIZE, SIZE), bool))
    spread = np.ptp(found, axis=-1)
    assert spread[:, : SIZE // 2 - 2].max() < 1e-6
    assert spread[:, SIZE // 2 + 2 :].max() < 1e-6
