"""Errors of a found calibration against the truth of the simulated cell, and that truth as a calibration.

The truth is read from `calibration_truth.json`, which no calibration reads. Positions are compared in the frame in
which they are stated: the camera's in the arm's base frame, the lamp's in the tool's. What matters is the direction
from the object to the lamp as the camera sees it (`direction_deg`), in which all errors and the joint offsets add up.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from acquisition import geometry, image_values, photometry
from acquisition.models.base import Float32Array, FloatArray, as_matrix4
from acquisition.models.calibration import Calibration, LampLobe
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import ErrorCode, RigError
from acquisition.waypoints import calibrated_kinematics

LOBE_TO_DEG = 40
"""Angle off the lamp's axis up to which its lobe is graded; this exceeds the part that lights an aimed-at object."""

SIDES = 12
"""Number of directions round the axis in which the lobe is graded."""

KNOT_STEP_DEG, LAST_KNOT_DEG = 2, 76
"""Knots of the true lobe as a calibration states it; beyond the last one the calibration keeps the last factor."""


@dataclass(frozen=True)
class CalibrationErrors:
    """Deviations from the truth: positions in mm; rotations in degrees; intensity, lobe (maximum up to LOBE_TO_DEG to
    all sides), focal length and flat field (root mean square over the image) in per cent."""

    lamp_mm: float
    intensity_percent: float
    lobe_percent: float
    camera_mm: float
    camera_deg: float
    focal_percent: float
    flat_field_percent: float


def load(path: Path) -> dict[str, Any]:
    """Reads `calibration_truth.json`. Raises RigError store.corrupt that names the file."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        detail = f"{path} is not a ground-truth file: {error}"
        raise RigError(ErrorCode.STORE_CORRUPT, detail, file=str(path)) from error


def errors(found: Calibration, truth: dict[str, Any]) -> CalibrationErrors:
    """Grades a calibration against the truth."""
    camera, true_camera = np.array(found.base_from_camera), np.array(truth["base_from_camera"])
    lamp, true_lamp = (np.array(pose)[:3, 3] for pose in (found.tool_from_lamp, truth["tool_from_lamp"]))
    focal, true_focal = (np.diag(np.array(matrix))[:2] for matrix in (found.camera_matrix, truth["camera_matrix"]))
    sensitivity = _true_sensitivity(found, truth)
    turn = Rotation.from_matrix(true_camera[:3, :3].T @ camera[:3, :3]).magnitude()
    return CalibrationErrors(
        lamp_mm=1e3 * float(np.linalg.norm(lamp - true_lamp)),
        intensity_percent=100 * abs(found.lamp_intensity / truth["lamp_intensity"] - 1),
        lobe_percent=100 * float(np.abs(_lobe(found) / _true_lobe(truth) - 1).max()),
        camera_mm=1e3 * float(np.linalg.norm(camera[:3, 3] - true_camera[:3, 3])),
        camera_deg=float(np.degrees(turn)),
        focal_percent=100 * float(np.abs(focal / true_focal - 1).max()),
        flat_field_percent=100 * float(np.sqrt(np.mean((_sensitivity(found) / sensitivity - 1) ** 2))),
    )


def error_probabilities(found: Calibration, truth: dict[str, Any]) -> dict[str, float]:
    """Probability of errors up to the actual ones by the stated covariances; uniform over 0–1 if covariances are right.

    Computed for the lamp's position, the camera's pose (six at once) and the flat field's terms, where they are stated.
    """
    camera = geometry.inverse(np.array(truth["base_from_camera"])) @ np.array(found.base_from_camera)
    motion = np.concatenate([camera[:3, 3], Rotation.from_matrix(camera[:3, :3]).as_rotvec()])
    lamp = np.array(found.tool_from_lamp)[:3, 3] - np.array(truth["tool_from_lamp"])[:3, 3]
    flat = found.flat_field
    stated = [
        ("lamp", lamp, found.tool_from_lamp_covariance),
        ("camera", motion, found.base_from_camera_covariance),
        ("flat_field", None if flat is None else np.array(flat.terms) - _flat_field(found, truth),
         None if flat is None else flat.covariance),
    ]  # fmt: skip
    return {
        name: float(chi2.cdf(error @ np.linalg.solve(np.array(covariance), error), len(error)))
        for name, error, covariance in stated
        if error is not None and covariance is not None
    }


def direction_deg(found: Calibration, true: Calibration, cell: CellConfig, joints: Sequence[Sequence[float]]) -> float:
    """Root mean square angle, degrees, between the directions from the object's middle to the lamp by two calibrations.

    Each direction is in its calibration's own camera frame, as normals are. `joints` (N, 6), rad, belong to the lights.
    """
    keep_out = cell.object.keep_out
    middle = geometry.transform(keep_out.base_from_object.matrix, np.array([0.0, 0.0, keep_out.height_m / 4]))
    by_each: list[FloatArray] = []
    for calibration in (found, true):
        stated = np.array(joints) + np.array(calibration.joint_offsets_rad or (0.0,) * 6)
        flanges = calibrated_kinematics.forward(calibrated_kinematics.of_arm(cell.arm), stated)[:, 6]
        lamps = (flanges @ cell.arm.flange_from_tool.matrix @ np.array(calibration.tool_from_lamp))[:, :3, 3]
        towards = (lamps - middle) @ np.array(calibration.base_from_camera)[:3, :3]
        by_each.append(towards / np.linalg.norm(towards, axis=1, keepdims=True))
    one, other = by_each
    across = np.linalg.norm(np.cross(one, other), axis=1)
    angles = np.arctan2(across, np.einsum("ni,ni->n", one, other))
    return float(np.degrees(np.sqrt(np.mean(angles**2))))


def true_calibration(nominal: Calibration, truth: dict[str, Any]) -> Calibration:
    """The true values as far as a calibration can state them; distortion is the nearest with five coefficients."""
    degrees = np.arange(0, LAST_KNOT_DEG + 1, KNOT_STEP_DEG)
    cosine = np.cos(np.radians(degrees))
    factors = np.array(truth["lobe_by_degree"])[degrees] / cosine**nominal.lobe_exponent
    lobe = LampLobe(
        knots_rad=tuple(np.radians(degrees).tolist()),
        factors=(1.0, *(factors[1:] / factors[0]).tolist()),
        tilt=(float(truth["lobe_tilt"][0]), float(truth["lobe_tilt"][1])),
    )
    values = {
        "camera_matrix": truth["camera_matrix"],
        "distortion": _five_coefficients(nominal, truth).tolist(),
        "base_from_camera": as_matrix4(np.array(truth["base_from_camera"])),
        "tool_from_lamp": as_matrix4(np.array(truth["tool_from_lamp"])),
        "joint_offsets_rad": truth["joint_offsets_rad"],
        "lamp_intensity": truth["lamp_intensity"],
        "lobe": lobe.model_dump(),
        "flat_field": {"terms": _flat_field(nominal, truth).tolist(), "covariance": np.zeros((5, 5)).tolist()},
    }
    return Calibration.model_validate(nominal.model_dump() | values)


def in_view_of(normals: Float32Array, solved_with: Calibration, nominal: Calibration) -> Float32Array:
    """Rotates normals (H, W, 3) from the view frame of `solved_with` to that of `nominal`, the truth's."""
    own, other = (geometry.base_from_view(np.array(known.base_from_camera))[:3, :3] for known in (solved_with, nominal))
    return (normals @ (other.T @ own).T.astype(np.float32)).astype(np.float32)


def _lobe(found: Calibration) -> FloatArray:
    """Intensity (degrees + 1, SIDES) relative to the axis, at whole degrees to all sides."""
    angle, direction = _directions()
    table = photometry.lobe_table(found.lobe)
    cosine = np.cos(angle)
    along = cosine**found.lobe_exponent * np.interp(cosine, np.linspace(0, 1, len(table)), table)
    tilt = (0.0, 0.0) if found.lobe is None else found.lobe.tilt
    return along[:, None] * (1 + direction @ np.array(tilt))


def _sensitivity(found: Calibration) -> Float32Array:
    """Sensitivity (H, W) over the image, 1 in its centre; 1 everywhere if the calibration states none."""
    whole = slice(0, found.height), slice(0, found.width)
    sensitivity = image_values.sensitivity(found, *whole)
    return np.ones((found.height, found.width), np.float32) if sensitivity is None else sensitivity


def _true_sensitivity(found: Calibration, truth: dict[str, Any]) -> FloatArray:
    a_x, a_y, q = truth["vignetting"]
    half = np.hypot(found.width, found.height) / 2
    v, u = np.mgrid[: found.height, : found.width]
    u, v = (u - (found.width - 1) / 2) / half, (v - (found.height - 1) / 2) / half
    return 1 + a_x * u + a_y * v + q * (u**2 + v**2)


def _true_lobe(truth: dict[str, Any]) -> FloatArray:
    along = np.array(truth["lobe_by_degree"])[: LOBE_TO_DEG + 1]
    return along[:, None] * (1 + _directions()[1] @ np.array(truth["lobe_tilt"]))


def _directions() -> tuple[FloatArray, FloatArray]:
    """Angles (degrees + 1,) off the axis, rad, and the direction's x and y (degrees + 1, SIDES, 2)."""
    angle = np.radians(np.arange(0, LOBE_TO_DEG + 1.0))
    round_axis = 2 * np.pi * np.arange(SIDES) / SIDES
    sides = np.stack([np.cos(round_axis), np.sin(round_axis)], axis=1)
    return angle, np.sin(angle)[:, None, None] * sides


def _flat_field(nominal: Calibration, truth: dict[str, Any]) -> FloatArray:
    """Terms of ln sensitivity nearest to the true one over the image, by linear least squares."""
    v, u = np.mgrid[: nominal.height : 16, : nominal.width : 16]
    terms = image_values.flat_terms(
        np.stack([u.ravel(), v.ravel()], axis=1).astype(float), nominal.width, nominal.height
    )
    logarithm = np.log(_true_sensitivity(nominal, truth)[::16, ::16]).ravel()
    return np.asarray(np.linalg.lstsq(terms, logarithm, rcond=None)[0], np.float64)


def _five_coefficients(nominal: Calibration, truth: dict[str, Any]) -> FloatArray:
    """k1, k2, p1, p2, k3 nearest to the true distortion over the image, by linear least squares."""
    matrix = np.array(truth["camera_matrix"])
    u, v = np.meshgrid(np.linspace(0, nominal.width - 1, 24), np.linspace(0, nominal.height - 1, 24))
    # Directions over the image and somewhat beyond; those of the pixels without distortion are accurate enough.
    rays = (np.stack([u.ravel(), v.ravel()], axis=1) - matrix[:2, 2]) / np.diag(matrix)[:2]
    points, zero = np.column_stack([rays, np.ones(len(rays))]), np.zeros(3)
    distorted = cv2.projectPoints(points, zero, zero, np.eye(3), np.array(truth["distortion"]))[0].reshape(-1, 2)
    x, y = rays.T
    square = x * x + y * y
    columns = [
        np.stack([one * square, one * square**2, cross, other, one * square**3], axis=1)
        for one, cross, other in (
            (x, 2 * x * y, square + 2 * x * x),
            (y, square + 2 * y * y, 2 * x * y),
        )
    ]
    return np.asarray(np.linalg.lstsq(np.concatenate(columns), (distorted - rays).T.ravel(), rcond=None)[0], np.float64)
