"""Defective pixels of a camera: hot in the dark, or unlike all their neighbours in the light (EMVA 1288 4.0).

A pixel is compared with its eight neighbours only, because the scene is no uniform field: an edge never makes a pixel
unlike all of them, only a detail of its own size.
"""

import cv2
import numpy as np

from acquisition import photometry
from acquisition.models.base import Float32Array

HOT_SIGMA, HOT_SHARE = 8.0, 0.01
"""A hot pixel is brighter in the dark than its neighbours by so many σ and by this share of the range."""

DEAD_FACTOR, DEAD_LEAST = 0.5, 0.08
"""A pixel whose response is this far below the darkest, or above the brightest, of its eight neighbours is defective;
judged where they have this share of the range."""

MAX_DEFECTS = 2000
"""Defective pixels that are listed."""


def find(dark: Float32Array, signal: Float32Array) -> tuple[tuple[int, int, str], ...]:
    """Column, row and kind (`hot`, `response`) of defective pixels.

    From images (H, W) as shares of the range: the mean with the lamp off, and the lit one less its lamp-off mean.
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
