"""Draws ChArUco boards to scale, for printing.

It is separate from the detection, which the service does in its own process, where no plotting library is loaded.
"""

from pathlib import Path

import cv2
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline

from acquisition.calibrate import charuco
from acquisition.calibrate.charuco import CharucoBoard
from acquisition.models.errors import ErrorCode, RigError

PAGE_MARGIN_M = 0.01
"""White margin around a drawn board, m, which markers need."""

MM_PER_INCH = 25.4


def draw(board: CharucoBoard, path: Path) -> None:
    """Draws a board to scale as vectors (PDF or SVG), with its description at the lower edge.

    Raises RigError config.invalid for another file extension.
    """
    if path.suffix.lower() not in (".pdf", ".svg"):
        raise RigError(ErrorCode.CONFIG_INVALID, f"{path.name}: a board is drawn as .pdf or .svg, which keep its scale")
    width, height = (side + 2 * PAGE_MARGIN_M for side in board.size_m)
    figure = Figure(figsize=(1000 * width / MM_PER_INCH, 1000 * height / MM_PER_INCH))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(-PAGE_MARGIN_M, width - PAGE_MARGIN_M), ylim=(height - PAGE_MARGIN_M, -PAGE_MARGIN_M))
    axes.set_axis_off()
    axes.add_patch(PathPatch(_outline(_black_squares_m(board)), color="black", linewidth=0))
    said = f"{board.columns} × {board.rows} squares of {1000 * board.square_m:g} mm · {charuco.DICTIONARY}"
    said += " · legacy pattern" if board.legacy_pattern else ""
    axes.text(0, board.size_m[1] + 0.7 * PAGE_MARGIN_M, said, fontsize=7)
    figure.savefig(path)


def _outline(squares: list[tuple[float, float, float]]) -> Outline:
    """Returns squares, given by upper left corner and side, as one path: a thousand patches would take seconds."""
    placed = np.array(squares)
    around = np.array([(0, 0), (1, 0), (1, 1), (0, 1), (0, 0)])
    vertices = placed[:, None, :2] + placed[:, 2, None, None] * around
    codes = [Outline.MOVETO, Outline.LINETO, Outline.LINETO, Outline.LINETO, Outline.CLOSEPOLY]
    return Outline(vertices.reshape(-1, 2), codes * len(squares))


def _black_squares_m(board: CharucoBoard) -> list[tuple[float, float, float]]:
    """Returns upper left corner and side, m, of each black square of the board and each black bit of its markers."""
    made = board.opencv()
    markers = np.asarray(made.getObjPoints())[:, 0, :2]  # their upper left corners
    white = {tuple(square) for square in np.floor(markers / board.square_m).astype(int)}
    squares = [
        (column * board.square_m, row * board.square_m, board.square_m)
        for column in range(board.columns)
        for row in range(board.rows)
        if (column, row) not in white and not board.is_blank(column, row)
    ]
    bit_m = board.marker_share * board.square_m / charuco.MARKER_BITS
    for number, (x, y) in zip(np.ravel(made.getIds()), markers, strict=True):
        if board.is_blank(int(x // board.square_m), int(y // board.square_m)):
            continue
        bits = cv2.aruco.generateImageMarker(made.getDictionary(), int(number), charuco.MARKER_BITS)
        squares += [(x + column * bit_m, y + row * bit_m, bit_m) for row, column in np.argwhere(bits == 0)]
    return squares
