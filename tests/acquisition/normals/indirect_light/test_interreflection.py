"""Interreflection: reflected radiosity, sky view, and its contribution to normal variance."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acquisition import photometry
from acquisition.models.result import SolveSettings
from acquisition.normals.indirect_light import interreflection
from acquisition.normals.pixels import pixel_solve
from acquisition.normals.pixels.pixel_solve import Pixels
from tests.acquisition import scenes
from tests.acquisition.normals import shared_scene


@settings(max_examples=60, deadline=None)
@given(
    albedo=st.floats(0.05, 0.95),
    direct=st.lists(st.floats(0.0, 1.0), min_size=4, max_size=8).filter(lambda values: sum(values) > 0.5),
    share=st.floats(0.0, 0.6),
    left=st.floats(0.0, 1.0),
)
def test_reflected_radiosity_any_subtracted_share_is_equal(
    albedo: float, direct: list[float], share: float, left: float
) -> None:
    """Subtracting all, some or none of the indirect light gives different albedos and the same radiosity."""
    falling = np.array(direct, np.float32)[:, None]
    received = np.full_like(falling, share)
    values = (albedo * (falling + received)).astype(np.float32)
    rest = (values - (1 - left) * albedo * received).astype(np.float32)
    fitted = albedo * np.sum(rest, axis=0) / np.sum(albedo * falling, axis=0)
    sent = interreflection.reflected_radiosity(
        received, np.sum(values, axis=0), np.sum(rest, axis=0), fitted.astype(np.float32)
    )
    np.testing.assert_allclose(sent, albedo * received, rtol=1e-3, atol=1e-6)


@settings(max_examples=60, deadline=None)
@given(
    albedo=st.floats(0.3, 0.9),
    received=st.lists(st.floats(0.01, 0.1), min_size=4, max_size=8),
    scale=st.floats(0.1, 10.0),
)
def test_hardly_lit_pixel_of_at_most_one_direct_value_counts_whatever_the_units(
    albedo: float, received: list[float], scale: float
) -> None:
    irradiance = np.float32(scale) * np.array(received, np.float32)[:, None]
    values = np.float32(albedo) * irradiance
    assert interreflection.hardly_lit(irradiance, values, albedo).all()
    values[0] = scale
    assert interreflection.hardly_lit(irradiance, values, albedo).all()
    values[1] = 0.5 * scale
    assert not interreflection.hardly_lit(irradiance, values, albedo).any()


def test_hardly_lit_dark_surface_under_all_lamps_does_not_count() -> None:
    """An albedo a fifth of the object's, in a hollow that sends a tenth of the lamps' light."""
    values = 0.1 * np.array([[0.4], [0.6], [0.8], [1.0]], np.float32)
    assert not interreflection.hardly_lit(np.full_like(values, 0.05), values, 0.5).any()


def test_reflected_radiosity_is_at_most_the_received() -> None:
    received = np.full((4, 1), 0.2, np.float32)
    total = np.full(1, 12.0, np.float32)
    np.testing.assert_allclose(
        interreflection.reflected_radiosity(received, total, total, np.array([2.5], np.float32)), received
    )


def test_normal_variance_scale_error_equals_finite_perturbation() -> None:
    made = shared_scene.measured()

    def solved(values: np.ndarray) -> pixel_solve.Estimate:
        return pixel_solve.solve(
            made.pixels,
            values,
            made.depth_m,
            dataclasses.replace(made.scene, settings=SolveSettings(shadow_threshold=0, robust=False)),
        )

    indirect = (0.05 * np.linspace(0.5, 1.5, len(made.values))[:, None] * np.ones_like(made.values)).astype(np.float32)
    right = solved(made.values)
    wrong = solved((made.values + np.float32(0.1) * indirect).astype(np.float32))
    turned = np.arccos(np.clip(np.sum(right.normals * wrong.normals, axis=0), -1, 1))
    said = 0.1 / photometry.SETTINGS.predicted_light_sigma * np.sqrt(interreflection.normal_variance(right, indirect))
    assert np.median(turned) > 1e-3
    assert np.median(turned / said) == pytest.approx(1, abs=0.1)
    assert np.all(interreflection.normal_variance(right, np.zeros_like(indirect)) == 0)


def test_received_irradiance_tilted_pixel_equals_view_factor_of_plane() -> None:
    """The view factor from a surface to a plane tilted against it by β is (1 − cos β) / 2."""
    made = shared_scene.measured(size=60)
    slant = 0.5
    normals = np.tile(np.array([[np.sin(slant)], [0.0], [np.cos(slant)]], np.float32), (1, made.depth_m.size))
    solution = pixel_solve.solve(made.pixels, made.values, made.depth_m, made.scene)
    bright = np.ones_like(made.values)

    def light(every: int) -> np.ndarray:
        surface = interreflection.Surface(made.depth_m, normals, solution.albedo, table=None)
        return interreflection.received_irradiance(made.pixels, bright, surface, made.lamp, made.calibration, every)

    every_one = light(1)
    middle = 30 * 60 + 30
    assert every_one[0, middle] == pytest.approx((1 - np.cos(slant)) / 2, rel=0.02)
    some = light(7)
    np.testing.assert_array_equal(some[:, ::7], every_one[:, ::7])
    some[:, ::7] = 0
    assert not np.any(some)


@pytest.mark.parametrize("columns", [4, 10, 25, 45])
def test_received_irradiance_of_a_low_wall_equals_its_form_factor_at_any_distance(columns: int) -> None:
    """Form factor of a rectangle at the end of a floor (Howell, A catalog of radiation heat transfer configuration
    factors, B-3). The faces beside the wall are black; a lamp lights the wall alone."""
    size, edge, high = 80, 16, 3
    made = shared_scene.measured(size=size)
    point = photometry.points(made.pixels.ray, made.depth_m).reshape(3, size, size)
    cell_m = float(point[0, 0, 1] - point[0, 0, 0])
    depth_m = made.depth_m.reshape(size, size).copy()
    depth_m[:, :edge] -= high * cell_m
    up = np.tile(np.array([[0.0], [0.0], [1.0]], np.float32), (1, size * size))
    lamp = np.array([[1.5, 0.0, -0.5, -1.0, 0.0, -0.3]], np.float32)
    surface = interreflection.Surface(depth_m.ravel(), up, np.full(size * size, 0.6, np.float32), table=None)
    black = np.zeros((1, size * size), np.float32)
    received = interreflection.received_irradiance(made.pixels, black, surface, lamp, made.calibration)
    foot = point[:, size // 2, edge][:, None] + np.array([[0.0], [0.0], [high * cell_m / 2]])
    wall = 0.6 * photometry.light_vectors(foot.astype(np.float32), lamp, made.calibration)[0, 0, 0]

    away, half = columns + 0.5, size / 2
    slanted = np.hypot(away, high)
    factor = (np.arctan(half / away) - away / slanted * np.arctan(half / slanted)) / np.pi
    rows = np.s_[size // 2 - 5 : size // 2 + 5]
    found = np.mean(received.reshape(size, size)[rows, edge + columns])
    assert found == pytest.approx(wall * factor, rel=0.15)


def test_sky_view_tilted_pixel_lacks_view_factor_of_table() -> None:
    """A table all round takes (1 − cos β) / 2 of the sky from a surface that is tilted by β, a black plane none."""
    made = shared_scene.measured(size=60)
    slant = 0.5
    normals = np.tile(np.array([[np.sin(slant)], [0.0], [np.cos(slant)]], np.float32), (1, made.depth_m.size))
    middle = 30 * 60 + 30
    table = interreflection.Table(made.pixels.image(made.depth_m), made.pixels.image(made.values))
    share = interreflection.sky_view(made.pixels, made.depth_m, normals, table)
    assert share[middle] == pytest.approx((1 + np.cos(slant)) / 2, rel=0.02)


def test_sky_view_hemispherical_cavity_sees_half_of_the_sky() -> None:
    """Every point of a spherical cap sees the rest of it under the same view factor, of a hemisphere 1/2."""
    size = 100
    known = scenes.calibration(size, lobe_exponent=0.0)
    ray = photometry.rays(known, slice(0, size), slice(0, size)).reshape(2, -1)
    far, radius = shared_scene.DEPTH_M, 0.4 * float(np.ptp(ray[0])) * shared_scene.DEPTH_M
    square = 1 + np.sum(ray**2, axis=0)
    # Where the ray leaves the sphere behind the plane of its middle; the plane around.
    depth = (far + np.sqrt(np.maximum(far**2 - square * (far**2 - radius**2), 0))) / square
    depth = np.maximum(depth, far)
    inside = depth > far
    inwards = np.stack([-ray[0] * depth, ray[1] * depth, depth - far]) / radius  # y is down in rays, up in normals
    normals = np.where(inside, inwards, np.array([[0.0], [0.0], [1.0]]))
    none = np.zeros((1, size**2), np.float32)
    pixels = Pixels((size, size), np.arange(size**2), ray, none, none > 0)
    share = interreflection.sky_view(pixels, depth.astype(np.float32), normals.astype(np.float32), None)
    assert np.count_nonzero(inside) > size**2 / 4
    middle = inside & (np.hypot(*ray) * far < 0.8 * radius)
    assert np.mean(share[middle]) == pytest.approx(0.5, abs=0.02)
    np.testing.assert_allclose(share[middle], 0.5, atol=0.06)
    np.testing.assert_allclose(share[~inside], 1, atol=0.01)
