"""A lamp on an arm before a mirror sphere: highlights as a true camera and a true arm would give them."""

from dataclasses import dataclass

import cv2
import numpy as np

from acquisition import geometry
from acquisition.calibrate import lamp_position
from acquisition.calibrate.lamp_position import Highlight
from acquisition.models.base import FloatArray
from hardware_sim import nominal

CALIBRATION = nominal.calibration(1024)
CENTER_M, RADIUS_M = np.array([0.55, 0.0, 0.03]), 0.025
POSE_COVARIANCE = np.diag([2e-4**2] * 3 + [3e-4**2] * 3)


@dataclass(frozen=True)
class Truth:
    lamp_m: FloatArray
    center_m: FloatArray
    base_from_camera: FloatArray


def truth(seed: int) -> Truth:
    random = np.random.default_rng(seed)
    error = np.sqrt(np.diag(POSE_COVARIANCE)) * random.standard_normal(6)
    return Truth(
        0.006 * random.standard_normal(3), CENTER_M + 0.004 * random.standard_normal(3),
        np.array(CALIBRATION.base_from_camera) @ geometry.pose(error[:3], error[3:]),
    )  # fmt: skip


def tools(count: int, seed: int, tilt_deg: float = 45.0, slant_deg: float = 70.0) -> FloatArray:
    """Poses (count, 4, 4) of the tool on the dome, its axis tilted away from the sphere to random sides."""
    random = np.random.default_rng(1000 + seed)
    made: list[FloatArray] = []
    for _ in range(count):
        up = geometry.direction(np.radians(random.uniform(8, slant_deg)), random.uniform(0, 2 * np.pi))
        side = np.cross(up, random.standard_normal(3))
        tilt = np.radians(random.uniform(0, tilt_deg))
        z = -np.cos(tilt) * up + np.sin(tilt) * side / np.linalg.norm(side)
        x = np.cross(z, random.standard_normal(3))
        x /= np.linalg.norm(x)
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = np.stack([x, np.cross(z, x), z], axis=1), CENTER_M + 0.45 * up
        made.append(pose)
    return np.stack(made)


def highlights(known: Truth, poses: FloatArray, seed: int, noise_px: float = 0.1) -> list[Highlight]:
    random = np.random.default_rng(2000 + seed)
    camera = geometry.inverse(known.base_from_camera)
    made: list[Highlight] = []
    for number, tool in enumerate(poses):
        deviation = geometry.pose(3e-5 * random.standard_normal(3), 5e-5 * random.standard_normal(3))
        lamp = geometry.transform(tool @ deviation, known.lamp_m)
        point = lamp_position.reflection(known.center_m, RADIUS_M, known.base_from_camera[:3, 3], lamp[None])
        pixel = cv2.projectPoints(
            geometry.transform(camera, point), np.zeros(3), np.zeros(3), np.array(CALIBRATION.camera_matrix),
            np.array(CALIBRATION.distortion),
        )[0].reshape(2)  # fmt: skip
        made.append(Highlight(f"{number:03}.png", pixel + noise_px * random.standard_normal(2), tool))
    return made
