"""Closed-form kinematics of the UR arms in batches (Hawkins 2013).

Source: Hawkins, "Analytic inverse kinematics for the Universal Robots UR-5/UR-10 arms". The closed form is chosen over
a numerical solver because the route needs *all* branches of many thousand poses (every roll of the lamp about its
axis), in microseconds each, and because it cannot fail to converge. It is valid for the nominal arm only. A real arm's
factory calibration differs by millimetres: `calibrated_kinematics` refines each branch, and measured lamp positions
come from the controller's own tool pose and never from here.

Joint angles are those of the controller. Link frame i is the Denavit–Hartenberg frame after joint i (0 the base, 6 the
flange), with the distances and twists that Universal Robots publishes ("DH parameters for calculations").
"""

import json
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

import numpy as np

from acquisition.models.base import FloatArray
from acquisition.models.errors import ErrorCode, RigError

TURN = 2.0 * np.pi
"""One turn, rad."""
JOINT_LIMIT = TURN - 0.05
"""Limit of every joint, ± rad: the controller's own, ± one turn, less a margin of 0.05 rad."""
ELBOW_LIMIT = np.pi - 0.05
"""Limit of the elbow, ± rad: beyond half a turn the forearm would pass through the upper arm."""
_SINGULAR = 1e-9
"""|sin q5| below which the wrist is singular."""


@dataclass(frozen=True)
class ArmModel:
    """Nominal arm model: Denavit–Hartenberg lengths in m, joint speeds in rad/s, link capsules in link frames."""

    name: str
    links_of: str  # the model with the same link meshes: UR5e for a UR7e, UR10e for a UR12e
    dh: FloatArray  # (6,) d1, a2, a3, d4, d5, d6
    max_joint_speed_rad_s: FloatArray  # (6,)
    capsule_links: tuple[int, ...]
    capsules: FloatArray  # (C, 7) start, end, radius


@cache
def arm_model(name: str) -> ArmModel:
    """Returns the nominal model of an arm such as `ur5e`. Raises RigError config.invalid for an unknown one."""
    models: dict[str, Any] = json.loads(
        resources.files("acquisition.waypoints").joinpath("arm_models.json").read_text()
    )["models"]
    if name not in models:
        raise RigError(
            ErrorCode.CONFIG_INVALID, f"no kinematic model for arm {name!r}", model=name, known=sorted(models)
        )
    links_of: str = models[name].get("same_as", name)
    item = models[links_of]
    return ArmModel(
        name=name,
        links_of=links_of,
        dh=np.array(item["dh"], dtype=float),
        max_joint_speed_rad_s=np.radians(np.array(item["max_joint_speed_deg_s"], dtype=float)),
        capsule_links=tuple(row[0] for row in item["capsules"]),
        capsules=np.array([[*row[1], *row[2], row[3]] for row in item["capsules"]], dtype=float).reshape(-1, 7),
    )


def forward(model: ArmModel, joints: FloatArray) -> FloatArray:
    """Forward kinematics: link frames (N, 7, 4, 4), base from link 0 … 6 (6: the flange), for joints (N, 6), rad."""
    frames = np.empty((len(joints), 7, 4, 4))
    frames[:, 0] = np.eye(4)
    for joint, (_, a, d, twist) in enumerate(denavit_hartenberg(model)):
        frames[:, joint + 1] = frames[:, joint] @ _link(joints[:, joint], d, a, twist)
    return frames


def denavit_hartenberg(model: ArmModel) -> list[tuple[float, float, float, float]]:
    """Returns the nominal arm's six Denavit–Hartenberg rows θ, a, d, α; rad and m."""
    d1, a2, a3, d4, d5, d6 = (float(length) for length in model.dh)
    return [
        (0.0, 0.0, d1, np.pi / 2),
        (0.0, a2, 0.0, 0.0),
        (0.0, a3, 0.0, 0.0),
        (0.0, 0.0, d4, np.pi / 2),
        (0.0, 0.0, d5, -np.pi / 2),
        (0.0, 0.0, d6, 0.0),
    ]


def _link(angle: FloatArray, d: float, a: float, twist: float) -> FloatArray:
    cosine, sine = np.cos(angle), np.sin(angle)
    # Rounded, because cos(π/2) evaluates to 6e-17, which would tilt the axes.
    cosine_twist, sine_twist = round(np.cos(twist)), round(np.sin(twist))
    matrix = np.zeros((len(angle), 4, 4))
    matrix[:, 0, 0], matrix[:, 0, 1], matrix[:, 0, 2] = cosine, -sine * cosine_twist, sine * sine_twist
    matrix[:, 1, 0], matrix[:, 1, 1], matrix[:, 1, 2] = sine, cosine * cosine_twist, -cosine * sine_twist
    matrix[:, 2, 1], matrix[:, 2, 2] = sine_twist, cosine_twist
    matrix[:, 0, 3], matrix[:, 1, 3], matrix[:, 2, 3] = a * cosine, a * sine, d
    matrix[:, 3, 3] = 1.0
    return matrix


def inverse(model: ArmModel, base_from_flange: FloatArray) -> FloatArray:
    """Analytic inverse kinematics (Hawkins 2013): joints (N, 8, 6) in (−π, π] for flange poses (N, 4, 4).

    NaN where a branch does not exist. Branches: shoulder left or right (4) × wrist up or down (2) × elbow up or down
    (1). If the wrist is straight (sin q5 = 0), joints 4 and 6 turn about the same axis and joint 6 is set to zero.
    """
    d1, a2, a3, d4, d5, d6 = model.dh
    position, rotation = base_from_flange[:, :3, 3], base_from_flange[:, :3, :3]
    result = np.full((len(base_from_flange), 8, 6), np.nan)
    wrist = position - d6 * rotation[:, :, 2]
    reach = np.hypot(wrist[:, 0], wrist[:, 1])
    with np.errstate(invalid="ignore", divide="ignore"):
        swing = np.arccos(d4 / reach)
        for shoulder in (0, 1):
            q1 = np.arctan2(wrist[:, 1], wrist[:, 0]) + np.pi / 2 + (swing if shoulder == 0 else -swing)
            s1, c1 = np.sin(q1), np.cos(q1)
            cosine5 = (position[:, 0] * s1 - position[:, 1] * c1 - d4) / d6
            # For a pose from forward kinematics the cosine may exceed 1 by rounding.
            cosine5 = np.where(np.abs(cosine5) < 1 + 1e-9, np.clip(cosine5, -1.0, 1.0), np.nan)
            for fold in (0, 1):
                q5 = np.arccos(cosine5) * (1 if fold == 0 else -1)
                s5, c5 = np.sin(q5), np.cos(q5)
                sign = np.where(s5 < 0, -1.0, 1.0)
                q6 = np.arctan2(
                    sign * (rotation[:, 1, 1] * c1 - rotation[:, 0, 1] * s1),
                    sign * (rotation[:, 0, 0] * s1 - rotation[:, 1, 0] * c1),
                )
                q6 = np.where(np.abs(s5) < _SINGULAR, 0.0, q6)
                s6, c6 = np.sin(q6), np.cos(q6)
                # In the arm's plane: x outwards, y up. `forearm_axis`: the x axis of frame 4, joints 5 and 6 undone.
                forearm_axis = c5[:, None] * (c6[:, None] * rotation[:, :, 0] - s6[:, None] * rotation[:, :, 1])
                forearm_axis -= s5[:, None] * rotation[:, :, 2]
                down = s6[:, None] * rotation[:, :, 0] + c6[:, None] * rotation[:, :, 1]
                end = wrist + d5 * down
                x, y = c1 * end[:, 0] + s1 * end[:, 1], end[:, 2] - d1
                pitch = np.arctan2(forearm_axis[:, 2], c1 * forearm_axis[:, 0] + s1 * forearm_axis[:, 1])
                cosine3 = (x**2 + y**2 - a2**2 - a3**2) / (2 * a2 * a3)
                cosine3 = np.where(np.abs(cosine3) < 1 + 1e-9, np.clip(cosine3, -1.0, 1.0), np.nan)
                for elbow in (0, 1):
                    q3 = np.arccos(cosine3) * (1 if elbow == 0 else -1)
                    q2 = np.arctan2(y, x) - np.arctan2(a3 * np.sin(q3), a2 + a3 * np.cos(q3))
                    result[:, 4 * shoulder + 2 * fold + elbow] = np.stack([q1, q2, q3, pitch - q2 - q3, q5, q6], -1)
    result = np.pi - np.mod(np.pi - result, TURN)
    result[np.isnan(result).any(axis=-1)] = np.nan
    return result


def unwrap(joints: FloatArray, home: FloatArray) -> FloatArray:
    """Shifts joints (..., 6) by full turns to within home ± π, so that cables do not wind up; the elbow within ± π.

    NaN where a joint limit would be exceeded.
    """
    near = home + np.pi - np.mod(home + np.pi - joints, TURN)
    near[..., 2] = np.pi - np.mod(np.pi - joints[..., 2], TURN)
    beyond = (np.abs(near) > JOINT_LIMIT).any(axis=-1) | (np.abs(near[..., 2]) > ELBOW_LIMIT)
    near[beyond] = np.nan
    return near
