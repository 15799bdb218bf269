"""Regularisation of uncertain normals: inverse-variance weighted mean of a normal and the mean of its neighbours.

Beside a wall three or four lights are left, one of them perhaps in penumbra, and the normal of a single pixel can be
wrong by thirty degrees. Its eight neighbours are one more measurement of it: their mean, whose variance is theirs plus
their scatter, so that it weighs little next to an edge. A pixel of small σ is left unchanged, which preserves fine
relief, and uncertain neighbours are left out: the same lights are missing there, so that they share the error.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from acquisition.models.base import Float32Array
from acquisition.models.tuned import tuned


@dataclass(frozen=True)
class RegularisationSettings:
    """Tuned numbers of the smoothing of uncertain pixels."""

    unsure_deg: float = tuned(4.0, "deg")
    """σ from which a pixel is regularised: 0.5–1 % of the pixels of simulated parts and figures under eight lights.
    With 2° pilots lose detail and plans suffer."""
    curved_deg: float = tuned(1.0, "deg")
    """1 σ of the angle between a pixel's normal and its neighbours' mean where these agree: the surface's curvature."""
    least_length: float = tuned(0.5, "1")
    """Length of the mean of unit normals below which it has no direction."""


SETTINGS = RegularisationSettings()

STRIP_ROWS = 256


def smooth_uncertain(normals: Float32Array, sigma_deg: Float32Array) -> None:
    """Inverse-variance weighted mean of uncertain unit normals (H, W, 3) with their neighbours' mean, in place.

    `sigma_deg` (H, W) is 1 σ over both tangential directions, as in NormalMap, NaN where there is no normal;
    it is lowered too. All neighbours enter with their values before the call.
    """
    height = len(sigma_deg)
    above = normals[:0].copy(), sigma_deg[:0].copy()
    for start in range(0, height, STRIP_ROWS):
        stop, after = min(start + STRIP_ROWS, height), min(start + STRIP_ROWS + 1, height)
        strip = np.concatenate([above[0], normals[start:after]]), np.concatenate([above[1], sigma_deg[start:after]])
        first = len(above[0])
        above = normals[stop - 1 : stop].copy(), sigma_deg[stop - 1 : stop].copy()
        rows, columns = np.nonzero(strip[1][first : first + stop - start] > SETTINGS.unsure_deg)
        if len(rows):
            smoothed = _smooth(*strip, (rows + first, columns))
            normals[rows + start, columns], sigma_deg[rows + start, columns] = smoothed


def _smooth(
    normals: Float32Array, sigma_deg: Float32Array, uncertain: tuple[np.ndarray, np.ndarray]
) -> tuple[Float32Array, Float32Array]:
    """Normals (K, 3) and σ (K) of the `uncertain` pixels of a strip, given by rows (K,) and columns (K,)."""
    variance = np.radians(sigma_deg) ** 2
    weight = np.where(sigma_deg <= SETTINGS.unsure_deg, 1 / variance, 0).astype(np.float32)
    total = _neighbour_sum(weight)[uncertain]
    mean = np.column_stack([_neighbour_sum(weight * normals[..., axis])[uncertain] for axis in range(3)])
    mean /= np.maximum(total, 1e-9)[:, None]
    length = np.sqrt(np.sum(mean * mean, axis=1))
    own, before = variance[uncertain], normals[uncertain]
    mean_variance = np.maximum(1 - length**2, 0) + 1 / np.maximum(total, 1e-9) + np.radians(SETTINGS.curved_deg) ** 2
    combined = before / own[:, None] + mean / (np.maximum(length, SETTINGS.least_length) * mean_variance)[:, None]
    combined /= np.sqrt(np.sum(combined * combined, axis=1, keepdims=True))
    sigma = np.degrees(np.sqrt(1 / (1 / own + 1 / mean_variance)))
    directed = length > SETTINGS.least_length
    return np.where(directed[:, None], combined, before), np.where(directed, sigma, sigma_deg[uncertain])


def _neighbour_sum(values: Float32Array) -> Float32Array:
    """Sum (H, W) over the eight neighbours of each pixel."""
    kernel = np.ones((3, 3), np.float32)
    kernel[1, 1] = 0
    return np.asarray(cv2.filter2D(values, cv2.CV_32F, kernel, borderType=cv2.BORDER_CONSTANT), np.float32)
