"""What neighbours say of a pixel whose own lights leave it unsure.

Beside a wall three or four lights are left, one of them perhaps at the edge of a shadow, and a pixel alone can err by
thirty degrees. The pixels round it are one more measurement of its normal: their mean, as uncertain as they are and as
far as they differ among themselves, so that next to an edge they say little. A sure pixel is left as it is, which keeps
fine relief whole, and unsure neighbours are not listened to: they err as the pixel itself does, for want of the same
lights.
"""

import cv2
import numpy as np

from acquisition.models.base import Float32Array

UNSURE_DEG = 4.0
"""σ from which a pixel listens to its neighbours: of simulated parts and figures under eight lights 0.5–1 % of the
pixels. With 2° pilots lose detail and plans suffer."""

CURVED_DEG = 1.0
"""1 σ of how far a pixel's normal is from its neighbours' mean where these agree."""

ROWS = 256
LEAST_LENGTH = 0.5
"""Length of the mean of unit normals below which they point anywhere."""


def smooth_uncertain(normals: Float32Array, sigma_deg: Float32Array) -> None:
    """Turns the unsure ones of the unit normals (H, W, 3) towards their neighbours, in place, and lowers their σ.

    `sigma_deg` (H, W) is 1 σ over both tangential directions, as in NormalMap, NaN where there is no normal. All
    neighbours count with what they were before.
    """
    height = len(sigma_deg)
    above = normals[:0].copy(), sigma_deg[:0].copy()
    for start in range(0, height, ROWS):
        stop, after = min(start + ROWS, height), min(start + ROWS + 1, height)
        strip = np.concatenate([above[0], normals[start:after]]), np.concatenate([above[1], sigma_deg[start:after]])
        first = len(above[0])
        above = normals[stop - 1 : stop].copy(), sigma_deg[stop - 1 : stop].copy()
        rows, columns = np.nonzero(strip[1][first : first + stop - start] > UNSURE_DEG)
        if len(rows):
            leant = _leant(*strip, (rows + first, columns))
            normals[rows + start, columns], sigma_deg[rows + start, columns] = leant


def _leant(
    normals: Float32Array, sigma_deg: Float32Array, unsure: tuple[np.ndarray, np.ndarray]
) -> tuple[Float32Array, Float32Array]:
    """Normals (K, 3) and σ (K) of the `unsure` pixels of a strip, given by rows (K,) and columns (K,)."""
    variance = np.radians(sigma_deg) ** 2
    weight = np.where(sigma_deg <= UNSURE_DEG, 1 / variance, 0).astype(np.float32)
    total = _round(weight)[unsure]
    mean = np.column_stack([_round(weight * normals[..., axis])[unsure] for axis in range(3)])
    mean /= np.maximum(total, 1e-9)[:, None]
    length = np.sqrt(np.sum(mean * mean, axis=1))
    own, before = variance[unsure], normals[unsure]
    theirs = np.maximum(1 - length**2, 0) + 1 / np.maximum(total, 1e-9) + np.radians(CURVED_DEG) ** 2
    both = before / own[:, None] + mean / (np.maximum(length, LEAST_LENGTH) * theirs)[:, None]
    both /= np.sqrt(np.sum(both * both, axis=1, keepdims=True))
    sigma = np.degrees(np.sqrt(1 / (1 / own + 1 / theirs)))
    pointing = length > LEAST_LENGTH
    return np.where(pointing[:, None], both, before), np.where(pointing, sigma, sigma_deg[unsure])


def _round(values: Float32Array) -> Float32Array:
    """The sum (H, W) over the eight pixels round each."""
    kernel = np.ones((3, 3), np.float32)
    kernel[1, 1] = 0
    return np.asarray(cv2.filter2D(values, cv2.CV_32F, kernel, borderType=cv2.BORDER_CONSTANT), np.float32)
