"""Lamp poses: lights on the dome of reachable positions, and the tool poses that bring the lamp there.

Several stages use it: capture records the light from the measured tool pose, waypoints computes the tool pose of a
planned light, pilot and planner choose among the dome's candidates. Patterns of lights are ideal directions, but the
arm reaches some positions only, so each direction is assigned its own nearest reachable candidate. A set of candidates
that cannot surround the object is refused before anything moves.
"""

import math
from collections.abc import Iterable, Sequence

import numpy as np

from acquisition import geometry
from acquisition.models.base import FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import Light
from acquisition.models.shot import Shot

MIN_SUPPORT = 0.05
"""Least extent of the candidates (sine of the slant) towards any azimuth. Below it they lie in one half-plane."""


def light_at(position: FloatArray, center: FloatArray) -> Light:
    """Light with the lamp at `position` and its axis towards `center`, both (3,) m, view frame."""
    axis = (center - position) / np.linalg.norm(center - position)
    x, y, z = (float(value) for value in position)
    a, b, c = (float(value) for value in axis)
    return Light(position=(x, y, z), axis=(a, b, c))


def directions(candidates: FloatArray, center: FloatArray, count: int, *, surround: bool = True) -> FloatArray:
    """Validated unit directions (K, 3) from `center` to the candidates (K, 3) for a design with `count` lights.

    Raises RigError plan.infeasible when there are fewer than `count`, when a position is not finite, or, where they
    have to `surround` the object, when all lie in one half-plane as seen by the camera.
    """
    if not np.all(np.isfinite(candidates)) or not np.all(np.isfinite(center)):
        raise RigError(
            ErrorCode.PLAN_INFEASIBLE,
            "a reachable position is not finite: check base_from_camera and the cell's dome",
        )
    if len(candidates) < max(count, 3 if surround else 1):
        raise RigError(
            ErrorCode.PLAN_INFEASIBLE,
            f"{count} lights are requested, but the arm reaches only {len(candidates)} positions: request fewer, "
            "or extend the reach (GET /v1/rig/reach says why positions are refused)",
            reachable=len(candidates),
            wanted=count,
        )
    offsets = candidates - center
    units = offsets / np.linalg.norm(offsets, axis=-1, keepdims=True)
    if not surround:
        return units
    around = np.arange(72) * 2 * np.pi / 72
    support = np.max(units[:, :2] @ np.stack([np.cos(around), np.sin(around)]), axis=0)
    if np.min(support) < MIN_SUPPORT:
        side = int(np.degrees(around[np.argmin(support)]))
        raise RigError(
            ErrorCode.PLAN_INFEASIBLE,
            f"all reachable positions lie on one side of the object (none towards azimuth {side}°, view frame): lights "
            "must surround it; GET /v1/rig/reach shows why the others are refused",
            empty_azimuth_deg=side,
        )
    return units


def nearest_distinct(ideal: FloatArray, units: FloatArray) -> tuple[list[int], FloatArray]:
    """Greedy assignment of ideal unit directions (M, 3) to distinct candidates of `units` (K, 3), nearest pair first.

    Returns indices (M) and the angular deviations (M,), rad. Raises RigError plan.infeasible when there are fewer than
    M candidates.
    """
    if len(units) < len(ideal):
        raise RigError(
            ErrorCode.PLAN_INFEASIBLE,
            f"the pattern has {len(ideal)} positions, but the arm reaches only {len(units)}: "
            "request fewer lights, or extend the reach (GET /v1/rig/reach says why positions are refused)",
            reachable=len(units),
            wanted=len(ideal),
        )
    angles = np.arccos(np.clip(ideal @ units.T, -1.0, 1.0))
    chosen = [-1] * len(ideal)
    miss = np.zeros(len(ideal))
    for _ in range(len(ideal)):
        row, column = (int(index) for index in np.unravel_index(np.argmin(angles), angles.shape))
        chosen[row] = column
        miss[row] = angles[row, column]
        angles[row, :] = np.inf
        angles[:, column] = np.inf
    return chosen, miss


def nearest_pattern(patterns: Iterable[FloatArray], units: FloatArray) -> tuple[list[int], FloatArray]:
    """Returns `nearest_distinct` for the one of the patterns (M, 3) that the candidates fit best by least squares."""
    found = [nearest_distinct(ideal, units) for ideal in patterns]
    return min(found, key=lambda one: float(np.sum(one[1] ** 2)))


def light_from_tool(base_from_tool: FloatArray, calibration: Calibration) -> Light:
    """Light in the view frame from a tool pose (4, 4) measured by the controller."""
    view_from_base = geometry.inverse(base_from_view(calibration))
    view_from_lamp = view_from_base @ base_from_tool @ np.array(calibration.tool_from_lamp)
    x, y, z = view_from_lamp[:3, 3].tolist()
    u, v, w = view_from_lamp[:3, 2].tolist()
    if calibration.lobe is None or not any(calibration.lobe.tilt):
        return Light(position=(x, y, z), axis=(u, v, w))
    i, j, k = (view_from_lamp[:3, :2] @ np.array(calibration.lobe.tilt)).tolist()
    return Light(position=(x, y, z), axis=(u, v, w), tilt=(i, j, k))


def with_motion(calibration: Calibration, shots: Sequence[Shot]) -> Calibration:
    """Returns the calibration with the lamp's position σ for images of which some were taken while the arm moved: the
    mean variance by motion and clocks is added to the calibrated one."""
    variances = [0.0 if shot.motion is None else shot.motion.sigma_m**2 for shot in shots]
    if not any(variances):
        return calibration
    sigma_m = math.sqrt(calibration.lamp_position_sigma_m**2 + float(np.mean(variances)))
    return calibration.model_copy(update={"lamp_position_sigma_m": sigma_m})


def common_errors(base_from_tools: FloatArray, calibration: Calibration) -> FloatArray | None:
    """First-order propagation of the calibration errors that all lamps share to the lamps' positions.

    For tool poses (F, 4, 4), returns displacements (F, 3, C) in m, view frame, of each lamp by 1 σ of each of C
    independent errors. Those of `tool_from_lamp` turn with the tool; those of `base_from_camera` move all lamps against
    the camera as one body. The covariance is the product of the displacements with their transpose over C. Returns None
    if the calibration states neither covariance.
    """
    view_from_base = geometry.inverse(base_from_view(calibration))
    view_from_tool = view_from_base @ base_from_tools
    errors: list[FloatArray] = []
    if calibration.tool_from_lamp_covariance is not None:
        errors.append(view_from_tool[:, :3, :3] @ _root(calibration.tool_from_lamp_covariance))
    if calibration.base_from_camera_covariance is not None:
        positions = (view_from_tool @ np.array(calibration.tool_from_lamp))[:, :3, 3]
        errors.append(_by_camera(positions, calibration.base_from_camera_covariance))
    return np.concatenate(errors, axis=2) if errors else None


def common_direction_sigma_rad(positions: FloatArray, center: FloatArray, calibration: Calibration) -> float:
    """1 σ in rad, per axis, of the directions from `center` (3,) to lamps (K, 3), m, view frame, by `common_errors`.

    The rolls of the tool are not known yet, so the error of `tool_from_lamp` counts equally in all directions.
    """
    offsets = positions - center
    distance = np.linalg.norm(offsets, axis=1)
    variance = np.zeros(len(positions))
    if calibration.tool_from_lamp_covariance is not None:
        variance += np.trace(np.array(calibration.tool_from_lamp_covariance)) / 3
    if calibration.base_from_camera_covariance is not None:
        errors = _by_camera(positions, calibration.base_from_camera_covariance)
        along = np.einsum("kac,ka->kc", errors, offsets / distance[:, None])
        variance += (np.sum(errors**2, axis=(1, 2)) - np.sum(along**2, axis=1)) / 2
    return float(np.sqrt(np.mean(variance / distance**2)))


def _by_camera(positions: FloatArray, covariance: Sequence[Sequence[float]]) -> FloatArray:
    """Displacements (K, 3, 6) in m, view frame, of lamps (K, 3) by 1 σ of each error of `base_from_camera`."""
    view_from_camera = geometry.VIEW_FROM_CAMERA[:3, :3]
    # A camera that is moved by t and turned by r sees a lamp at p displaced by −t − r × p, all in its own frame.
    turned = np.cross(positions[:, :, None] @ np.ones((1, 3)), view_from_camera[None], axis=1)
    by_motion = np.concatenate([np.broadcast_to(-view_from_camera, turned.shape), turned], axis=2)
    return np.asarray(by_motion @ _root(covariance), np.float64)


def _root(covariance: Sequence[Sequence[float]]) -> FloatArray:
    """A square root R (N, N) of a covariance R Rᵀ, which may be singular and have units of very different size."""
    matrix = np.array(covariance)
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-30))
    variance, axes = np.linalg.eigh(matrix / np.outer(scale, scale))
    return scale[:, None] * axes * np.sqrt(np.maximum(variance, 0))


def base_from_view(calibration: Calibration) -> FloatArray:
    """Pose (4, 4) of the view frame in the arm's base frame, from the hand–eye calibration."""
    return geometry.base_from_view(np.array(calibration.base_from_camera))


def tool_poses(positions: FloatArray, axes: FloatArray, rolls: int, calibration: Calibration) -> FloatArray:
    """Tool poses (N, rolls, 4, 4) for lamps at positions (N, 3) with axes (N, 3), all in the base frame.

    The lamp is rotationally symmetric, so the roll about its axis is free; `rolls` equal steps of it are returned.
    """
    z = axes / np.linalg.norm(axes, axis=-1, keepdims=True)
    reference = np.where(np.abs(z[:, 2:3]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    x = np.cross(reference, z)
    x /= np.linalg.norm(x, axis=-1, keepdims=True)
    y = np.cross(z, x)
    angles = np.arange(rolls) * (2 * np.pi / rolls)
    cosine, sine = np.cos(angles)[None, :, None], np.sin(angles)[None, :, None]
    base_from_lamp = np.zeros((len(positions), rolls, 4, 4))
    base_from_lamp[..., :3, 0] = cosine * x[:, None] + sine * y[:, None]
    base_from_lamp[..., :3, 1] = cosine * y[:, None] - sine * x[:, None]
    base_from_lamp[..., :3, 2] = z[:, None]
    base_from_lamp[..., :3, 3] = positions[:, None]
    base_from_lamp[..., 3, 3] = 1.0
    return base_from_lamp @ geometry.inverse(np.array(calibration.tool_from_lamp))
