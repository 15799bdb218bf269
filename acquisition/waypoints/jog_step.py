"""One step of jogging: a short straight joint segment, certified like those of routes.

Before: a person who holds a button. After: `runner.operator_moves` sends the step. The whole segment keeps all
clearances; its end keeps those of stop configurations and all joint limits. If the full step is not free, half of it is
tried, down to `_SHORTEST`, so that the arm goes close to a limit and no further.
"""

import numpy as np

from acquisition.models.base import FloatArray, as_joints
from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import ArmConfig, CellConfig
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.jog import JogMotion
from acquisition.models.route import JointPath
from acquisition.waypoints import calibrated_kinematics, kinematics
from acquisition.waypoints.collision import Scene, scene
from acquisition.waypoints.motion import legs

JOG_SPEED_RAD_S = 0.25
"""Highest joint speed, rad/s: the usual reduced speed of teaching."""
JOG_TOOL_SPEED_M_S = 0.1
"""Highest speed of the tool and of the elbow, m/s: less than half of the 0.25 m/s that ISO 10218-1 allows with a person
at hand, since nobody holds an enabling switch here."""

_SHORTEST = 1 / 8
"""Smallest fraction of the step that is tried."""
_LARGEST_TURN_RAD = 0.5
"""Largest turn of a joint, rad, in a step along an axis; beyond it the arm is near a singularity."""
_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def jog_step(joints: tuple[float, ...], motion: JogMotion, cell: CellConfig, calibration: Calibration) -> JointPath:
    """Returns a certified segment from `joints` (6, rad) in the direction of a motion.

    Raises RigError waypoints.collision, which names the obstacle (`reason`), waypoints.unreachable at a joint's limit
    or where the arm cannot reach further.
    """
    arm, start, slow = scene(cell, calibration), np.array(joints, dtype=float), _slow(cell)
    share, refusal = 1.0, RigError(ErrorCode.WAYPOINTS_UNREACHABLE, "no step is possible")
    while share >= _SHORTEST:
        try:
            end = _end(start, motion, share, cell)
            _require_free(start, end, cell.arm, arm)
        except RigError as error:
            share, refusal = share / 2, error
            continue
        leg = legs(start[None], end[None], slow)
        return JointPath(path=[as_joints(end.tolist())], speeds=[float(leg.speeds[0])], seconds=float(leg.seconds[0]))
    raise refusal


def _end(start: FloatArray, motion: JogMotion, share: float, cell: CellConfig) -> FloatArray:
    """Returns the joints (6,) at the end of a fraction of the step."""
    if motion.joint is not None:
        end = start.copy()
        end[motion.joint] += motion.direction * motion.step_rad * share
        return end
    model, own = kinematics.arm_model(cell.arm.model), cell.arm.kinematics
    chain = None if own is None else calibrated_kinematics.chain(own)
    frames = (
        kinematics.forward(model, start[None]) if chain is None else calibrated_kinematics.forward(chain, start[None])
    )
    target = frames[0, 6].copy()
    target[:3, 3] += motion.direction * motion.step_m * share * np.array(_AXES[motion.axis or "x"])
    branches = kinematics.inverse(model, target[None])[0]
    branches = branches[~np.isnan(branches).any(axis=1)]
    if chain is not None and len(branches):
        branches = calibrated_kinematics.refine(chain, branches, np.repeat(target[None], len(branches), axis=0))
        branches = branches[~np.isnan(branches).any(axis=1)]
    near = start + np.mod(branches - start + np.pi, kinematics.TURN) - np.pi
    turns = np.abs(near - start).max(axis=1, initial=0.0)
    if not len(near) or turns.min() > _LARGEST_TURN_RAD:
        raise RigError(
            ErrorCode.WAYPOINTS_UNREACHABLE,
            f"the arm cannot move further along {motion.axis} with this orientation: turn single joints instead",
            reason="too-far",
        )
    return near[int(np.argmin(turns))]


def _require_free(start: FloatArray, end: FloatArray, config: ArmConfig, arm: Scene) -> None:
    limit = np.full(6, kinematics.JOINT_LIMIT)
    limit[2] = kinematics.ELBOW_LIMIT
    home = np.array(config.home)
    # A joint that a person has moved beyond a limit by hand may move back.
    outwards = (np.abs(end) > np.abs(start)) & (np.abs(end) > limit)
    outwards |= (np.abs(end - home) > np.abs(start - home)) & (np.abs(end - home) > np.pi)
    if outwards.any():
        joint = int(np.argmax(outwards))
        raise RigError(
            ErrorCode.WAYPOINTS_UNREACHABLE,
            f"joint {joint + 1} is at its limit, or half a turn from home",
            reason="joint-limit",
            joint=joint,
        )
    violation = int(arm.violations(end[None])[0])
    if violation >= 0:
        reason, name = arm.describe_violation(violation)
        raise RigError(ErrorCode.WAYPOINTS_COLLISION, f"the way is blocked by {name}", reason=reason)
    if not arm.edges_free(start[None], end[None])[0]:
        raise RigError(
            ErrorCode.WAYPOINTS_COLLISION,
            "no step from here keeps the clearances: move the arm by hand",
            reason="not-connected",
        )


def _slow(cell: CellConfig) -> CellConfig:
    arm = cell.arm.model_copy(
        update={
            "max_joint_speed_rad_s": min(cell.arm.max_joint_speed_rad_s, JOG_SPEED_RAD_S),
            "max_tool_speed_m_s": min(cell.arm.max_tool_speed_m_s, JOG_TOOL_SPEED_M_S),
            "max_elbow_speed_m_s": min(cell.arm.max_elbow_speed_m_s, JOG_TOOL_SPEED_M_S),
        }
    )
    return cell.model_copy(update={"arm": arm})
