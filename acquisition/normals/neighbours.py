"""What neighbours say of a pixel whose own lights leave it unsure.

Beside a wall three or four lights are left, one of them perhaps at the edge of a shadow, and a pixel alone can err by
thirty degrees. The pixels round it are one more measurement of its normal: their mean, as uncertain as they are and as
far as they differ among themselves, so that next to an edge they say little. A sure pixel is left as it is, which keeps
fine relief whole.
"""

import cv2
import numpy as np

from acquisition.types import BoolArray, Float32Array

UNSURE_DEG = 4.0
"""σ from which a pixel listens to its neighbours: of simulated parts and figures under eight lights 0.5–1 % of the
pixels, and a quarter of those that were more than 10° off then are not. With 2° pilots lose detail and plans suffer."""

CURVED_DEG = 1.0
"""1 σ of how far a pixel's normal is from its neighbours' mean where these agree."""

ROWS = 256
LEAST_LENGTH = 0.5
"""Length of the mean of unit normals below which they point anywhere."""


def lean(normals: Float32Array, sigma_deg: Float32Array, mask: BoolArray) -> None:
    """Turns the unsure ones of the unit normals (H, W, 3) towards their neighbours, in place, and lowers their σ.

    `sigma_deg` (H, W) is 1 σ over both tangential directions, as in NormalMap; `mask` (H, W) says where normals are.
    All neighbours count with what they were before.
    """
    height = len(mask)
    above = slice(0, 0)
    kept = normals[above].copy(), sigma_deg[above].copy()
    for start in range(0, height, ROWS):
        stop, after = min(start + ROWS, height), min(start + ROWS + 1, height)
        own = slice(len(kept[0]), len(kept[0]) + stop - start)
        before = np.concatenate([kept[0], normals[start:after]])
        sigma = np.concatenate([kept[1], sigma_deg[start:after]])
        kept = normals[stop - 1 : stop].copy(), sigma_deg[stop - 1 : stop].copy()
        leant, told = _leant(before, sigma, mask[start - own.start : after])
        normals[start:stop], sigma_deg[start:stop] = leant[own], told[own]


def _leant(normals: Float32Array, sigma_deg: Float32Array, mask: BoolArray) -> tuple[Float32Array, Float32Array]:
    """Normals and σ of a strip whose first and last rows only lend themselves to others."""
    there = mask & np.isfinite(sigma_deg)
    variance = np.where(there, np.radians(sigma_deg, where=there, out=np.ones_like(sigma_deg)) ** 2, 1)
    weight = np.where(there, 1 / variance, 0).astype(np.float32)
    total = _round(weight)
    mean = np.dstack([_round(weight * normals[..., axis]) for axis in range(3)])
    mean /= np.maximum(total, 1e-9)[..., None]
    length = np.sqrt(np.sum(mean * mean, axis=-1))
    unsure = there & (variance > np.radians(UNSURE_DEG) ** 2) & (length > LEAST_LENGTH)
    own, length, mean = variance[unsure], length[unsure], mean[unsure]
    scatter = np.maximum(1 - length**2, 0)
    theirs = scatter + 1 / total[unsure] + np.radians(CURVED_DEG) ** 2
    both = normals[unsure] / own[:, None] + mean / (length * theirs)[:, None]
    leant, sigma = normals.copy(), sigma_deg.copy()
    leant[unsure] = both / np.sqrt(np.sum(both * both, axis=-1, keepdims=True))
    sigma[unsure] = np.degrees(np.sqrt(1 / (1 / own + 1 / theirs)))
    return leant, sigma


def _round(values: Float32Array) -> Float32Array:
    """The sum (H, W) over the eight pixels round each."""
    kernel = np.ones((3, 3), np.float32)
    kernel[1, 1] = 0
    return np.asarray(cv2.filter2D(values, cv2.CV_32F, kernel, borderType=cv2.BORDER_CONSTANT), np.float32)
