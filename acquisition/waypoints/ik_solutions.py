"""Inverse-kinematics solutions of each light: all rolls and branches, filtered by limits, collisions and both cones.

Every roll of the lamp about its axis and every branch of the inverse kinematics is computed, then filtered in this
order: joint limits, collisions, view cone, light cone. The reason of a refusal is the filter that rejected the last
remaining solutions.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from acquisition import geometry, lamp_pose
from acquisition.models.base import FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import CellConfig
from acquisition.models.light_plan import Light
from acquisition.models.route import Refusal
from acquisition.waypoints import calibrated_kinematics, collision_kernels, kinematics
from acquisition.waypoints.collision import Scene

ROLLS = 36
"""Rolls about the lamp's axis, one per 10°. Measured: one fixed roll solves 42 % of random cells, 24 rolls 92 %."""
FINE_ROLLS = 180
"""Rolls, one per 2°, for lights without a solution at `ROLLS`; such lights are few, so the cost is small."""

_BATCH = 64
"""Lights that are solved together at `ROLLS`; limits memory."""


@dataclass(frozen=True)
class IkSolutions:
    """A light's collision-free configurations (M, 6), rad, with both cones unobstructed; the refusal if none."""

    joints: FloatArray
    refusal: Refusal | None


def solve_lights(
    lights: Sequence[Light], cell: CellConfig, calibration: Calibration, scene: Scene, rolls: int = ROLLS
) -> list[IkSolutions]:
    """Solves the inverse kinematics of lights (view frame) over `rolls` rolls and all branches, filtered."""
    result: list[IkSolutions] = []
    step = _BATCH * ROLLS // rolls
    for start in range(0, len(lights), step):  # 64 lights × 288 configurations a batch
        result += _batch(lights[start : start + step], cell, calibration, scene, rolls)
    return result


def _batch(
    lights: Sequence[Light], cell: CellConfig, calibration: Calibration, scene: Scene, rolls: int
) -> list[IkSolutions]:
    base_from_view = lamp_pose.base_from_view(calibration)
    positions = geometry.transform(base_from_view, np.array([light.position for light in lights]))
    axes = geometry.rotate(base_from_view, np.array([light.axis for light in lights]))
    base_from_tool = lamp_pose.tool_poses(positions, axes, rolls, calibration)
    base_from_flange = base_from_tool @ geometry.inverse(cell.arm.flange_from_tool.matrix)
    flange = base_from_flange.reshape(-1, 4, 4)
    solved = kinematics.inverse(scene.model, flange)
    if cell.arm.kinematics is not None:
        pose, branch = np.nonzero(~np.isnan(solved[..., 0]))
        solved[pose, branch] = calibrated_kinematics.refine(
            calibrated_kinematics.chain(cell.arm.kinematics), solved[pose, branch], flange[pose]
        )
    solved = solved.reshape(len(lights), -1, 6)
    within = kinematics.unwrap(solved, np.array(cell.arm.home))

    # Flat lists of the solutions left after each filter, with the number of each solution's light.
    owner, rows = np.nonzero(~np.isnan(within[..., 0]))
    joints = within[owner, rows]
    violations = scene.violations(joints)
    free = violations < 0
    hit_owner, hit = owner[~free], violations[~free]
    owner, joints = owner[free], joints[free]
    blocked = scene.blocked_cones(joints, positions[owner])
    clear = blocked < 0

    result: list[IkSolutions] = []
    for number in range(len(lights)):
        of_light = owner == number
        occluder = scene.light_occluder(positions[number])
        if occluder >= 0:
            detail = f"{scene.names[occluder]} stands between the lamp and the object"
            result.append(IkSolutions(joints[:0], Refusal(reason="shadows-object", detail=detail)))
            continue
        usable = joints[of_light & clear]
        refusal = None
        if not len(usable):
            refusal = _refusal(
                solutions=int((~np.isnan(solved[number, :, 0])).sum()),
                hits=hit[hit_owner == number],
                blocked=blocked[of_light],
                distance_m=float(np.linalg.norm(positions[number])),
                scene=scene,
            )
        result.append(IkSolutions(usable, refusal))
    return result


def _refusal(
    solutions: int, hits: np.ndarray[tuple[int], np.dtype[np.int64]],
    blocked: np.ndarray[tuple[int], np.dtype[np.int64]], distance_m: float, scene: Scene,
) -> Refusal:  # fmt: skip
    if len(blocked):
        views = int((blocked == collision_kernels.VIEW_BLOCKED).sum())
        if views * 2 >= len(blocked):
            return Refusal(
                reason="blocks-view",
                detail=f"the arm would block the view of the object in {views} of {len(blocked)} free configurations",
            )
        return Refusal(
            reason="shadows-object",
            detail=f"the arm would shadow the object in {len(blocked) - views} of {len(blocked)} free configurations",
        )
    if len(hits):
        reason, name = scene.most_common_violation(hits)
        return Refusal(
            reason=reason,
            detail=f"none of {len(hits)} configurations is collision-free; most frequent obstacle: {name}",
        )
    if solutions:
        return Refusal(
            reason="joint-limit",
            detail=f"all {solutions} configurations exceed a joint limit or are more than half a turn from home",
        )
    return Refusal(
        reason="too-far", detail=f"the lamp would be {distance_m:.2f} m from the arm's base, out of reach at any roll"
    )
