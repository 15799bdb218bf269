"""Smoothing of uncertain normals: their errors drop, certain pixels are unchanged, edges are kept."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from acquisition.normals import regularisation


def dome(height: int, width: int) -> np.ndarray:
    """Normals (H, W, 3) of a shallow bowl."""
    y, x = np.meshgrid(np.linspace(-0.5, 0.5, height), np.linspace(-0.5, 0.5, width), indexing="ij")
    out = np.dstack([x, y, np.ones_like(x)])
    return (out / np.linalg.norm(out, axis=-1, keepdims=True)).astype(np.float32)


def shaken(true: np.ndarray, sigma_deg: np.ndarray, seed: int) -> np.ndarray:
    """The normals with Gaussian errors in the tangent plane, σ in total over both directions."""
    rng = np.random.default_rng(seed)
    noise = rng.normal(size=true.shape) * np.radians(sigma_deg)[..., None] / np.sqrt(2)
    noise -= np.sum(noise * true, axis=-1, keepdims=True) * true
    out = true + noise
    return (out / np.linalg.norm(out, axis=-1, keepdims=True)).astype(np.float32)


def error_deg(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return np.degrees(np.arccos(np.clip(np.sum(one * other, axis=-1), -1, 1)))


def test_smooth_uncertain_isolated_pixel_error_drops_sigma_holds() -> None:
    true = dome(60, 60)
    sigma = np.full((60, 60), 0.5, np.float32)
    sigma[2::4, 2::4] = 12.0
    lone = sigma > 1
    normals = shaken(true, sigma, 1)
    before = error_deg(normals, true)[lone]
    regularisation.smooth_uncertain(normals, sigma)
    after = error_deg(normals, true)[lone]
    assert np.mean(after) < 0.2 * np.mean(before)
    assert np.mean(after < 2 * sigma[lone]) > 0.92


@given(seed=st.integers(0, 1000), rows=st.integers(1, 20), sure=st.floats(0, 1))
def test_smooth_uncertain_certain_pixels_unchanged_no_sigma_grows(seed: int, rows: int, sure: float) -> None:
    rng = np.random.default_rng(seed)
    true = dome(rows, 9)
    sigma = np.where(rng.random((rows, 9)) < sure, 1.0, 15.0).astype(np.float32)
    mask = rng.random((rows, 9)) < 0.8
    sigma[~mask] = np.nan
    normals = np.where(mask[..., None], shaken(true, np.nan_to_num(sigma), seed), 0).astype(np.float32)
    smoothed, smoothed_sigma = normals.copy(), sigma.copy()
    regularisation.smooth_uncertain(smoothed, smoothed_sigma)
    stays = ~mask | (sigma < regularisation.SETTINGS.unsure_deg)
    np.testing.assert_array_equal(smoothed[stays], normals[stays])
    np.testing.assert_array_equal(smoothed_sigma[stays], sigma[stays])
    assert np.all(smoothed_sigma[mask] <= sigma[mask] * (1 + 1e-6))
    np.testing.assert_allclose(np.linalg.norm(smoothed[mask], axis=-1), 1, atol=1e-5)


def test_smooth_uncertain_edge_ignores_dissimilar_neighbours() -> None:
    normals = np.zeros((9, 9, 3), np.float32)
    normals[:, :4] = (0, 0, 1)
    normals[:, 4:] = (np.sin(1.2), 0, np.cos(1.2))
    sigma = np.full((9, 9), 0.5, np.float32)
    sigma[4, 4] = 5.0
    before = normals[4, 4].copy()
    regularisation.smooth_uncertain(normals, sigma)
    assert error_deg(normals[4, 4], before) < 1.0


def test_smooth_uncertain_in_strips_has_no_seam() -> None:
    height = regularisation.STRIP_ROWS + 7
    sigma = np.full((height, 6), 6.0, np.float32)
    normals = shaken(dome(height, 6), sigma, 2)
    top = regularisation.STRIP_ROWS - 5
    around = slice(top - 1, top + 11)
    cut, cut_sigma = normals[around].copy(), sigma[around].copy()
    regularisation.smooth_uncertain(normals, sigma)
    regularisation.smooth_uncertain(cut, cut_sigma)
    # Sums over nine pixels of three components, then a unit vector: at most some 40 roundings u = 6e-8 in any order.
    np.testing.assert_allclose(normals[top : top + 10], cut[1:-1], rtol=0, atol=40 * 6e-8)
    np.testing.assert_allclose(sigma[top : top + 10], cut_sigma[1:-1], rtol=1e-5)


def test_smooth_uncertain_patch_changes_at_its_border_only() -> None:
    """Neighbours lit by the same lights have the same error: they must not confirm each other."""
    true = dome(20, 20)
    sigma = np.full((20, 20), 1.0, np.float32)
    patch, inner = (slice(5, 15),) * 2, (slice(6, 14),) * 2
    sigma[patch] = 15.0
    normals = true.copy()
    normals[patch] = (0.0, 0.5, np.sqrt(0.75))
    before = normals[inner].copy()
    regularisation.smooth_uncertain(normals, sigma)
    np.testing.assert_array_equal(normals[inner], before)
    assert np.all(sigma[inner] == 15.0)
    assert np.max(sigma[5, 5:15]) < 15.0
