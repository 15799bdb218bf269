"""Diffusion over the surface: constants and means stay, the inverse undoes the blur, light does not cross steps."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acquisition.models.base import Float32Array
from acquisition.normals.indirect_light import surface_diffusion
from acquisition.normals.indirect_light.surface_diffusion import SurfaceGraph

SHAPE = (24, 31)


def flat(rng: np.random.Generator | None = None, holes: float = 0.0, side: tuple[int, int] = SHAPE) -> SurfaceGraph:
    """A plane that faces the camera, or a rough surface with holes."""
    mask = np.ones(side, np.bool_) if rng is None else rng.random(side) >= holes
    depth = np.full(side, 0.5, np.float32)
    if rng is not None:
        depth += rng.uniform(0, 0.002, side).astype(np.float32)
    return surface_diffusion.graph(mask, rays(side), depth)


def rays(side: tuple[int, int]) -> Float32Array:
    """Rays of a camera whose pixels are 1 mm wide at 0.5 m."""
    y, x = np.mgrid[: side[0], : side[1]]
    return (np.stack([x, y]) * 0.002).astype(np.float32)


def noise(rng: np.random.Generator) -> Float32Array:
    return rng.normal(size=SHAPE).astype(np.float32)


@given(st.integers(0, 2**32 - 1), st.floats(0, 0.5), st.floats(0.2, 4))
@settings(max_examples=25, deadline=None)
def test_filters_keep_constants_and_the_mean(seed: int, holes: float, length_px: float) -> None:
    rng = np.random.default_rng(seed)
    over, image = flat(rng, holes), noise(rng)
    for filtered in (surface_diffusion.blurred, surface_diffusion.sharpened):
        constant = filtered(np.full(SHAPE, 0.7, np.float32), over, length_px)
        assert constant == pytest.approx(0.7, abs=1e-4)
        assert np.mean(filtered(image, over, length_px)) == pytest.approx(np.mean(image), abs=1e-4)


@given(st.integers(0, 2**32 - 1), st.floats(0.2, 4))
@settings(max_examples=25, deadline=None)
def test_blurred_is_a_contraction(seed: int, length_px: float) -> None:
    image = noise(np.random.default_rng(seed))
    image -= np.mean(image)
    assert np.linalg.norm(surface_diffusion.blurred(image, flat(), length_px)) < np.linalg.norm(image)


def test_sharpened_undoes_most_of_the_blur() -> None:
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    image = (np.cos(2 * np.pi * (x + 0.5) / 12) + np.cos(2 * np.pi * (y + 0.5) / 12)).astype(np.float32)
    soft = surface_diffusion.blurred(image, flat(), 1.2)
    sharp = surface_diffusion.sharpened(soft, flat(), 1.2)
    assert np.linalg.norm(sharp - image) < 0.4 * np.linalg.norm(soft - image)


def test_blurred_point_has_the_exponential_profile() -> None:
    side, length_px = 61, 3.0
    over = flat(side=(side, side))
    point = np.zeros((side, side), np.float32)
    point[30, 30] = 1
    spread = surface_diffusion.blurred(point, over, length_px)
    for r in (3, 6, 9):
        expected = np.exp(-r / length_px) / (2 * np.pi * r * length_px)
        assert spread[30, 30 + r] == pytest.approx(expected, rel=0.25)


def test_graph_weights_are_squared_distances_in_pixels() -> None:
    tilted = np.broadcast_to(0.5 + 0.001 * np.arange(SHAPE[1]), SHAPE).astype(np.float32)
    ray = rays(SHAPE) - rays(SHAPE)[:, :1, 12:13]  # the tilted plane's middle is on the axis
    over = surface_diffusion.graph(np.ones(SHAPE, np.bool_), ray, tilted)
    assert over.across[:, 12] == pytest.approx(0.5, rel=0.03)
    assert over.down == pytest.approx(1, rel=0.03)


def test_graph_with_a_depth_step_keeps_sides_apart() -> None:
    depth = np.full(SHAPE, 0.5, np.float32)
    depth[:, 15:] = 0.55
    over = surface_diffusion.graph(np.ones(SHAPE, np.bool_), rays(SHAPE), depth)
    image = np.zeros(SHAPE, np.float32)
    image[:, :15] = 1
    assert surface_diffusion.blurred(image, over, 2.0)[:, 15:] == pytest.approx(0, abs=1e-3)


def test_sharpened_block_of_rows_equals_the_whole() -> None:
    rng = np.random.default_rng(0)
    over, image = flat(rng, 0.1), noise(rng)
    margin = surface_diffusion.reach(0.6)
    whole = surface_diffusion.sharpened(image, over, 0.6)
    first = 8
    part = surface_diffusion.sharpened(image[first:], over.rows(first, SHAPE[0]), 0.6)
    assert part[margin:] == pytest.approx(whole[first + margin :], abs=1e-5)


def test_noise_gain_is_that_of_white_noise() -> None:
    over, rng = flat(), np.random.default_rng(3)
    found = np.mean([np.var(surface_diffusion.sharpened(noise(rng), over, 1.0)) for _ in range(40)])
    assert found == pytest.approx(surface_diffusion.noise_gain(1.0), rel=0.1)
