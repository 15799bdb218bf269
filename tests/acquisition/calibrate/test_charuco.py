"""Boards: what is drawn is what is detected, and where."""

import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from acquisition.calibrate import board_drawing, charuco
from acquisition.calibrate.charuco import CharucoBoard
from acquisition.models.base import FloatArray
from acquisition.models.errors import RigError

BOARD = CharucoBoard(columns=9, rows=8, square_m=0.012)
SQUARE_PX, FINER = 40, 4
SEEN_BY = np.array([[1.6, 0.25, 200.0], [-0.15, 1.5, 180.0], [1e-4, 2e-4, 1.0]])
"""Homography from the board, in pixels of SQUARE_PX to a square, to the image; (0, 0) is a corner, not a middle."""


def picture(board: CharucoBoard, shape: tuple[int, int] = (850, 1000)) -> np.ndarray:
    """A board seen obliquely, on pixels that average over their area."""
    drawn = board.opencv().generateImage((board.columns * SQUARE_PX, board.rows * SQUARE_PX))
    to_middle = np.array([[1, 0, -0.5], [0, 1, -0.5], [0, 0, 1.0]])
    mapped = to_middle @ np.diag([FINER, FINER, 1.0]) @ SEEN_BY @ np.linalg.inv(to_middle)
    fine = cv2.warpPerspective(drawn, mapped, (shape[1] * FINER, shape[0] * FINER), borderValue=[255])
    return cv2.GaussianBlur(cv2.resize(fine, shape[::-1], interpolation=cv2.INTER_AREA), (0, 0), 0.7)


def true_pixels(board: CharucoBoard, corners: np.ndarray) -> FloatArray:
    flat = board.corners_m[corners][:, :2] / board.square_m * SQUARE_PX
    mapped = np.column_stack([flat, np.ones(len(flat))]) @ SEEN_BY.T
    return np.asarray(mapped[:, :2] / mapped[:, 2:] - 0.5)


@pytest.mark.parametrize("legacy", [False, True])
def test_detect_corners_are_where_pixels_have_their_middle(legacy: bool) -> None:
    board = BOARD.model_copy(update={"legacy_pattern": legacy})
    view = charuco.detect(picture(board), board, "one.png")
    assert view is not None
    assert len(view.corners) == 56
    errors = view.pixels - true_pixels(board, view.corners)
    assert np.abs(errors.mean(axis=0)).max() < 0.03  # half a pixel is the known fault
    assert np.abs(errors).max() < 0.25


def test_detect_other_pattern_or_no_board_is_none() -> None:
    other = BOARD.model_copy(update={"legacy_pattern": True})
    assert charuco.detect(picture(BOARD), other, "one.png") is None
    assert charuco.detect(np.full((300, 300), 90, np.uint8), BOARD, "empty.png") is None


def test_detect_16_bits_gives_corners_of_8_bits() -> None:
    eight = charuco.detect(picture(BOARD), BOARD, "8.png")
    sixteen = charuco.detect(picture(BOARD).astype(np.uint16) * 16, BOARD, "16.tiff")  # 12 bits of a sensor
    assert eight is not None
    assert sixteen is not None
    np.testing.assert_allclose(sixteen.pixels, eight.pixels, atol=0.02)


def test_detect_hidden_part_leaves_the_other_corners() -> None:
    image = picture(BOARD)
    image[:400] = 255
    view = charuco.detect(image, BOARD, "hidden.png")
    assert view is not None
    assert 8 <= len(view.corners) < 50
    assert np.abs(view.pixels - true_pixels(BOARD, view.corners)).max() < 0.25


@pytest.mark.parametrize("legacy", [False, True])
def test_draw_is_to_scale_and_is_the_board(legacy: bool, tmp_path: Path) -> None:
    board = BOARD.model_copy(update={"legacy_pattern": legacy})
    board_drawing.draw(board, tmp_path / "board.svg")
    svg = (tmp_path / "board.svg").read_text(encoding="utf-8")
    points = [float(re.search(rf'<svg [^>]*{side}="([\d.]+)pt"', svg)[1]) for side in ("width", "height")]  # type: ignore[index]
    assert np.array(points) / 72 * 25.4 == pytest.approx([128, 116], abs=1e-3)  # mm, 10 mm margin
    outlines = [path.count("M") for path in re.findall(r' d="([^"]*)"', svg)]
    assert max(outlines) == len(board_drawing._black_squares_m(board))

    # The black squares, filled in at some pixels each, give the very picture of OpenCV.
    square = 70  # a marker's 7 bits are 7.5 px each
    image = np.full((board.rows * square, board.columns * square), 255, np.uint8)
    for x, y, side in board_drawing._black_squares_m(board):
        corner = np.round(np.array([x, y]) / board.square_m * square).astype(int)
        end = np.round((np.array([x, y]) + side) / board.square_m * square).astype(int)
        image[corner[1] : end[1], corner[0] : end[0]] = 0
    opencv = board.opencv().generateImage((board.columns * square, board.rows * square))
    assert np.mean(image != opencv) < 0.02  # edges of bits between pixels
    view = charuco.detect(cv2.copyMakeBorder(image, 40, 40, 40, 40, cv2.BORDER_CONSTANT, value=[255]), board, "svg")
    assert view is not None
    assert len(view.corners) == 56


def test_draw_pixel_format_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RigError, match=r"board\.png.*\.pdf"):
        board_drawing.draw(BOARD, tmp_path / "board.png")
    assert list(tmp_path.iterdir()) == []


def test_shift_is_that_of_shared_corners_and_infinite_without() -> None:
    numbers = np.arange(12)
    pixels: FloatArray = np.stack([10.0 * numbers, 5.0 * numbers], axis=1, dtype=np.float64)
    first = charuco.View("first", numbers, pixels)
    moved = charuco.View("moved", numbers[2:], pixels[2:] + np.array([3.0, -4.0]))
    assert charuco.shift_px(first, moved) == pytest.approx(5.0)
    assert charuco.shift_px(first, charuco.View("other", numbers + 20, pixels)) == np.inf
