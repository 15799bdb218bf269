"""Camera and hand–eye calibration beside other programs on the same corners: OpenCV, mrcal, KinHEC's solvers."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from acquisition import geometry
from acquisition.calibrate import hand_eye, intrinsics
from acquisition.calibrate.charuco import CharucoBoard, View
from acquisition.models.base import FloatArray
from acquisition.waypoints import calibrated_kinematics
from tests.acquisition.calibrate.synthetic import BOARD, NOMINAL, SIZE, Truth, joints_of, truth, views

pytestmark = pytest.mark.long
SCRIPTS = Path(__file__).parent / "oracles"
DEBIAN_PYTHON = "/usr/bin/python3"
COUNT = 12
"""Sequences of KinHEC."""


def run(*command: str | Path) -> None:
    environment = {"PATH": "/usr/bin:/bin", "HOME": str(Path.home())}
    environment |= {name: value for name, value in os.environ.items() if name.startswith("PIP_")}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def full_views(known: Truth, seed: int) -> list[View]:
    """Views in which all corners are in the image, as mrcal wants them."""
    seen = views(known, joints_of(known, 60, seed), seed)
    return [view for view in seen if len(view.corners) == len(BOARD.corners_m)][:25]


def rays_of(seen: list[View], fit: intrinsics.CameraFit) -> FloatArray:
    """Directions (K, 3) in which corners were seen."""
    parameters = fit.adjusted.parameters
    pixels = np.concatenate([view.pixels for view in seen])[:, None]
    flat = cv2.undistortPoints(pixels, parameters.matrix, parameters.camera[4:])[:, 0]
    return np.column_stack([flat, np.ones(len(flat))])


def difference_px(ours: FloatArray, theirs: FloatArray, rays: FloatArray, focal: float) -> float:
    """Root mean square of the difference of projections after the best rotation of one camera against the other.

    A small rotation of the camera moves all pixels alike to first order and belongs to the views' poses.
    """
    x, y = rays[:, 0], rays[:, 1]
    by_rotation = np.stack(
        [np.stack([-x * y, 1 + x * x, -y], axis=1), np.stack([-1 - y * y, x * y, x], axis=1)], axis=1
    ).reshape(-1, 3)
    left = (theirs - ours).reshape(-1) / focal
    left = left - by_rotation @ np.linalg.lstsq(by_rotation, left, rcond=None)[0]
    return float(focal * np.sqrt(np.mean(left**2) * 2))


def projected(matrix: FloatArray, distortion: FloatArray, rays: FloatArray) -> FloatArray:
    """Pixels (K, 2) of directions (K, 3)."""
    return cv2.projectPoints(rays, np.zeros(3), np.zeros(3), matrix, distortion)[0][:, 0]


@pytest.mark.parametrize("seed", range(300, 304))
def test_camera_agrees_with_mrcal(seed: int, tmp_path: Path) -> None:
    """Both find the board's warp, of which mrcal knows no twist."""
    found = subprocess.run([DEBIAN_PYTHON, "-c", "import mrcal"], capture_output=True, check=False)
    if found.returncode:
        pytest.skip("Debian's python3-mrcal is not installed: apt-get install python3-mrcal")
    known = truth(seed)
    seen = full_views(replace(known, warp=known.warp * [1, 1, 0]), seed)
    fit = intrinsics.fit(BOARD, seen, SIZE)
    rays = rays_of(seen, fit)
    np.savez(
        tmp_path / "corners.npz", pixels=np.stack([view.pixels for view in seen]), rows=BOARD.rows - 1,
        columns=BOARD.columns - 1, pitch_m=BOARD.square_m, size=np.array(SIZE), focal=4200.0, rays=rays,
    )  # fmt: skip
    run(DEBIAN_PYTHON, SCRIPTS / "mrcal_camera.py", tmp_path / "corners.npz", tmp_path / "mrcal.npz")
    parameters = fit.adjusted.parameters
    ours = projected(parameters.matrix, parameters.camera[4:], rays)
    difference = difference_px(ours, np.load(tmp_path / "mrcal.npz")["pixels"], rays, 4200.0)
    print(seed, f"{difference:.1e} px from mrcal")
    assert difference <= 0.1


@pytest.mark.parametrize("seed", range(300, 304))
def test_camera_of_flat_board_agrees_with_opencv(seed: int) -> None:
    """OpenCV takes a board for flat: on one that is, the two differ by the noise that the warp takes up."""
    seen = full_views(replace(truth(seed), warp=np.zeros(3)), seed)
    fit = intrinsics.fit(BOARD, seen, SIZE)
    rays = rays_of(seen, fit)
    _, matrix, distortion, *_ = cv2.calibrateCamera(
        [BOARD.corners_m.astype(np.float32)] * len(seen),
        [view.pixels.astype(np.float32).reshape(-1, 1, 2) for view in seen], SIZE, np.eye(3), np.zeros(5),
    )  # fmt: skip
    parameters = fit.adjusted.parameters
    ours = projected(parameters.matrix, parameters.camera[4:], rays)
    difference = difference_px(ours, projected(matrix, distortion.ravel(), rays), rays, 4200.0)
    print(seed, f"{difference:.3f} px from OpenCV")
    assert difference <= 0.1


@pytest.fixture(scope="module")
def kinhec(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Python of an environment with KinHEC, and with the OpenCV that still has hand–eye solvers."""
    folder = tmp_path_factory.mktemp("kinhec")
    run(sys.executable, "-m", "venv", folder)
    run(folder / "bin" / "python", "-m", "pip", "install", "-q", "kinhec==1.1.0", "opencv-python-headless<5")
    return folder / "bin" / "python"


def error(found: FloatArray, true: FloatArray) -> tuple[float, float]:
    """Distance in mm and angle in degrees between two poses."""
    between = geometry.inverse(found) @ true
    angle = Rotation.from_matrix(between[:3, :3]).magnitude()
    return 1e3 * float(np.linalg.norm(between[:3, 3])), float(np.degrees(angle))


@pytest.mark.timeout(3600)
def test_hand_eye_is_never_worse_than_reference_solvers(kinhec: Path, tmp_path: Path) -> None:
    """On sequences of KinHEC's generator: mean errors of base from camera and flange from board over all of them.

    Poses for the others are those of OpenCV's calibration from the same corners.
    """
    run(kinhec, SCRIPTS / "kinhec_sequences.py", "generate", tmp_path / "sequences.npz", str(COUNT))
    given = np.load(tmp_path / "sequences.npz")
    board, size = CharucoBoard(columns=9, rows=7, square_m=0.012), (2448, 2048)
    # KinHEC's board has its origin in the middle.
    middle = np.eye(4)
    middle[:3, 3] = board.corners_m.mean(axis=0)
    ours: list[tuple[FloatArray, FloatArray]] = []
    measured: list[FloatArray] = []
    for joints, corners, flange in zip(given["joints"], given["pixels"], given["flange"], strict=True):
        np.testing.assert_allclose(calibrated_kinematics.forward(NOMINAL, joints)[:, 6], flange, atol=1e-6)
        seen = [
            View(f"{n:03}.png", np.arange(len(board.corners_m)), pixels, one)
            for n, (pixels, one) in enumerate(zip(corners, joints, strict=True))
        ]
        found = hand_eye.fit(board, NOMINAL, seen, intrinsics.fit(board, seen, size)).adjusted.parameters
        ours.append((found.flange_from_board @ middle, found.base_from_camera))
        measured.append(camera_from_boards(board, seen, size) @ middle)
    np.savez(tmp_path / "poses.npz", flange=given["flange"], board=np.array(measured))
    run(kinhec, SCRIPTS / "kinhec_sequences.py", "solve", tmp_path / "poses.npz", tmp_path / "found.npz")
    theirs = np.load(tmp_path / "found.npz")
    estimates = {"ours": ours}
    for number, name in enumerate(json.loads(str(theirs["names"]))):
        estimates[name] = [(row[number][0], row[number][1]) for row in theirs["found"]]
    figures = {name: graded(found, given["X"], given["Y"]) for name, found in estimates.items()}
    for name, row in figures.items():
        print(f"{name:24s}" + "".join(f"{value:9.3f}" for value in row))
    for name, row in figures.items():
        assert all(np.isnan(row) | (figures["ours"] <= row)), name


def graded(found: list[tuple[FloatArray, FloatArray]], true_x: FloatArray, true_y: FloatArray) -> FloatArray:
    """Mean errors (4,): flange from board, mm and degrees, base from camera likewise."""
    rows = []
    for (x, y), own, other in zip(found, true_x, true_y, strict=True):
        of_y = (np.nan, np.nan) if np.isnan(y).any() else error(y, other)
        rows.append((*error(x, own), *of_y))
    return np.mean(rows, axis=0)


def camera_from_boards(board: CharucoBoard, seen: list[View], size: tuple[int, int]) -> FloatArray:
    """Poses (V, 4, 4) by OpenCV's calibration of the camera from the same corners."""
    _, _, _, turns, places = cv2.calibrateCamera(
        [board.corners_m.astype(np.float32)] * len(seen),
        [view.pixels.astype(np.float32).reshape(-1, 1, 2) for view in seen], size, np.eye(3), np.zeros(5),
    )  # fmt: skip
    return np.stack([geometry.pose(place.ravel(), turn.ravel()) for turn, place in zip(turns, places, strict=True)])
