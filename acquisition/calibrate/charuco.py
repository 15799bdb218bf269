"""ChArUco boards: description, and sub-pixel detection of the corners (OpenCV `aruco`).

A chessboard's corners are located to some hundredths of a pixel. The markers in its white squares number the corners,
so that a board that is partly hidden or leaves the image still counts. The board's frame has its origin at a corner of
the board, x along its columns, y along its rows, z into it.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from pydantic import Field, model_validator

from acquisition.models.base import BoolArray, FloatArray, Value
from acquisition.models.cell_config import BoardConfig
from acquisition.models.charuco_markers import refuse_too_many_squares

DICTIONARY = "DICT_5X5_250"
"""Markers of the board: their 25 bits are read down to 1.5 pixels a bit, and 250 markers fill boards of 500 squares."""

MARKER_BITS = 7
"""Bits along the side of a marker, its black border included."""

MIN_CORNERS = 8
"""Least number of corners of a view: fewer hardly determine its pose."""

MIN_SPREAD = 0.1
"""Least ratio of the shorter to the longer extent of a view's corners: corners on a line do not determine the tilt."""


class CharucoBoard(Value):
    """Squares of a ChArUco board, as printed and measured."""

    columns: int = Field(ge=3, le=40, description="Squares along x")
    rows: int = Field(ge=3, le=40, description="Squares along y")
    square_m: float = Field(gt=0.001, lt=0.5, description="Side of a square as measured on the print, m")
    marker_share: float = Field(default=0.75, ge=0.4, le=0.9, description="Side of a marker over that of a square")
    legacy_pattern: bool = Field(
        default=False,
        description="Whether the upper left square of a board of even rows is white, as before OpenCV 4.6 (calib.io)",
    )

    border_squares: int = Field(
        default=0, ge=0, le=10, description="0: squares all over; n: a frame of n squares round a blank, matt middle"
    )

    @model_validator(mode="after")
    def _markers_suffice(self) -> "CharucoBoard":
        refuse_too_many_squares(self.columns, self.rows)
        return self

    @property
    def size_m(self) -> tuple[float, float]:
        """Width and height, m."""
        return self.columns * self.square_m, self.rows * self.square_m

    @property
    def corners_m(self) -> FloatArray:
        """Inner corners (N, 3) in the board's frame, m, as if the board were flat."""
        return np.asarray(self.opencv().getChessboardCorners(), dtype=float)

    @property
    def blank_m(self) -> tuple[float, float, float, float] | None:
        """Left, upper, right and lower edge of the blank middle in the board's frame, m; None if squares fill it."""
        n, side = self.border_squares, self.square_m
        right, lower = self.columns - n, self.rows - n
        return (n * side, n * side, right * side, lower * side) if 0 < n < min(right, lower) else None

    def is_blank(self, column: int, row: int) -> bool:
        """Tells whether a square belongs to the blank middle."""
        n = self.border_squares
        return n > 0 and n <= column < self.columns - n and n <= row < self.rows - n

    def opencv(self) -> cv2.aruco.CharucoBoard:
        """Returns OpenCV's object for the board."""
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, DICTIONARY))
        marker_m = self.marker_share * self.square_m
        board = cv2.aruco.CharucoBoard((self.columns, self.rows), self.square_m, marker_m, dictionary)
        board.setLegacyPattern(self.legacy_pattern)
        return board


def of_cell(board: BoardConfig) -> CharucoBoard:
    """Returns the squares of a cell's board."""
    return CharucoBoard.model_validate(board.model_dump(include=set(CharucoBoard.model_fields)))


@dataclass(frozen=True)
class View:
    """Corners of a board in one image: numbers (K,) in `CharucoBoard.corners_m`, and pixels (K, 2), column and row; the
    arm's joints (6,), rad, if the board is on its flange."""

    name: str
    corners: np.ndarray
    pixels: FloatArray
    joints: FloatArray | None = None

    def only(self, good: BoolArray) -> "View":
        """Returns the view with only the corners `good` (K,)."""
        return replace(self, corners=self.corners[good], pixels=self.pixels[good])


def detect(image: np.ndarray, board: CharucoBoard, name: str, joints: FloatArray | None = None) -> View | None:
    """Detects a board's corners by its markers and refines them (OpenCV `CharucoDetector`); None if it is not seen.

    `image` (H, W), 8 or 16 bits, brightness linear or not.
    """
    detector = cv2.aruco.CharucoDetector(board.opencv())
    pixels, numbers, _, _ = detector.detectBoard(_as_8_bit(image))
    if np.size(numbers) < MIN_CORNERS:  # `numbers` is None if there are no markers
        return None
    seen = np.asarray(pixels, dtype=float).reshape(-1, 2)
    extent = np.linalg.svd(seen - seen.mean(axis=0), compute_uv=False)
    if extent[1] < MIN_SPREAD * extent[0]:
        return None
    return View(name, np.ravel(numbers), seen, joints)


def shift_px(first: View, second: View) -> float:
    """Median distance of the corners that both views show, pixels; infinite if they share too few."""
    _, one, other = np.intersect1d(first.corners, second.corners, return_indices=True)
    if len(one) < MIN_CORNERS:
        return float("inf")
    return float(np.median(np.linalg.norm(second.pixels[other] - first.pixels[one], axis=1)))


def _as_8_bit(image: np.ndarray) -> np.ndarray:
    if image.dtype == np.uint8:
        return image
    brightest = float(np.percentile(image, 99.5))
    return np.clip(255 / max(brightest, 1.0) * image.astype(np.float32), 0, 255).astype(np.uint8)
