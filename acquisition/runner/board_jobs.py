"""Jobs of sessions that calibrate with the board on the flange: poses of a pass, judgement of a frame, estimate.

They are pure except for the files of an estimate, which are written as a whole: an existing folder is complete.
"""

import json
from pathlib import Path

import numpy as np

from acquisition import lamp_pose
from acquisition.calibrate import board_results, board_session, board_view, charuco
from acquisition.calibrate.board_results import AdjustmentRecord
from acquisition.calibrate.board_session import BoardEstimate, BoardImages
from acquisition.capture.compare import has_shifted
from acquisition.formats.atomic_write import atomic_folder, discard_partial
from acquisition.models.base import as_joints
from acquisition.models.calibration import Calibration
from acquisition.models.calibration_recipe import BoardRecipe
from acquisition.models.calibration_result import CalibrationSummary
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import LightPlan
from acquisition.models.shot import Observations
from acquisition.runner.estimate_files import BASIS, CALIBRATION, SUMMARY, write_json
from acquisition.waypoints import calibrated_kinematics, mounted_tool
from acquisition.waypoints.roadmap import connected_views

CANDIDATES = 160
"""Number of candidates for a pass's poses. Twice as many lower the loss by only 2 % and take twice as long."""


def board_poses(
    recipe: BoardRecipe, cell: CellConfig, calibration: Calibration, observations: Observations, previous: Path | None
) -> LightPlan:
    """Plans the next pass's poses from all images so far; none when the accuracy or number of images is reached.

    `cell` is that of the cell file, with whatever tool it names; `previous` is the folder of the last estimate. Raises
    RigError waypoints.unreachable, calibration.infeasible.
    """
    taken = len(observations.shots)
    count = recipe.images_after(0 if previous is None else taken)
    if previous is not None:
        known = CalibrationSummary.model_validate_json((previous / SUMMARY).read_bytes())
        if known.reached or count <= 0:
            reason = "The requested accuracy is reached" if known.reached else f"All {taken} images are taken"
            return LightPlan(lights=[], method="views", reasons=[], joints=[], conclusion=f"{reason}.")
    mounted = mounted_tool.with_tool(cell, recipe.tool)
    candidates = connected_views(mounted, calibration, CANDIDATES, recipe.seed + 1)
    basis = (
        board_session.prior(cell, calibration)
        if previous is None
        else AdjustmentRecord.model_validate_json((previous / BASIS).read_bytes()).adjusted
    )
    chosen = board_session.further_views(basis, list(candidates), count, recipe, cell, calibration)
    joints = np.array([candidates[number] for number, _ in chosen])
    chain, flange_from_tool = calibrated_kinematics.of_arm(cell.arm), cell.arm.flange_from_tool.matrix
    tools = calibrated_kinematics.forward(chain, joints)[:, 6] @ flange_from_tool
    return LightPlan(
        lights=[lamp_pose.light_from_tool(tool, calibration) for tool in tools],
        method="views",
        reasons=[reason for _, reason in chosen],
        joints=[as_joints(one) for one in joints],
    )


def look_at_board(pixels: np.ndarray, cell: CellConfig) -> str:
    """Returns for people why a frame (H, W) cannot be used; empty if the board is seen."""
    return board_view.seen(pixels, mounted_tool.require_board(cell))[1]


def board_moved(before: np.ndarray, after: np.ndarray, cell: CellConfig) -> str:
    """Returns for people how the board has moved between two frames (H, W) of one pose; empty if it has not."""
    board = charuco.of_cell(mounted_tool.require_board(cell))
    first, second = charuco.detect(before, board, "before"), charuco.detect(after, board, "after")
    if first is None or second is None:
        return "the board is not seen any more" if second is None else ""
    shift_px = charuco.shift_px(first, second)
    if np.isinf(shift_px):
        return "the two frames share too few corners of the board: the board or the camera has moved"
    if has_shifted(shift_px, before.shape[1]):
        return f"the board's corners have shifted by {shift_px:.1f} pixels: the board or the camera has moved"
    return ""


def estimate_from_board(
    recipe: BoardRecipe, cell: CellConfig, calibration: Calibration, observations: Observations, folder: Path,
    last: bool,
) -> CalibrationSummary:  # fmt: skip
    """Calibrates from all images of a session and writes the estimate's folder.

    Images that do not yet determine the calibration raise RigError calibration.infeasible in the `last` pass only.
    RigError calibration.board_wrong and scene.moved are raised at once.
    """
    images = board_session.read(observations, cell)
    found, why_not = None, ""
    try:
        found = board_session.estimate(images, recipe, cell)
    except RigError as error:
        if error.code is not ErrorCode.CALIBRATION_INFEASIBLE or last:
            raise
        why_not = error.detail
    discard_partial(folder)
    with atomic_folder(folder) as partial:
        if found is not None:
            summary = _write_results(found, images, recipe, calibration, partial)
        else:
            summary = CalibrationSummary(
                kind=recipe.kind, images=len(images.hashes), used=len(images.views), estimated=False, why_not=why_not
            )
        _write_corners(images, partial / "corners.json")
        write_json(partial / BASIS, AdjustmentRecord.of(board_session.basis(found, images, cell, calibration)))
        write_json(partial / SUMMARY, summary)
    return summary


def _write_results(
    found: BoardEstimate, images: BoardImages, recipe: BoardRecipe, calibration: Calibration, folder: Path
) -> CalibrationSummary:
    """Writes the estimated values, and the calibration in use with these in place of its own."""
    made = board_results.results(found.camera, found.hand_eye, images.hashes)
    board_results.draw_projection_sigma(found.camera, made.projection_sigma_px, folder / "projection_sigma.png")
    board_results.draw_residuals(found.camera, folder / "residuals.png")
    write_json(folder / "camera.json", made.camera)
    if made.hand_eye is not None:
        write_json(folder / "hand_eye.json", made.hand_eye)
    merged = made.merged(calibration)
    write_json(folder / CALIBRATION, merged)
    summary = board_session.summary(found, images, recipe, made.camera.projection_sigma_px)
    return summary.model_copy(update={"fingerprint": merged.fingerprint})


def _write_corners(images: BoardImages, path: Path) -> None:
    corners = {
        view.name: {
            "corners": view.corners.tolist(),
            "pixels": view.pixels.tolist(),
            "joints": None if view.joints is None else view.joints.tolist(),
        }
        for view in images.views
    }
    path.write_text(json.dumps(corners), encoding="utf-8")
