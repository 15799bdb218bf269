"""Weighted least-squares normal integration (Horn & Brooks 1986; Quéau, Durou & Aujol 2018) on any mask.

A plane with normal n satisfies n·r Z = const along the rays r of a perspective (and distorted) image. Two neighbours p
and q on it therefore have log Z_q − log Z_p = log(n·r_p / n·r_q). This is linear in log depth, whatever the lens;
orthographic depth is linear without a logarithm. The normal equations are solved by conjugate gradients with a DCT
Poisson preconditioner (`poisson`). Edges are weighted by the confidence of both ends and by how frontal they are.

At a depth discontinuity any least-squares surface is wrong by the step. `keep_steps` adds bilateral normal integration
(Cao et al., ECCV 2022) by iteratively reweighted least squares: each pixel's one-sided differences are weighted towards
the side that agrees with its own normal. It is right at discontinuities, but less exact on smooth relief.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array
from acquisition.models.tuned import tuned
from acquisition.normals.surface.poisson import Edges, Poisson


@dataclass(frozen=True)
class IntegrationSettings:
    """Tuned number of the integration of depth."""

    bilateral_sharpness: float = tuned(100.0, "1/px²")
    """Steepness k of the sigmoid of the bilateral weights, on squared residuals in units of a pixel. A larger value
    keeps steps sharper; with a small one they are smoothed as by least squares, as with 2.8 a step between noiseless
    planes (`test_integration`). Measured: depth of 20 scenes from true normals with 2° of noise errs by 2.03 mm, with
    half of it by 1.95, with twice 2.11, with 2.8 1.82 (design seeds 40–43, scratch evaluation, November 2026)."""


SETTINGS = IntegrationSettings()

BILATERAL_ROUNDS = 12
"""Largest number of reweightings."""

LEAST_BILATERAL_WEIGHT = 1e-3
"""Least bilateral weight; it keeps the system well conditioned."""

STRIP_ROWS = 128
"""Rows processed at once where each pixel needs many temporaries."""


def depth(
    normals: Float32Array, mask: BoolArray, ray: Float32Array, confidence: Float32Array, start_m: Float32Array,
    *, continuity_weight: Float32Array | None = None, keep_steps: bool = False,
) -> Float32Array:  # fmt: skip
    """Integrates normals in log depth: depth (h, w) in m along OpenCV's z of a perspective image.

    `normals` (3, h, w) are in the view frame, `ray` (2, h, w) are X/Z and Y/Z, and `confidence` (h, w), 0–1, weights
    pixels. The depth is `start_m` (h, w) outside `mask`, and each connected part of the mask keeps the mean log depth
    of `start_m`. Normals do not show discontinuities, so depth differences are mixed by `continuity_weight` w (h, w),
    0–1: the share w comes from the normals, 1 − w from `start_m`.
    """
    log_start = np.log(start_m)
    edges = [_perspective(normals, ray, mask, confidence, axis, keep_steps) for axis in (0, 1)]
    if continuity_weight is not None:
        for axis, along_axis in enumerate(edges):
            _blend_start(along_axis, log_start, continuity_weight, axis)
    del start_m, confidence, continuity_weight  # frees memory of large images
    pitch = float(np.median(np.abs(np.diff(ray[0], axis=1)))) if keep_steps and mask.shape[1] > 1 else 1.0
    solution = _solve(edges, log_start, mask, pitch if keep_steps else None)
    return np.exp(solution, out=solution)


def confidence(variance: Float32Array) -> Float32Array:
    """Confidence of normals, 0–1, by variance, rad², of both tangential directions; ½ at `weakly_checked_sigma_deg`."""
    out = variance / np.float32(np.radians(photometry.SETTINGS.weakly_checked_sigma_deg) ** 2)
    out += 1
    np.divide(1, out, out=out)
    out += np.float32(1e-3)
    return out


def orthographic_depth(
    normals: Float32Array, mask: BoolArray, confidence: Float32Array, *, keep_steps: bool = False
) -> Float32Array:
    """Integrates normals of an orthographic image: depth (h, w) away from the camera in pixels.

    Its mean is 0 over each connected part of the mask; outside the mask it is 0. `normals` (3, h, w) are in the view
    frame, `confidence` (h, w), 0–1, weights pixels.
    """
    edges = [_orthographic(normals, mask, confidence, axis, keep_steps) for axis in (0, 1)]
    del confidence
    solution = _solve(edges, np.zeros(mask.shape, np.float32), mask, 1.0 if keep_steps else None)
    solution[~mask] = 0
    return solution


Window = tuple[slice, slice]
"""Rows and columns of an image."""

DepthStep = Callable[[Window, Window, Float32Array, Float32Array, Float32Array], tuple[Float32Array, Float32Array]]
"""Computes the depth differences of neighbours, and the cosine of their surface to the ray, from the windows of the
first and of the second pixels and the components of their summed normals."""


def _ends(axis: int) -> tuple[Window, Window]:
    """Returns the windows of the first and of the second pixels of all edges along one axis."""
    full = slice(None)
    return (
        ((full, slice(None, -1)), (full, slice(1, None))) if axis else ((slice(None, -1), full), (slice(1, None), full))
    )


def _strips(shape: tuple[int, ...], axis: int) -> Iterator[tuple[slice, Window, Window]]:
    """Iterates over the edges along one axis in strips: their rows among the edges, and the windows of both ends."""
    down, across = (0, 1) if axis else (1, 0)
    count, columns = shape[0] - down, shape[1] - across
    for start in range(0, count, STRIP_ROWS):
        rows = slice(start, min(start + STRIP_ROWS, count))
        yield (
            rows,
            (rows, slice(0, columns)),
            (slice(rows.start + down, rows.stop + down), slice(across, columns + across)),
        )


def _perspective(
    normals: Float32Array, ray: Float32Array, mask: BoolArray, confidence: Float32Array, axis: int, both_ends: bool
) -> Edges:
    """Returns the edges of log depth along one axis."""
    rx, ry = ray[0], ray[1]

    def step(
        first: Window, second: Window, nx: Float32Array, ny: Float32Array, nz: Float32Array
    ) -> tuple[Float32Array, Float32Array]:
        ny, nz = -ny, -nz  # OpenCV's frame
        dx, dy = rx[second] - rx[first], ry[second] - ry[first]
        mx, my = (rx[second] + rx[first]) / 2, (ry[second] + ry[first]) / 2
        length = np.sqrt(1 + mx * mx + my * my)
        norm = np.sqrt(nx * nx + ny * ny + nz * nz) + np.float32(1e-12)
        cosine = np.maximum(
            -(nx * mx + ny * my + nz) / (norm * length), np.float32(photometry.SETTINGS.min_view_cosine)
        )
        return (nx * dx + ny * dy) / (norm * length * cosine), cosine

    return _edges(step, normals, mask, confidence, axis, both_ends)


def _blend_start(edges: Edges, log_start: Float32Array, continuity_weight: Float32Array, axis: int) -> None:
    """Mixes the steps of edges, in place, with those of `log_start` (h, w) where the weight (h, w) is below 1."""
    for rows, first, second in _strips(continuity_weight.shape, axis):
        share = np.minimum(continuity_weight[first], continuity_weight[second])
        discontinuous = (1 - share) * (log_start[second] - log_start[first])
        for step in (edges.step, *(edges.ends or ())):
            step[rows] = share * step[rows] + discontinuous


def _orthographic(
    normals: Float32Array, mask: BoolArray, confidence: Float32Array, axis: int, both_ends: bool
) -> Edges:
    """Returns the edges of orthographic depth, in pixels, along one axis."""

    def step(
        first: Window, second: Window, nx: Float32Array, ny: Float32Array, nz: Float32Array
    ) -> tuple[Float32Array, Float32Array]:
        norm = np.sqrt(nx * nx + ny * ny + nz * nz) + np.float32(1e-12)
        cosine = np.maximum(nz / norm, np.float32(photometry.SETTINGS.min_view_cosine))
        return (nx if axis else -ny) / (norm * cosine), cosine

    return _edges(step, normals, mask, confidence, axis, both_ends)


def _edges(
    step: DepthStep, normals: Float32Array, mask: BoolArray, confidence: Float32Array, axis: int, both_ends: bool
) -> Edges:
    """Returns steps and weights of all edges along one axis; with `both_ends` also the steps by each end's normal."""
    size = (mask.shape[0] - (axis == 0), mask.shape[1] - (axis == 1))
    mean, weight = np.empty(size, np.float32), np.empty(size, np.float32)
    ends = (np.empty(size, np.float32), np.empty(size, np.float32)) if both_ends else None
    for rows, first, second in _strips(mask.shape, axis):
        first_normal, second_normal = normals[:, *first], normals[:, *second]
        mean[rows], cosine = step(first, second, *(first_normal + second_normal))
        both = mask[first] & mask[second]
        weight[rows] = np.where(both, np.minimum(confidence[first], confidence[second]) * cosine * cosine, 0)
        for end, own in zip(ends or (), (first_normal, second_normal), strict=False):
            end[rows] = step(first, second, *own)[0]
    return Edges(mean, ends, weight)


def _solve(edges: list[Edges], start: Float32Array, mask: BoolArray, pitch: float | None) -> Float32Array:
    """Solves least squares (h, w), bilateral if `pitch` is given; each connected part keeps the mean of `start`.
    Removes the `edges` from their list, to free memory."""
    solver = Poisson(mask)
    original = [] if pitch is None else list(edges)
    solution = solver.solve(edges, start, against_flat=True)
    for _ in range(BILATERAL_ROUNDS if pitch is not None else 0):
        assert pitch is not None  # noqa: S101
        before = solution
        reweighted = [_bilateral(along_axis, solution, axis, pitch) for axis, along_axis in enumerate(original)]
        solution = solver.solve(reweighted, solution)
        if float(np.mean(np.abs(solution - before)[mask])) < 1e-3 * pitch:
            break
    parts, components = cv2.connectedComponents(np.ascontiguousarray(mask).view(np.uint8), connectivity=4)
    labels = np.asarray(components, np.int32)
    counts, total = np.zeros(parts, np.int64), np.zeros(parts)
    strips = [slice(first, first + STRIP_ROWS) for first in range(0, len(labels), STRIP_ROWS)]
    for rows in strips:
        label = labels[rows].ravel()
        counts += np.bincount(label, minlength=parts)
        total += np.bincount(label, (start[rows] - solution[rows]).ravel(), minlength=parts)
    shift = (total / np.maximum(counts, 1)).astype(np.float32)
    shift[0] = 0.0
    for rows in strips:
        solution[rows] += shift[labels[rows]]
    return solution


def _bilateral(edges: Edges, solution: Float32Array, axis: int, pitch: float) -> Edges:
    """Weights each pixel's one-sided differences by how well its normal fits them (bilateral; Cao et al. 2022)."""
    assert edges.ends is not None  # noqa: S101
    first, second = _ends(axis)
    first_step, second_step = edges.ends
    change = solution[second] - solution[first]
    inside = edges.weight > 0
    forward = np.full(solution.shape, np.nan, np.float32)  # squared residual of a pixel's own normal at the edge ahead
    backward = np.full(solution.shape, np.nan, np.float32)
    forward[first] = np.where(inside, ((change - first_step) / pitch) ** 2, np.nan)
    backward[second] = np.where(inside, ((change - second_step) / pitch) ** 2, np.nan)
    # Of a pixel with a neighbour on one side only, both sides get the same weight.
    ahead = np.nan_to_num(backward - forward, nan=0.0)
    share = 1 / (1 + np.exp(-np.clip(SETTINGS.bilateral_sharpness * ahead, -30, 30)))
    w1, w2 = share[first] + LEAST_BILATERAL_WEIGHT, (1 - share)[second] + LEAST_BILATERAL_WEIGHT
    step = (w1 * first_step + w2 * second_step) / (w1 + w2)
    return replace(edges, step=step.astype(np.float32), weight=(edges.weight * (w1 + w2)).astype(np.float32))
