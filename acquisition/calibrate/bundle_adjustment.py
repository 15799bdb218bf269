"""Bundle adjustment of camera, board and arm over all corners of all views, with the covariance of shared unknowns.

All views share the unknowns θ: the camera's intrinsics, the board's warp and, with an arm, base from camera, flange
from board, the board's scale and the joint offsets. Each view has its own unknowns: without an arm its pose; with one,
the arm's deviation from its kinematic model, with a prior. The views' own unknowns are eliminated from Gauss–Newton's
normal equations one view at a time (Schur complement), so that the inverse of the rest is the covariance of θ with all
else unknown.

The arm's deviation makes that covariance realistic. It moves all corners of a view together; treated as noise of the
corners it would be averaged over thousands of them. Its variances, of translation and of rotation, and that of the
corners are estimated along with θ by expectation–maximisation on the same equations.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from acquisition import geometry
from acquisition.calibrate.charuco import MIN_CORNERS, CharucoBoard, View
from acquisition.models.base import FloatArray
from acquisition.models.errors import ErrorCode, RigError
from acquisition.waypoints import calibrated_kinematics

CAMERA = slice(0, 9)
"""Part of θ: f_x, f_y, c_x, c_y in pixels and OpenCV's distortion k1, k2, p1, p2, k3."""

WARP = slice(9, 12)
"""Part of θ: sag of the board's middle along x and along y, and its twist, by which opposite corners stand out, m.
Measured: 35 µm of twist, if left out, turned a camera of narrow field by 0.09°, via its principal point."""

BASE_FROM_CAMERA, FLANGE_FROM_BOARD = slice(12, 18), slice(18, 24)
"""Parts of θ: translation, m, and rotation vector, rad, of a change that multiplies the pose on the right."""

SCALE = 24
"""Part of θ: relative deviation of the board's squares from their stated side."""

JOINT_OFFSETS = slice(25, 29)
"""Part of θ: offsets of the second to the fifth joint, rad. Offsets of the first, which turns the base, and of the
last, which turns the board, are part of the two poses."""
UNKNOWNS = 29

WARP_SIGMA_M, SCALE_SIGMA, JOINT_OFFSET_SIGMA_RAD = 1e-3, 1e-3, math.radians(0.2)
"""Prior 1 σ of the warp (a sheet on a board sags by tenths of a millimetre), of the scale (a printer's, and a ruler
read over 200 mm), and of joint offsets (a UR's are below 0.1° even without factory kinematics)."""

ARM_SIGMA_START = (1e-4, 2e-4)
"""Initial deviation of the arm, m and rad."""

ARM_SIGMA_FLOOR, CORNER_SIGMA_FLOOR_PX = (5e-6, 5e-6), 2e-3
"""Least deviation of the arm, m and rad, and least noise of a corner, pixels: weights of perfect data stay finite."""

CORNER_SIGMA_START_PX = 0.1
"""Initial noise of a corner's coordinates, pixels."""

MAX_STEPS, CONVERGED, MAX_DAMPING = 60, 1e-3, 1e6
"""Largest number of Gauss–Newton steps; length of a step, in standard deviations, below which they end; damping,
relative to the equations' diagonal, above which no step lowers the cost."""

MAX_CONDITION = 1e12
"""Condition of the normal equations, scaled to a unit diagonal, above which their inverse is meaningless."""

OUTLIER_SIGMA = 6.0
"""Residual, in standard deviations, from which a corner counts as misread and is left out."""


@dataclass(frozen=True)
class Parameters:
    """An estimate: camera (9,) as in CAMERA; warp (3,); poses of camera and board; scale; joint offsets (6,), rad; the
    views' own poses (V, 4, 4): `camera_from_board` without an arm, `board_from_board` deviations with one."""

    camera: FloatArray
    own: FloatArray
    warp: FloatArray = field(default_factory=lambda: np.zeros(3))
    base_from_camera: FloatArray = field(default_factory=lambda: np.eye(4))
    flange_from_board: FloatArray = field(default_factory=lambda: np.eye(4))
    scale: float = 0.0
    joint_offsets: FloatArray = field(default_factory=lambda: np.zeros(6))

    @property
    def matrix(self) -> FloatArray:
        """Camera matrix (3, 3)."""
        f_x, f_y, c_x, c_y = self.camera[:4]
        return np.array([[f_x, 0.0, c_x], [0.0, f_y, c_y], [0.0, 0.0, 1.0]])

    @property
    def prior_part(self) -> FloatArray:
        """θ (29,) with zeros for all parameters that have no prior; the priors have mean zero."""
        part = np.zeros(UNKNOWNS)
        part[WARP], part[SCALE], part[JOINT_OFFSETS] = self.warp, self.scale, self.joint_offsets[1:5]
        return part

    def stepped(self, shared: FloatArray, own: Sequence[FloatArray]) -> "Parameters":
        """Returns the estimate after a step of θ (29,) and of the views' own poses, V of (6,)."""
        offsets = self.joint_offsets.copy()
        offsets[1:5] += shared[JOINT_OFFSETS]
        return Parameters(
            self.camera + shared[CAMERA],
            np.stack([one @ geometry.pose(*step.reshape(2, 3)) for one, step in zip(self.own, own, strict=True)]),
            self.warp + shared[WARP],
            self.base_from_camera @ geometry.pose(*shared[BASE_FROM_CAMERA].reshape(2, 3)),
            self.flange_from_board @ geometry.pose(*shared[FLANGE_FROM_BOARD].reshape(2, 3)),
            self.scale + float(shared[SCALE]),
            offsets,
        )


@dataclass(frozen=True)
class Adjusted:
    """Result of an adjustment.

    `covariance` (29, 29) of θ, zero where a parameter was held; `corner_sigma_px` of a coordinate; `arm_sigma` of the
    arm's deviation, m and rad; `residuals_px`: per view (K, 2), observed minus predicted; `left_out`: name and number
    of misread corners.
    """

    parameters: Parameters
    covariance: FloatArray
    corner_sigma_px: float
    arm_sigma: tuple[float, float]
    views: tuple[View, ...]
    residuals_px: tuple[FloatArray, ...]
    left_out: tuple[tuple[str, int], ...]

    def sigma(self, part: slice | int) -> FloatArray:
        """Returns 1 σ of a part of θ."""
        return np.sqrt(np.diag(self.covariance)[part])


@dataclass(frozen=True)
class Model:
    """A board and, if it is on the flange, the arm's chain (6, 4) as in `calibrated_kinematics`."""

    board: CharucoBoard
    chain: FloatArray | None = None

    @property
    def free(self) -> np.ndarray:
        """Mask of the parameters θ (29,) that are estimated."""
        free = np.ones(UNKNOWNS, bool)
        if self.chain is None:
            free[BASE_FROM_CAMERA.start :] = False
        return free

    @property
    def prior(self) -> FloatArray:
        """Inverse prior variance of θ (29,)."""
        prior = np.zeros(UNKNOWNS)
        prior[WARP], prior[SCALE] = 1 / WARP_SIGMA_M**2, 1 / SCALE_SIGMA**2
        prior[JOINT_OFFSETS] = 1 / JOINT_OFFSET_SIGMA_RAD**2
        return prior


@dataclass(frozen=True)
class _Equations:
    """One view's residuals (2K,), pixels, and their derivatives with respect to θ (2K, 29) and its own pose (2K, 6)."""

    residual: FloatArray
    shared: FloatArray
    own: FloatArray


@dataclass(frozen=True)
class _Variances:
    """1 σ of a corner's coordinate, pixels, and of the arm's deviation, m and rad; infinite without an arm."""

    corner_px: float
    arm: tuple[float, float]

    @property
    def own_prior(self) -> FloatArray:
        """Inverse variance of a view's own pose (6,)."""
        return np.repeat([1 / self.arm[0] ** 2, 1 / self.arm[1] ** 2], 3)

    def near(self, other: "_Variances") -> bool:
        """Tells whether two estimates agree to one per cent."""
        pairs = zip((self.corner_px, *self.arm), (other.corner_px, *other.arm), strict=True)
        return all(one == two or abs(one / two - 1) < 0.01 for one, two in pairs)


@dataclass(frozen=True)
class _View:
    """A view's share of the normal equations: of its own pose (6, 6) and (6,), and of θ with it (29, 6)."""

    normal: FloatArray
    gradient: FloatArray
    cross: FloatArray


@dataclass(frozen=True)
class _Reduced:
    """Normal equations of θ, (29, 29) and (29,), with the views' own poses eliminated, and the views' shares."""

    normal: FloatArray
    gradient: FloatArray
    views: tuple[_View, ...]


def adjust(model: Model, views: Sequence[View], start: Parameters, least: int) -> Adjusted:
    """Bundle adjustment by Gauss–Newton with Levenberg's damping; leaves out misread corners and repeats the fit.

    A view that keeps too few corners is left out as a whole. Raises RigError calibration.infeasible if the views do not
    determine the parameters, and if fewer than `least`, or than half of them, are left.
    """
    kept, left_out, parameters = list(views), list[tuple[str, int]](), start
    while True:
        found = _descend(model, kept, parameters)
        good = [np.abs(one).max(axis=1) <= OUTLIER_SIGMA * found.corner_sigma_px for one in found.residuals_px]
        if all(one.all() for one in good):
            return replace(found, left_out=tuple(left_out))
        good = [one & (np.count_nonzero(one) >= MIN_CORNERS) for one in good]
        left_out += [(view.name, int(n)) for view, one in zip(kept, good, strict=True) for n in view.corners[~one]]
        parameters = replace(found.parameters, own=found.parameters.own[[bool(one.any()) for one in good]])
        kept = [view.only(one) for view, one in zip(kept, good, strict=True) if one.any()]
        if len(kept) < max(least, len(views) / 2):
            why = "are they sharp, and do the joints stated for each image belong to it?"
            said = f"Of {len(views)} images of the board too few agree with each other: {why}"
            raise RigError(ErrorCode.CALIBRATION_INFEASIBLE, said)


@dataclass(frozen=True)
class Seen:
    """A view's contribution to θ at an estimate, its own pose eliminated: residuals (2K,), pixels, Fisher information
    (29, 29) and gradient (29,) of the log-likelihood."""

    residual: FloatArray
    information: FloatArray
    gradient: FloatArray


def seen_by(model: Model, view: View, found: Adjusted) -> Seen:
    """Returns a view's contribution to θ at the estimate `found`, with its variances."""
    equations = _equations(model, view, found.parameters, np.eye(4))
    share = _share(equations, _Variances(found.corner_sigma_px, found.arm_sigma), np.zeros(6))
    weight = 1 / found.corner_sigma_px**2
    gain = np.linalg.solve(share.normal, share.cross.T).T
    return Seen(
        equations.residual,
        np.asarray(weight * equations.shared.T @ equations.shared - gain @ share.cross.T),
        np.asarray(weight * equations.shared.T @ equations.residual - gain @ share.gradient),
    )


def information(model: Model, view: View, found: Adjusted) -> FloatArray:
    """Fisher information (29, 29) that a further view would add on θ, its own pose eliminated.

    It does not depend on the view's pixels, only on its joints and on the corners in it.
    """
    return seen_by(model, view, found).information


def camera_from_board(model: Model, parameters: Parameters, view: View) -> FloatArray:
    """Returns the pose (4, 4) of the board in the camera's frame, by an estimate, at the view's joints."""
    flange = _arm_links(model, parameters, view)[6]
    return geometry.inverse(parameters.base_from_camera) @ flange @ parameters.flange_from_board


def _descend(model: Model, views: Sequence[View], start: Parameters) -> Adjusted:
    present, damping, free = start, 1e-3, model.free
    variances = _Variances(CORNER_SIGMA_START_PX, ARM_SIGMA_START if model.chain is not None else (math.inf, math.inf))
    equations = _all_equations(model, views, present)
    for _ in range(MAX_STEPS):
        reduced = _reduce(model, equations, present, variances)
        scaling = 1 / np.sqrt(np.diag(reduced.normal)[free])
        scaled = reduced.normal[np.ix_(free, free)] * np.outer(scaling, scaling)
        _require_determined(scaled)
        step = np.zeros(len(free))
        step[free] = scaling * np.linalg.solve(scaled + damping * np.eye(len(scaled)), scaling * reduced.gradient[free])
        own_steps = [
            np.asarray(np.linalg.solve(one.normal, one.gradient - one.cross.T @ step), dtype=float)
            for one in reduced.views
        ]
        trial = present.stepped(step, own_steps)
        tried = _all_equations(model, views, trial)
        if _cost(model, tried, trial, variances) > _cost(model, equations, present, variances):
            damping = 10 * damping
            if damping > MAX_DAMPING:
                break
            continue
        present, equations, damping, before = trial, tried, max(damping / 10, 1e-12), variances
        variances = _estimated_variances(model, equations, present, reduced, before)
        if np.linalg.norm(step[free] / scaling) < CONVERGED and variances.near(before):
            break
    reduced = _reduce(model, equations, present, variances)
    covariance = np.zeros((len(free), len(free)))
    covariance[np.ix_(free, free)] = np.linalg.inv(reduced.normal[np.ix_(free, free)])
    residuals = tuple(one.residual.reshape(-1, 2) for one in equations)
    return Adjusted(present, covariance, variances.corner_px, variances.arm, tuple(views), residuals, ())


def _require_determined(normal: FloatArray) -> None:
    """Refuses normal equations, scaled to a unit diagonal, whose condition is above MAX_CONDITION."""
    if not np.isfinite(normal).all() or np.linalg.cond(normal) > MAX_CONDITION:
        raise RigError(
            ErrorCode.CALIBRATION_INFEASIBLE,
            "The views do not determine the calibration: tilt the board by 20–45° to different sides, at different "
            "distances and places in the image",
        )


def _reduce(model: Model, equations: Sequence[_Equations], present: Parameters, variances: _Variances) -> _Reduced:
    normal, gradient = np.diag(model.prior), -model.prior * present.prior_part
    views: list[_View] = []
    for one, own in zip(equations, present.own, strict=True):
        share = _share(one, variances, _logarithm(own))
        gain = np.linalg.solve(share.normal, share.cross.T).T
        normal = normal + one.shared.T @ one.shared / variances.corner_px**2 - gain @ share.cross.T
        gradient = gradient + one.shared.T @ one.residual / variances.corner_px**2 - gain @ share.gradient
        views.append(share)
    return _Reduced(normal, gradient, tuple(views))


def _share(one: _Equations, variances: _Variances, deviation: FloatArray) -> _View:
    weight, prior = 1 / variances.corner_px**2, variances.own_prior
    normal = weight * one.own.T @ one.own + np.diag(prior)
    return _View(normal, weight * one.own.T @ one.residual - prior * deviation, weight * one.shared.T @ one.own)


def _cost(model: Model, equations: Sequence[_Equations], present: Parameters, variances: _Variances) -> float:
    corners = sum(float(one.residual @ one.residual) for one in equations) / variances.corner_px**2
    arm = sum(float(variances.own_prior @ _logarithm(own) ** 2) for own in present.own)
    return corners + arm + float(model.prior @ present.prior_part**2)


def _estimated_variances(
    model: Model, equations: Sequence[_Equations], present: Parameters, reduced: _Reduced, before: _Variances
) -> _Variances:
    """Expectation–maximisation step: mean squares of residuals and deviations, plus the variances that they leave."""
    free = model.free
    covariance = np.linalg.inv(reduced.normal[np.ix_(free, free)])
    squares, count, unknowns = 0.0, 0, float(np.count_nonzero(free))
    arm = np.zeros(6)
    for one, own, share in zip(equations, present.own, reduced.views, strict=True):
        inverse = np.linalg.inv(share.normal)
        squares += float(one.residual @ one.residual)
        count += len(one.residual)
        unknowns += float(np.trace(inverse @ one.own.T @ one.own)) / before.corner_px**2
        carried = inverse @ share.cross[free].T
        arm += _logarithm(own) ** 2 + np.diag(inverse + carried @ covariance @ carried.T)
    corner_px = max(math.sqrt(squares / max(count - unknowns, 1.0)), CORNER_SIGMA_FLOOR_PX)
    if model.chain is None:
        return _Variances(corner_px, before.arm)
    mean = np.sqrt(arm.reshape(2, 3).mean(axis=1) / len(equations))
    return _Variances(corner_px, (max(float(mean[0]), ARM_SIGMA_FLOOR[0]), max(float(mean[1]), ARM_SIGMA_FLOOR[1])))


def _all_equations(model: Model, views: Sequence[View], present: Parameters) -> list[_Equations]:
    return [_equations(model, view, present, own) for view, own in zip(views, present.own, strict=True)]


def _equations(model: Model, view: View, present: Parameters, own: FloatArray) -> _Equations:
    flat = model.board.corners_m[view.corners]
    place = 2 * flat[:, :2] / np.array(model.board.size_m) - 1  # −1 to 1 over the board
    shapes = np.column_stack([1 - place**2, place[:, 0] * place[:, 1]])
    points = np.column_stack([(1 + present.scale) * flat[:, :2], shapes @ present.warp])
    camera_from_own = np.eye(4) if model.chain is None else camera_from_board(model, present, view)
    pose = camera_from_own @ own
    vector = cv2.Rodrigues(pose[:3, :3])[0]
    predicted, derivatives = cv2.projectPoints(points, vector, pose[:3, 3], present.matrix, present.camera[4:])
    by_all = np.asarray(derivatives, dtype=float).reshape(len(points), 2, -1)
    by_point = by_all[:, :, 3:6]  # by the point in the camera's frame
    by_own = by_point @ pose[:3, :3]  # by the point in the board's frame
    shared = np.zeros((len(points), 2, UNKNOWNS))
    shared[..., CAMERA] = by_all[:, :, 6:15]
    shared[..., WARP] = by_own[..., 2:3] * shapes[:, None, :]
    if model.chain is not None:
        arm = _arm_links(model, present, view)
        in_camera = geometry.transform(pose, points)
        shared[..., BASE_FROM_CAMERA] = -_by_twist(by_point, in_camera)
        shared[..., FLANGE_FROM_BOARD] = _by_twist(by_point @ camera_from_own[:3, :3], geometry.transform(own, points))
        shared[..., SCALE] = np.einsum("kij,kj->ki", by_own[..., :2], flat[:, :2])
        base = geometry.transform(present.base_from_camera, in_camera)
        by_base = by_point @ present.base_from_camera[:3, :3].T
        for number, column in zip(range(1, 5), range(JOINT_OFFSETS.start, JOINT_OFFSETS.stop), strict=True):
            moved = np.cross(arm[number][:3, 2], base - arm[number][:3, 3])
            shared[..., column] = np.einsum("kij,kj->ki", by_base, moved)
    residual = view.pixels - np.asarray(predicted, dtype=float).reshape(-1, 2)
    return _Equations(residual.ravel(), shared.reshape(-1, UNKNOWNS), _by_twist(by_own, points).reshape(-1, 6))


def _arm_links(model: Model, parameters: Parameters, view: View) -> FloatArray:
    """Returns the link frames (7, 4, 4) in the base frame at the view's joints."""
    if model.chain is None or view.joints is None:
        raise RigError(ErrorCode.CALIBRATION_INFEASIBLE, f"{view.name}: the arm's chain and its joints are needed")
    return calibrated_kinematics.forward(model.chain, (view.joints + parameters.joint_offsets)[None])[0]


def _by_twist(by_point: FloatArray, points: FloatArray) -> FloatArray:
    """Converts derivatives by points (K, 2, 3) of a frame into those by its translation and rotation, (K, 2, 6)."""
    turned = np.stack([np.cross(axis, points) for axis in np.eye(3)], axis=-1)  # (K, 3, axis)
    return np.concatenate([by_point, by_point @ turned], axis=-1)


def _logarithm(pose: FloatArray) -> FloatArray:
    """Returns translation and rotation vector (6,) of a pose: its logarithm to first order of the rotation."""
    return np.concatenate([pose[:3, 3], Rotation.from_matrix(pose[:3, :3]).as_rotvec()])
