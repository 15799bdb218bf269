"""The tool on the flange: the cell with the lamp or with the calibration board, for collisions and speed limits.

A session states its tool; its paths are certified in the cell file's cell with that tool. The plate of a board is
covered with capsules, because the arm's other parts are capsules too. This makes the plate thicker, never thinner.
"""

import numpy as np

from acquisition import geometry
from acquisition.models.base import FloatArray, Vector3
from acquisition.models.cell_config import BoardConfig, CapsuleShape, CellConfig, Tool
from acquisition.models.errors import ErrorCode, RigError

PLATE_CAPSULES = 6
"""Capsules side by side over a plate, of radius √((a twelfth of its shorter side)² + (half its thickness)²)."""


def with_tool(cell: CellConfig, tool: Tool) -> CellConfig:
    """Returns the cell with a tool on its flange. Raises RigError config.invalid if the cell file has no board.

    The controller's TCP stays the lamp's emitter.
    """
    if tool == "board":
        require_board(cell)
    mass_kg, center_m = payload(cell, tool)
    arm = cell.arm.model_copy(update={"tool": tool, "payload_kg": mass_kg, "payload_center_m": center_m})
    return cell.model_copy(update={"arm": arm})


def speed_points(cell: CellConfig) -> FloatArray:
    """Returns the points (K, 3), m, of the flange frame whose speed is limited: the controller's TCP, which has limits
    of its own, and with a board all corners of its plate. Which of them is the fastest depends on the motion."""
    tcp = np.array([cell.arm.flange_from_tool.position_m], dtype=float)
    if cell.arm.tool == "lamp":
        return tcp
    board = require_board(cell)
    return np.concatenate([tcp, plate_corners(board), plate_corners(board, board.thickness_m)])


def payload(cell: CellConfig, tool: Tool) -> tuple[float, Vector3]:
    """Returns mass, kg, and centre of gravity (3,), m, in the flange frame, of the stated tool.

    A board whose payload is not stated has the lamp's; `payload_warning` reports it.
    """
    board = cell.board if tool == "board" else None
    if board is None or board.payload_kg is None or board.payload_center_m is None:
        return cell.arm.payload_kg, cell.arm.payload_center_m
    return board.payload_kg, board.payload_center_m


def payload_warning(cell: CellConfig, tool: Tool) -> str:
    """Returns a warning about the payload that the controller gets; empty if there is none."""
    if tool == "lamp" or require_board(cell).payload_kg is not None:
        return ""
    return (
        f"The payload with the board is not stated, so the controller keeps the lamp's {cell.arm.payload_kg:g} kg. "
        "Weigh what is on the flange and state payload_kg and payload_center_m in [board]: a wrong payload makes the "
        "arm sag, and stop because of forces that do not exist."
    )


def require_board(cell: CellConfig) -> BoardConfig:
    """Returns the cell's board. Raises RigError config.invalid if there is none."""
    if cell.board is None:
        raise RigError(ErrorCode.CONFIG_INVALID, "The cell file describes no calibration board: add a section [board]")
    return cell.board


def capsules(cell: CellConfig) -> list[CapsuleShape]:
    """Capsules of the tool in the flange frame."""
    if cell.arm.tool == "lamp":
        return list(cell.arm.tool_capsules)
    board = require_board(cell)
    lamp = [] if board.replaces_lamp else cell.arm.tool_capsules
    return [*lamp, *board.bracket_capsules, *plate(board)]


def plate(board: BoardConfig) -> list[CapsuleShape]:
    """Returns capsules in the flange frame whose union encloses the plate."""
    low, high = _extent(board)
    long, short = (0, 1) if high[0] - low[0] >= high[1] - low[1] else (1, 0)
    step = (high[short] - low[short]) / PLATE_CAPSULES
    # The plate's face midway between two axes is half a step aside and half its thickness above.
    radius = float(np.hypot(step / 2, board.thickness_m / 2))
    made: list[CapsuleShape] = []
    for number in range(PLATE_CAPSULES):
        ends = np.zeros((2, 3))
        ends[:, short] = low[short] + (number + 0.5) * step
        ends[:, long] = low[long], high[long]
        ends[:, 2] = board.thickness_m / 2
        start, end = geometry.transform(board.flange_from_board.matrix, ends).tolist()
        made.append(CapsuleShape(start_m=(*start,), end_m=(*end,), radius_m=radius))
    return made


def plate_corners(board: BoardConfig, depth_m: float = 0.0) -> FloatArray:
    """Returns the corners (4, 3) of the plate in the flange frame, at a depth below its printed face."""
    low, high = _extent(board)
    face = np.array([[x, y, depth_m] for x in (low[0], high[0]) for y in (low[1], high[1])])
    return geometry.transform(board.flange_from_board.matrix, face)


def _extent(board: BoardConfig) -> tuple[FloatArray, FloatArray]:
    """Returns the lower and upper corner (2,) of the plate in the board's frame, m."""
    size = board.square_m * np.array([board.columns, board.rows])
    return np.full(2, -board.margin_m), size + board.margin_m
