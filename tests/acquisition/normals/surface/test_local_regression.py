"""Regression of normals on those around: noise goes, and what images say of the surface stays."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acquisition import photometry
from acquisition.normals.surface import local_regression

SIZE = 96
Y, X = np.mgrid[:SIZE, :SIZE].astype(np.float64)


def of_slopes(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Unit normals of a surface with these slopes."""
    normals = np.stack([-p, -q, np.ones_like(p)], axis=-1)
    return normals / np.linalg.norm(normals, axis=-1, keepdims=True)


PLANE = of_slopes(np.full((SIZE, SIZE), 0.3), np.full((SIZE, SIZE), -0.2))
SPHERE = of_slopes((X - SIZE / 2) / SIZE, (Y - SIZE / 2) / SIZE)
CREASE = of_slopes(np.where(X + 0.3 * Y < 0.6 * SIZE, 0.4, -0.2), np.zeros((SIZE, SIZE)))


def noisy(normals: np.ndarray, sigma_deg: float) -> np.ndarray:
    """Normals turned at random, 1 σ over both tangential directions."""
    turn = np.random.default_rng(3).normal(0, np.radians(sigma_deg) / np.sqrt(2), normals.shape)
    turned = normals + turn - np.sum(turn * normals, axis=-1, keepdims=True) * normals
    return (turned / np.linalg.norm(turned, axis=-1, keepdims=True)).astype(np.float32)


def regressed(normals: np.ndarray, sigma_deg: float, known: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Normals and σ (H, W) after regression of maps whose noise has one σ."""
    out = normals.astype(np.float32)
    sigma = np.full(normals.shape[:2], sigma_deg, np.float32)
    if known is not None:
        sigma[~known] = np.nan
    variance = np.radians(np.nan_to_num(sigma)) ** 2
    local_regression.regress(out, sigma, variance.astype(np.float32), 1.0)
    return out, sigma


def error_deg(normals: np.ndarray, true: np.ndarray) -> np.ndarray:
    cross = np.linalg.norm(np.cross(normals.astype(np.float64), true), axis=-1)
    return np.degrees(np.arctan2(cross, np.sum(normals * true, axis=-1)))


@pytest.mark.parametrize("true", [PLANE, SPHERE], ids=["plane", "curved"])
@pytest.mark.parametrize("sigma_deg", [0.3, 3.0])
def test_regress_noise_of_a_smooth_surface_falls_to_a_third(true: np.ndarray, sigma_deg: float) -> None:
    out, sigma = regressed(noisy(true, sigma_deg), sigma_deg)
    error = error_deg(out, true)
    assert np.sqrt(np.mean(error**2)) < sigma_deg / 3
    assert 0.4 < np.sqrt(np.mean((error / sigma) ** 2)) < 1


def test_regress_normals_beside_a_crease_stay_on_their_side() -> None:
    """32° between two planes, ten times the noise: no further from the truth than noise was, and no rounding."""
    out, _ = regressed(noisy(CREASE, 2.0), 2.0)
    error, before = error_deg(out, CREASE), error_deg(noisy(CREASE, 2.0), CREASE)
    near = np.abs(X + 0.3 * Y - 0.6 * SIZE) < 2
    assert np.mean(error[near]) < 0.8 * np.mean(before[near])
    assert np.max(error[~near]) < 6


@settings(max_examples=20, deadline=None)
@given(period_px=st.floats(2.0, 6.0), azimuth=st.floats(0, np.pi), sigma_deg=st.floats(0.2, 2.0))
def test_regress_detail_of_ten_times_the_noise_stays(period_px: float, azimuth: float, sigma_deg: float) -> None:
    wave = np.cos(2 * np.pi / period_px * (np.cos(azimuth) * X + np.sin(azimuth) * Y))
    slope = np.tan(np.radians(10 * sigma_deg)) * np.sqrt(2) * wave
    true = of_slopes(np.cos(azimuth) * slope, np.sin(azimuth) * slope)
    before = noisy(true, sigma_deg)
    out, _ = regressed(before, sigma_deg)
    assert np.mean(error_deg(out, true)) < 1.1 * np.mean(error_deg(before, true))


def test_regress_in_strips_equals_regression_in_one(monkeypatch: pytest.MonkeyPatch) -> None:
    known = (X - SIZE / 2) ** 2 + (Y - SIZE / 2) ** 2 < (0.45 * SIZE) ** 2
    true = np.where(known[..., None], SPHERE, 0)
    whole = regressed(noisy(true, 1.0) * known[..., None], 1.0, known)
    monkeypatch.setattr(local_regression, "STRIP_ROWS", 7)
    for one, other in zip(whole, regressed(noisy(true, 1.0) * known[..., None], 1.0, known), strict=True):
        np.testing.assert_array_equal(one, other)
    assert not np.any(whole[0][~known])
    assert np.isnan(whole[1][~known]).all()


def test_regress_pixel_with_few_neighbours_stays() -> None:
    known = (X + Y) < 3
    before = noisy(PLANE, 1.0)
    out, sigma = regressed(before, 1.0, known)
    np.testing.assert_allclose(out[known], before[known], atol=1e-6)
    np.testing.assert_allclose(sigma[known], 1.0)


def test_noise_mean_square_is_that_of_a_gaussian_under_its_biweights() -> None:
    x = np.linspace(0, photometry.SETTINGS.outlying_deviations**2, 100_001)
    weight = np.exp(-x) * (1 - x / x[-1]) ** 2
    assert np.sum(weight * x) / np.sum(weight) == pytest.approx(local_regression.noise_mean_square(x[-1]), abs=0.005)
