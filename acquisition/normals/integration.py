"""Normals to depth: least squares over the edges between neighbouring pixels, exact on any mask.

With rays r of a perspective (and distorted) image, a plane with normal n satisfies n·r Z = const, so two neighbours p
and q on it have log Z_q − log Z_p = log(n·r_p / n·r_q). Log depth is therefore linear in the unknowns, whatever the
lens; orthographic depth is so without a logarithm. The normal equations are solved by conjugate gradients,
preconditioned by a Poisson solve on the full rectangle by cosine transforms: that needs about ten iterations where
plain CG needs hundreds, and the mask's border stays exact. Edges count by how surely both ends see the camera.

Where the surface has steps, every least-squares surface is wrong by the step. `keep_steps` lets each pixel lean to the
neighbour, of the two on either side, that its normal agrees with (bilateral weights after Cao et al., ECCV 2022): right
at steps, a little less exact on smooth relief.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace

import cv2
import numpy as np

from acquisition.models.base import BoolArray, Float32Array
from acquisition.normals.poisson import Edges, Poisson

LEAST_COSINE = 0.1
"""Slopes are limited to surfaces seen at 84°: beyond, a normal's error moves depth without bound."""

STEP_ROUNDS = 12
SHARPNESS = 100.0
"""How firmly a pixel leans to one neighbour: the sigmoid's factor on squared misfits, in units of a pixel."""

LEAST_LEANING = 1e-3

SURE = np.float32(np.radians(3.0))
"""1 σ of normals that count half."""

STRIP = 128
"""Rows that are worked on at once where each pixel takes many helpers."""


def depth(
    normals: Float32Array, mask: BoolArray, ray: Float32Array, certainty: Float32Array, start_m: Float32Array,
    *, whole: Float32Array | None = None, keep_steps: bool = False,
) -> Float32Array:  # fmt: skip
    """Depth (h, w) in m along OpenCV's z; where `mask` is false it is `start_m`.

    `normals` (3, h, w) in the view frame, `ray` (2, h, w), `certainty` (h, w) in 0–1 weighs pixels. Each connected part
    of the mask keeps the mean log depth that `start_m` (h, w) gives it. Where the surface is not `whole` (h, w), 0–1,
    `start_m` tells its steps in place of the normals, which know of none.
    """
    log_start = np.log(start_m)
    edges = [_perspective(normals, ray, mask, certainty, axis, keep_steps) for axis in (0, 1)]
    if whole is not None:
        for axis, one in enumerate(edges):
            _step(one, log_start, whole, axis)
    del start_m, certainty, whole  # of large images each array counts
    pitch = float(np.median(np.abs(np.diff(ray[0], axis=1)))) if keep_steps and mask.shape[1] > 1 else 1.0
    solution = _integrated(edges, log_start, mask, pitch if keep_steps else None)
    return np.exp(solution, out=solution)


def certainty(variance: Float32Array) -> Float32Array:
    """How far normals are to be believed, 0–1; replaces their variance, rad² over both tangential directions."""
    variance /= SURE * SURE
    variance += 1
    np.divide(1, variance, out=variance)
    variance += np.float32(1e-3)
    return variance


def relief(
    normals: Float32Array, mask: BoolArray, certainty: Float32Array, *, keep_steps: bool = False
) -> Float32Array:
    """Orthographic depth (h, w) away from the camera in pixels, mean 0 over each connected part of the mask, else 0.

    `normals` (3, h, w) in the view frame, `certainty` (h, w) in 0–1 weighs pixels.
    """
    edges = [_orthographic(normals, mask, certainty, axis, keep_steps) for axis in (0, 1)]
    del certainty
    solution = _integrated(edges, np.zeros(mask.shape, np.float32), mask, 1.0 if keep_steps else None)
    solution[~mask] = 0
    return solution


Place = tuple[slice, slice]
Step = Callable[[Place, Place, Float32Array, Float32Array, Float32Array], tuple[Float32Array, Float32Array]]
"""From where two neighbours are, and the sum of their normals, the step between them and its cosine to the ray."""


def _ends(axis: int) -> tuple[Place, Place]:
    every = slice(None)
    return (
        ((every, slice(None, -1)), (every, slice(1, None)))
        if axis
        else ((slice(None, -1), every), (slice(1, None), every))
    )


def _strips(shape: tuple[int, ...], axis: int) -> Iterator[tuple[slice, Place, Place]]:
    """The edges along one axis in strips of rows: their rows among the edges, and where their ends are."""
    down, across = (0, 1) if axis else (1, 0)
    count, columns = shape[0] - down, shape[1] - across
    for start in range(0, count, STRIP):
        rows = slice(start, min(start + STRIP, count))
        yield (
            rows,
            (rows, slice(0, columns)),
            (slice(rows.start + down, rows.stop + down), slice(across, columns + across)),
        )


def _perspective(
    normals: Float32Array, ray: Float32Array, mask: BoolArray, certainty: Float32Array, axis: int, both_ends: bool
) -> Edges:
    """Log-depth steps along one axis."""
    rx, ry = ray[0], ray[1]

    def step(
        here: Place, there: Place, nx: Float32Array, ny: Float32Array, nz: Float32Array
    ) -> tuple[Float32Array, Float32Array]:
        ny, nz = -ny, -nz  # OpenCV's frame
        dx, dy = rx[there] - rx[here], ry[there] - ry[here]
        mx, my = (rx[there] + rx[here]) / 2, (ry[there] + ry[here]) / 2
        length = np.sqrt(1 + mx * mx + my * my)
        norm = np.sqrt(nx * nx + ny * ny + nz * nz) + np.float32(1e-12)
        cosine = np.maximum(-(nx * mx + ny * my + nz) / (norm * length), np.float32(LEAST_COSINE))
        return (nx * dx + ny * dy) / (norm * length * cosine), cosine

    return _edges(step, normals, mask, certainty, axis, both_ends)


def _step(edges: Edges, log_start: Float32Array, whole: Float32Array, axis: int) -> None:
    """Gives edges the steps of `log_start` (h, w) for that share by which an end is not `whole` (h, w)."""
    for rows, here, there in _strips(whole.shape, axis):
        share = np.minimum(whole[here], whole[there])
        told = (1 - share) * (log_start[there] - log_start[here])
        for step in (edges.step, *(edges.ends or ())):
            step[rows] = share * step[rows] + told


def _orthographic(normals: Float32Array, mask: BoolArray, certainty: Float32Array, axis: int, both_ends: bool) -> Edges:
    """Steps in pixels along one axis."""

    def step(
        here: Place, there: Place, nx: Float32Array, ny: Float32Array, nz: Float32Array
    ) -> tuple[Float32Array, Float32Array]:
        norm = np.sqrt(nx * nx + ny * ny + nz * nz) + np.float32(1e-12)
        cosine = np.maximum(nz / norm, np.float32(LEAST_COSINE))
        return (nx if axis else -ny) / (norm * cosine), cosine

    return _edges(step, normals, mask, certainty, axis, both_ends)


def _edges(
    step: Step, normals: Float32Array, mask: BoolArray, certainty: Float32Array, axis: int, both_ends: bool
) -> Edges:
    size = (mask.shape[0] - (axis == 0), mask.shape[1] - (axis == 1))
    mean, weight = np.empty(size, np.float32), np.empty(size, np.float32)
    ends = (np.empty(size, np.float32), np.empty(size, np.float32)) if both_ends else None
    for rows, here, there in _strips(mask.shape, axis):
        first, second = normals[:, *here], normals[:, *there]
        mean[rows], cosine = step(here, there, *(first + second))
        both = mask[here] & mask[there]
        weight[rows] = np.where(both, np.minimum(certainty[here], certainty[there]) * cosine * cosine, 0)
        for end, own in zip(ends or (), (first, second), strict=False):
            end[rows] = step(here, there, *own)[0]
    return Edges(mean, ends, weight)


def _integrated(edges: list[Edges], start: Float32Array, mask: BoolArray, pitch: float | None) -> Float32Array:
    """The solution (h, w); each connected part of the mask keeps the mean of `start`. `pitch`: steps are kept.

    Takes the `edges` out of their list.
    """
    solver = Poisson(mask)
    kept = [] if pitch is None else list(edges)
    solution = solver.solve(edges, start, against_flat=True)
    for _ in range(STEP_ROUNDS if pitch is not None else 0):
        assert pitch is not None  # noqa: S101
        before = solution
        solution = solver.solve([_leaning(one, solution, axis, pitch) for axis, one in enumerate(kept)], solution)
        if float(np.mean(np.abs(solution - before)[mask])) < 1e-3 * pitch:
            break
    parts, found = cv2.connectedComponents(np.ascontiguousarray(mask).view(np.uint8), connectivity=4)
    labels = np.asarray(found, np.int32)
    counts, total = np.zeros(parts, np.int64), np.zeros(parts)
    strips = [slice(first, first + STRIP) for first in range(0, len(labels), STRIP)]
    for rows in strips:
        here = labels[rows].ravel()
        counts += np.bincount(here, minlength=parts)
        total += np.bincount(here, (start[rows] - solution[rows]).ravel(), minlength=parts)
    shift = (total / np.maximum(counts, 1)).astype(np.float32)
    shift[0] = 0.0
    for rows in strips:
        solution[rows] += shift[labels[rows]]
    return solution


def _leaning(edges: Edges, solution: Float32Array, axis: int, pitch: float) -> Edges:
    """The edges when each pixel leans to the side that its own normal agrees with."""
    assert edges.ends is not None  # noqa: S101
    here, there = _ends(axis)
    first, second = edges.ends
    change = solution[there] - solution[here]
    inside = edges.weight > 0
    forward = np.full(solution.shape, np.nan, np.float32)  # misfit of a pixel's own normal at the edge ahead of it
    backward = np.full(solution.shape, np.nan, np.float32)
    forward[here] = np.where(inside, ((change - first) / pitch) ** 2, np.nan)
    backward[there] = np.where(inside, ((change - second) / pitch) ** 2, np.nan)
    # Where a side has no neighbour, nothing is to be chosen.
    ahead = np.nan_to_num(backward - forward, nan=0.0)
    share = 1 / (1 + np.exp(-np.clip(SHARPNESS * ahead, -30, 30)))
    one, other = share[here] + LEAST_LEANING, (1 - share)[there] + LEAST_LEANING
    step = (one * first + other * second) / (one + other)
    return replace(edges, step=step.astype(np.float32), weight=(edges.weight * (one + other)).astype(np.float32))
