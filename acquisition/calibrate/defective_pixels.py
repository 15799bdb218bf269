"""Defective pixels of a camera: hot in the dark, or unlike all their neighbours in the light (EMVA 1288 4.0).

A pixel is compared with its eight neighbours only, because the scene is not a uniform field: an edge never makes a
pixel unlike all of them, only a detail of one pixel's size does.
"""

import cv2
import numpy as np

from acquisition import photometry
from acquisition.models.base import Float32Array

HOT_SIGMA, HOT_SHARE = 8.0, 0.01
"""Excess of a hot pixel in the dark over its neighbours: at least so many σ and this share of the range."""

DEAD_FACTOR, DEAD_LEAST = 0.5, 0.08
"""Factor by which the response of a defective pixel is below the darkest, or above the brightest, of its eight
neighbours; share of the range that these must have for the comparison."""

MAX_DEFECTS = 2000
"""Largest number of defective pixels that are listed."""


def find(dark: Float32Array, signal: Float32Array) -> tuple[tuple[int, int, str], ...]:
    """Returns column, row and kind (`hot`, `response`) of defective pixels.

    The images (H, W) are shares of the range: the mean with the lamp off, and the lit one less its lamp-off mean.
    """
    away = dark - cv2.medianBlur(dark, 3)
    sigma = float(np.median(np.abs(away))) / photometry.GAUSSIAN_MEDIAN_DEVIATION
    hot = away > max(HOT_SIGMA * sigma, HOT_SHARE)
    ring = np.ones((3, 3), np.uint8)
    ring[1, 1] = 0
    least, most = cv2.erode(signal, ring), cv2.dilate(signal, ring)
    dead = (least > DEAD_LEAST) & ((signal < DEAD_FACTOR * least) | (signal > most / DEAD_FACTOR)) & ~hot
    found = [
        (int(column), int(row), kind)
        for mask, kind in ((hot, "hot"), (dead, "response"))
        for row, column in np.argwhere(mask)
    ]
    return tuple(found[:MAX_DEFECTS])
