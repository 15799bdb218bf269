"""Projection on integrable normals: noise variance and σ² halve, relief and depth discontinuities are kept."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acquisition.normals.surface import integrability

PITCH = 0.001


def rays(height: int, width: int) -> np.ndarray:
    """Rays (2, H, W) of an undistorted camera."""
    y, x = np.mgrid[:height, :width]
    return (PITCH * np.stack([x - width / 2, y - height / 2])).astype(np.float32)


def normals(log_depth: np.ndarray, ray: np.ndarray) -> np.ndarray:
    """Normals (H, W, 3), view frame, of the surface whose log depth is given at the pixels' corners (H + 1, W + 1)."""
    across = np.diff(log_depth, axis=1)
    down = np.diff(log_depth, axis=0)
    p, q = (across[1:] + across[:-1]) / 2 / PITCH, (down[:, 1:] + down[:, :-1]) / 2 / PITCH
    out = np.dstack([p, -q, 1 + p * ray[0] + q * ray[1]])
    return (out / np.linalg.norm(out, axis=-1, keepdims=True)).astype(np.float32)


def bumpy(height: int, width: int, seed: int, slope: float = 0.3) -> np.ndarray:
    """Log depth (H + 1, W + 1) of white noise: the roughest surface that pixels can represent."""
    return PITCH * slope * np.random.default_rng(seed).normal(size=(height + 1, width + 1))


def shaken(true: np.ndarray, sigma_deg: float, seed: int) -> np.ndarray:
    """The normals with Gaussian errors in the tangent plane, σ in total over both directions."""
    noise = np.random.default_rng(seed).normal(size=true.shape) * np.radians(sigma_deg) / np.sqrt(2)
    noise -= np.sum(noise * true, axis=-1, keepdims=True) * true
    out = true + noise
    return (out / np.linalg.norm(out, axis=-1, keepdims=True)).astype(np.float32)


def error_deg(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return np.degrees(2 * np.arcsin(np.linalg.norm(one - other, axis=-1) / 2))


def projected(noisy: np.ndarray, sigma_deg: float, ray: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Projected normals, σ (degrees) and independent variance (rad²), where all of σ is independent between pixels."""
    out, sigma = noisy.copy(), np.full(noisy.shape[:2], sigma_deg, np.float32)
    variance = np.radians(sigma) ** 2
    integrability.project_integrable(out, sigma, variance, ray)
    return out, sigma, variance


@pytest.mark.parametrize("relief", [0.0, 0.02])
def test_project_integrable_rough_surface_halves_variance_and_sigma(relief: float) -> None:
    ray = rays(300, 80)
    true = normals(bumpy(300, 80, 1, relief), ray)
    estimate, sigma, _ = projected(shaken(true, 1.0, 2), 1.0, ray)
    left = np.mean(error_deg(estimate, true) ** 2)
    assert left == pytest.approx(0.5, abs=0.03)
    assert np.mean(sigma**2) == pytest.approx(left, rel=0.06)


def test_project_integrable_mixed_sigma_stays_calibrated() -> None:
    ray = rays(400, 200)
    true = normals(bumpy(400, 200, 1, 0.02), ray)
    unsure = np.random.default_rng(3).random(ray.shape[1:]) < 0.2
    estimate = np.where(unsure[..., None], shaken(true, 2.0, 4), shaken(true, 0.5, 5))
    sigma = np.where(unsure, 2.0, 0.5).astype(np.float32)
    integrability.project_integrable(estimate, sigma, np.radians(sigma) ** 2, ray)
    for some in (unsure, ~unsure):
        left = np.sqrt(np.mean(error_deg(estimate, true)[some] ** 2))
        assert np.sqrt(np.mean(sigma[some] ** 2)) == pytest.approx(left, rel=0.2)


@given(seed=st.integers(0, 1000), height=st.integers(1, 40), width=st.integers(1, 12))
@settings(max_examples=25)
def test_project_integrable_consistent_surface_is_unchanged(seed: int, height: int, width: int) -> None:
    ray = rays(height, width)
    true = normals(bumpy(height, width, seed), ray)
    estimate, sigma, variance = projected(true, 2.0, ray)
    assert np.max(error_deg(estimate, true)) < 0.02
    assert np.all((sigma <= 2.0 + 1e-5) & (sigma >= 1.41))
    np.testing.assert_allclose(np.radians(sigma) ** 2, variance, rtol=1e-4)


def test_project_integrable_common_mode_variance_stays_in_sigma() -> None:
    ray = rays(30, 30)
    sigma = np.full((30, 30), 2.0, np.float32)
    variance = np.radians(np.full_like(sigma, 1.0)) ** 2
    integrability.project_integrable(shaken(normals(bumpy(30, 30, 3, 0.05), ray), 1.0, 4), sigma, variance, ray)
    assert np.median(sigma) == pytest.approx(np.sqrt(3.5), rel=0.02)


def test_project_integrable_pixels_without_normal_are_ignored() -> None:
    ray = rays(30, 30)
    before = shaken(normals(bumpy(30, 30, 5), ray), 1.0, 6)
    out, sigma = before.copy(), np.ones((30, 30), np.float32)
    holes = np.random.default_rng(7).random(sigma.shape) < 0.3
    out[holes], sigma[holes] = 0, np.nan
    variance = np.radians(np.nan_to_num(sigma, nan=50.0)) ** 2
    integrability.project_integrable(out, sigma, variance, ray)
    assert not np.any(out[holes])
    assert np.all(np.isnan(sigma[holes]))
    np.testing.assert_allclose(np.linalg.norm(out[~holes], axis=-1), 1, atol=1e-5)


@given(seed=st.integers(0, 1000), share=st.sampled_from([0.02, 0.1, 0.3]))
@settings(max_examples=25)
def test_project_integrable_scattered_pixels_stay_unit_normals(seed: int, share: float) -> None:
    """Among scattered pixels a few cells of 2 × 2 are complete, for which the iteration is soon exact."""
    ray = rays(40, 40)
    noisy = shaken(normals(bumpy(40, 40, seed), ray), 1.0, seed)
    known = np.random.default_rng(seed).random((40, 40)) < share
    known[18:20, 20:22] = True
    sigma = np.where(known, np.float32(1.0), np.float32(np.nan))
    integrability.project_integrable(noisy, sigma, np.where(known, np.radians(1.0) ** 2, 0).astype(np.float32), ray)
    assert np.linalg.norm(noisy[known], axis=-1) == pytest.approx(1.0, abs=1e-5)
    assert np.all(sigma[known] > 0)


def test_project_integrable_discontinuity_keeps_both_surfaces() -> None:
    """One surface rises towards the occluding contour, the other runs along it: no single surface has both normals."""
    ray = rays(60, 60)
    y, x = np.mgrid[:61, :61] * PITCH
    one, other = normals(-np.sqrt(0.04**2 - (x - 0.03) ** 2) * 2, ray), normals(1.2 * y, ray)
    true = np.where(np.arange(60)[None, :, None] < 40, one, other)
    estimate, _, _ = projected(shaken(true, 0.5, 8), 0.5, ray)
    beside = slice(37, 43)
    assert np.mean(error_deg(estimate, true)[:, beside]) < 0.5
    assert np.max(error_deg(estimate, true)) < 2.5


def test_project_integrable_in_strips_equals_one_strip(monkeypatch: pytest.MonkeyPatch) -> None:
    ray = rays(120, 20)
    noisy = shaken(normals(bumpy(120, 20, 9), ray), 1.0, 10)
    full, sigma, _ = projected(noisy, 1.0, ray)
    monkeypatch.setattr(integrability, "STRIP_ROWS", 25)
    parts, sigma_of_parts, _ = projected(noisy, 1.0, ray)
    assert np.max(error_deg(full, parts)) < 0.01
    np.testing.assert_allclose(sigma, sigma_of_parts, rtol=1e-3)


@pytest.mark.parametrize("stated", [0.5, 1.0, 4.0])
def test_project_integrable_says_how_much_noise_is_independent(stated: float) -> None:
    """Of noise whose variance is stated wrongly, beside a tilt of a degree that all pixels have in common."""
    ray = rays(120, 130)
    true = normals(np.zeros((121, 131)), ray)
    tilted = shaken(true, 1.0, 4) + np.radians(1.0) * np.array([1.0, 0.0, 0.0])
    tilted = (tilted / np.linalg.norm(tilted, axis=-1, keepdims=True)).astype(np.float32)
    variance = np.full((120, 130), stated * np.radians(1.0) ** 2, np.float32)
    independent = integrability.project_integrable(tilted, np.degrees(np.sqrt(variance)), variance, ray)
    assert independent == pytest.approx(1 / stated, rel=0.1)


def test_project_integrable_too_few_cells_say_nothing_of_noise() -> None:
    ray = rays(5, 6)
    maps = normals(np.zeros((6, 7)), ray), np.ones((5, 6), np.float32), np.full((5, 6), 3e-4, np.float32)
    assert integrability.project_integrable(*maps, ray) == 1
