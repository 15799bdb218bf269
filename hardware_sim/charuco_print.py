"""Printed ChArUco board: which of its points are black, by a layout of its own, with markers of OpenCV's dictionary.

The layout is OpenCV's since 4.6: the upper left square is black, and the white squares carry the dictionary's markers
row by row. Before 4.6 that square was white if the number of rows was even. The layout is written out here rather than
drawn by OpenCV, so that a wrong description of the board shows in the calibration's results.
"""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from acquisition.models.base import Float32Array, FloatArray

MARKER_BITS = 7
"""Bits along a marker's side, including its black border (5 × 5 dictionaries)."""

TEXELS, MARGIN_SQUARES = 224, 1
"""Texels along a square (24 for each bit of a marker of three quarters), and squares of paper round the print."""

REMAP_ROW = 1024
"""Points in a row for OpenCV's `remap`, which takes at most 32,767."""

INK_SPREAD_M = 5e-5
"""1 σ of an edge's blur, m: toner spreads, and paper scatters light sideways."""

PAPER_ALBEDO, INK_ALBEDO = 0.85, 0.05
"""Albedo of matt office paper and of laser toner."""


@dataclass(frozen=True)
class CharucoPrint:
    """A print of `columns` × `rows` squares of `square_m`, with markers of `marker_share` of a square.

    The frame is the board's: x along columns, y along rows, origin in its upper left corner. `border_squares`: 0 for
    squares all over, n for a frame of n squares round a blank middle. `legacy_pattern`: OpenCV's layout before 4.6.
    """

    columns: int
    rows: int
    square_m: float
    marker_share: float = 0.75
    dictionary: str = "DICT_5X5_250"
    border_squares: int = 0
    legacy_pattern: bool = False
    paper_albedo: float = PAPER_ALBEDO

    @property
    def size_m(self) -> tuple[float, float]:
        """Width and height of the squares, m, without the paper's margin."""
        return self.columns * self.square_m, self.rows * self.square_m

    def albedo(self, points: FloatArray | Float32Array) -> Float32Array:
        """Albedo (N,) at points (N, 2), m, of the print; paper outside the squares."""
        texel = (points[:, :2] / self.square_m + MARGIN_SQUARES) * TEXELS - 0.5
        at = np.zeros((-(-len(texel) // REMAP_ROW), REMAP_ROW, 2), np.float32)
        at.reshape(-1, 2)[: len(texel)] = texel
        paper = cv2.BORDER_REPLICATE  # the picture ends in paper all round
        found = cv2.remap(self._picture, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=paper)
        return np.asarray(found, np.float32).ravel()[: len(texel)]

    @cached_property
    def _picture(self) -> Float32Array:
        """Albedo of the print and some paper round it, `TEXELS` to a square, blurred like toner on paper."""
        picture = np.full(((self.rows + 2) * TEXELS, (self.columns + 2) * TEXELS), self.paper_albedo, np.float32)
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, self.dictionary))
        bit = round(TEXELS * self.marker_share / MARKER_BITS)
        inset = (TEXELS - MARKER_BITS * bit) // 2
        marker, first_white = 0, int(self.legacy_pattern and self.rows % 2 == 0)
        for row in range(self.rows):
            for column in range(self.columns):
                square = picture[
                    (row + MARGIN_SQUARES) * TEXELS : (row + MARGIN_SQUARES + 1) * TEXELS,
                    (column + MARGIN_SQUARES) * TEXELS : (column + MARGIN_SQUARES + 1) * TEXELS,
                ]
                white = (row + column + first_white) % 2 == 1
                if white and not self._blank(row, column):
                    bits = cv2.aruco.generateImageMarker(dictionary, marker, MARKER_BITS)
                    drawn = np.kron(np.where(bits == 0, INK_ALBEDO, self.paper_albedo), np.ones((bit, bit)))
                    square[inset : inset + len(drawn), inset : inset + len(drawn)] = drawn
                elif not self._blank(row, column):
                    square[:] = INK_ALBEDO
                marker += white
        return np.asarray(cv2.GaussianBlur(picture, (0, 0), INK_SPREAD_M / self.square_m * TEXELS), np.float32)

    def _blank(self, row: int, column: int) -> bool:
        """Whether a square is in the blank middle."""
        n = self.border_squares
        return n > 0 and n <= row < self.rows - n and n <= column < self.columns - n
