"""Depth from true normals of analytic surfaces, in perspective, on masks with holes."""

import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.linalg import spsolve

from acquisition import photometry
from acquisition.models.base import Float32Array
from acquisition.normals.surface import integration
from tests.acquisition import scenes

SIZE = 160


def surface(tilt: float = 0.0, wave_m: float = 0.004, distortion: float = 0.0):
    """Depth Z(x, y) of a wavy, tilted surface at each pixel, its normals (3, H, W) and its rays."""
    known = scenes.calibration(SIZE, distortion=(distortion, 0.0, 0.0, 0.0, 0.0))
    ray = photometry.rays(known, slice(0, SIZE), slice(0, SIZE)).astype(float)

    def z(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return 0.85 + tilt * x + wave_m * np.sin(x / 0.012) * np.cos(y / 0.015)

    depth = np.full((SIZE, SIZE), 0.85)
    for _ in range(60):
        depth = z(ray[0] * depth, ray[1] * depth)
    x, y = ray * depth
    e = 1e-6
    gx, gy = (z(x + e, y) - z(x - e, y)) / (2 * e), (z(x, y + e) - z(x, y - e)) / (2 * e)
    normal = np.stack([gx, -gy, np.ones_like(gx)])  # view frame: y up, towards the camera
    normal /= np.linalg.norm(normal, axis=0)
    return depth, normal.astype(np.float32), ray.astype(np.float32)


def integrated(normal: Float32Array, mask: np.ndarray, ray: Float32Array, depth: np.ndarray) -> np.ndarray:
    start = np.where(mask, np.exp(np.mean(np.log(depth[mask]))), 0.9).astype(np.float32)
    return integration.depth(normal, mask, ray, np.ones(mask.shape, np.float32), start)


def rms_mm(estimate: np.ndarray, depth: np.ndarray, mask: np.ndarray) -> float:
    return float(np.sqrt(np.mean((estimate - depth)[mask] ** 2)) * 1e3)


@pytest.mark.parametrize("tilt", [0.0, 0.5])
@pytest.mark.parametrize("distortion", [0.0, -0.15])
def test_depth_wavy_surface_error_below_tenth_millimetre(tilt: float, distortion: float) -> None:
    depth, normal, ray = surface(tilt, distortion=distortion)
    mask = np.ones(depth.shape, np.bool_)
    assert rms_mm(integrated(normal, mask, ray, depth), depth, mask) < 0.1


def test_depth_mask_with_holes_recovers_surface() -> None:
    depth, normal, ray = surface(0.2)
    v, u = np.mgrid[:SIZE, :SIZE]
    angle, radius = np.arctan2(v - 80, u - 80), np.hypot(v - 80, u - 80)
    mask = radius < 60 + 8 * np.sin(7 * angle)
    mask &= (np.hypot(v - 60, u - 70) > 12) & (np.hypot(v - 100, u - 95) > 9)
    garbage = np.where(mask, normal, np.float32(0))
    estimate = integrated(garbage, mask, ray, depth)
    assert rms_mm(estimate, depth, mask) < 0.1
    np.testing.assert_allclose(estimate[~mask], 0.9)


def test_depth_plane_is_exact() -> None:
    depth, normal, ray = surface(0.7, wave_m=0.0)
    mask = np.ones(depth.shape, np.bool_)
    assert rms_mm(integrated(normal, mask, ray, depth), depth, mask) < 0.03


def test_depth_separate_components_keep_their_mean() -> None:
    depth, normal, ray = surface(0.1)
    mask = np.zeros(depth.shape, np.bool_)
    mask[20:140, 10:60] = mask[20:140, 90:150] = True
    start = depth.astype(np.float32).copy()
    for columns, shift in ((slice(10, 60), 1.0), (slice(90, 150), 1.02)):
        part = depth[20:140, columns]
        start[20:140, columns] = shift * np.exp(np.mean(np.log(part)))
    estimate = integration.depth(normal, mask, ray, np.ones(mask.shape, np.float32), start)
    for columns, shift in ((slice(12, 58), 1.0), (slice(92, 148), 1.02)):
        ratio = estimate[25:135, columns] / depth[25:135, columns]
        np.testing.assert_allclose(ratio, shift, atol=3e-4)


def test_depth_uncertain_pixels_do_not_distort_others() -> None:
    depth, normal, ray = surface(0.0)
    mask = np.ones(depth.shape, np.bool_)
    wrong = normal.copy()
    wrong[:, 70:90, 70:90] = np.array([0.6, 0.0, 0.8], np.float32)[:, None, None]
    certainty = np.ones(mask.shape, np.float32)
    start = np.full(depth.shape, np.exp(np.mean(np.log(depth))), np.float32)
    believed = integration.depth(wrong, mask, ray, certainty, start)
    certainty[70:90, 70:90] = 1e-3
    doubted = integration.depth(wrong, mask, ray, certainty, start)
    outside = mask.copy()
    outside[68:92, 68:92] = False
    assert rms_mm(doubted, depth, outside) < 0.15
    assert rms_mm(doubted, depth, outside) < 0.3 * rms_mm(believed, depth, outside)


def test_orthographic_depth_converges_where_pixels_of_little_weight_stand_among_others() -> None:
    """Against a direct solution of the same normal equations, but for the few pixels that stand quite alone."""
    rng = np.random.default_rng(0)
    v, u = np.mgrid[:120, :120]
    mask = np.hypot(u - 60, v - 60) < 54
    normal = np.stack(
        [(u - 60) / 60, (60 - v) / 60, np.sqrt(np.maximum(1 - ((u - 60) ** 2 + (v - 60) ** 2) / 3600, 0))]
    )
    normal = normal + 0.05 * rng.standard_normal(normal.shape)
    normal = (normal / np.linalg.norm(normal, axis=0)).astype(np.float32)
    certainty = np.where(rng.random(mask.shape) < 0.1, 1e-3, 1).astype(np.float32)
    estimate = integration.orthographic_depth(normal, mask, certainty)
    error = (estimate - least_squares_depth(normal, mask, certainty))[mask]
    assert np.quantile(np.abs(error), 0.999) < 0.05


def least_squares_depth(normal: Float32Array, mask: np.ndarray, certainty: Float32Array) -> np.ndarray:
    """Depth (H, W) of mean 0 by a direct solution: steps by the mean of both normals, weights as `integration` has."""
    number = np.full(mask.shape, -1)
    number[mask] = np.arange(np.count_nonzero(mask))
    rows, steps, weights = [], [], []
    for axis in (0, 1):
        first, second = (np.s_[:-1], np.s_[1:]) if axis == 0 else (np.s_[:, :-1], np.s_[:, 1:])
        both = mask[first] & mask[second]
        mean = normal[(slice(None), *np.index_exp[first])] + normal[(slice(None), *np.index_exp[second])]
        unit = mean / np.linalg.norm(mean, axis=0)
        cosine = np.maximum(unit[2], photometry.SETTINGS.min_view_cosine)
        steps.append(((unit[0] if axis else -unit[1]) / cosine)[both])
        weights.append((np.minimum(certainty[first], certainty[second]) * cosine**2)[both])
        rows.append(np.stack([number[first][both], number[second][both]], axis=1))
    ends, step, weight = np.concatenate(rows), np.concatenate(steps), np.concatenate(weights)
    count = np.arange(len(ends))
    difference = sparse.csr_matrix(
        (np.tile([-1.0, 1.0], len(ends)), (np.repeat(count, 2), ends.ravel())), (len(ends), number.max() + 1)
    )
    weighted = difference.T @ sparse.diags(weight.astype(float))
    depth = np.zeros(number.max() + 1)
    depth[1:] = spsolve((weighted @ difference)[1:, 1:].tocsc(), (weighted @ step)[1:])
    out = np.zeros(mask.shape)
    out[mask] = depth - np.mean(depth)
    return out


def slab(size: int = 128) -> tuple[np.ndarray, Float32Array, np.ndarray]:
    """Orthographic depth in pixels, normals (3, H, W) and mask of a ramp that ends in a cliff facing away."""
    v, u = np.mgrid[:size, :size]
    x, y = (u - size / 2) / size, -(v - size / 2) / size

    def height(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        rise = np.clip((x + 0.35) / 0.4, 0, 1)
        bump = 0.12 * np.exp(-((y / 0.15) ** 2)) * rise**2 * (3 - 2 * rise)
        return size * (np.where(x < 0.1, bump, 0) + 0.02 * np.sin(9 * x) * np.cos(8 * y))

    e = 1e-5
    gx, gy = ((height(x + a, y + b) - height(x - a, y - b)) / (2 * e * size) for a, b in ((e, 0), (0, e)))
    normal = np.stack([-gx, -gy, np.ones_like(gx)])
    return -height(x, y), (normal / np.linalg.norm(normal, axis=0)).astype(np.float32), np.hypot(x, y) < 0.47


def test_orthographic_depth_is_in_pixels() -> None:
    depth, normal, mask = slab()
    smooth = mask & (np.mgrid[:128, :128][1] < 70)
    estimate = integration.orthographic_depth(normal, smooth, np.ones(mask.shape, np.float32))
    error = (estimate - depth)[smooth]
    assert np.std(error) < 0.01
    assert abs(float(np.mean(estimate[smooth]))) < 1e-3
    assert np.all(estimate[~smooth] == 0)


def test_orthographic_depth_keep_steps_lowers_error() -> None:
    depth, normal, mask = slab()
    certainty = np.ones(mask.shape, np.float32)

    def error(keep_steps: bool) -> np.ndarray:
        off = (integration.orthographic_depth(normal, mask, certainty, keep_steps=keep_steps) - depth)[mask]
        return np.abs(off - np.median(off))

    smeared, kept = error(False), error(True)
    assert np.median(kept) < 0.3 * np.median(smeared)
    assert kept.mean() < 0.4 * smeared.mean()


def test_depth_keep_steps_smooth_surface_stays_accurate() -> None:
    depth, normal, ray = surface(0.2)
    mask = np.ones(depth.shape, np.bool_)
    start = np.full(mask.shape, np.exp(np.mean(np.log(depth))), np.float32)
    estimate = integration.depth(normal, mask, ray, np.ones(mask.shape, np.float32), start, keep_steps=True)
    assert rms_mm(estimate, depth, mask) < 0.1
