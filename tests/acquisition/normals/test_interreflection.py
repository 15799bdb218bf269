"""Interreflection: reflected radiosity, scale of the prediction, and its contribution to normal variance."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acquisition import photometry
from acquisition.models.result import SolveSettings
from acquisition.normals import interreflection, pixel_solve
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


def test_prediction_scale_dark_shadows_is_zero_half_filled_is_one() -> None:
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
    assert interreflection.prediction_scale(made.pixels, values, predicted, estimate) == 0
    some = np.where(dark & (np.arange(values.shape[1]) % 2 == 0), predicted, values).astype(np.float32)
    assert interreflection.prediction_scale(made.pixels, some, predicted, estimate) == 1


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
