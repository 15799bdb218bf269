"""Light in shadows: whether there is indirect light, and normal equations of ambient light and offset."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acquisition import photometry
from acquisition.models.base import Float32Array
from acquisition.normals.indirect_light import shadow_light
from acquisition.normals.indirect_light.shadow_light import ShadowEquations
from acquisition.normals.pixels import pixel_solve
from acquisition.normals.pixels.estimate import Estimate
from acquisition.normals.pixels.pixel_solve import Pixels
from tests.acquisition.normals import shared_scene

AZIMUTHS = np.linspace(0, 2 * np.pi, 8, endpoint=False)


def sphere(albedo: float = 0.5) -> tuple[Pixels, Estimate]:
    """A sphere under eight slanted lamps from afar, its lower half twice as dark, and its true solution."""
    size = 64
    y, x = (np.mgrid[:size, :size].reshape(2, -1) - (size - 1) / 2) / (size / 2)
    index = np.flatnonzero(np.hypot(x, y) < 0.95)
    x, y = x[index], y[index]
    normals = np.stack([x, -y, np.sqrt(1 - x * x - y * y)])
    lamps = np.stack([0.9 * np.cos(AZIMUTHS), 0.9 * np.sin(AZIMUTHS), np.full(8, np.sqrt(1 - 0.81))], axis=1)
    g = (albedo * np.where(y > 0, 0.5, 1.0) * normals).astype(np.float32)
    light = np.repeat(lamps[:, :, None], len(index), axis=2).astype(np.float32)
    values = np.maximum(np.einsum("fck,ck->fk", light, g), 0)
    pixels = Pixels(
        (size, size), index, np.stack([x, -y]).astype(np.float32), values, np.zeros(values.shape, np.bool_)
    )  # fmt: skip
    estimate = Estimate(
        g=g, variance=np.zeros(len(index), np.float32), residual=np.zeros(len(index), np.float32),
        weights=np.ones_like(values), usable=values > 0, light=light, point=np.zeros_like(g),
    )  # fmt: skip
    return pixels, estimate


def found_in(
    pixels: Pixels, sky: float, values: Float32Array, indirect: Float32Array, estimate: Estimate
) -> ShadowEquations:
    """The equations of pixels that all see the same share of the sky."""
    factors = np.full(len(pixels.index), sky, np.float32)
    return shadow_light.equations(pixels, factors, values, indirect, estimate, shared_scene.measured().noise)


def solved(found: ShadowEquations) -> np.ndarray:
    return np.linalg.solve(found.matrix, found.right)


@settings(max_examples=30, deadline=None)
@given(
    ambient=st.floats(0.0, 0.2), offset=st.floats(-0.05, 0.05), indirect=st.floats(0.0, 0.05), sky=st.floats(0.6, 1.0)
)
def test_equations_give_ambient_light_and_offset_of_shadows(
    ambient: float, offset: float, indirect: float, sky: float
) -> None:
    pixels, estimate = sphere()
    received = np.full_like(pixels.values, indirect)
    values = (pixels.values + received + ambient * sky * estimate.albedo + offset).astype(np.float32)
    found = found_in(pixels, sky, values, received, estimate)
    in_shadow = np.broadcast_to(sky * estimate.albedo, values.shape)[shadow_light.umbra(pixels, values, estimate)]
    assert found.indirect == pytest.approx(indirect / np.mean(in_shadow, dtype=np.float64), abs=1e-6)
    # A negative offset makes some grazing light pass for shadow.
    np.testing.assert_allclose(solved(found), [ambient, offset], atol=2e-4 + 0.1 * max(-offset, 0))


def test_equations_highlights_in_a_tenth_of_the_shadows_hardly_count() -> None:
    pixels, estimate = sphere()
    rng = np.random.default_rng(2)
    mirrored = 0.2 * (rng.random(pixels.values.shape) < 0.1)
    values = (pixels.values + 0.05 * estimate.albedo + mirrored).astype(np.float32)
    found = found_in(pixels, 1.0, values, np.zeros_like(values), estimate)
    np.testing.assert_allclose(solved(found), [0.05, 0.0], atol=2e-3)


@pytest.mark.parametrize("why", ["cavity", "no shadow"])
def test_equations_of_no_open_shadow_say_nothing(why: str) -> None:
    pixels, estimate = sphere()
    if why == "no shadow":
        estimate = dataclasses.replace(estimate, light=np.repeat(estimate.light.mean(axis=0)[None], 8, axis=0))
        pixels = dataclasses.replace(pixels, values=np.full_like(pixels.values, 0.5))
    sky = 0.3 if why == "cavity" else 1.0
    found = found_in(pixels, sky, pixels.values, np.zeros_like(pixels.values), estimate)
    assert not np.any(found.matrix)
    assert not np.any(found.right)


def test_shadows_show_indirect_where_half_filled_not_where_dark() -> None:
    """The prediction is accepted when a quarter of it is measured in attached shadows."""
    made = shared_scene.measured(size=60, largest_slant=1.3)
    solution = pixel_solve.solve(made.pixels, made.values, made.depth_m, made.scene)
    light = photometry.light_vectors(
        photometry.points(made.pixels.ray, made.depth_m), made.lamp, made.calibration
    )  # fmt: skip
    away = np.einsum("fcn,cn->fn", light, made.normals) < 0
    # Normals of neighbouring pixels are unrelated in this scene, but the detection needs connected shadow areas.
    order = np.argsort(made.normals[0] + 1e-3 * made.normals[1])
    estimate = dataclasses.replace(
        solution,
        **{
            name: np.ascontiguousarray(value[..., order])
            for name, value in vars(solution).items()
            if isinstance(value, np.ndarray)
        },
    )
    values, dark = made.values[:, order], away[:, order]
    predicted = np.full_like(values, 0.02)
    assert np.count_nonzero(dark) > 500
    assert not shadow_light.shadows_show_indirect(made.pixels, values, predicted, estimate)
    some = np.where(dark & (np.arange(values.shape[1]) % 2 == 0), predicted, values).astype(np.float32)
    assert shadow_light.shadows_show_indirect(made.pixels, some, predicted, estimate)
