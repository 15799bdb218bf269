"""Position of the lamp in the tool's frame, from its highlights on a mirror sphere under many poses of the arm.

A mirror sphere shows the lamp where its normal bisects the angle between camera and lamp. Every image gives one
highlight, two numbers. The lamp's place in the tool's frame is the same in all of them, so that a dozen poses
overdetermine it, together with the sphere's place. The usual triangulation from two spheres has one pose and no
residual. The camera's pose is uncertain too: it is a nuisance parameter with the covariance of the hand–eye
calibration, and so part of the lamp's.

The lamp's place along the line to the sphere is not observable, so this line must change in the tool's frame. With the
lamp tilted by up to 45° to different sides, 48 highlights with 0.1 px of noise on a ball of 30 mm leave 0.4 mm; 24 that
all aim at the sphere leave 12 mm (scratch simulation, November 2026), which is refused.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from scipy.optimize import least_squares

from acquisition import geometry
from acquisition.models.base import FloatArray, as_matrix4
from acquisition.models.calibration import Calibration
from acquisition.models.calibration_result import HandEyeResult
from acquisition.models.errors import ErrorCode, RigError

MIN_HIGHLIGHTS = 8
"""Least number of images with a highlight: lamp and sphere have seven unknowns, and the rest must show the noise."""

MIN_SPREAD_DEG = 25.0
"""Least spread of the lamp's directions at the sphere, degrees: from one side its place and the sphere's trade off."""

RADIUS_SIGMA_M = 2e-5
"""Prior 1 σ of the sphere's radius, m: a calliper's; a bearing ball is rather better."""

START_SIGMA_M = 0.05
"""Prior 1 σ of the lamp's and the sphere's place as stated, m: it only keeps the first steps small enough."""

FLOOR_PX = 0.02
"""Least noise of a highlight's coordinate, pixels."""

MAX_SIGMA_M = 0.003
"""1 σ of the lamp's position along its worst axis, m, above which the images do not determine it."""

REFLECTION_ROUNDS = 30
"""Iterations for the point of reflection; each reduces the error by the sphere's radius over the lamp's distance."""

RIM_POINTS = 16
"""Points of the window's rim, from which the middle of its image is computed."""

DIFFERENCE, PLANNED_SIGMA_PX = 1e-6, 0.1
"""Step of numerical derivatives, m and rad; noise of a highlight, pixels, that the choice of poses assumes."""


@dataclass(frozen=True)
class Highlight:
    """The lamp's reflection in one image: pixel (2,), column and row; the tool's pose (4, 4) in the base frame; its
    derivatives (J, 4, 4) by the joint offsets."""

    name: str
    pixel: FloatArray
    base_from_tool: FloatArray
    by_offsets: FloatArray = field(default_factory=lambda: np.zeros((0, 4, 4)))


ARM_REPEATABILITY_M = 3e-5
"""Least 1 σ of the lamp's position from image to image, m: the repeatability in a UR5e's data sheet (ISO 9283)."""


@dataclass(frozen=True)
class LampFit:
    """The lamp's position (3,) in the tool's frame, m, with its covariance (3, 3); the sphere's centre (3,) in the base
    frame and radius, m; residuals (N, 2), pixels, observed minus predicted, and 1 σ of a coordinate."""

    tool_from_lamp_m: FloatArray
    covariance: FloatArray
    sphere_center_m: FloatArray
    sphere_radius_m: float
    residuals_px: FloatArray
    highlight_sigma_px: float

    @property
    def sigma_m(self) -> float:
        """1 σ of the position per axis, root mean square, m."""
        return float(np.sqrt(np.trace(self.covariance) / 3))

    def calibrated(self, calibration: Calibration, hand_eye: HandEyeResult) -> Calibration:
        """Returns a calibration with this lamp: its covariance, which all images share, and the arm's own deviation in
        each image as `hand_eye` states it."""
        tool_from_lamp = np.array(calibration.tool_from_lamp)
        tool_from_lamp[:3, 3] = self.tool_from_lamp_m
        update = {
            "tool_from_lamp": as_matrix4(tool_from_lamp),
            "tool_from_lamp_covariance": self.covariance.tolist(),
            "lamp_position_sigma_m": max(hand_eye.deviation_m, ARM_REPEATABILITY_M),
        }
        return Calibration.model_validate(calibration.model_dump() | update)


def reflection(center: FloatArray, radius: float, camera: FloatArray, lamps: FloatArray) -> FloatArray:
    """Points (N, 3) of a mirror sphere at which a camera sees lamps (N, 3), all in one frame, by fixed-point iteration.

    The normal is along the sum of the unit vectors to camera and lamp.
    """
    normal = _unit(_unit(camera - center) + _unit(lamps - center))
    for _ in range(REFLECTION_ROUNDS):
        point = center + radius * normal
        normal = _unit(_unit(camera - point) + _unit(lamps - point))
    return center + radius * normal


def fit(
    highlights: Sequence[Highlight], calibration: Calibration, pose_covariance: FloatArray, radius_m: float,
    sphere_center_m: FloatArray, window_radius_m: float = 0.0,
) -> LampFit:  # fmt: skip
    """Least squares over all highlights for lamp, sphere and, within their covariance, camera's pose and joint offsets.

    `calibration` states the camera and, as start, `tool_from_lamp`. `pose_covariance` is that of its
    `base_from_camera`, (6, 6), m and rad, as in `hand_eye`, or (6 + J, 6 + J) with that of the joint offsets; the
    highlights then have derivatives by these. `sphere_center_m` (3,) is the sphere's place in the base frame to some
    centimetres; `window_radius_m` is that of the lamp's luminous window, a disc across its axis. Raises RigError
    calibration.infeasible for too few highlights, or lamps all on one side.
    """
    if len(highlights) < MIN_HIGHLIGHTS:
        raise RigError(ErrorCode.CALIBRATION_INFEASIBLE, f"{len(highlights)} highlights: {MIN_HIGHLIGHTS} are needed")
    tools = np.stack([one.base_from_tool for one in highlights])
    uncertain = len(pose_covariance) - 6
    by_offsets = np.stack([one.by_offsets[:uncertain] for one in highlights])
    observed = np.stack([one.pixel for one in highlights])
    start = np.array(calibration.tool_from_lamp)[:3, 3]
    _require_spread(_lamps(tools, start) - sphere_center_m)
    whitening = np.linalg.inv(np.linalg.cholesky(pose_covariance))

    def residuals(unknown: FloatArray) -> FloatArray:
        moved = tools + np.einsum("j,njkl->nkl", unknown[13:], by_offsets)
        return observed - _predicted(unknown, moved, calibration, window_radius_m)

    def whitened(unknown: FloatArray, sigma_px: float) -> FloatArray:
        prior = np.concatenate([
            (unknown[:3] - start) / START_SIGMA_M,
            (unknown[3:6] - sphere_center_m) / START_SIGMA_M,
            [(unknown[6] - radius_m) / RADIUS_SIGMA_M],
            whitening @ unknown[7:],
        ])  # fmt: skip
        return np.concatenate([(residuals(unknown) / sigma_px).ravel(), prior])

    unknown, sigma_px = np.concatenate([start, sphere_center_m, [radius_m], np.zeros(len(pose_covariance))]), 1.0
    found = least_squares(whitened, unknown, args=(sigma_px,), x_scale="jac")
    for _ in range(3):  # the residuals give the noise, which weights the data against the prior of the pose
        left = residuals(found.x)
        sigma_px = max(float(np.sqrt(np.sum(left**2) / (left.size - 7))), FLOOR_PX)
        found = least_squares(whitened, found.x, args=(sigma_px,), x_scale="jac", jac="3-point")
    jacobian = np.asarray(found.jac, dtype=float)
    covariance = np.linalg.inv(jacobian.T @ jacobian)[:3, :3]
    _require_determined(covariance, sigma_px, highlights, residuals(found.x))
    return LampFit(found.x[:3], covariance, found.x[3:6], float(found.x[6]), residuals(found.x), sigma_px)


def choose_poses(
    tools: FloatArray, calibration: Calibration, pose_covariance: FloatArray, sphere_center_m: FloatArray,
    radius_m: float, count: int,
) -> list[int]:  # fmt: skip
    """Greedy A-optimal design: numbers of at most `count` tool poses (N, 4, 4) that determine the lamp's place best.

    A highlight's information about lamp, sphere and camera is computed by central differences at the values in use;
    `pose_covariance` (6, 6) as in `fit`.
    """
    start = np.concatenate([np.array(calibration.tool_from_lamp)[:3, 3], sphere_center_m, [radius_m], np.zeros(6)])
    columns = list[FloatArray]()
    for which in range(len(start)):
        step = np.zeros(len(start))
        step[which] = DIFFERENCE
        ahead, behind = (_predicted(start + sign * step, tools, calibration, 0.0) for sign in (1, -1))
        columns.append((ahead - behind) / (2 * DIFFERENCE))
    derivatives = np.stack(columns, axis=2) / PLANNED_SIGMA_PX
    gains = np.einsum("nik,nil->nkl", derivatives, derivatives)
    present = np.diag(np.r_[np.full(6, START_SIGMA_M**-2), RADIUS_SIGMA_M**-2, np.zeros(6)])
    present[7:, 7:] = np.linalg.inv(pose_covariance)
    chosen: list[int] = []
    left = list(range(len(tools)))
    while left and len(chosen) < count:
        losses = np.trace(np.linalg.inv(present + gains[left])[:, :3, :3], axis1=1, axis2=2)
        best = left.pop(int(np.argmin(losses)))
        chosen.append(best)
        present = present + gains[best]
    return chosen


def _predicted(unknown: FloatArray, tools: FloatArray, calibration: Calibration, window_radius_m: float) -> FloatArray:
    """Pixels (N, 2) of the highlights' middles under tool poses (N, 4, 4); `unknown` (13,): lamp, sphere's centre, its
    radius, small motion of the camera.

    The middle is that of the area of the window's image: the nearer side of a tilted window looks larger.
    """
    pose = np.array(calibration.base_from_camera) @ geometry.pose(unknown[7:10], unknown[10:13])
    around = 2 * np.pi * np.arange(RIM_POINTS) / RIM_POINTS
    across = np.array(calibration.tool_from_lamp)[:3, :2]  # the window's plane in the tool's frame
    rim = window_radius_m * np.stack([np.cos(around), np.sin(around)], axis=1) @ across.T
    offsets = rim if window_radius_m > 0 else np.zeros((1, 3))
    lamps = np.stack([_lamps(tools, unknown[:3] + offset) for offset in offsets], axis=1)
    points = reflection(unknown[3:6], unknown[6], pose[:3, 3], lamps.reshape(-1, 3))
    seen = geometry.transform(geometry.inverse(pose), points)
    matrix, distortion = np.array(calibration.camera_matrix), np.array(calibration.distortion)
    predicted = cv2.projectPoints(seen, np.zeros(3), np.zeros(3), matrix, distortion)[0]
    outline = np.asarray(predicted, dtype=float).reshape(len(tools), -1, 2)
    return outline[:, 0] if outline.shape[1] == 1 else _middle(outline)


def _middle(outline: FloatArray) -> FloatArray:
    """Centres of area (N, 2) of polygons (N, K, 2)."""
    start = outline[:, :1]
    one, other = outline - start, np.roll(outline, -1, axis=1) - start  # about a corner, to limit rounding
    doubled = one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0]
    moment = ((one + other) * doubled[..., None]).sum(axis=1)
    return start[:, 0] + moment / (3 * doubled.sum(axis=1)[:, None])


def _lamps(tools: FloatArray, tool_from_lamp_m: FloatArray) -> FloatArray:
    """Positions (N, 3) of the lamp in the base frame under tool poses (N, 4, 4)."""
    return tools[:, :3, :3] @ tool_from_lamp_m + tools[:, :3, 3]


def _require_spread(directions: FloatArray) -> None:
    units = _unit(directions)
    spread = np.degrees(np.arccos(np.clip(units @ units.T, -1, 1))).max()
    if spread < MIN_SPREAD_DEG:
        raise RigError(
            ErrorCode.CALIBRATION_INFEASIBLE,
            f"Seen from the sphere, all lamp positions lie within {spread:.0f}° of each other: use the whole dome",
        )


def _require_determined(
    covariance: FloatArray, sigma_px: float, highlights: Sequence[Highlight], residuals_px: FloatArray
) -> None:
    """Refuses images that contradict each other, and poses that all aim the lamp at the sphere: its place along its
    axis is then not determined."""
    worst_m = float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))
    if worst_m <= MAX_SIGMA_M:
        return
    if worst_m * PLANNED_SIGMA_PX / sigma_px <= MAX_SIGMA_M:  # with the usual noise these poses would suffice
        worst = highlights[int(np.argmax(np.linalg.norm(residuals_px, axis=1)))].name
        raise RigError(
            ErrorCode.CALIBRATION_INFEASIBLE,
            f"The highlights lie {sigma_px:.1f} pixels from where one lamp would show them, most of all in {worst}: is "
            "that highlight the lamp's, do the joints belong to their images, and is the sphere's radius right?",
            image=worst,
        )
    raise RigError(
        ErrorCode.CALIBRATION_INFEASIBLE,
        f"The lamp's place is known only to {1000 * worst_m:.0f} mm along one axis of the tool: tilt the lamp by "
        "30–45° away from the sphere, to different sides",
    )


def _unit(vectors: FloatArray) -> FloatArray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
