"""Forward and inverse kinematics of UR e-Series arms in closed form.

The controller solves them itself, apart from `acquisition.waypoints`, so that an error in one does not hide in the
other. Denavit–Hartenberg lengths are the manufacturer's published ones; α = (π/2, 0, 0, π/2, −π/2, 0). The inverse
follows Hawkins (Analytic inverse kinematics for the Universal Robots UR-5/UR-10 arms, 2013).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from hardware_sim.controller.poses import Frame

JOINT_LIMIT = 2.0 * math.pi  # rad, every joint
_TOLERANCE = 1e-9


@dataclass(frozen=True)
class ArmModel:
    """Lengths in m and the greatest joint speeds in rad/s of one model."""

    name: str
    d1: float
    a2: float
    a3: float
    d4: float
    d5: float
    d6: float
    joint_speeds: tuple[float, ...]
    payload: float  # kg


def _model(name: str, lengths: Sequence[float], speeds_deg_s: Sequence[float], payload: float) -> ArmModel:
    return ArmModel(name, *lengths, joint_speeds=tuple(math.radians(s) for s in speeds_deg_s), payload=payload)


_SLOW_BASE = (120, 120, 180, 180, 180, 180)
MODELS: dict[str, ArmModel] = {
    m.name: m
    for m in (
        _model("ur3e", (0.15185, -0.24355, -0.2132, 0.13105, 0.08535, 0.0921), (180, 180, 180, 360, 360, 360), 3.0),
        _model("ur5e", (0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996), (180,) * 6, 5.0),
        _model("ur10e", (0.1807, -0.6127, -0.57155, 0.17415, 0.11985, 0.11655), _SLOW_BASE, 12.5),
        _model("ur16e", (0.1807, -0.4784, -0.36, 0.17415, 0.11985, 0.11655), _SLOW_BASE, 16.0),
    )
}


def forward(arm: ArmModel, joints: Sequence[float]) -> Frame:
    """`base_from_flange` at `joints` (6) in rad."""
    q1, q2, q3, q4, q5, q6 = joints
    c1, s1 = math.cos(q1), math.sin(q1)
    c, s = math.cos(q2 + q3 + q4), math.sin(q2 + q3 + q4)
    c5, s5 = math.cos(q5), math.sin(q5)
    c6, s6 = math.cos(q6), math.sin(q6)
    reach = arm.a2 * math.cos(q2) + arm.a3 * math.cos(q2 + q3)
    rise = arm.a2 * math.sin(q2) + arm.a3 * math.sin(q2 + q3)
    # Axes of the fourth frame; joints 2, 3 and 4 are parallel, so that only their sum turns it.
    x4 = (c1 * c, s1 * c, s)
    z4 = (c1 * s, s1 * s, -c)
    # The y axis of the fourth frame is (s1, −c1, 0).
    x5 = (c5 * x4[0] + s5 * s1, c5 * x4[1] - s5 * c1, c5 * x4[2])
    z5 = (-s5 * x4[0] + c5 * s1, -s5 * x4[1] - c5 * c1, -s5 * x4[2])
    x = c1 * reach + s1 * arm.d4 + arm.d5 * z4[0] + arm.d6 * z5[0]
    y = s1 * reach - c1 * arm.d4 + arm.d5 * z4[1] + arm.d6 * z5[1]
    z = arm.d1 + rise + arm.d5 * z4[2] + arm.d6 * z5[2]
    # The y axis of the fifth frame is −z4.
    return (
        c6 * x5[0] - s6 * z4[0], -s6 * x5[0] - c6 * z4[0], z5[0], x,
        c6 * x5[1] - s6 * z4[1], -s6 * x5[1] - c6 * z4[1], z5[1], y,
        c6 * x5[2] - s6 * z4[2], -s6 * x5[2] - c6 * z4[2], z5[2], z,
    )  # fmt: skip


def _arccosine(value: float) -> float | None:
    if abs(value) <= 1.0:
        return math.acos(value)
    # A target at the very edge of the reach must not be lost to rounding.
    return math.acos(math.copysign(1.0, value)) if abs(value) < 1.0 + _TOLERANCE else None


def solutions(arm: ArmModel, base_from_flange: Frame, last_joint: float = 0.0) -> list[tuple[float, ...]]:
    """All joint sets (up to 8) that reach a flange pose, each angle in (−π, π].

    Where joints 4 and 6 turn about one line, joint 6 is free and `last_joint` is used for it.
    """
    r00, r01, r02, x, r10, r11, r12, y, r20, r21, r22, z = base_from_flange
    found: list[tuple[float, ...]] = []
    wrist_x, wrist_y = x - arm.d6 * r02, y - arm.d6 * r12
    radius = math.hypot(wrist_x, wrist_y)
    if radius < _TOLERANCE:
        return found
    swing = _arccosine(arm.d4 / radius)
    if swing is None:
        return found
    azimuth = math.atan2(wrist_y, wrist_x) + math.pi / 2
    for q1 in (azimuth + swing, azimuth - swing) if swing > 0.0 else (azimuth,):
        c1, s1 = math.cos(q1), math.sin(q1)
        bend = _arccosine((x * s1 - y * c1 - arm.d4) / arm.d6)
        if bend is None:
            continue
        for q5 in (bend, -bend) if bend > 0.0 else (bend,):
            s5 = math.sin(q5)
            if abs(s5) > 1e-7:  # noqa: SIM108 - two lines are clearer
                q6 = math.atan2((-r01 * s1 + r11 * c1) / s5, (r00 * s1 - r10 * c1) / s5)
            else:
                q6 = last_joint
            c5, s5 = math.cos(q5), math.sin(q5)
            c6, s6 = math.cos(q6), math.sin(q6)
            # Rows of the target in the first frame's plane (its x outwards, its y up).
            out = (c1 * r00 + s1 * r10, c1 * r01 + s1 * r11, c1 * r02 + s1 * r12)
            up = (r20, r21, r22)
            # x5 = c6 x6 − s6 y6 and y5 = s6 x6 + c6 y6 = −z4; x4 = c5 x5 − s5 z5.
            x5_out, x5_up = c6 * out[0] - s6 * out[1], c6 * up[0] - s6 * up[1]
            z4_out, z4_up = -(s6 * out[0] + c6 * out[1]), -(s6 * up[0] + c6 * up[1])
            x4_out, x4_up = c5 * x5_out - s5 * out[2], c5 * x5_up - s5 * up[2]
            total = math.atan2(x4_up, x4_out)
            reach = c1 * x + s1 * y - arm.d6 * out[2] - arm.d5 * z4_out
            rise = z - arm.d1 - arm.d6 * up[2] - arm.d5 * z4_up
            squared = reach * reach + rise * rise
            elbow = _arccosine((squared - arm.a2**2 - arm.a3**2) / (2.0 * arm.a2 * arm.a3))
            if elbow is None:
                continue
            for q3 in (elbow, -elbow) if elbow > 0.0 else (elbow,):
                along, across = arm.a2 + arm.a3 * math.cos(q3), arm.a3 * math.sin(q3)
                q2 = math.atan2(rise, reach) - math.atan2(across, along)
                found.append(tuple(_wrap(q) for q in (q1, q2, q3, total - q2 - q3, q5, q6)))
    return found


def _wrap(angle: float) -> float:
    return math.remainder(angle, 2.0 * math.pi)


def inverse(arm: ArmModel, base_from_flange: Frame, near: Sequence[float]) -> list[float] | None:
    """The joints (6) in rad nearest to `near`, unwrapped within the joint limits; None where no set reaches."""
    best: list[float] | None = None
    least = math.inf
    for solution in solutions(arm, base_from_flange, near[5]):
        candidate = [_unwrap(q, n) for q, n in zip(solution, near, strict=True)]
        cost = sum((q - n) ** 2 for q, n in zip(candidate, near, strict=True))
        if cost < least:
            best, least = candidate, cost
    return best


def _unwrap(angle: float, near: float) -> float:
    angle = near + math.remainder(angle - near, 2.0 * math.pi)
    if angle > JOINT_LIMIT:
        return angle - 2.0 * math.pi
    return angle + 2.0 * math.pi if angle < -JOINT_LIMIT else angle


def tool_velocity(
    arm: ArmModel, joints: Sequence[float], speeds: Sequence[float], point: Sequence[float]
) -> tuple[float, ...]:
    """Velocity of a point fixed to the flange (m/s, rad/s; base frame), `point` (3) given in the base frame."""
    q1, q2, q3, q4, q5, _ = joints
    c1, s1 = math.cos(q1), math.sin(q1)
    c, s = math.cos(q2 + q3 + q4), math.sin(q2 + q3 + q4)
    c5, s5 = math.cos(q5), math.sin(q5)
    r2, h2 = arm.a2 * math.cos(q2), arm.d1 + arm.a2 * math.sin(q2)
    r3, h3 = r2 + arm.a3 * math.cos(q2 + q3), h2 + arm.a3 * math.sin(q2 + q3)
    hinge = (s1, -c1, 0.0)
    z4 = (c1 * s, s1 * s, -c)
    z5 = (-s5 * c1 * c + c5 * s1, -s5 * s1 * c - c5 * c1, -s5 * s)
    p4 = (c1 * r3 + s1 * arm.d4, s1 * r3 - c1 * arm.d4, h3)
    p5 = (p4[0] + arm.d5 * z4[0], p4[1] + arm.d5 * z4[1], p4[2] + arm.d5 * z4[2])
    axes = (
        ((0.0, 0.0, 1.0), (0.0, 0.0, 0.0)),
        (hinge, (0.0, 0.0, arm.d1)),
        (hinge, (c1 * r2, s1 * r2, h2)),
        (hinge, (c1 * r3, s1 * r3, h3)),
        (z4, p4),
        (z5, p5),
    )
    vx = vy = vz = wx = wy = wz = 0.0
    for (ax, ay, az), (px, py, pz), rate in ((axis, origin, w) for (axis, origin), w in zip(axes, speeds, strict=True)):
        if rate:
            lx, ly, lz = point[0] - px, point[1] - py, point[2] - pz
            vx += rate * (ay * lz - az * ly)
            vy += rate * (az * lx - ax * lz)
            vz += rate * (ax * ly - ay * lx)
            wx += rate * ax
            wy += rate * ay
            wz += rate * az
    return (vx, vy, vz, wx, wy, wz)
