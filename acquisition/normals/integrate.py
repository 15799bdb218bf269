"""Normals to depth: least squares over the edges between neighbouring pixels, exact on any mask.

With rays r of a perspective (and distorted) image, a plane with normal n satisfies n·r Z = const, so two neighbours p
and q on it have log Z_q − log Z_p = log(n·r_p / n·r_q). Log depth is therefore linear in the unknowns, whatever the
lens. The normal equations are solved by conjugate gradients, preconditioned by a Poisson solve on the full rectangle by
cosine transforms: that needs about ten iterations where plain CG needs hundreds, and the mask's border stays exact.
Edges count by how surely both ends see the camera. Depth is known up to one factor per connected part, which the caller
gives.
"""

import cv2
import numpy as np
from scipy.fft import dctn, idctn

from acquisition.types import BoolArray, Float32Array

LEAST_COSINE = 0.1
"""Slopes are limited to surfaces seen at 84°: beyond, a normal's error moves depth without bound."""

ITERATIONS = 40
TOLERANCE = 1e-4


def depth(
    normals: Float32Array, mask: BoolArray, ray: Float32Array, certainty: Float32Array, start_m: Float32Array
) -> Float32Array:
    """Depth (h, w) in m along OpenCV's z; where `mask` is false it is `start_m`.

    `normals` (3, h, w) in the view frame, `ray` (2, h, w), `certainty` (h, w) in 0–1 weighs pixels. Each connected part
    of the mask keeps the mean log depth that `start_m` (h, w) gives it.
    """
    x, y, z = normals[0], -normals[1], -normals[2]  # OpenCV's frame
    columns = _steps(x, y, z, ray, mask, certainty, axis=1)
    rows = _steps(x, y, z, ray, mask, certainty, axis=0)
    log_start = np.log(start_m)
    solution = log_start + _conjugate_gradients(columns, rows, log_start, mask)
    parts, found = cv2.connectedComponents(mask.astype(np.uint8), connectivity=4)
    labels = np.asarray(found, dtype=np.intp)
    counts = np.maximum(np.bincount(labels.ravel(), minlength=parts), 1)
    shift = np.bincount(labels.ravel(), (log_start - solution).ravel(), minlength=parts) / counts
    shift[0] = 0.0
    return np.where(mask, np.exp(solution + shift[labels]), start_m).astype(np.float32)


def _steps(
    x: Float32Array,
    y: Float32Array,
    z: Float32Array,
    ray: Float32Array,
    mask: BoolArray,
    certainty: Float32Array,
    axis: int,
) -> tuple[Float32Array, Float32Array]:
    """Log-depth steps and weights of the edges along one axis."""
    here = (slice(None), slice(None, -1)) if axis == 1 else (slice(None, -1), slice(None))
    next_ = (slice(None), slice(1, None)) if axis == 1 else (slice(1, None), slice(None))
    nx, ny, nz = x[here] + x[next_], y[here] + y[next_], z[here] + z[next_]
    length = np.sqrt(nx * nx + ny * ny + nz * nz) + np.float32(1e-12)
    rx, ry = ray[0], ray[1]
    norm = np.sqrt(1 + rx[here] ** 2 + ry[here] ** 2)
    toward = -(nx * (rx[here] + rx[next_]) + ny * (ry[here] + ry[next_]) + 2 * nz) / (2 * length * norm)
    change = (nx * (rx[next_] - rx[here]) + ny * (ry[next_] - ry[here])) / (length * norm)
    cosine = np.maximum(toward, np.float32(LEAST_COSINE))
    both = mask[here] & mask[next_]
    weight = np.where(both, np.minimum(certainty[here], certainty[next_]) * cosine * cosine, 0)
    return (change / cosine).astype(np.float32), weight.astype(np.float32)


def _conjugate_gradients(
    columns: tuple[Float32Array, Float32Array],
    rows: tuple[Float32Array, Float32Array],
    start: Float32Array,
    mask: BoolArray,
) -> Float32Array:
    """The correction to `start` that minimises the weighted squared misfit of all steps."""
    (step_c, weight_c), (step_r, weight_r) = columns, rows
    height, width = mask.shape
    frequencies = (2 - 2 * np.cos(np.pi * np.arange(height) / height))[:, None] + (
        2 - 2 * np.cos(np.pi * np.arange(width) / width)
    )[None, :]
    frequencies[0, 0] = np.inf
    inside = mask.astype(np.float32)
    mean_weight = float(np.mean(weight_c[weight_c > 0])) if np.any(weight_c > 0) else 1.0
    inverse = (1.0 / (frequencies * mean_weight)).astype(np.float32)

    def gather(flow_c: Float32Array, flow_r: Float32Array) -> Float32Array:
        out = np.zeros((height, width), dtype=np.float32)
        out[:, 1:] += flow_c
        out[:, :-1] -= flow_c
        out[1:] += flow_r
        out[:-1] -= flow_r
        return out

    def precondition(residual: Float32Array) -> Float32Array:
        spectrum = dctn(residual, type=2, norm="ortho") * inverse
        return idctn(spectrum, type=2, norm="ortho") * inside

    solution = np.zeros((height, width), dtype=np.float32)
    residual = gather(
        (weight_c * (step_c - np.diff(start, axis=1))).astype(np.float32),
        (weight_r * (step_r - np.diff(start, axis=0))).astype(np.float32),
    )
    first = float(np.sqrt(np.vdot(residual, residual)))
    if first == 0.0:
        return solution
    conditioned = precondition(residual)
    direction = conditioned.copy()
    product = float(np.vdot(residual, conditioned))
    for _ in range(ITERATIONS):
        image = gather(weight_c * np.diff(direction, axis=1), weight_r * np.diff(direction, axis=0))
        length = product / float(np.vdot(direction, image))
        solution += np.float32(length) * direction
        residual -= np.float32(length) * image
        if float(np.sqrt(np.vdot(residual, residual))) < TOLERANCE * first:
            break
        conditioned = precondition(residual)
        previous, product = product, float(np.vdot(residual, conditioned))
        direction = conditioned + np.float32(product / previous) * direction
    return solution
