"""Kinematics of the factory-calibrated arm: Newton refinement of the closed-form branches.

A real arm's axes are never exactly parallel, so the closed form of `kinematics` is off by millimetres at the lamp. It
still gives the branches and good initial values: from each of them a few Newton steps on the calibrated chain converge
to the pose. Branches that do not converge (near a singularity) are discarded.
"""

import itertools

import numpy as np

from acquisition.models.base import FloatArray
from acquisition.models.cell_config import ArmConfig, JointGeometry
from acquisition.waypoints.kinematics import TURN, arm_model, denavit_hartenberg

_NEWTON_STEPS = 5
"""Maximum number of Newton steps."""
_TOLERANCE = 1e-7
"""Tolerance of the pose, m and rad; three steps reach it except near singularities."""
_MAX_CORRECTION_RAD = 0.3
"""Largest change of a joint from the closed form, rad; beyond it the iteration has converged to another branch."""


def chain(joints: list[JointGeometry]) -> FloatArray:
    """Returns the factory calibration as Denavit–Hartenberg rows (6, 4): θ, a, d, α; rad and m."""
    return np.array([[joint.theta_rad, joint.a_m, joint.d_m, joint.alpha_rad] for joint in joints])


def of_arm(arm: ArmConfig) -> FloatArray:
    """Returns an arm's Denavit–Hartenberg rows (6, 4): the factory's if the cell file states them, else the model's."""
    if arm.kinematics is not None:
        return chain(list(arm.kinematics))
    return np.array(denavit_hartenberg(arm_model(arm.model)))


def forward(chain: FloatArray, joints: FloatArray) -> FloatArray:
    """Forward kinematics of the calibrated chain: link frames (N, 7, 4, 4), base from link 0 … 6 (6: the flange), of
    joints (N, 6), rad."""
    frames = np.empty((len(joints), 7, 4, 4))
    frames[:, 0] = np.eye(4)
    for number, (offset, a, d, twist) in enumerate(chain):
        angle = joints[:, number] + offset
        cosine, sine = np.cos(angle), np.sin(angle)
        matrix = np.zeros((len(joints), 4, 4))
        matrix[:, 0, 0], matrix[:, 0, 1], matrix[:, 0, 2] = cosine, -sine * np.cos(twist), sine * np.sin(twist)
        matrix[:, 1, 0], matrix[:, 1, 1], matrix[:, 1, 2] = sine, cosine * np.cos(twist), -cosine * np.sin(twist)
        matrix[:, 2, 1], matrix[:, 2, 2] = np.sin(twist), np.cos(twist)
        matrix[:, 0, 3], matrix[:, 1, 3], matrix[:, 2, 3] = a * cosine, a * sine, d
        matrix[:, 3, 3] = 1.0
        frames[:, number + 1] = frames[:, number] @ matrix
    return frames


def departure_m(arm: ArmConfig, points: FloatArray) -> float:
    """Returns the largest distance, m, of points (K, 3) of the flange frame from where the model's nominal chain has
    them, over quarter turns of all joints but the first, which turns both chains alike; 0 without a calibration."""
    if arm.kinematics is None:
        return 0.0
    joints = np.zeros((4**5, 6))
    joints[:, 1:] = list(itertools.product(np.arange(4) * TURN / 4, repeat=5))
    chains = of_arm(arm), np.array(denavit_hartenberg(arm_model(arm.model)))
    flanges, nominal = (forward(one, joints)[:, 6] for one in chains)
    apart = (flanges - nominal)[:, :3] @ np.column_stack([points, np.ones(len(points))]).T
    return float(np.linalg.norm(apart, axis=1).max())


def refine(chain: FloatArray, joints: FloatArray, base_from_flange: FloatArray) -> FloatArray:
    """Refines joints (N, 6) to flange poses (N, 4, 4) by a damped Newton iteration on the calibrated chain.

    NaN where it does not converge.
    """
    result = joints.copy()
    for _ in range(_NEWTON_STEPS):
        frames = forward(chain, result)
        error = _pose_error(frames[:, 6], base_from_flange)
        axes, origins = frames[:, :6, :3, 2], frames[:, :6, :3, 3]
        lever_arms = np.cross(axes, frames[:, 6:7, :3, 3] - origins)
        jacobian = np.concatenate([lever_arms, axes], axis=2)  # (N, joint, 6): transposed
        # The damping is negligible; it makes a singular system solvable, and the branch then fails to converge.
        square = jacobian @ jacobian.transpose(0, 2, 1) + 1e-12 * np.eye(6)
        result += np.linalg.solve(square, jacobian @ error[..., None])[..., 0]
    missed = np.abs(_pose_error(forward(chain, result)[:, 6], base_from_flange)).max(axis=1) > _TOLERANCE
    turned = np.abs(np.mod(result - joints + np.pi, TURN) - np.pi).max(axis=1) > _MAX_CORRECTION_RAD
    result[missed | turned] = np.nan
    return result


def _pose_error(current: FloatArray, target: FloatArray) -> FloatArray:
    """Returns the pose error from (N, 4, 4) to targets, to first order: m and rad (N, 6), base frame."""
    rotation = target[:, :3, :3] @ current[:, :3, :3].transpose(0, 2, 1)
    vector = np.stack(
        [
            rotation[:, 2, 1] - rotation[:, 1, 2],
            rotation[:, 0, 2] - rotation[:, 2, 0],
            rotation[:, 1, 0] - rotation[:, 0, 1],
        ],
        axis=1,
    )
    return np.concatenate([target[:, :3, 3] - current[:, :3, 3], vector / 2], axis=1)
