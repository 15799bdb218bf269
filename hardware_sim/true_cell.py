"""True parameters of the cell's camera, lamp and arm, from which the calibration's nominal values deviate.

A cell that has just been assembled is known only from drawings and data sheets; this module samples its true
deviations. They are constant; deviations from image to image belong to `world.Profile`. Grading reads the truth from
`calibration_truth.json`; no calibration does.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from acquisition import geometry
from acquisition.models.base import Float32Array, FloatArray
from acquisition.models.calibration import Calibration
from hardware_sim import lamp_lobe
from hardware_sim.lamp_lobe import LampLobe

LAMP_OFF_M, INTENSITY_OFF = 0.010, 0.05
"""Distance of the true lamp from its nominal position, m, and deviation of its intensity, as a fraction."""

CAMERA_OFF_M, CAMERA_OFF_RAD, FOCAL_OFF = 0.005, float(np.radians(0.5)), 0.01
"""Deviation of the camera's position, m, of its rotation, rad, and of its focal length, as a fraction."""

CENTER_OFF_SHARE = 0.004
"""1 σ of the principal point, as a share of the image's width."""

JOINT_OFFSET_RAD = float(np.radians(0.1))
"""Root mean square, rad, of the offsets of joints 2 to 5. Joints 1 and 6 have none: an offset there is the same as a
turn of the base, or of whatever the flange carries."""

BEYOND_FIT = (0.02, -0.03, 0.02, 4e-5, -3e-5)
"""Magnitudes of k4, k5, k6 (rational model) and s1, s3 (thin prism) of OpenCV's distortion, of random sign: terms that
the five coefficients of `calibration.json` lack."""

VIGNETTING = 0.02
"""Loss of light in the image's corners, as a fraction; half of it more on one side, and half less on the other."""

COEFFICIENTS = 12
"""Number of coefficients of OpenCV's distortion: five polynomial, three rational and four thin-prism ones."""


@dataclass(frozen=True)
class TrueCell:
    """Camera matrix (3, 3), OpenCV's distortion (5,) or (12,), poses (4, 4), the lamp's intensity as in `Calibration`
    and its lobe, joint offsets (6,) in rad, and the lens's vignetting.

    `vignetting` holds a_x, a_y, q of the sensitivity 1 + a_x u + a_y v + q (u² + v²), where u and v are measured from
    the image's centre in half diagonals.
    """

    camera_matrix: FloatArray
    distortion: FloatArray
    base_from_camera: FloatArray
    tool_from_lamp: FloatArray
    lamp_intensity: float
    lobe: LampLobe
    joint_offsets: FloatArray
    vignetting: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def sensitivity(self, width: int, height: int) -> Float32Array:
        """Sensitivity (H, W) of the pixels, 1 in the image's centre."""
        half = np.hypot(width, height) / 2
        u = (np.arange(width) - (width - 1) / 2) / half
        v = ((np.arange(height) - (height - 1) / 2) / half)[:, None]
        a_x, a_y, q = self.vignetting
        return (1 + a_x * u + a_y * v + q * (u**2 + v**2)).astype(np.float32)

    def save(self, path: Path, **more: Any) -> None:
        """Writes `calibration_truth.json` with `more` facts; the lobe is sampled at whole degrees off the axis."""
        degrees = np.arange(0, 91)
        angle = np.radians(degrees)
        along = np.stack([np.zeros(91), np.zeros(91), np.cos(angle)], axis=1)
        facts = {
            "camera_matrix": self.camera_matrix.tolist(),
            "distortion": self.distortion.tolist(),
            "base_from_camera": self.base_from_camera.tolist(),
            "tool_from_lamp": self.tool_from_lamp.tolist(),
            "lamp_intensity": self.lamp_intensity,
            "lobe_by_degree": self.lobe.relative(along).tolist(),
            "lobe_tilt": list(self.lobe.tilt),
            "joint_offsets_rad": self.joint_offsets.tolist(),
            "vignetting": list(self.vignetting),
        }
        part = path.with_suffix(".part.json")
        part.write_text(json.dumps(facts | more, indent=2) + "\n", encoding="utf-8")
        part.replace(path)


def nominal(calibration: Calibration) -> TrueCell:
    """A cell that equals its calibration."""
    return TrueCell(
        np.array(calibration.camera_matrix),
        np.array(calibration.distortion),
        np.array(calibration.base_from_camera),
        np.array(calibration.tool_from_lamp),
        calibration.lamp_intensity,
        LampLobe(calibration.lobe_exponent),
        np.zeros(6),
    )


def perturbed(calibration: Calibration, seed: int) -> TrueCell:
    """A cell that deviates from its calibration by the amounts above, in directions that `seed` determines."""
    random = np.random.default_rng([19, seed])
    known = nominal(calibration)
    matrix = known.camera_matrix.copy()
    matrix[:2, :2] *= 1 + FOCAL_OFF * _sign(random)
    matrix[:2, 2] += CENTER_OFF_SHARE * calibration.width * random.standard_normal(2)
    distortion = np.zeros(COEFFICIENTS)
    distortion[:5] = known.distortion
    distortion[[5, 6, 7, 8, 10]] = np.array(BEYOND_FIT) * random.choice([-1.0, 1.0], 5)
    off = geometry.pose(CAMERA_OFF_M * _direction(random), CAMERA_OFF_RAD * _direction(random))
    tool_from_lamp = known.tool_from_lamp.copy()
    tool_from_lamp[:3, 3] += LAMP_OFF_M * _direction(random)
    offsets = np.zeros(6)
    drawn = random.standard_normal(4)
    offsets[1:5] = JOINT_OFFSET_RAD * drawn / np.sqrt(np.mean(drawn**2))
    side = random.uniform(0, 2 * np.pi)
    return TrueCell(
        matrix,
        distortion,
        known.base_from_camera @ off,
        tool_from_lamp,
        known.lamp_intensity * (1 + INTENSITY_OFF * _sign(random)),
        lamp_lobe.led(random),
        offsets,
        (VIGNETTING / 2 * float(np.cos(side)), VIGNETTING / 2 * float(np.sin(side)), -VIGNETTING),
    )


def _direction(random: np.random.Generator) -> FloatArray:
    vector = random.standard_normal(3)
    return vector / np.linalg.norm(vector)


def _sign(random: np.random.Generator) -> float:
    return float(random.choice([-1.0, 1.0]))
