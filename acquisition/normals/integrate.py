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
from dataclasses import dataclass, replace

import cv2
import numba
import numpy as np
from scipy.fft import dctn, idctn, next_fast_len

from acquisition.types import BoolArray, Float32Array

LEAST_COSINE = 0.1
"""Slopes are limited to surfaces seen at 84°: beyond, a normal's error moves depth without bound."""

ITERATIONS = 60
TOLERANCE = 1e-4

STEP_ROUNDS = 12
SHARPNESS = 100.0
"""How firmly a pixel leans to one neighbour: the sigmoid's factor on squared misfits, in units of a pixel."""

LEAST_LEANING = 1e-3

STRIP = 128
"""Rows that are worked on at once where each pixel takes many helpers."""

SHARED_FROM_PIXELS = 1 << 16
"""A cosine transform of fewer pixels takes less time than sharing it out between threads."""


@dataclass(frozen=True)
class _Edges:
    """Edges between neighbours along one axis: the step that the mean of both normals gives, the steps that the first
    and the second end give (none unless steps are kept), and the weight, 0 where an end is outside."""

    step: Float32Array
    ends: tuple[Float32Array, Float32Array] | None
    weight: Float32Array


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
) -> _Edges:
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


def _step(edges: _Edges, log_start: Float32Array, whole: Float32Array, axis: int) -> None:
    """Gives edges the steps of `log_start` (h, w) for that share by which an end is not `whole` (h, w)."""
    for rows, here, there in _strips(whole.shape, axis):
        share = np.minimum(whole[here], whole[there])
        edges.step[rows] = share * edges.step[rows] + (1 - share) * (log_start[there] - log_start[here])


def _orthographic(
    normals: Float32Array, mask: BoolArray, certainty: Float32Array, axis: int, both_ends: bool
) -> _Edges:
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
) -> _Edges:
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
    return _Edges(mean, ends, weight)


def _integrated(edges: list[_Edges], start: Float32Array, mask: BoolArray, pitch: float | None) -> Float32Array:
    """The solution (h, w); each connected part of the mask keeps the mean of `start`. `pitch`: steps are kept.

    Takes the `edges` out of their list.
    """
    solver = _Poisson(mask)
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


def _leaning(edges: _Edges, solution: Float32Array, axis: int, pitch: float) -> _Edges:
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


class _Poisson:
    """Conjugate gradients for Σ w (difference − step)², on the mask's bounding box, which is filled up to a size that
    cosine transforms are fast at."""

    def __init__(self, mask: BoolArray) -> None:
        there = [np.flatnonzero(np.any(mask, axis=axis)) for axis in (1, 0)]
        low = [int(one[0]) if len(one) else 0 for one in there]
        high = [int(one[-1]) + 1 if len(one) else 1 for one in there]
        self._window = (slice(low[0], high[0]), slice(low[1], high[1]))
        size = [next_fast_len(stop - start, real=True) for start, stop in zip(low, high, strict=True)]
        self._shape = (size[0], size[1])
        self._inside = self._filled(mask[self._window].astype(np.float32))
        along = [(2 - 2 * np.cos(np.pi * np.arange(length) / length)).astype(np.float32) for length in size]
        self._inverse = along[0][:, None] + along[1][None, :]
        self._inverse[0, 0] = np.inf
        np.divide(np.float32(1), self._inverse, out=self._inverse)

    def solve(self, edges: list[_Edges], start: Float32Array, *, against_flat: bool = False) -> Float32Array:
        """The best solution (h, w) found from `start` (h, w), which it keeps outside the mask's edges.

        Takes the `edges`, of rows and of columns, out of their list: of large images each array counts.

        Ends when TOLERANCE of the misfit of `start` is left, or, `against_flat`, of a flat surface's if that is larger:
        who starts near the end needs no more digits than who does not.
        """
        down, steps_down = self._edges(edges.pop(0), axis=0)
        across, steps_across = self._edges(edges.pop(0), axis=1)
        size = self._shape
        residual = np.empty(size, np.float32)
        _misfit(self._filled(start[self._window]), steps_down, steps_across, down, across, residual)
        first = float(np.vdot(residual, residual))
        if first == 0.0:
            return start.copy()
        if against_flat:
            flat = np.empty(size, np.float32)
            _misfit(np.zeros(size, np.float32), steps_down, steps_across, down, across, flat)
            first = max(first, float(np.vdot(flat, flat)))
            del flat
        del steps_down, steps_across
        scale = float(1 / np.mean(across[across > 0])) if np.any(across > 0) else 1.0
        solution, direction = np.zeros(size, np.float32), np.zeros(size, np.float32)
        previous = 1.0
        workers = -1 if residual.size >= SHARED_FROM_PIXELS else 1
        for turn in range(ITERATIONS):
            spectrum = dctn(residual, type=2, norm="ortho", workers=workers, overwrite_x=False)
            spectrum *= self._inverse
            conditioned = idctn(spectrum, type=2, norm="ortho", workers=workers, overwrite_x=True)
            product = scale * _product(residual, conditioned, self._inside)
            _advance(direction, conditioned, self._inside, scale, product / previous if turn else 0.0)
            previous = product
            image = conditioned  # which is not needed any more
            length = product / max(_apply(direction, down, across, image), 1e-30)
            left = _descend(solution, residual, direction, image, length)
            del spectrum, conditioned, image  # before the next transform takes as much again
            if left < TOLERANCE**2 * first:
                break
        del residual, direction, down, across
        out = start.copy()
        out[self._window] += solution[: out[self._window].shape[0], : out[self._window].shape[1]]
        return out

    def _edges(self, edges: _Edges, axis: int) -> tuple[Float32Array, Float32Array]:
        """Weights and steps within the window, as many as pixels: the last of each line is empty."""
        rows, columns = self._window
        cut = (slice(rows.start, rows.stop - (axis == 0)), slice(columns.start, columns.stop - (axis == 1)))
        return self._filled(edges.weight[cut]), self._filled(edges.step[cut])

    def _filled(self, values: Float32Array) -> Float32Array:
        filled = np.zeros(self._shape, np.float32)
        filled[: values.shape[0], : values.shape[1]] = values
        return filled


_STRIP = 16
"""Rows that one thread takes at a time."""


@numba.njit(
    "void(float32[:,::1], float32[:,::1], float32[:,::1], float32[:,::1], float32[:,::1], float32[:,::1])",
    cache=True, parallel=True, error_model="numpy",
)  # fmt: skip
def _misfit(
    start: Float32Array, step_down: Float32Array, step_across: Float32Array, down: Float32Array, across: Float32Array,
    out: Float32Array,
) -> None:  # fmt: skip
    """Minus half the gradient of Σ w (difference − step)² at `start`."""
    height, width = start.shape
    for i in numba.prange(height):
        for j in range(width):
            total = np.float32(0)
            here = start[i, j]
            if i > 0:
                total += down[i - 1, j] * (step_down[i - 1, j] - here + start[i - 1, j])
            if i + 1 < height:
                total -= down[i, j] * (step_down[i, j] - start[i + 1, j] + here)
            if j > 0:
                total += across[i, j - 1] * (step_across[i, j - 1] - here + start[i, j - 1])
            if j + 1 < width:
                total -= across[i, j] * (step_across[i, j] - start[i, j + 1] + here)
            out[i, j] = total


@numba.njit(
    "float64(float32[:,::1], float32[:,::1], float32[:,::1], float32[:,::1])",
    cache=True, parallel=True, fastmath=True, error_model="numpy",
)  # fmt: skip
def _apply(x: Float32Array, down: Float32Array, across: Float32Array, out: Float32Array) -> float:
    """out = A x, and xᵀ A x; weights at the last row and column are zero."""
    height, width = x.shape
    total = 0.0
    for strip in numba.prange((height + _STRIP - 1) // _STRIP):
        part = 0.0
        for i in range(strip * _STRIP, min((strip + 1) * _STRIP, height)):
            above, below = max(i - 1, 0), min(i + 1, height - 1)
            keep = np.float32(0) if i == 0 else np.float32(1)
            line = np.float32(0)
            for j in range(1, width - 1):
                here = x[i, j]
                value = keep * down[above, j] * (here - x[above, j]) + down[i, j] * (here - x[below, j])
                value += across[i, j - 1] * (here - x[i, j - 1]) + across[i, j] * (here - x[i, j + 1])
                out[i, j] = value
                line += value * here
            for j in (0, width - 1):
                here = x[i, j]
                value = keep * down[above, j] * (here - x[above, j]) + down[i, j] * (here - x[below, j])
                if j > 0:
                    value += across[i, j - 1] * (here - x[i, j - 1])
                if j + 1 < width:
                    value += across[i, j] * (here - x[i, j + 1])
                out[i, j] = value
                line += value * here
            part += line
        total += part
    return float(total)


@numba.njit(
    "float64(float32[:,::1], float32[:,::1], float32[:,::1])",
    cache=True, parallel=True, fastmath=True, error_model="numpy",
)  # fmt: skip
def _product(a: Float32Array, b: Float32Array, inside: Float32Array) -> float:
    """Σ a b over the mask."""
    total = 0.0
    for i in numba.prange(a.shape[0]):
        line = np.float32(0)
        for j in range(a.shape[1]):
            line += a[i, j] * b[i, j] * inside[i, j]
        total += line
    return float(total)


@numba.njit(
    "void(float32[:,::1], float32[:,::1], float32[:,::1], float32, float32)",
    cache=True, parallel=True, fastmath=True, error_model="numpy",
)  # fmt: skip
def _advance(
    direction: Float32Array, conditioned: Float32Array, inside: Float32Array, scale: float, keep: float
) -> None:
    """direction = scale · conditioned within the mask + keep · direction."""
    for i in numba.prange(direction.shape[0]):
        for j in range(direction.shape[1]):
            direction[i, j] = scale * conditioned[i, j] * inside[i, j] + keep * direction[i, j]


@numba.njit(
    "float64(float32[:,::1], float32[:,::1], float32[:,::1], float32[:,::1], float32)",
    cache=True, parallel=True, fastmath=True, error_model="numpy",
)  # fmt: skip
def _descend(
    solution: Float32Array, residual: Float32Array, direction: Float32Array, image: Float32Array, length: float
) -> float:
    """Moves along the direction and returns the residual's square."""
    total = 0.0
    for i in numba.prange(solution.shape[0]):
        line = np.float32(0)
        for j in range(solution.shape[1]):
            solution[i, j] += length * direction[i, j]
            residual[i, j] -= length * image[i, j]
            line += residual[i, j] * residual[i, j]
        total += line
    return float(total)


KERNELS = (_misfit, _apply, _product, _advance, _descend)
