"""Sites of a mosaic sensor: the channel that each pixel sees, means over cells, and interpolation to three channels.

Photometric stereo needs no demosaicing: each site is a monochrome pixel whose albedo is that of its channel. Operations
on neighbouring pixels need the channels of the sites. Means that hold the channels in the proportions of a 2 × 2 cell
(R + 2 G + B) are free of the mosaic's pattern.
"""

import cv2
import numpy as np
import numpy.typing as npt

from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.colour import Mosaic

CHANNELS = "rgb"
CELL = 2
"""Side of a cell of the mosaic, pixels."""

BALANCED_KERNEL = np.array([1.0, 2.0, 1.0], np.float32) / 4
"""Weights along rows and columns of a mean over 3 × 3 sites, which holds R : G : B as 1 : 2 : 1 round any site."""

Sites = npt.NDArray[np.uint8]


def sites(mosaic: Mosaic, rows: slice, columns: slice) -> Sites:
    """Channel (h, w) of each pixel of a window of the frame: 0 red, 1 green, 2 blue."""
    cell = np.array([CHANNELS.index(letter) for letter in mosaic], np.uint8).reshape(CELL, CELL)
    row, column = np.arange(rows.start, rows.stop) % CELL, np.arange(columns.start, columns.stop) % CELL
    return cell[row[:, None], column[None, :]]


def of_calibration(calibration: Calibration, rows: slice, columns: slice) -> Sites | None:
    """`sites` of the calibration's sensor; None: it is monochrome."""
    mosaic = calibration.sensor.mosaic
    return None if mosaic is None else sites(mosaic, rows, columns)


def white(calibration: Calibration) -> Float32Array:
    """Values (3,) of R, G, B on a white surface over their mean; ones without a colour calibration."""
    colour = calibration.colour
    return np.ones(3, np.float32) if colour is None else np.array(colour.white, np.float32)


def balanced_mean(image: Float32Array, inside: BoolArray | None = None) -> Float32Array:
    """Mean (h, w) over the 3 × 3 sites round each pixel, R : G : B as 1 : 2 : 1, of an image (h, w) of a mosaic.

    `inside` (h, w) marks the pixels that count. Near its border the proportions of the channels are not kept.
    """
    border = cv2.BORDER_REFLECT_101  # keeps the sites' pattern
    if inside is None:
        out = cv2.sepFilter2D(image, cv2.CV_32F, BALANCED_KERNEL, BALANCED_KERNEL, borderType=border)
        return np.asarray(out, np.float32)
    weight = inside.astype(np.float32)
    total = cv2.sepFilter2D(image * weight, cv2.CV_32F, BALANCED_KERNEL, BALANCED_KERNEL, borderType=border)
    share = cv2.sepFilter2D(weight, cv2.CV_32F, BALANCED_KERNEL, BALANCED_KERNEL, borderType=border)
    return np.asarray(total / np.maximum(share, 1e-6), np.float32)


def least_cell_mean(image: Float32Array) -> Float32Array:
    """Least of the means (h, w) over the four cells of 2 × 2 sites that each pixel lies in, of an image (h, w).

    It is free of the mosaic's pattern. Beside a bright region it is as dark as the surroundings; a mean would blur.
    """
    padded = np.pad(image, 1, mode="reflect")
    means = (padded[1:, 1:] + padded[1:, :-1] + padded[:-1, 1:] + padded[:-1, :-1]) / 4
    return np.minimum(np.minimum(means[1:, 1:], means[1:, :-1]), np.minimum(means[:-1, 1:], means[:-1, :-1]))


def cell_means(image: npt.NDArray[np.uint16]) -> FloatArray:
    """Means (h/2, w/2) over the 2 × 2 cells of a frame."""
    height, width = (side // CELL for side in image.shape)
    cells = image[: CELL * height, : CELL * width].reshape(height, CELL, width, CELL)
    return np.asarray(cells.mean(axis=(1, 3), dtype=np.float64))


def interpolated(image: Float32Array, channel: Sites, inside: BoolArray) -> Float32Array:
    """Three channels (h, w, 3) of an image (h, w) of a mosaic's sites, by interpolation of colour differences.

    Green is interpolated first, then red and blue less green, which hardly change at edges of brightness (Hibbard 1995
    without its choice of direction). Interpolation is bilinear, over the sites `inside` (h, w) alone. A site keeps its
    own value. Where no site of a channel is near, the channel has the value of the site itself.
    """
    green = _filled(image, inside & (channel == 1), image)
    out = np.empty((*image.shape, 3), np.float32)
    out[..., 1] = green
    for number in (0, 2):
        known = inside & (channel == number)
        out[..., number] = green + _filled(image - green, known, np.zeros_like(image))
    out[~inside] = 0
    return out


def _filled(image: Float32Array, known: BoolArray, otherwise: Float32Array) -> Float32Array:
    """Fills an image where it is not `known` by normalised convolution (Knutsson & Westin 1993): bilinear over 3 × 3,
    then over 5 × 5 sites. Values out of reach are taken from `otherwise`."""
    out, missing = np.where(known, image, otherwise), ~known
    for size in (3, 5):
        ramp = np.minimum(np.arange(1, size + 1), np.arange(size, 0, -1)).astype(np.float32)
        border = cv2.BORDER_CONSTANT
        total = cv2.sepFilter2D(image * known, cv2.CV_32F, ramp, ramp, borderType=border)
        weight = cv2.sepFilter2D(known.astype(np.float32), cv2.CV_32F, ramp, ramp, borderType=border)
        found = missing & (weight > 0)
        out = np.where(found, total / np.maximum(weight, 1e-6), out)
        missing &= ~found
    return out.astype(np.float32)
