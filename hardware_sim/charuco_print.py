"""ChArUco board as it is printed: which of its points are black, by its own layout, markers from OpenCV's dictionary.

The layout is OpenCV's since 4.6: the upper left square is black, and the white squares carry the dictionary's markers
row by row. It is written out here rather than drawn by OpenCV, so that a fault in how a calibration describes a board
shows in what it finds.
"""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from acquisition.models.base import Float32Array, FloatArray

MARKER_BITS = 7
"""Bits along a marker's side, its black border included (5 × 5 dictionaries)."""

PAPER_ALBEDO, INK_ALBEDO = 0.85, 0.05
"""Of matt paper and of laser toner."""


@dataclass(frozen=True)
class CharucoPrint:
    """A print of `columns` × `rows` squares of `square_m`, markers `marker_share` of these; the frame is the board's: x
    along columns, y along rows, from its upper left corner.

    `border_squares`: 0 for squares all over, n for a frame of n squares round a blank middle.
    """

    columns: int
    rows: int
    square_m: float
    marker_share: float = 0.75
    dictionary: str = "DICT_5X5_250"
    border_squares: int = 0

    @property
    def size_m(self) -> tuple[float, float]:
        """Width and height of the squares, m, without the paper's margin."""
        return self.columns * self.square_m, self.rows * self.square_m

    def albedo(self, points: FloatArray | Float32Array) -> Float32Array:
        """Albedo (N,) at points (N, 2), m, of the print; paper outside the squares."""
        place = points[:, :2].astype(np.float64) / self.square_m
        square = np.floor(place).astype(np.int64)
        column, row = square[:, 0], square[:, 1]
        printed = (column >= 0) & (row >= 0) & (column < self.columns) & (row < self.rows)
        if self.border_squares:
            n = self.border_squares
            printed &= ~((column >= n) & (row >= n) & (column < self.columns - n) & (row < self.rows - n))
        black = printed & ((column + row) % 2 == 0)
        at = (place - square - (1 - self.marker_share) / 2) / self.marker_share * MARKER_BITS
        bit = np.floor(at).astype(np.int64)
        in_marker = printed & ~black & ((bit >= 0) & (bit < MARKER_BITS)).all(axis=1)
        number = self._numbers[row[in_marker], column[in_marker]]
        black[in_marker] = self._bits[number, bit[in_marker, 1], bit[in_marker, 0]] == 0
        return np.where(black, INK_ALBEDO, PAPER_ALBEDO).astype(np.float32)

    @cached_property
    def _numbers(self) -> np.ndarray:
        """Number (rows, columns) of the marker in each white square, −1 in black ones."""
        row, column = np.mgrid[0 : self.rows, 0 : self.columns]
        white = (row + column) % 2 == 1
        numbers = np.full(white.shape, -1)
        numbers[white] = np.arange(int(white.sum()))
        return numbers

    @cached_property
    def _bits(self) -> np.ndarray:
        """Bits (M, 7, 7) of the markers, 0 for black."""
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, self.dictionary))
        count = int(self._numbers.max()) + 1
        return np.stack([cv2.aruco.generateImageMarker(dictionary, number, MARKER_BITS) for number in range(count)])
