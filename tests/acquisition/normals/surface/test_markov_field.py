"""Regularisation of uncertain pixels: what images do not tell goes on from those around, what they tell stays."""

import numba
import numpy as np
import pytest

from acquisition import photometry
from acquisition.normals.surface import markov_field

SIZE = 128
Y, X = np.mgrid[:SIZE, :SIZE].astype(np.float64)
RAY = (np.stack([X - SIZE / 2, Y - SIZE / 2]) / SIZE).astype(np.float32)
FEW = (np.abs(X - SIZE / 2) < 6) & (np.abs(Y - SIZE / 2) < 10)
"""Pixels in the middle that few lamps reach."""


def of_slopes(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Unit normals of a surface with these slopes."""
    normals = np.stack([-p, -q, np.ones_like(p)], axis=-1)
    return (normals / np.linalg.norm(normals, axis=-1, keepdims=True)).astype(np.float32)


PLANE = of_slopes(np.full((SIZE, SIZE), 0.4), np.full((SIZE, SIZE), -0.2))
SPHERE = of_slopes((X - 0.1 * SIZE) / SIZE, (Y - 0.2 * SIZE) / SIZE)
ALONG_X, NONE = np.array([1, 0, 0, 0, 0, 0], np.float32), np.zeros(6, np.float32)


def errors_deg(normals: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Angles (H, W) between normals."""
    return np.degrees(np.arccos(np.clip(np.sum(normals * true, axis=-1), -1, 1)))


def regularised(
    normals: np.ndarray, albedo: np.ndarray, information: np.ndarray, few: np.ndarray = FEW
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Normals, albedo and σ after regularisation; σ was 1° and, of few lights, 40°. What `information` (6,) there is
    says that they are what they are."""
    known = np.where(few, 40, 1).astype(np.float32)
    normals, albedo, sigma = normals.copy(), albedo.astype(np.float32), known.copy()
    xx, xy, xz, yy, yz, zz = information.tolist()
    right = albedo[..., None] * normals @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    equations = np.concatenate([np.broadcast_to(information, (*few.shape, 6)), right], axis=-1, dtype=np.float32)
    markov_field.regularise(normals, albedo, sigma, known, equations, RAY)
    np.testing.assert_array_equal(sigma[~few], 1)
    return normals, albedo, sigma


@pytest.mark.parametrize("true", [PLANE, SPHERE], ids=["plane", "sphere"])
def test_regularise_pixels_without_information_go_on_from_those_around(true: np.ndarray) -> None:
    start = np.where(FEW[..., None], np.float32([0, 0, 1]), true)
    albedo = np.where(FEW, 0.3, 0.5)
    normals, shades, _ = regularised(start, albedo, NONE)
    assert np.mean(errors_deg(normals, true)[FEW]) < 0.3 * np.mean(errors_deg(start, true)[FEW])
    np.testing.assert_array_equal(normals[~FEW], start[~FEW])
    assert np.median(shades[FEW]) == pytest.approx(0.5, rel=0.1)


def test_regularise_keeps_what_images_tell_and_continues_the_rest() -> None:
    told = of_slopes(np.full((SIZE, SIZE), 0.8), np.full((SIZE, SIZE), 0.5))
    start = np.where(FEW[..., None], told, PLANE)
    normals, shades, _ = regularised(start, np.full((SIZE, SIZE), 0.5), 1e9 * ALONG_X)
    g = normals * shades[..., None]
    np.testing.assert_allclose(g[FEW][:, 0], 0.5 * told[FEW][:, 0], rtol=0.01)
    assert np.mean(errors_deg(normals, PLANE)[FEW]) < 0.7 * np.mean(errors_deg(start, PLANE)[FEW])


def test_regularise_carved_surface_is_a_wide_prior() -> None:
    rng = np.random.default_rng(1)
    carved = of_slopes(*rng.normal(0, 0.5, (2, SIZE, SIZE)))
    painted = np.exp(rng.normal(-1, 0.5, (SIZE, SIZE)))
    # 5° of information, less than the prior's on a smooth object.
    information = np.array([1, 0, 0, 1, 0, 1], np.float32) / np.float32(np.radians(5) * 0.4) ** 2
    rough, _, of_rough = regularised(carved, painted, information)
    smooth, _, of_smooth = regularised(np.where(FEW[..., None], carved, PLANE), np.full((SIZE, SIZE), 0.4), information)
    assert np.mean(errors_deg(rough, carved)[FEW]) < 0.5 * np.mean(errors_deg(smooth, carved)[FEW])
    assert np.min(of_rough[FEW]) > 35
    assert np.median(of_smooth[FEW]) < 15


def test_regularise_leaves_pixels_without_normal_and_needs_certain_ones() -> None:
    known = X > 10
    normals, albedo = np.where(known[..., None], PLANE, 0), np.where(known, 0.5, 0).astype(np.float32)
    sigma = np.where(known, np.where(FEW, 40, 1), np.nan).astype(np.float32)
    markov_field.regularise(normals, albedo, sigma.copy(), sigma, np.zeros((SIZE, SIZE, 9), np.float32), RAY)
    assert not np.any(normals[~known])
    uncertain, _, sigma = regularised(SPHERE, np.full((SIZE, SIZE), 0.5), NONE, np.ones((SIZE, SIZE), np.bool_))
    np.testing.assert_array_equal(uncertain, SPHERE)
    np.testing.assert_array_equal(sigma, 40)


def test_regularise_normals_stay_visible_and_of_unit_length() -> None:
    rng = np.random.default_rng(2)
    steep = of_slopes(np.full((SIZE, SIZE), 8.0), rng.normal(0, 3, (SIZE, SIZE)))
    normals, _, _ = regularised(steep, np.full((SIZE, SIZE), 0.5), NONE)
    direction = photometry.ray_directions(RAY.reshape(2, -1)).T.reshape(SIZE, SIZE, 3)
    towards = -np.sum(normals * direction, axis=-1) / np.linalg.norm(direction, axis=-1)
    assert np.min(towards[FEW]) > photometry.SETTINGS.min_view_cosine - 1e-4
    np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1, atol=1e-5)


def test_regularise_does_not_depend_on_the_number_of_threads() -> None:
    rng = np.random.default_rng(3)
    start = of_slopes(*rng.normal(0, 0.3, (2, SIZE, SIZE)))
    few = rng.random((SIZE, SIZE)) < 0.5
    threads = numba.get_num_threads()
    together, *_ = regularised(start, np.full((SIZE, SIZE), 0.5), NONE, few)
    numba.set_num_threads(1)
    try:
        alone, *_ = regularised(start, np.full((SIZE, SIZE), 0.5), NONE, few)
    finally:
        numba.set_num_threads(threads)
    np.testing.assert_array_equal(together, alone)
