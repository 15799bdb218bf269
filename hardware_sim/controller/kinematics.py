"""Forward and inverse kinematics of UR arms, nominal and as calibrated in the factory.

The implementation is independent of `acquisition.waypoints`, so that an error in one shows against the other.
Denavit–Hartenberg lengths are the manufacturer's published ones; α = (π/2, 0, 0, π/2, −π/2, 0). A real arm's axes are
never exactly parallel: `calibration.calibrated` gives the links of an `ArmModel` small errors, and all functions here
then refer to that arm. Its inverse has no closed form. The nominal one (Hawkins, Analytic inverse kinematics for the
Universal Robots UR-5/UR-10 arms, 2013) gives the branches, and Newton's method takes each to the true arm.
"""

import math
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from hardware_sim.controller import poses
from hardware_sim.controller.limits import JOINT_LIMIT
from hardware_sim.controller.poses import Frame, Vector

_TOLERANCE = 1e-9
_ROUNDING = 1e-9  # of a cosine
_EDGE = 0.06  # of a cosine: how far beyond the nominal arm's reach a calibrated one may reach
_CONVERGED = 1e-10  # m and rad
_NEWTON_STEPS = 12
_LONGEST_NEWTON_STEP = 0.2  # rad, so that a branch near a singularity is not left
_NEAR = 0.2  # sine of a bend, or share of the reach, below which a singularity is near
_SAME_BRANCH = 1e-6  # rad

Axis = tuple[Vector, Vector]  # direction and a point on it, base frame


@dataclass(frozen=True)
class Link:
    """One row of the Denavit–Hartenberg table: lengths in m, angles in rad; `offset` adds to the joint's angle."""

    length: float
    distance: float
    cos_twist: float
    sin_twist: float
    offset: float = 0.0


class Bodies(NamedTuple):
    """Masses in kg of the links beyond the base; positions of their centres in m: `along` upper arm and forearm, and
    `offsets` of all along the next axis.
    """

    masses: tuple[float, ...]
    along: tuple[float, ...]
    offsets: tuple[float, ...]


@dataclass(frozen=True)
class ArmModel:
    """Nominal lengths in m, the chain of links as built, and the greatest joint speeds in rad/s of one arm."""

    name: str
    d1: float
    a2: float
    a3: float
    d4: float
    d5: float
    d6: float
    joint_speeds: tuple[float, ...]
    payload: float  # kg
    links: tuple[Link, ...]
    bodies: Bodies
    robot_type: int  # its number in the primary interface
    unlimited_joints: tuple[int, ...]
    calibration_seed: int | None = None
    calibration_error_m: float = 0.0

    @property
    def reach(self) -> float:
        """An upper bound in m of the flange's distance from any joint's axis."""
        return sum(map(abs, (self.a2, self.a3, self.d4, self.d5, self.d6)))


def _model(name: str, table: dict[str, Any]) -> ArmModel:
    d1, a2, a3, d4, d5, d6 = lengths = table["lengths_m"]
    rows = ((0.0, d1, 90), (a2, 0.0, 0), (a3, 0.0, 0), (0.0, d4, 90), (0.0, d5, -90), (0.0, d6, 0))
    twists = {0: (1.0, 0.0), 90: (0.0, 1.0), -90: (0.0, -1.0)}  # cosine and sine
    bodies = Bodies(*(tuple(table[key]) for key in ("masses_kg", "along_m", "offsets_m")))
    return ArmModel(
        name,
        *lengths,
        joint_speeds=tuple(math.radians(s) for s in table["speeds_deg_s"]),
        payload=table["payload_kg"],
        links=tuple(Link(length, distance, *twists[twist]) for length, distance, twist in rows),
        bodies=bodies,
        robot_type=table["robot_type"],
        unlimited_joints=tuple(table.get("unlimited_joints", ())),
    )


def _models() -> dict[str, ArmModel]:
    """The arms of `models.toml`; an arm that is `like` another takes from it what it does not state itself."""
    tables = tomllib.loads(Path(__file__).with_name("models.toml").read_text(encoding="utf-8"))
    return {name: _model(name, tables.get(table.get("like", ""), {}) | table) for name, table in tables.items()}


MODELS = _models()


def chain(arm: ArmModel, joints: Sequence[float]) -> tuple[list[Axis], Frame]:
    """Forward kinematics (Denavit–Hartenberg): six joint axes in the base frame, `base_from_flange`; joints in rad."""
    axes: list[Axis] = []
    xx, xy, xz = 1.0, 0.0, 0.0
    yx, yy, yz = 0.0, 1.0, 0.0
    zx, zy, zz = 0.0, 0.0, 1.0
    px = py = pz = 0.0
    for link, q in zip(arm.links, joints, strict=True):
        axes.append(((zx, zy, zz), (px, py, pz)))
        angle = q + link.offset
        c, s = math.cos(angle), math.sin(angle)
        # Turned about z; then y and z turn about the new x by the twist.
        ux, uy, uz = c * yx - s * xx, c * yy - s * xy, c * yz - s * xz
        xx, xy, xz = c * xx + s * yx, c * xy + s * yy, c * xz + s * yz
        a, d = link.length, link.distance
        px, py, pz = px + a * xx + d * zx, py + a * xy + d * zy, pz + a * xz + d * zz
        c, s = link.cos_twist, link.sin_twist
        yx, yy, yz = c * ux + s * zx, c * uy + s * zy, c * uz + s * zz
        zx, zy, zz = c * zx - s * ux, c * zy - s * uy, c * zz - s * uz
    return axes, (xx, yx, zx, px, xy, yy, zy, py, xz, yz, zz, pz)


def forward(arm: ArmModel, joints: Sequence[float]) -> Frame:
    """Forward kinematics: `base_from_flange` at `joints` (6) in rad."""
    return chain(arm, joints)[1]


def velocity(axes: Sequence[Axis], speeds: Sequence[float], point: Sequence[float]) -> tuple[float, ...]:
    """Jacobian times joint speeds: velocity (m/s, rad/s; base frame) of a flange `point` (3), base frame."""
    vx = vy = vz = wx = wy = wz = 0.0
    for ((ax, ay, az), (px, py, pz)), rate in zip(axes, speeds, strict=True):
        if rate:
            lx, ly, lz = point[0] - px, point[1] - py, point[2] - pz
            vx += rate * (ay * lz - az * ly)
            vy += rate * (az * lx - ax * lz)
            vz += rate * (ax * ly - ay * lx)
            wx += rate * ax
            wy += rate * ay
            wz += rate * az
    return (vx, vy, vz, wx, wy, wz)


def near_singularity(arm: ArmModel, joints: Sequence[float]) -> str | None:
    """The singularity of the nominal arm that `joints` are close to, as part of a sentence; None if none is near."""
    _, q2, q3, q4, q5, _ = joints
    if abs(math.sin(q5)) < _NEAR:
        return "close to the wrist singularity (wrist 2 near 0° or 180°)"
    if abs(math.sin(q3)) < _NEAR:
        return "close to the elbow singularity (arm stretched)"
    # If the wrist's centre is above the base's axis, the base joint cannot move it.
    across = arm.a2 * math.cos(q2) + arm.a3 * math.cos(q2 + q3) + arm.d5 * math.sin(q2 + q3 + q4)
    if abs(across) < _NEAR * arm.reach:
        return "close to the shoulder singularity (wrist above the base)"
    return None


def _arccosine(value: float, slack: float) -> float | None:
    if abs(value) <= 1.0:
        return math.acos(value)
    if abs(value) > 1.0 + slack:
        return None
    # A target at the very edge of the reach must not be lost. Beyond it, Newton's method starts beside the singularity.
    return math.acos(math.copysign(1.0 if slack == _ROUNDING else 2.0 - abs(value), value))


def _nominal_solutions(
    arm: ArmModel, base_from_flange: Frame, last_joint: float, slack: float = _ROUNDING
) -> list[list[float]]:
    """All joint sets of the nominal arm in closed form (Hawkins 2013); `slack` extends its reach, in cosines."""
    r00, r01, r02, x, r10, r11, r12, y, r20, r21, r22, z = base_from_flange
    joint_sets: list[list[float]] = []
    wrist_x, wrist_y = x - arm.d6 * r02, y - arm.d6 * r12
    radius = math.hypot(wrist_x, wrist_y)
    if radius < _TOLERANCE:
        return joint_sets
    swing = _arccosine(arm.d4 / radius, slack)
    if swing is None:
        return joint_sets
    azimuth = math.atan2(wrist_y, wrist_x) + math.pi / 2
    for q1 in (azimuth + swing, azimuth - swing) if swing > 0.0 else (azimuth,):
        c1, s1 = math.cos(q1), math.sin(q1)
        bend = _arccosine((x * s1 - y * c1 - arm.d4) / arm.d6, slack)
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
            elbow = _arccosine((squared - arm.a2**2 - arm.a3**2) / (2.0 * arm.a2 * arm.a3), slack)
            if elbow is None:
                continue
            for q3 in (elbow, -elbow) if elbow > 0.0 else (elbow,):
                along, across = arm.a2 + arm.a3 * math.cos(q3), arm.a3 * math.sin(q3)
                q2 = math.atan2(rise, reach) - math.atan2(across, along)
                joint_sets.append([_wrap(q) for q in (q1, q2, q3, total - q2 - q3, q5, q6)])
    return joint_sets


def newton_solution(arm: ArmModel, base_from_flange: Frame, joints: Sequence[float]) -> list[float] | None:
    """Solves the inverse kinematics of the calibrated arm by Newton's method from `joints`: joints (6) in rad that
    reach a flange pose to 1e-9 m and rad; None if it does not converge.
    """
    solution = list(joints)
    error = math.inf
    for _ in range(_NEWTON_STEPS):
        axes, reached = chain(arm, solution)
        away, turn = poses.difference(reached, base_from_flange)
        error = max(math.hypot(*away), math.hypot(*turn))
        if error < _CONVERGED:
            break
        point = (reached[3], reached[7], reached[11])
        step = _solve_linear([velocity((axis,), (1.0,), point) for axis in axes], [*away, *turn])
        if step is None:
            return None
        share = min(1.0, _LONGEST_NEWTON_STEP / max(map(abs, step)))
        solution = [q + share * s for q, s in zip(solution, step, strict=True)]
    return solution if error < _TOLERANCE else None


def _solve_linear(columns: list[tuple[float, ...]], right: list[float]) -> list[float] | None:
    """Solves a square system, given by its columns, by Gaussian elimination with pivots; None if it is singular."""
    size = len(right)
    rows = [[*(column[i] for column in columns), right[i]] for i in range(size)]
    for i in range(size):
        pivot = max(range(i, size), key=lambda k: abs(rows[k][i]))
        if abs(rows[pivot][i]) < _TOLERANCE:
            return None
        rows[i], rows[pivot] = rows[pivot], rows[i]
        for k in range(i + 1, size):
            factor = rows[k][i] / rows[i][i]
            if factor:
                rows[k] = [a - factor * b for a, b in zip(rows[k], rows[i], strict=True)]
    solution = [0.0] * size
    for i in reversed(range(size)):
        solution[i] = (rows[i][size] - sum(rows[i][k] * solution[k] for k in range(i + 1, size))) / rows[i][i]
    return solution


def solutions(arm: ArmModel, base_from_flange: Frame, last_joint: float = 0.0) -> list[tuple[float, ...]]:
    """Inverse kinematics: all joint sets (up to 8) that reach a flange pose, each angle in (−π, π].

    If joints 4 and 6 turn about one line, joint 6 is free and set to `last_joint`.
    """
    if arm.calibration_seed is None:
        return [tuple(joints) for joints in _nominal_solutions(arm, base_from_flange, last_joint)]
    distinct: list[tuple[float, ...]] = []
    for seed in _nominal_solutions(arm, base_from_flange, last_joint, _EDGE):
        joints = newton_solution(arm, base_from_flange, seed)
        if joints is None:
            continue
        wrapped = tuple(_wrap(q) for q in joints)
        if all(
            max(abs(_wrap(a - b)) for a, b in zip(wrapped, other, strict=True)) > _SAME_BRANCH for other in distinct
        ):
            distinct.append(wrapped)
    return distinct


def _wrap(angle: float) -> float:
    return math.remainder(angle, 2.0 * math.pi)


def inverse(arm: ArmModel, base_from_flange: Frame, near: Sequence[float]) -> list[float] | None:
    """The joints (6) in rad nearest to `near`, within the joint limits; None if no set reaches the pose."""
    return _nearest(arm, base_from_flange, near, JOINT_LIMIT)


def following(arm: ArmModel, base_from_flange: Frame, last: Sequence[float]) -> list[float] | None:
    """The joints (6) in rad that continue `last` without a jump, whatever the joint limits; None if none do."""
    if arm.calibration_seed is not None:
        # From the last joints Newton's method needs two steps and cannot change the branch.
        joints = newton_solution(arm, base_from_flange, last)
        if joints is not None:
            return joints
    return _nearest(arm, base_from_flange, last, math.inf)


def _nearest(arm: ArmModel, base_from_flange: Frame, near: Sequence[float], limit: float) -> list[float] | None:
    best: list[float] | None = None
    least = math.inf
    candidates = solutions(arm, base_from_flange, near[5])
    if arm.calibration_seed is not None:
        # Near a singularity the nominal arm may lack the true arm's branch.
        beside = newton_solution(arm, base_from_flange, near)
        candidates += [] if beside is None else [tuple(_wrap(q) for q in beside)]
    for solution in candidates:
        candidate = [
            _unwrap(q, n, math.inf if number in arm.unlimited_joints else limit)
            for number, (q, n) in enumerate(zip(solution, near, strict=True))
        ]
        cost = sum((q - n) ** 2 for q, n in zip(candidate, near, strict=True))
        if cost < least:
            best, least = candidate, cost
    return best


def _unwrap(angle: float, near: float, limit: float) -> float:
    angle = near + math.remainder(angle - near, 2.0 * math.pi)
    if angle > limit:
        return angle - 2.0 * math.pi
    return angle + 2.0 * math.pi if angle < -limit else angle
