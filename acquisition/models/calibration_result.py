"""Results of calibrations as their files hold them: values with covariance, and the residuals of each image."""

import math
from typing import Annotated, Literal

from pydantic import Field

from acquisition.models.base import Joints, Matrix4, Value, Vector3
from acquisition.models.calibration import LampLobe

USE_IT = "Make it the active calibration (PUT /v1/rig/calibrations/active)."
"""Advice of a result with which nothing is wrong, until it is in use."""

Rows = Annotated[tuple[Annotated[tuple[float, ...], Field(strict=False)], ...], Field(strict=False)]
"""A matrix of any size, row by row."""


class ViewResidual(Value):
    """Residuals of one image of the board in a calibration."""

    image: str
    sha256: str
    corners: int = Field(ge=0, description="Corners of the board that took part")
    left_out: int = Field(ge=0, description="Corners left out as misread")
    rms_px: float | None = Field(description="Root mean square of the residuals, pixels; none: the board is not seen")


class CameraResult(Value):
    """Calibration of a camera; `camera.json`."""

    kind: Literal["camera"] = "camera"
    made_at: str
    version: str = Field(description="Version of the software")
    width: int
    height: int
    camera_matrix: Annotated[tuple[Vector3, Vector3, Vector3], Field(strict=False)]
    distortion: Annotated[tuple[float, float, float, float, float], Field(strict=False)]
    covariance: Rows = Field(description="Covariance of f_x, f_y, c_x, c_y in pixels and k1, k2, p1, p2, k3")
    warp_m: Annotated[tuple[float, ...], Field(strict=False, min_length=2, max_length=3)] = Field(
        description="Sag of the board's middle against its edges along x and y, and its twist, m"
    )
    corner_sigma_px: float = Field(description="1 σ of a corner's coordinate, pixels")
    projection_sigma_px: float = Field(
        description="Projection uncertainty: 1 σ of a direction's place in the image, median over the image, pixels"
    )
    worst_projection_sigma_px: float = Field(description="The same at its worst, mostly in a corner of the image")
    views: Annotated[tuple[ViewResidual, ...], Field(strict=False)]


class HandEyeResult(Value):
    """Pose of the camera in the arm's base frame, found with a board on the flange; `hand_eye.json`."""

    kind: Literal["hand-eye"] = "hand-eye"
    made_at: str
    version: str = Field(description="Version of the software")
    base_from_camera: Matrix4
    covariance: Rows = Field(
        description="Covariance of translation, m, and rotation vector, rad, of a small motion in the camera's frame"
    )
    position_sigma_m: float = Field(description="1 σ of the camera's place, m")
    rotation_sigma_rad: float = Field(description="1 σ of the camera's rotation, rad")
    flange_from_board: Matrix4
    square_scale: float = Field(
        description="Side of the squares estimated from the arm's motions, divided by the stated side"
    )
    joint_offsets_rad: Annotated[tuple[float, ...], Field(strict=False)] = Field(
        description="Offsets of the six joints; those of the first and the last are part of the two poses"
    )
    joint_offset_sigmas_rad: Annotated[tuple[float, ...], Field(strict=False)]
    pose_and_offsets_covariance: Rows | None = Field(
        default=None,
        description="Covariance of the camera's small motion together with the offsets of joints 2 to 5, rad",
    )
    arm_sigma_m: float = Field(description="1 σ of the arm's deviation from its kinematic model, per axis, m")
    arm_sigma_rad: float = Field(description="1 σ of the arm's deviation in rotation, per axis, rad")
    views: Annotated[tuple[ViewResidual, ...], Field(strict=False)]

    @property
    def shared_covariance(self) -> Rows:
        """Covariance of the errors that all images share: (10, 10) with joint offsets, (6, 6) in files without them."""
        return self.covariance if self.pose_and_offsets_covariance is None else self.pose_and_offsets_covariance

    @property
    def deviation_m(self) -> float:
        """1 σ per axis, m, by which the arm's deviations move a point as far from the flange as the board's corner."""
        x, y, z = (row[3] for row in self.flange_from_board[:3])
        return math.hypot(self.arm_sigma_m, math.hypot(x, y, z) * self.arm_sigma_rad)


class AdjustmentValues(Value):
    """All parameters that an adjustment of views of the board found, without the views; `basis.json`."""

    camera: Annotated[tuple[float, ...], Field(strict=False)]
    warp_m: Annotated[tuple[float, ...], Field(strict=False)]
    base_from_camera: Matrix4
    flange_from_board: Matrix4
    scale: float
    joint_offsets_rad: Joints
    covariance: Rows = Field(description="Of all 29 parameters, as in `bundle_adjustment`")
    corner_sigma_px: float
    arm_sigma: Annotated[tuple[float, float], Field(strict=False)] = Field(description="m and rad")


class CalibrationSummary(Value):
    """Main figures of an estimate of a calibration session, for people."""

    kind: str = Field(description="`camera`, `hand-eye`, …: the session's")
    images: int = Field(ge=0, description="Images so far")
    used: int = Field(ge=0, description="Images in which the target was seen")
    estimated: bool = Field(description="Whether they determine the calibration already")
    why_not: str = Field(default="", description="Why they do not; empty: they do")
    reached: bool = Field(default=False, description="Whether the accuracy that the recipe asks for is reached")
    focal_px: float | None = Field(default=None, description="Focal length, pixels")
    corner_sigma_px: float | None = Field(default=None, description="1 σ of a corner's coordinate, pixels")
    projection_sigma_px: float | None = Field(
        default=None,
        description="Projection uncertainty: 1 σ of a direction's place in the image, median over the image, pixels",
    )
    position_sigma_mm: float | None = Field(default=None, description="1 σ of the place that was found, mm")
    rotation_sigma_deg: float | None = Field(default=None, description="1 σ of the camera's rotation, degrees")
    arm_sigma_mm: float | None = Field(
        default=None, description="1 σ of the arm's deviation from its kinematic model, per axis, mm"
    )
    square_scale: float | None = Field(
        default=None,
        description="Side of the board's squares estimated from the arm's motions, divided by the stated side",
    )
    intensity_sigma_percent: float | None = Field(
        default=None, description="1 σ of the lamp's intensity, that of the plane's albedo included, per cent"
    )
    lobe_sigma_percent: float | None = Field(
        default=None, description="1 σ of the lamp's lobe at its least certain knot, per cent"
    )
    verified_deg: float | None = Field(
        default=None, description="Mean error of normals on a placing of the plane that was not fitted, degrees"
    )
    gain_e_per_dn: float | None = Field(default=None, description="`response`: electrons per value")
    read_noise_e: float | None = Field(default=None, description="`response`: 1 σ of a value in the dark, electrons")
    full_well_e: float | None = Field(default=None, description="`response`: electrons at which a pixel is full")
    defective_pixels: int | None = Field(
        default=None, description="`response`: number of pixels that are hot or respond unlike their neighbours"
    )
    passed: bool | None = Field(default=None, description="`check`: whether the calibration in use is still true")
    changed: list[str] = Field(
        default_factory=list[str],
        description="`check`: what has changed: `camera`, `board`, `joints`, `lens`, `intensity`, `lobe`, `lamp`",
    )
    probability: float | None = Field(
        default=None, description="`check`: probability that a correct calibration deviates as much by chance"
    )
    fingerprint: str | None = Field(default=None, description="SHA-256 of the values of its calibration.json")
    advice: list[str] = Field(default_factory=list[str], description="What to do next, for people")


class ExposureResidual(Value):
    """Means and residual of one exposure time in a calibration of the response."""

    exposure_s: float
    mean_dn: float = Field(description="Mean of the lit frames less that of the frames without lamp, values")
    dark_dn: float = Field(description="Mean of the frames without lamp less the black level, values")
    lamp: Annotated[tuple[float, ...], Field(strict=False)] = Field(
        description="The lamp's brightness in each lit frame divided by its mean in all"
    )
    nonlinear: float = Field(description="Residual of the linear model between parts of the image, as a fraction")


class DefectivePixel(Value):
    """A pixel that is bright in the dark, or whose sensitivity differs from that of its neighbours."""

    column: int
    row: int
    kind: str = Field(
        description="`hot`: bright in the dark; `response`: less than half, or more than twice, as sensitive as all "
        "its neighbours"
    )


class ResponseResult(Value):
    """The camera's response by photon transfer (EMVA 1288); `response.json`."""

    kind: Literal["response"] = "response"
    made_at: str
    version: str = Field(description="Version of the software")
    width: int
    height: int
    black_level_dn: float = Field(description="Value without light, at exposure time 0")
    gain_e_per_dn: float = Field(description="Electrons per value")
    read_noise_e: float = Field(description="1 σ of a value in the dark, without rounding, electrons")
    full_well_e: float = Field(description="Electrons at which a pixel is full")
    full_by: str = Field(
        description="What clips first, `pixel` or `converter`; `not reached`: the full well is larger than stated"
    )
    nonlinearity: float = Field(description="How much too large the response is at full scale, as a fraction")
    covariance: Rows = Field(description="Covariance of black level, gain, read noise, full well and nonlinearity")
    room_per_s: float = Field(description="Room light and dark current, median, fraction of full scale per second")
    brightest_room_per_s: float = Field(description="The same at the 99.5th percentile")
    room_over_lamp: float = Field(
        description="Light without the lamp divided by that of the lamp, at the longest exposure"
    )
    lamp_sigma: float = Field(description="1 σ by which the lamp's brightness differs from image to image, a fraction")
    lamp_drift_per_h: float = Field(description="Trend of the lamp's brightness as it warms up, fraction per hour")
    lamp_drift_sigma_per_h: float = Field(description="1 σ of the trend, fraction per hour")
    exposures: Annotated[tuple[ExposureResidual, ...], Field(strict=False)]
    defects: Annotated[tuple[DefectivePixel, ...], Field(strict=False)]
    images: dict[str, str] = Field(description="SHA-256 of each image")


class HighlightResidual(Value):
    """Residual of one image in the calibration of the lamp's position."""

    image: str
    sha256: str
    residual_px: float | None = Field(description="Distance of the highlight from where it should be; none: not used")
    why_not: str = Field(default="", description="Why an image was not used")


class LampResult(Value):
    """Position of the lamp in the tool's frame, found on a mirror sphere; `lamp.json`."""

    kind: Literal["lamp"] = "lamp"
    made_at: str
    version: str = Field(description="Version of the software")
    tool_from_lamp_m: Vector3
    covariance: Rows = Field(description="Covariance of the position, m²")
    position_sigma_m: float = Field(description="1 σ of the position, per axis, root mean square, m")
    sphere_center_m: Vector3 = Field(description="In the arm's base frame, m")
    sphere_radius_m: float
    highlight_sigma_px: float = Field(description="1 σ of a highlight's coordinate, pixels")
    images: Annotated[tuple[HighlightResidual, ...], Field(strict=False)]


class PlaneResidual(Value):
    """Deviation of one image in the calibration of the lamp's lobe."""

    image: str
    sha256: str
    patches: int = Field(ge=0, description="Patches of the plane that are neither dark, clipped nor outside the image")
    offset: float | None = Field(description="How much brighter it is than the others, as a fraction; none: not fitted")


class LobeResult(Value):
    """Intensity and lobe of the lamp, found on a matt plane; `lobe.json`."""

    kind: Literal["lobe"] = "lobe"
    made_at: str
    version: str = Field(description="Version of the software")
    lamp_intensity: float = Field(description="As in calibration.json")
    full_scale_dn: float | None = Field(
        default=None, description="Digital values of full scale, of which the intensity is a fraction"
    )
    intensity_sigma: float = Field(
        description="1 σ of the intensity, as a fraction, that of the plane's albedo included"
    )
    lobe: LampLobe
    covariance: Rows = Field(description="Covariance of ln intensity, ln of the factors but the first, and the tilt")
    flat_field: Annotated[tuple[float, ...], Field(strict=False)] = Field(
        description="Terms of ln sensitivity in u, v, u², u v, v², u and v from the image's centre in half diagonals"
    )
    flat_field_covariance: Rows
    image_sigma: float = Field(description="1 σ by which images differ in brightness, as a fraction")
    patch_sigma: float = Field(description="1 σ of a patch of the plane about the fit, as a fraction")
    lamp_sigma_m: float = Field(default=0.0, description="1 σ of the lamp's place in one image, along each axis")
    held_out: Rows = Field(
        description="Numbers of knots that were tried, each with the residual of images left out of the fit"
    )
    verified_deg: float | None = Field(
        description="Mean error of normals by photometric stereo on a placing that was not fitted, degrees; none: "
        "there was none"
    )
    images: Annotated[tuple[PlaneResidual, ...], Field(strict=False)]
