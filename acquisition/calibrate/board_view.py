"""The board in one image: whether it is detected and, if not, why; where a planned pose of the arm will show it.

Live images are judged by the same detection as the session's images. Whoever places board and light by the live image
has thus placed them for the session.
"""

import math

import cv2
import numpy as np
from pydantic import Field

from acquisition import geometry
from acquisition.calibrate import charuco
from acquisition.calibrate.charuco import View
from acquisition.models.base import FloatArray, Joints, Value
from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import BoardConfig, CellConfig
from acquisition.waypoints import calibrated_kinematics, mounted_tool

Pixel = tuple[float, float]
"""Column and row; the origin is the middle of the image's first pixel."""


class ExpectedView(Value):
    """Position of the board in the image that a calibration predicts for a view."""

    outline_px: list[Pixel] = Field(
        description="The four corners of the squares' area, from the board's origin along its columns: column and row, "
        "pixels; beyond the image where the board is"
    )
    corners_px: list[Pixel] = Field(
        description="The corners between squares that lie in the image: column, row, pixels"
    )
    corners: int = Field(ge=0, description="All corners of the board")
    distance_m: float = Field(description="Distance of the board's middle from the camera, m")
    tilt_deg: float = Field(description="Angle between the board's normal and the ray to its middle, degrees")


def seen(pixels: np.ndarray, board: BoardConfig) -> tuple[View | None, str]:
    """Detects the board in a frame (H, W); if it is not seen, returns None and the reason, for people."""
    wanted = charuco.of_cell(board)
    view = charuco.detect(pixels, wanted, "frame")
    if view is not None:
        return view, ""
    other = wanted.model_copy(update={"legacy_pattern": not wanted.legacy_pattern})
    if charuco.detect(pixels, other, "frame") is not None:
        right = str(other.legacy_pattern).lower()
        return None, f"the board has the other layout: set `board.legacy_pattern = {right}` in the cell file"
    return None, (
        f"the board ({board.columns} × {board.rows} squares of {1e3 * board.square_m:g} mm) is not seen: is it "
        "mounted, lit and in focus, and is it the board of the cell file?"
    )


def expected(joints: Joints, cell: CellConfig, calibration: Calibration) -> ExpectedView | None:
    """Projects the cell's board at joints (rad) by a calibration; None unless all of it is in front of the camera.

    Raises RigError config.invalid for a cell without a board.
    """
    board = mounted_tool.require_board(cell)
    flange = calibrated_kinematics.forward(calibrated_kinematics.of_arm(cell.arm), np.array([joints], dtype=float))
    base_from_board = flange[0, 6] @ np.asarray(board.flange_from_board.matrix)
    camera_from_board = geometry.inverse(np.array(calibration.base_from_camera)) @ base_from_board
    squares = charuco.of_cell(board)
    width, height = squares.size_m
    edge = np.array([[0.0, 0.0, 0.0], [width, 0.0, 0.0], [width, height, 0.0], [0.0, height, 0.0]])
    if geometry.transform(camera_from_board, edge)[:, 2].min() <= 0:
        return None
    inner = _project(squares.corners_m, camera_from_board, calibration)
    inside = ((inner >= 0) & (inner <= np.array([calibration.width, calibration.height]) - 1)).all(axis=1)
    middle = geometry.transform(camera_from_board, edge.mean(axis=0))
    distance = float(np.linalg.norm(middle))
    cosine = abs(float(camera_from_board[:3, 2] @ middle)) / distance
    return ExpectedView(
        outline_px=_pairs(_project(edge, camera_from_board, calibration)),
        corners_px=_pairs(inner[inside]),
        corners=len(inner),
        distance_m=distance,
        tilt_deg=math.degrees(math.acos(min(cosine, 1.0))),
    )


def _project(points: FloatArray, camera_from_board: FloatArray, calibration: Calibration) -> FloatArray:
    """Projects points (N, 3) in the board's frame, m, to pixels (N, 2)."""
    rotation = cv2.Rodrigues(camera_from_board[:3, :3])[0]
    matrix, distortion = np.array(calibration.camera_matrix), np.array(calibration.distortion)
    projected = cv2.projectPoints(points, rotation, camera_from_board[:3, 3], matrix, distortion)[0]
    return np.asarray(projected, dtype=float).reshape(-1, 2)


def _pairs(pixels: FloatArray) -> list[Pixel]:
    return [(round(float(column), 2), round(float(row), 2)) for column, row in pixels]
