"""`lightpose calibrate board | camera | hand-eye`: a board to print, and calibrations from a folder of images of it.

Results go into new files of a folder. Existing files are never overwritten, because a replaced calibration could not be
restored. The cell file states which calibration a cell uses.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError
from rich.console import Console

from acquisition.calibrate import board_drawing, board_results, charuco, hand_eye, intrinsics, view_planning
from acquisition.calibrate.bundle_adjustment import Model
from acquisition.calibrate.charuco import CharucoBoard, View
from acquisition.calibrate.intrinsics import CameraFit
from acquisition.formats.folders.refusal import refusal
from acquisition.models import cell_config
from acquisition.models.base import FloatArray
from acquisition.models.calibration_result import CameraResult, ViewResidual
from acquisition.models.errors import ErrorCode, RigError, in_words
from acquisition.models.rounding import percent
from acquisition.store.folder import write_value
from acquisition.waypoints import calibrated_kinematics
from api.cli import calibration_folder
from api.cli.calibration_folder import JOINTS_FILE, read_joints, read_value, refuse_overwriting

BOARD_OPTIONS = {"border_squares": "border"}
"""Options of `calibrate board` whose names differ from the board's fields."""

LEAST_SQUARE_MM, MOST_SQUARE_MM = 1.0, 500.0
"""Limits of a board's square, mm, as of its description, which is in m."""


@dataclass(frozen=True)
class Captured:
    """A folder's images: views of the board, names and hashes of all images, and their size (width, height)."""

    views: tuple[View, ...]
    hashes: dict[str, str]
    size: tuple[int, int]


def draw_board(
    columns: int, rows: int, square_mm: float, out: Path, *, border: int = 0, legacy: bool = False
) -> dict[str, Any]:
    """Draws a board, and writes its description beside it as `<name>.json`.

    Raises RigError request.invalid for squares that make no board, config.invalid for a file's ending.
    """
    if not LEAST_SQUARE_MM < square_mm < MOST_SQUARE_MM:
        raise RigError(
            ErrorCode.REQUEST_INVALID,
            f"--square-mm {square_mm:g}: give more than {LEAST_SQUARE_MM:g} and less than {MOST_SQUARE_MM:g} mm",
        )
    try:
        board = CharucoBoard(
            columns=columns, rows=rows, square_m=square_mm / 1000, legacy_pattern=legacy, border_squares=border
        )
    except ValidationError as error:
        raise RigError(ErrorCode.REQUEST_INVALID, _option_and_fault(error)) from error
    if border and board.blank_m is None:
        raise RigError(
            ErrorCode.REQUEST_INVALID,
            f"--border {border}: it leaves no blank middle in {columns} × {rows} squares: give a smaller one",
        )
    described = out.with_suffix(".json")
    refuse_overwriting(out, described)
    out.parent.mkdir(parents=True, exist_ok=True)
    board_drawing.draw(board, out)
    write_value(described, board)
    width, height = board.size_m
    console = Console(stderr=True, markup=False)
    console.print(f"{out}: print at 100 %, glue to a flat plate; it covers {1e3 * width:g} × {1e3 * height:g} mm")
    console.print(f"{described}: measure ten squares on the print and correct square_m")
    return {"board": str(out), "description": str(described)}


def _option_and_fault(error: ValidationError) -> str:
    """Formats the first fault of a board with the option that it concerns."""
    wrong = error.errors()[0]
    if not wrong["loc"]:
        return in_words(wrong)
    name = str(wrong["loc"][0])
    return f"--{BOARD_OPTIONS.get(name, name)}: {in_words(wrong)}"


def calibrate_camera(folder: Path, board_file: Path, out: Path, base: Path | None = None) -> dict[str, Any]:
    """Calibrates a camera from a folder of images of the board.

    Writes `camera.json`, `projection_sigma.png` and, with `base`, a `calibration.json` that is `base` with the new
    camera. Raises RigError folder.invalid, config.invalid and calibration.infeasible, before anything is written.
    """
    refuse_overwriting(*(out / name for name in ("camera.json", "projection_sigma.png", *_merged_name(base))))
    merged = cell_config.load_calibration(base) if base is not None else None
    board, captured = _read(folder, board_file, None)
    found = intrinsics.fit(board, captured.views, captured.size)
    result = _write_camera(found, captured, out)
    if merged is not None:
        write_value(out / "calibration.json", board_results.with_camera(merged, result))
    console = Console(stderr=True, markup=False)
    _show_views(console, result.views)
    console.print(
        f"focal length {result.camera_matrix[0][0]:.1f} px; projection uncertainty "
        f"{result.projection_sigma_px:.3f} px (median), {result.worst_projection_sigma_px:.3f} px at the worst"
    )
    return result.model_dump(mode="json")


def calibrate_hand_eye(
    folder: Path, board_file: Path, cell_file: Path, out: Path, base: Path | None = None,
    candidates: Path | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Calibrates base from camera from images of the board on the flange and the arm's joints at each (`joints.csv`).

    The camera is calibrated on the same images. Writes `hand_eye.json`, `camera.json`, `projection_sigma.png` and, with
    `base`, a `calibration.json` with the new camera and pose. The result names which of `candidates` (a file like
    `joints.csv`) is the best next view. Raises RigError as `calibrate_camera`.
    """
    names = ("camera.json", "projection_sigma.png", "hand_eye.json", *_merged_name(base))
    refuse_overwriting(*(out / name for name in names))
    cell = cell_config.load(cell_file)
    merged = cell_config.load_calibration(base) if base is not None else None
    chain = calibrated_kinematics.of_arm(cell.arm)
    offered = read_joints(candidates) if candidates is not None else {}
    board, captured = _read(folder, board_file, read_joints(folder / JOINTS_FILE))
    camera = intrinsics.fit(board, captured.views, captured.size)
    found = hand_eye.fit(board, chain, captured.views, camera)
    if found.furthest is not None:
        raise RigError(
            ErrorCode.CALIBRATION_INFEASIBLE,
            f"The board is {1e3 * found.adjusted.arm_sigma[0]:.1f} mm from where the arm's joints put it, most in "
            f"{found.furthest}: does {JOINTS_FILE} state each image's own joints in rad, is the cell file's arm this "
            "one, and did board, camera and arm stay fixed?",
            image=found.furthest,
        )
    # This camera fits all corners together with the arm's motions, which fix the scale of the views.
    result = board_results.hand_eye_result(found, captured.hashes)
    camera_result = _write_camera(CameraFit(captured.size, found.adjusted), captured, out)
    write_value(out / "hand_eye.json", result)
    if merged is not None:
        placed = board_results.with_hand_eye(merged, result)
        write_value(out / "calibration.json", board_results.with_camera(placed, camera_result))
    console = Console(stderr=True, markup=False)
    _show_views(console, result.views)
    console.print(
        f"camera known to {1e3 * result.position_sigma_m:.2f} mm and {np.degrees(result.rotation_sigma_rad):.3f}°; "
        f"joint offsets {', '.join(f'{np.degrees(one):.3f}' for one in result.joint_offsets_rad[1:5])}° "
        f"(joints 2–5); the arm deviates by {1e3 * result.arm_sigma_m:.3f} mm"
    )
    following = _next_view(console, Model(board, chain), found, offered, captured.size)
    return result.model_dump(mode="json") | ({} if candidates is None else {"next_view": following})


def _next_view(
    console: Console, model: Model, found: hand_eye.HandEyeFit, offered: dict[str, FloatArray], size: tuple[int, int]
) -> str | None:
    """Returns the name of the offered view that lowers the pose's uncertainty most; None if none shows the board."""
    best = view_planning.next_view(model, found.adjusted, list(offered.values()), size)
    if best is None:
        return None
    name, loss = list(offered)[best[0]], best[1]
    gain = 1 - (loss / view_planning.loss(found.covariance)) ** 0.5
    console.print(f"take next: {name}, which lowers the pose's uncertainty by {percent(gain, 0)}")
    return name


# ------------------------------------------------------------------------------------------------------ what is given


def _read(folder: Path, board_file: Path, joints: dict[str, FloatArray] | None) -> tuple[CharucoBoard, Captured]:
    board = read_value(board_file, CharucoBoard, "description of a board")
    views: list[View] = []
    hashes: dict[str, str] = {}
    size = (0, 0)
    for image in calibration_folder.images(folder, joints):
        hashes[image.name], size = image.sha256, image.size
        view = charuco.detect(image.values, board, image.name, None if joints is None else joints[image.name])
        if view is not None:
            views.append(view)
    if not views:
        raise refusal(
            folder,
            f"none of its {len(hashes)} images shows the board: check columns, rows and legacy_pattern in "
            f"{board_file.name}, focus and exposure",
        )
    return board, Captured(tuple(views), hashes, size)


# ---------------------------------------------------------------------------------------------------- what is written


def _merged_name(base: Path | None) -> tuple[str, ...]:
    """Returns the name of the calibration that is written if `base` is given."""
    return () if base is None else ("calibration.json",)


def _write_camera(found: CameraFit, captured: Captured, out: Path) -> CameraResult:
    """Writes `camera.json` and `projection_sigma.png`."""
    sigma = intrinsics.projection_sigma(found)
    result = board_results.camera_result(found, captured.hashes, sigma)
    out.mkdir(parents=True, exist_ok=True)
    board_results.draw_projection_sigma(found, sigma, out / "projection_sigma.png")
    write_value(out / "camera.json", result)
    return result


def _show_views(console: Console, views: Sequence[ViewResidual]) -> None:
    for view in views:
        if view.rms_px is None:
            why = "left out, its corners contradict the other images" if view.left_out else "the board is not seen"
            console.print(f"{view.image}: {why}", style="yellow")
        else:
            more = f", {view.left_out} left out as misread" if view.left_out else ""
            console.print(f"{view.image}: {view.corners} corners, {view.rms_px:.3f} px{more}", style="dim")
