"""Results of calibrations with a board as their files hold them, and the picture of how well the camera is known.

Sessions and the commands on folders write the same files, so that either can be read in place of the other.
"""

from collections.abc import Mapping
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from acquisition.calibrate.bundle_adjustment import CAMERA, JOINT_OFFSETS, Adjusted
from acquisition.calibrate.hand_eye import HandEyeFit
from acquisition.calibrate.intrinsics import CameraFit
from acquisition.models.base import FloatArray, as_matrix4
from acquisition.models.calibration import Calibration
from acquisition.models.calibration_result import CameraResult, HandEyeResult, ViewResidual


def now() -> str:
    """The present time, ISO 8601 in UTC."""
    return datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")


def with_camera(calibration: Calibration, camera: CameraResult) -> Calibration:
    """A calibration with another camera."""
    changed = camera.model_dump(include={"width", "height", "camera_matrix", "distortion", "made_at"})
    return calibration.model_copy(update=changed)


def camera_result(found: CameraFit, hashes: Mapping[str, str], sigma: FloatArray) -> CameraResult:
    """A calibrated camera; `hashes` of all images by name, `sigma` of `intrinsics.projection_sigma`."""
    adjusted = found.adjusted
    matrix = adjusted.parameters.matrix
    return CameraResult.model_validate(
        {
            "made_at": now(), "version": metadata.version("lightpose"), "width": found.size[0],
            "height": found.size[1], "camera_matrix": matrix.tolist(),
            "distortion": adjusted.parameters.camera[4:].tolist(),
            "covariance": adjusted.covariance[CAMERA, CAMERA].tolist(), "warp_m": adjusted.parameters.warp.tolist(),
            "corner_sigma_px": adjusted.corner_sigma_px, "projection_sigma_px": float(np.median(sigma)),
            "worst_projection_sigma_px": float(sigma.max()), "views": residuals(adjusted, hashes),
        }
    )  # fmt: skip


def hand_eye_result(found: HandEyeFit, hashes: Mapping[str, str]) -> HandEyeResult:
    """Base from camera with what else was found; `hashes` of all images by name."""
    adjusted, parameters = found.adjusted, found.adjusted.parameters
    position, rotation = found.sigma
    offset_sigmas = np.zeros(6)
    offset_sigmas[1:5] = adjusted.sigma(JOINT_OFFSETS)
    return HandEyeResult.model_validate(
        {
            "made_at": now(), "version": metadata.version("lightpose"),
            "base_from_camera": as_matrix4(found.base_from_camera), "covariance": found.covariance.tolist(),
            "position_sigma_m": position, "rotation_sigma_rad": rotation,
            "flange_from_board": as_matrix4(parameters.flange_from_board), "square_scale": 1 + parameters.scale,
            "joint_offsets_rad": parameters.joint_offsets.tolist(), "joint_offset_sigmas_rad": offset_sigmas.tolist(),
            "arm_sigma_m": adjusted.arm_sigma[0], "arm_sigma_rad": adjusted.arm_sigma[1],
            "views": residuals(adjusted, hashes),
        }
    )  # fmt: skip


def residuals(adjusted: Adjusted, hashes: Mapping[str, str]) -> list[ViewResidual]:
    """Each image's part in an adjustment; of one that shows no board, too."""
    of_view = dict(zip((view.name for view in adjusted.views), adjusted.residuals_px, strict=True))
    return [
        ViewResidual(
            image=name,
            sha256=digest,
            corners=len(of_view.get(name, ())),
            left_out=sum(image == name for image, _ in adjusted.left_out),
            rms_px=float(np.sqrt(np.mean(of_view[name] ** 2))) if name in of_view else None,
        )
        for name, digest in hashes.items()
    ]


def draw_projection_sigma(found: CameraFit, sigma: FloatArray, path: Path) -> None:
    """Draws 1 σ of a direction's place over the image with the corners that were seen."""
    width, height = found.size
    figure = Figure(figsize=(6, 6 * height / width), layout="constrained")
    axes = figure.subplots()
    shown = axes.imshow(sigma, extent=(0, width, height, 0), cmap="viridis", vmin=0)
    for view in found.adjusted.views:
        axes.plot(*view.pixels.T, ",", color="white")
    figure.colorbar(shown, label="1 σ of a direction's place, px")
    axes.set(xlabel="column, px", ylabel="row, px")
    figure.savefig(path, dpi=120)
