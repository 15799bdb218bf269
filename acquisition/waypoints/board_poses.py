"""Samples, solves and checks arm poses that show the board on the flange to the camera.

`calibrate.view_planning` judges how useful a view is for a calibration. This module finds the views that the arm can
take: the board anywhere in the image, tilted to any side, within the joint limits, free of collisions, with no part of
the arm between lens and board. The board is placed by the calibration in use, which is only approximate; the cell's
clearances, which are centimetres, keep the plate free nevertheless.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from acquisition import geometry
from acquisition.models.base import BoolArray, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import BoardConfig, CellConfig
from acquisition.models.errors import ErrorCode, RigError
from acquisition.waypoints import calibrated_kinematics, kinematics, mounted_tool
from acquisition.waypoints.collision import Scene
from acquisition.waypoints.ik_solutions import IkSolutions

MIN_TILT_DEG, MAX_TILT_DEG = 5.0, 42.0
"""Tilt of the board against the view, degrees: beyond 45° corners blur along one direction."""
NEAREST, FARTHEST = 0.35, 1.1
"""Side of the board relative to the image's shorter side: smaller boards waste pixels, larger ones leave the image."""
DEPTHS = 0.4, 1.05
"""Distances of the board from the camera, relative to that of the object's middle: beyond these it is out of focus."""
BORDER = 0.12
"""Share of the image at each edge in which the middle of the board is not placed."""
BEFORE_BOARD = 0.97
"""Share of a line of sight, from the lens, that must be clear: the rest ends at the plate, with the arm behind it."""
SIGHT_MARGIN_M = 0.005
"""Distance, m, of the arm from lines of sight: half the entrance pupil of the lens."""


@dataclass(frozen=True)
class BoardPoses:
    """Free configurations of each sampled board pose, and the number of poses without one, by reason."""

    solutions: list[IkSolutions]
    refused: dict[str, int]


def sample(cell: CellConfig, calibration: Calibration, count: int, seed: int) -> FloatArray:
    """Samples flange poses (count, 4, 4), base frame, that show the board, with random place, tilt and roll.

    Raises RigError config.invalid if the board has a useful size in the image at no distance.
    """
    board = mounted_tool.require_board(cell)
    random = np.random.default_rng(seed)
    near, far = _depths(board, cell, calibration)
    to_corner = np.eye(4)
    to_corner[:2, 3] = -np.array([board.columns, board.rows]) * board.square_m / 2
    from_flange = to_corner @ geometry.inverse(board.flange_from_board.matrix)
    made = np.empty((count, 4, 4))
    for pose in made:
        share = random.uniform(BORDER, 1 - BORDER, 2)
        pixel = share * (calibration.width, calibration.height)
        ray = np.append(geometry.undistorted(pixel, calibration.camera_matrix, calibration.distortion), 1.0)
        tilt, side = np.radians(random.uniform(MIN_TILT_DEG, MAX_TILT_DEG)), random.uniform(0, 2 * np.pi)
        facing = Rotation.from_rotvec(tilt * np.array([np.cos(side), np.sin(side), 0.0]))
        roll = Rotation.from_rotvec([0.0, 0.0, random.uniform(-np.pi, np.pi)])
        middle = np.eye(4)
        middle[:3, :3], middle[:3, 3] = (facing * roll).as_matrix(), random.uniform(near, far) * ray
        pose[:] = np.array(calibration.base_from_camera) @ middle @ from_flange
    return made


def solve(flanges: FloatArray, cell: CellConfig, calibration: Calibration, arm: Scene) -> BoardPoses:
    """Returns the free configurations (all branches) of flange poses (N, 4, 4) that keep the board in sight."""
    solved = kinematics.inverse(arm.model, flanges)
    if cell.arm.kinematics is not None:
        pose, branch = np.nonzero(~np.isnan(solved[..., 0]))
        chain = calibrated_kinematics.chain(cell.arm.kinematics)
        solved[pose, branch] = calibrated_kinematics.refine(chain, solved[pose, branch], flanges[pose])
    within = kinematics.unwrap(solved, np.array(cell.arm.home))
    owner, rows = np.nonzero(~np.isnan(within[..., 0]))
    joints = within[owner, rows]
    refused = {"too-far": len(flanges) - len(np.unique(owner))}
    free = arm.free(joints)
    refused["hits-something"] = len(np.unique(owner)) - len(np.unique(owner[free]))
    owner, joints = owner[free], joints[free]
    seen = in_sight(joints, cell, calibration, arm)
    refused["blocks-view"] = len(np.unique(owner)) - len(np.unique(owner[seen]))
    owner, joints = owner[seen], joints[seen]
    return BoardPoses([IkSolutions(joints[owner == number], None) for number in np.unique(owner)], refused)


def in_sight(joints: FloatArray, cell: CellConfig, calibration: Calibration, arm: Scene) -> BoolArray:
    """Tells whether the arm at each of (N, 6) leaves the lines of sight from the lens to the plate's edges clear.

    The plate itself, at which the lines end, does not count as an obstacle.
    """
    if not len(joints):
        return np.zeros(0, dtype=bool)
    board = mounted_tool.require_board(cell)
    links = kinematics.forward(arm.model, joints)
    corners = mounted_tool.plate_corners(board)
    face = np.concatenate([corners, [corners.mean(axis=0)], (corners + np.roll(corners, 1, axis=0)) / 2])
    targets = _in_each_frame(links[:, 6], face)
    lens = np.array(calibration.base_from_camera)[:3, 3]
    ends = lens + BEFORE_BOARD * (targets - lens)
    clear = np.ones(len(joints), dtype=bool)
    plates = len(mounted_tool.plate(board))
    for link, row in zip(arm.links[:-plates], arm.capsules[:-plates], strict=True):
        start, end = (_in_each_frame(links[:, link], row[part].reshape(1, 3))[:, 0] for part in (slice(3), slice(3, 6)))
        distance = _distance_of_segments(lens, ends, start[:, None], end[:, None])
        clear &= (distance > row[6] + SIGHT_MARGIN_M).all(axis=1)
    return clear


def _in_each_frame(frames: FloatArray, points: FloatArray) -> FloatArray:
    """Transforms points (P, 3) by each of frames (N, 4, 4) into the frames' reference: (N, P, 3)."""
    return np.einsum("nij,pj->npi", frames[:, :3, :3], points) + frames[:, None, :3, 3]


def _distance_of_segments(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> FloatArray:
    """Returns the distance of segments a–b and c–d (…, 3), broadcast (Ericson 2005, 5.1.9)."""
    u, v, w = b - a, d - c, a - c
    uu, vv, uv = (np.maximum((x * y).sum(-1), 1e-18 if x is y else -np.inf) for x, y in ((u, u), (v, v), (u, v)))
    uw, vw = (u * w).sum(-1), (v * w).sum(-1)
    denominator = np.maximum(uu * vv - uv**2, 1e-18)
    s = np.clip((uv * vw - vv * uw) / denominator, 0, 1)
    t = np.clip((uv * s + vw) / vv, 0, 1)
    s = np.clip((uv * t - uw) / uu, 0, 1)
    return np.linalg.norm(w + s[..., None] * u - t[..., None] * v, axis=-1)


def _depths(board: BoardConfig, cell: CellConfig, calibration: Calibration) -> tuple[float, float]:
    """Returns the nearest and farthest distance of the board's middle along the camera's z, m."""
    side = max(board.columns, board.rows) * board.square_m
    shorter = min(calibration.width, calibration.height)
    focal = calibration.camera_matrix[0][0]
    near, far = focal * side / (FARTHEST * shorter), focal * side / (NEAREST * shorter)
    keep_out = cell.object.keep_out
    middle = geometry.transform(keep_out.base_from_object.matrix, [0.0, 0.0, keep_out.height_m / 2])
    depth = float(geometry.transform(geometry.inverse(np.array(calibration.base_from_camera)), middle)[2])
    low, high = max(near, DEPTHS[0] * depth), min(far, DEPTHS[1] * depth)
    if low >= high:
        raise RigError(
            ErrorCode.CONFIG_INVALID,
            f"A board of {1e3 * side:.0f} mm has a useful size in the image at {near:.2f} to {far:.2f} m from the "
            f"camera, but the camera is focused at {depth:.2f} m: use another size of board",
        )
    return low, high
