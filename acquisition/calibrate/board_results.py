"""Results of board calibrations as their files hold them, and pictures of projection uncertainty and residuals.

Sessions and the commands on folders write the same files, so that either can be read in place of the other.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

import numpy as np

from acquisition.calibrate import intrinsics
from acquisition.calibrate.bundle_adjustment import (
    BASE_FROM_CAMERA,
    CAMERA,
    JOINT_OFFSETS,
    UNKNOWNS,
    Adjusted,
    Parameters,
)
from acquisition.calibrate.hand_eye import HandEyeFit
from acquisition.calibrate.intrinsics import CameraFit
from acquisition.models.base import FloatArray, as_matrix4
from acquisition.models.calibration import Calibration
from acquisition.models.calibration_result import AdjustmentValues, CameraResult, HandEyeResult, ViewResidual


def now() -> str:
    """Returns the present time, ISO 8601 in UTC."""
    return datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")


class AdjustmentRecord(AdjustmentValues):
    """An adjustment without its views: the basis for planning further views."""

    @classmethod
    def of(cls, found: Adjusted) -> "AdjustmentRecord":
        """Makes the record of an adjustment."""
        known = found.parameters
        return cls.model_validate(
            {
                "camera": known.camera.tolist(), "warp_m": known.warp.tolist(),
                "base_from_camera": as_matrix4(known.base_from_camera),
                "flange_from_board": as_matrix4(known.flange_from_board), "scale": known.scale,
                "joint_offsets_rad": known.joint_offsets.tolist(), "covariance": found.covariance.tolist(),
                "corner_sigma_px": found.corner_sigma_px, "arm_sigma": found.arm_sigma,
            }
        )  # fmt: skip

    @property
    def adjusted(self) -> Adjusted:
        """The adjustment, without views."""
        parameters = Parameters(
            np.array(self.camera), np.zeros((0, 4, 4)), np.array(self.warp_m), np.array(self.base_from_camera),
            np.array(self.flange_from_board), self.scale, np.array(self.joint_offsets_rad),
        )  # fmt: skip
        return Adjusted(parameters, np.array(self.covariance), self.corner_sigma_px, self.arm_sigma, (), (), ())


@dataclass(frozen=True)
class BoardResults:
    """Results of one estimate as their files hold them, and the map in the camera's picture."""

    camera: CameraResult
    hand_eye: HandEyeResult | None
    projection_sigma_px: FloatArray

    def merged(self, calibration: Calibration) -> Calibration:
        """Returns a calibration with the results in place of its own values."""
        made = with_camera(calibration, self.camera)
        if self.hand_eye is None:
            return made
        return with_hand_eye(made, self.hand_eye)


def results(camera: CameraFit, hand_eye: HandEyeFit | None, hashes: Mapping[str, str]) -> BoardResults:
    """Collects the results of an estimate; `hashes` of all images by name."""
    sigma = intrinsics.projection_sigma(camera)
    return BoardResults(
        camera_result(camera, hashes, sigma), None if hand_eye is None else hand_eye_result(hand_eye, hashes), sigma
    )


def with_camera(calibration: Calibration, camera: CameraResult) -> Calibration:
    """Returns a calibration with another camera."""
    changed = camera.model_dump(include={"width", "height", "camera_matrix", "distortion", "made_at"})
    return calibration.model_copy(update=changed)


def with_hand_eye(calibration: Calibration, found: HandEyeResult) -> Calibration:
    """Returns a calibration with another place of the camera and the joint offsets that belong to it."""
    changed = found.model_dump(include={"base_from_camera", "joint_offsets_rad", "made_at"})
    changed["base_from_camera_covariance"] = found.covariance
    return calibration.model_copy(update=changed)


def camera_result(found: CameraFit, hashes: Mapping[str, str], sigma: FloatArray) -> CameraResult:
    """Result of a calibrated camera; `hashes` of all images by name, `sigma` of `intrinsics.projection_sigma`."""
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
    """Result of a hand–eye calibration, all its estimates included; `hashes` of all images by name."""
    adjusted, parameters = found.adjusted, found.adjusted.parameters
    position, rotation = found.sigma
    offset_sigmas = np.zeros(6)
    offset_sigmas[1:5] = adjusted.sigma(JOINT_OFFSETS)
    together = [*range(UNKNOWNS)[BASE_FROM_CAMERA], *range(UNKNOWNS)[JOINT_OFFSETS]]
    return HandEyeResult.model_validate(
        {
            "made_at": now(), "version": metadata.version("lightpose"),
            "base_from_camera": as_matrix4(found.base_from_camera), "covariance": found.covariance.tolist(),
            "position_sigma_m": position, "rotation_sigma_rad": rotation,
            "flange_from_board": as_matrix4(parameters.flange_from_board), "square_scale": 1 + parameters.scale,
            "joint_offsets_rad": parameters.joint_offsets.tolist(), "joint_offset_sigmas_rad": offset_sigmas.tolist(),
            "pose_and_offsets_covariance": adjusted.covariance[np.ix_(together, together)].tolist(),
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
    """Draws 1 σ of a direction's place over the image, with the detected corners."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - slow to load and seldom needed

    width, height = found.size
    figure = Figure(figsize=(6, 6 * height / width), layout="constrained")
    axes = figure.subplots()
    shown = axes.imshow(sigma, extent=(0, width, height, 0), cmap="viridis", vmin=0)
    for view in found.adjusted.views:
        axes.plot(*view.pixels.T, ",", color="white")
    figure.colorbar(shown, label="projection uncertainty, 1 σ, px")
    axes.set(xlabel="column, px", ylabel="row, px")
    figure.savefig(path, dpi=120)


def draw_residuals(found: CameraFit, path: Path) -> None:
    """Draws each corner's residual as an enlarged arrow over the image."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - slow to load and seldom needed

    width, height = found.size
    at = np.concatenate([view.pixels for view in found.adjusted.views])
    rest = np.concatenate(found.adjusted.residuals_px)
    # A typical arrow is a fortieth of the image's width long, a large one several times as long.
    larger = width / 40 / max(found.adjusted.corner_sigma_px, 1e-6)
    figure = Figure(figsize=(6, 6 * height / width), layout="constrained")
    axes = figure.subplots()
    axes.quiver(*at.T, *(larger * rest).T, angles="xy", scale_units="xy", scale=1, width=0.0015)
    axes.set(
        xlim=(0, width), ylim=(height, 0), xlabel="column, px", ylabel="row, px", title=f"residuals × {larger:.0f}"
    )
    figure.savefig(path, dpi=120)
