"""Weighted least squares on grid edges by conjugate gradients with a discrete-cosine-transform Poisson preconditioner.

On the full rectangle with equal weights, the normal equations are a Poisson equation with Neumann boundary, which two
cosine transforms solve. With that as preconditioner about ten iterations do where plain CG needs hundreds (1 MP: 1.3 s
in nine; sparse Cholesky 8.2 s), and any mask's border stays exact. Of large images each array counts, so the few arrays
are filled in place.

Kernels compile at import, into numba's cache.
"""

from dataclasses import dataclass

import numba
import numpy as np
from scipy.fft import dctn, idctn, next_fast_len

from acquisition.models.base import BoolArray, Float32Array
from acquisition.normals import silhouette

ITERATIONS = 60
TOLERANCE = 1e-4
"""Residual, relative to the starting one, at which the iteration ends."""

SHARED_FROM_PIXELS = 1 << 16
"""Pixels from which a cosine transform runs on several threads: below, starting them takes longer."""


@dataclass(frozen=True)
class Edges:
    """Edges between neighbours along one axis: depth difference and weight of each.

    `step` is from the mean of both normals, `ends` from the first and from the second one (none unless bilateral);
    `weight` is 0 where an end is outside the mask.
    """

    step: Float32Array
    ends: tuple[Float32Array, Float32Array] | None
    weight: Float32Array


class Poisson:
    """Preconditioned conjugate gradients for min Σ w (difference − step)² on the mask's bounding box.

    The box is padded to a size for which cosine transforms are fast.
    """

    def __init__(self, mask: BoolArray) -> None:
        self._window = silhouette.bounding_box(mask)
        inside = mask[self._window]
        size = [next_fast_len(length, real=True) for length in inside.shape]
        self._shape = (size[0], size[1])
        self._inside = np.zeros(self._shape, np.bool_)
        self._inside[: inside.shape[0], : inside.shape[1]] = inside
        values = [(2 - 2 * np.cos(np.pi * np.arange(length) / length)).astype(np.float32) for length in size]
        self._eigenvalues = (values[0], values[1])

    def solve(self, edges: list[Edges], start: Float32Array, *, against_flat: bool = False) -> Float32Array:
        """Least-squares solution (h, w) from `start` (h, w), whose values stay outside the mask.

        Removes the `edges`, of rows and of columns, from their list: of large images each array counts.

        Ends when the gradient has fallen to TOLERANCE of that of `start` or, `against_flat`, of a flat surface if that
        is larger: a start near the solution needs no more digits than another.
        """
        down, steps_down = self._edges(edges.pop(0), axis=0)
        across, steps_across = self._edges(edges.pop(0), axis=1)
        size = self._shape
        residual = np.empty(size, np.float32)
        _negative_gradient(self._filled(start[self._window]), steps_down, steps_across, down, across, residual)
        first = float(np.vdot(residual, residual))
        if first == 0.0:
            return start.copy()
        if against_flat:
            flat = np.empty(size, np.float32)
            _negative_gradient(np.zeros(size, np.float32), steps_down, steps_across, down, across, flat)
            first = max(first, float(np.vdot(flat, flat)))
            del flat
        del steps_down, steps_across
        scale = float(1 / np.mean(across[across > 0])) if np.any(across > 0) else 1.0
        solution, direction = np.zeros(size, np.float32), np.zeros(size, np.float32)
        previous = 1.0
        workers = -1 if residual.size >= SHARED_FROM_PIXELS else 1
        for iteration in range(ITERATIONS):
            spectrum = dctn(residual, type=2, norm="ortho", workers=workers, overwrite_x=False)
            _divide(spectrum, *self._eigenvalues)
            conditioned = idctn(spectrum, type=2, norm="ortho", workers=workers, overwrite_x=True)
            product = scale * _product(residual, conditioned, self._inside)
            _advance(direction, conditioned, self._inside, scale, product / previous if iteration else 0.0)
            previous = product
            image = conditioned  # its memory is free
            length = product / max(_apply(direction, down, across, image), 1e-30)
            left = _descend(solution, residual, direction, image, length)
            del spectrum, conditioned, image  # before the next transform takes as much again
            if left < TOLERANCE**2 * first:
                break
        del residual, direction, down, across
        out = start.copy()
        out[self._window] += solution[: out[self._window].shape[0], : out[self._window].shape[1]]
        return out

    def _edges(self, edges: Edges, axis: int) -> tuple[Float32Array, Float32Array]:
        """Weights and steps within the window, padded to one per pixel: the last of each line is zero."""
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
def _negative_gradient(
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
    "void(float32[:,::1], float32[::1], float32[::1])",
    cache=True, parallel=True, error_model="numpy",
)  # fmt: skip
def _divide(spectrum: Float32Array, down: Float32Array, across: Float32Array) -> None:
    """Poisson solve in the cosine basis: the spectrum over the Laplacian's eigenvalues, zero mean."""
    for i in numba.prange(spectrum.shape[0]):
        for j in range(spectrum.shape[1]):
            spectrum[i, j] *= np.float32(1) / (down[i] + across[j])
    spectrum[0, 0] = np.float32(0)


@numba.njit(
    "float64(float32[:,::1], float32[:,::1], boolean[:,::1])",
    cache=True, parallel=True, fastmath=True, error_model="numpy",
)  # fmt: skip
def _product(a: Float32Array, b: Float32Array, inside: BoolArray) -> float:
    """Σ a b over the mask."""
    total = 0.0
    for i in numba.prange(a.shape[0]):
        line = np.float32(0)
        for j in range(a.shape[1]):
            line += a[i, j] * b[i, j] if inside[i, j] else np.float32(0)
        total += line
    return float(total)


@numba.njit(
    "void(float32[:,::1], float32[:,::1], boolean[:,::1], float32, float32)",
    cache=True, parallel=True, fastmath=True, error_model="numpy",
)  # fmt: skip
def _advance(direction: Float32Array, conditioned: Float32Array, inside: BoolArray, scale: float, keep: float) -> None:
    """direction = scale · conditioned within the mask + keep · direction."""
    for i in numba.prange(direction.shape[0]):
        for j in range(direction.shape[1]):
            step = scale * conditioned[i, j] if inside[i, j] else np.float32(0)
            direction[i, j] = step + keep * direction[i, j]


@numba.njit(
    "float64(float32[:,::1], float32[:,::1], float32[:,::1], float32[:,::1], float32)",
    cache=True, parallel=True, fastmath=True, error_model="numpy",
)  # fmt: skip
def _descend(
    solution: Float32Array, residual: Float32Array, direction: Float32Array, image: Float32Array, length: float
) -> float:
    """Updates solution and residual along the direction; the squared norm of the residual."""
    total = 0.0
    for i in numba.prange(solution.shape[0]):
        line = np.float32(0)
        for j in range(solution.shape[1]):
            solution[i, j] += length * direction[i, j]
            residual[i, j] -= length * image[i, j]
            line += residual[i, j] * residual[i, j]
        total += line
    return float(total)


KERNELS = (_negative_gradient, _apply, _divide, _product, _advance, _descend)
