"""A board on the flange of an arm before a camera: corners as a true camera and a true arm would give them."""

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from acquisition import geometry
from acquisition.calibrate.charuco import CharucoBoard, View
from acquisition.models.base import FloatArray
from acquisition.waypoints import calibrated_kinematics, kinematics

SIZE = (1600, 1200)
BOARD = CharucoBoard(columns=9, rows=7, square_m=0.012)
NOMINAL = np.array(kinematics.denavit_hartenberg(kinematics.arm_model("ur5e")))

TWIST_SIGMA_M = 1e-4
"""1 σ by which opposite corners of the board stand out, m."""


@dataclass(frozen=True)
class Truth:
    """What is true of a cell: camera (9,) as in `bundle_adjustment.CAMERA`, board's warp, scale of its squares, poses,
    joint offsets, and 1 σ of the arm's deviation, m and rad, and of a corner, pixels."""

    camera: FloatArray
    warp: FloatArray
    scale: float
    base_from_camera: FloatArray
    flange_from_board: FloatArray
    joint_offsets: FloatArray
    arm_sigma: tuple[float, float] = (3e-5, 5e-5)
    corner_sigma_px: float = 0.05

    @property
    def matrix(self) -> FloatArray:
        f_x, f_y, c_x, c_y = self.camera[:4]
        return np.array([[f_x, 0, c_x], [0, f_y, c_y], [0, 0, 1.0]])


def truth(seed: int, scale_sigma: float = 3e-4) -> Truth:
    random = np.random.default_rng(seed)
    camera = np.array([4200.0, 4205.0, 805.0, 590.0, -0.1, 0.12, 4e-4, -3e-4, 0.0])
    camera[:4] *= 1 + 0.01 * random.standard_normal(4)
    offsets = np.radians(0.1) * random.standard_normal(6)
    offsets[[0, 5]] = 0
    twist_m = TWIST_SIGMA_M * np.random.default_rng(4000 + seed).standard_normal()
    down = geometry.pose((0.55, 0.0, 0.9), (np.pi, 0.0, 0.0))
    return Truth(
        camera, np.append(3e-4 * random.standard_normal(2), twist_m), scale_sigma * random.standard_normal(),
        down @ geometry.pose(0.01 * random.standard_normal(3), 0.02 * random.standard_normal(3)),
        geometry.pose((-0.054, -0.042, 0.05), (0.0, 0.0, 0.0))
        @ geometry.pose(0.003 * random.standard_normal(3), 0.02 * random.standard_normal(3)),
        offsets,
    )  # fmt: skip


def joints_of(known: Truth, count: int, seed: int, tilt_deg: tuple[float, float] = (15.0, 40.0)) -> FloatArray:
    """Joints (count, 6) at which the board is before the camera, tilted to random sides."""
    random = np.random.default_rng(1000 + seed)
    found: list[FloatArray] = []
    while len(found) < count:
        tilt, side, roll = np.radians(random.uniform(*tilt_deg)), random.uniform(0, 2 * np.pi), random.uniform(-3, 3)
        facing = Rotation.from_rotvec(tilt * np.array([np.cos(side), np.sin(side), 0])) * Rotation.from_rotvec(
            [0, 0, roll]
        )
        middle = np.eye(4)  # of the board, in the camera's frame
        middle[:3, :3] = facing.as_matrix()
        middle[:3, 3] = (*random.uniform(-0.05, 0.05, 2), random.uniform(0.42, 0.6))
        to_corner = np.eye(4)
        to_corner[:2, 3] = -np.array(BOARD.size_m) / 2
        flange = known.base_from_camera @ middle @ to_corner @ geometry.inverse(known.flange_from_board)
        solutions = kinematics.inverse(kinematics.arm_model("ur5e"), flange[None])[0]
        reachable = solutions[np.isfinite(solutions).all(axis=1)]
        if len(reachable):
            found.append(reachable[0])
    return np.stack(found)


def camera_from_boards(known: Truth, joints: FloatArray, seed: int) -> FloatArray:
    """True poses (V, 4, 4) of the board in the camera's frame at stated joints, the arm's deviations included."""
    random = np.random.default_rng(2000 + seed)
    links = calibrated_kinematics.forward(NOMINAL, joints + known.joint_offsets)[:, 6]
    deviations = np.stack([
        geometry.pose(known.arm_sigma[0] * random.standard_normal(3), known.arm_sigma[1] * random.standard_normal(3))
        for _ in joints
    ])  # fmt: skip
    return geometry.inverse(known.base_from_camera) @ links @ known.flange_from_board @ deviations


def views(known: Truth, joints: FloatArray, seed: int) -> list[View]:
    """Corners that the true camera sees of the true board on the true arm, with noise; those in the image."""
    random = np.random.default_rng(3000 + seed)
    flat = BOARD.corners_m
    u, v = (2 * flat[:, :2] / np.array(BOARD.size_m) - 1).T
    depth = known.warp[0] * (1 - u * u) + known.warp[1] * (1 - v * v) + known.warp[2] * u * v
    points = np.column_stack([(1 + known.scale) * flat[:, :2], depth])
    made: list[View] = []
    for number, (pose, stated) in enumerate(zip(camera_from_boards(known, joints, seed), joints, strict=True)):
        vector = cv2.Rodrigues(pose[:3, :3])[0]
        pixels = cv2.projectPoints(points, vector, pose[:3, 3], known.matrix, known.camera[4:])[0].reshape(-1, 2)
        pixels = pixels + known.corner_sigma_px * random.standard_normal(pixels.shape)
        inside = ((pixels > 5) & (pixels < np.array(SIZE) - 5)).all(axis=1)
        if inside.sum() >= 20:
            made.append(View(f"{number:03}.png", np.flatnonzero(inside), pixels[inside], stated))
    return made


def image(known: Truth, camera_from_board: FloatArray, size: tuple[int, int]) -> np.ndarray:
    """Image (H, W), 8 bits, of the flat board on grey, by rays through a grid of two by two in each pixel."""
    width, height = size
    finer = (np.arange(2) - 0.5) / 2
    u, v = np.meshgrid((np.arange(width)[:, None] + finer).ravel(), (np.arange(height)[:, None] + finer).ravel())
    pixels = np.stack([u.ravel(), v.ravel()], axis=-1).reshape(-1, 1, 2)
    rays = np.column_stack([cv2.undistortPoints(pixels, known.matrix, known.camera[4:])[:, 0], np.ones(u.size)])
    board_from_camera = geometry.inverse(camera_from_board)
    direction, origin = rays @ board_from_camera[:3, :3].T, board_from_camera[:3, 3]
    hit = origin + direction * (-origin[2] / direction[:, 2])[:, None]
    square_px = 84
    shape = (BOARD.columns * square_px, BOARD.rows * square_px)
    drawn = cv2.copyMakeBorder(BOARD.opencv().generateImage(shape), 60, 60, 60, 60, cv2.BORDER_CONSTANT, value=[255])
    at = (hit[:, :2] / BOARD.square_m * square_px + 59.5).astype(np.float32).reshape(*u.shape, 2)
    fine = cv2.remap(drawn, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=[90])
    return cv2.GaussianBlur(cv2.resize(fine, size, interpolation=cv2.INTER_AREA), (0, 0), 0.6)
