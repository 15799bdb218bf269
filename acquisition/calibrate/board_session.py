"""Steps of a calibration session with the board on the flange: reads images, estimates, and plans further views.

Every pass estimates anew from all images, because planning further views needs the covariance of the present estimate.
Until there are enough views, the calibration in use stands in for an estimate, with the covariance of a cell that was
set up with a ruler.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from acquisition.calibrate import charuco, hand_eye, intrinsics, view_planning
from acquisition.calibrate.bundle_adjustment import (
    ARM_SIGMA_START,
    BASE_FROM_CAMERA,
    CAMERA,
    CORNER_SIGMA_START_PX,
    FLANGE_FROM_BOARD,
    JOINT_OFFSET_SIGMA_RAD,
    JOINT_OFFSETS,
    SCALE,
    SCALE_SIGMA,
    UNKNOWNS,
    WARP,
    WARP_SIGMA_M,
    Adjusted,
    Model,
    Parameters,
    information,
)
from acquisition.calibrate.charuco import CharucoBoard, View
from acquisition.calibrate.hand_eye import HandEyeFit
from acquisition.calibrate.intrinsics import CameraFit
from acquisition.models.base import FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.calibration_recipe import BoardRecipe
from acquisition.models.calibration_result import USE_IT, CalibrationSummary
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.shot import Observations
from acquisition.waypoints import calibrated_kinematics, mounted_tool

FOCAL_SIGMA, CENTER_SIGMA_PX = 0.03, 30.0
"""Prior 1 σ of the focal length, as a fraction (a lens's nominal one), and of the principal point, pixels."""
DISTORTION_SIGMAS = (0.2, 0.5, 2e-3, 2e-3, 0.5)
"""Prior 1 σ of k1, k2, p1, p2, k3, for the lenses that a lab uses."""
POSE_SIGMA = (0.01, math.radians(1.0))
"""Prior 1 σ of the poses of camera and board, m and rad: placed with ruler and protractor."""


@dataclass(frozen=True)
class BoardImages:
    """A session's images: views of the board, hashes of all images by name, and their size (width, height)."""

    views: tuple[View, ...]
    hashes: dict[str, str]
    size: tuple[int, int]


@dataclass(frozen=True)
class BoardEstimate:
    """A calibrated camera and, for the kind `hand-eye`, its place."""

    camera: CameraFit
    hand_eye: HandEyeFit | None


def read(observations: Observations, cell: CellConfig) -> BoardImages:
    """Detects the cell's board in all lit images of a session."""
    board = charuco.of_cell(mounted_tool.require_board(cell))
    views: list[View] = []
    hashes: dict[str, str] = {}
    size = (0, 0)
    for shot in observations.shots:
        frame = shot.frame
        hashes[frame.path], size = frame.sha256, (frame.width, frame.height)
        view = charuco.detect(
            observations.frames.rows(frame, 0, frame.height), board, frame.path, np.array(shot.joints, dtype=float)
        )
        if view is not None:
            views.append(view)
    return BoardImages(tuple(views), hashes, size)


def estimate(images: BoardImages, recipe: BoardRecipe, cell: CellConfig) -> BoardEstimate:
    """Calibrates from all views. Raises RigError calibration.infeasible, calibration.board_wrong, scene.moved."""
    model = model_of(cell)
    camera = intrinsics.fit(model.board, images.views, images.size)
    if recipe.kind == "camera" or model.chain is None:
        return BoardEstimate(camera, None)
    found = hand_eye.fit(model.board, model.chain, images.views, camera)
    if found.furthest is not None:
        raise RigError(
            ErrorCode.SCENE_MOVED,
            f"Between the views, board, camera and arm moved by {1e3 * found.adjusted.arm_sigma[0]:.1f} mm relative to "
            f"each other, beyond the joint motion, most in {found.furthest}: tighten the board on the flange and the "
            "camera's mount, then begin a new session",
        )
    # The camera is that of the adjustment with the arm, whose motions fix the scale of the views.
    return BoardEstimate(CameraFit(images.size, found.adjusted), found)


def summary(found: BoardEstimate, images: BoardImages, recipe: BoardRecipe, projection_px: float) -> CalibrationSummary:
    """Returns the figures of an estimate, whether they meet the recipe, and what to do next.

    `projection_px` is the median over the image of 1 σ of a direction's place by the camera model, pixels.
    """
    adjusted, hand = found.camera.adjusted, found.hand_eye
    position_mm = None if hand is None else 1e3 * hand.sigma[0]
    targets = [(projection_px, recipe.target_px), (position_mm, recipe.target_mm)]
    asked = [value is not None and value <= target for value, target in targets if target is not None]
    return CalibrationSummary(
        kind=recipe.kind,
        images=len(images.hashes),
        used=len(images.views),
        estimated=True,
        reached=bool(asked) and all(asked),
        focal_px=float(adjusted.parameters.camera[0]),
        corner_sigma_px=adjusted.corner_sigma_px,
        projection_sigma_px=projection_px,
        position_sigma_mm=position_mm,
        rotation_sigma_deg=None if hand is None else math.degrees(hand.sigma[1]),
        arm_sigma_mm=None if hand is None else 1e3 * hand.adjusted.arm_sigma[0],
        square_scale=None if hand is None else 1 + adjusted.parameters.scale,
        advice=_advice(found, asked),
    )


def further_views(
    basis: Adjusted, candidates: Sequence[FloatArray], count: int, recipe: BoardRecipe, cell: CellConfig,
    calibration: Calibration,
) -> list[tuple[int, str]]:  # fmt: skip
    """Chooses the next views: numbers of at most `count` candidate joints (6,), each with its reason, a sentence.

    `basis` is the present estimate: `prior` or `basis`. Raises RigError calibration.infeasible if no candidate shows
    the board.
    """
    model, size = model_of(cell), (calibration.width, calibration.height)
    criterion, unit = _criterion(recipe, basis.parameters, size)
    chosen = view_planning.plan_views(model, basis, candidates, size, count, criterion)
    if not chosen:
        raise RigError(ErrorCode.CALIBRATION_INFEASIBLE, "No arm pose shows the board in the image")
    return [(number, f"expected error after this view: {math.sqrt(value):.3g} {unit} rms") for number, value in chosen]


def _criterion(
    recipe: BoardRecipe, parameters: Parameters, size: tuple[int, int]
) -> tuple[Callable[[FloatArray], float], str]:
    """Returns the design criterion, a mean square, and the unit of its root."""
    if recipe.kind == "hand-eye":
        return (lambda covariance: 1e6 * view_planning.pose_loss(covariance)), "mm"
    derivatives, _ = intrinsics.projection_derivatives(parameters, size)

    def projection(covariance: FloatArray) -> float:
        return float(np.mean(intrinsics.projection_sigma_by(derivatives, covariance[CAMERA, CAMERA]) ** 2))

    return projection, "px"


def basis(found: BoardEstimate | None, images: BoardImages, cell: CellConfig, calibration: Calibration) -> Adjusted:
    """Returns the present estimate of all parameters; while the images determine none, that is the calibration in use
    with the information of the views added."""
    if found is not None and found.hand_eye is not None:
        return found.hand_eye.adjusted
    model, before = model_of(cell), prior(cell, calibration)
    if found is not None and model.chain is not None:
        try:  # a calibration of the camera alone has not estimated its place, on which the next views depend
            return hand_eye.fit(model.board, model.chain, images.views, found.camera).adjusted
        except RigError as error:
            if error.code is not ErrorCode.CALIBRATION_INFEASIBLE:
                raise
    free = np.ix_(model.free, model.free)
    present = np.linalg.inv(before.covariance[free])
    for view in images.views:
        present = present + information(model, view, before)[free]
    covariance = np.zeros_like(before.covariance)
    covariance[free] = np.linalg.inv(present)
    return replace(before, covariance=covariance)


def prior(cell: CellConfig, calibration: Calibration) -> Adjusted:
    """Returns the calibration in use as an estimate, with the covariance of a cell that was set up by hand."""
    matrix = calibration.camera_matrix
    camera = np.array([matrix[0][0], matrix[1][1], matrix[0][2], matrix[1][2], *calibration.distortion])
    sigma = np.zeros(UNKNOWNS)
    sigma[CAMERA] = [FOCAL_SIGMA * camera[0]] * 2 + [CENTER_SIGMA_PX] * 2 + [*DISTORTION_SIGMAS]
    sigma[WARP], sigma[SCALE], sigma[JOINT_OFFSETS] = WARP_SIGMA_M, SCALE_SIGMA, JOINT_OFFSET_SIGMA_RAD
    sigma[BASE_FROM_CAMERA] = sigma[FLANGE_FROM_BOARD] = np.repeat(POSE_SIGMA, 3)
    parameters = Parameters(
        camera,
        np.zeros((0, 4, 4)),
        base_from_camera=np.array(calibration.base_from_camera),
        flange_from_board=mounted_tool.require_board(cell).flange_from_board.matrix,
    )
    return Adjusted(parameters, np.diag(sigma**2), CORNER_SIGMA_START_PX, ARM_SIGMA_START, (), (), ())


def model_of(cell: CellConfig) -> Model:
    """Returns the board on the cell's flange, with the arm's chain."""
    board: CharucoBoard = charuco.of_cell(mounted_tool.require_board(cell))
    return Model(board, calibrated_kinematics.of_arm(cell.arm))


def _advice(found: BoardEstimate, asked: Sequence[bool]) -> list[str]:
    said: list[str] = []
    if asked and not all(asked):
        said.append("The requested accuracy is not reached: allow more images, or use a larger board.")
    if found.hand_eye is not None and found.hand_eye.adjusted.arm_sigma[0] > 1e-4:
        said.append(
            "The arm deviates from its kinematic model by more than 0.1 mm: state its factory kinematics in the cell "
            "file (`lightpose check` prints them)."
        )
    if found.camera.adjusted.corner_sigma_px > 0.3:
        said.append(
            "Corners scatter by more than 0.3 px: check whether images are blurred and whether the board is flat."
        )
    return said or [USE_IT]
