"""Torques, currents, momentum and elbow of the arm, as RTDE reports them: a static model.

A joint carries the weight of all links beyond it and of the payload (composite masses, from the tool inwards). Its
torque is that weight's moment about its axis, and its current is the torque divided by a constant. Inertia, Coriolis
forces, friction and noise are left out. Currents are those of an arm that holds still, so targets equal actual values;
an arm held by its brakes has no current. Masses and their places are from UR's article on Denavit–Hartenberg parameters
for calculations of kinematics and dynamics, as in `ur_description`, without the sideways offsets of the wrists (a few
mm). For a UR5e the currents at shoulder and elbow agree with those of URSim within 0.05 %.
"""

import math
from collections.abc import Sequence

from hardware_sim.controller import kinematics, poses
from hardware_sim.controller.arm import Arm
from hardware_sim.controller.poses import Vector
from hardware_sim.controller.registers import Registers
from hardware_sim.controller.script_values import STEP_TIME

_NAMES = """target_qdd target_current target_moment actual_current joint_control_output actual_momentum
    actual_tool_accelerometer elbow_position elbow_velocity ft_raw_wrench"""
VARIABLES = frozenset(_NAMES.split())
"""Variables that `Dynamics.publish` sets; they are computed only if a client reads one of them."""
GRAVITY = 9.82  # m/s²
_FARTHEST = 10.0  # m, greatest coordinate of a payload from the flange
_TORQUE_PER_AMPERE = (9.94, 9.94, 9.94, 7.8, 7.8, 7.8)
"""N m/A: torques of this model divided by the currents of the UR5e that UR's client library recorded from URSim. Other
arms have other motors; the same constants are used for them.
"""


class Dynamics:
    """Publishes the variables that follow from the masses of one arm."""

    def __init__(self, arm: Arm, registers: Registers) -> None:
        self._arm, self._registers = arm, registers
        self._published: tuple[object, ...] = ()
        self._speeds: Sequence[float] = arm.speeds
        self._since = 0.0

    def publish(self, now: float, brakes_open: bool) -> None:
        """Sets the variables if anything has changed since the last call; `now` is the controller's time in s."""
        arm = self._arm
        # Limited, so that a message can hold the numbers whatever place a program states.
        x, y, z = (max(-_FARTHEST, min(_FARTHEST, c)) for c in arm.payload_center)
        payload = (arm.payload, x, y, z)
        state = (arm.joints, self._speeds, arm.speeds, payload, brakes_open)
        if state == self._published:
            return
        self._published = state
        put = self._registers.set
        moments, momentum = self._moments(arm.payload, (x, y, z))
        currents = [m / k if brakes_open else 0.0 for m, k in zip(moments, _TORQUE_PER_AMPERE, strict=True)]
        put("target_moment", *moments)
        for name in ("target_current", "actual_current", "joint_control_output"):
            put(name, *currents)
        put("actual_momentum", momentum)
        rate = 1.0 / max(now - self._since, STEP_TIME)
        put("target_qdd", *((b - a) * rate for a, b in zip(self._speeds, arm.speeds, strict=True)))
        elbow = arm.axes[2][1]
        put("elbow_position", *elbow)
        put("elbow_velocity", *kinematics.velocity(arm.axes[:2], arm.speeds[:2], elbow)[:3])
        up = poses.rotate(poses.invert(arm.base_from_flange), (0.0, 0.0, GRAVITY))
        put("actual_tool_accelerometer", *up)
        weight = (-arm.payload * up[0], -arm.payload * up[1], -arm.payload * up[2])
        put("ft_raw_wrench", *weight, *poses.cross((x, y, z), weight))
        self._speeds, self._since = arm.speeds, now

    def _moments(self, payload: float, center: Vector) -> tuple[list[float], float]:
        """Torques in N m that hold all links against gravity, and the norm of the linear momentum in kg m/s."""
        arm = self._arm
        masses, along, offsets = arm.model.bodies
        flange = arm.base_from_flange
        axes = [*arm.axes, ((flange[2], flange[6], flange[10]), poses.position(flange))]
        mass = payload
        turned = poses.rotate(flange, center)
        sx, sy, sz = (payload * (t + p) for t, p in zip(turned, axes[6][1], strict=True))
        moments, px, py, pz = [0.0] * 6, 0.0, 0.0, 0.0
        for joint in range(5, -1, -1):
            (ax, ay, az), begin = axes[joint]
            (nx, ny, nz), end = axes[joint + 1]
            share = 1.0 - along[joint - 1] / math.dist(begin, end) if joint in (1, 2) else 0.0
            out, own = offsets[joint], masses[joint]
            mass += own
            sx += own * (end[0] + share * (begin[0] - end[0]) + out * nx)
            sy += own * (end[1] + share * (begin[1] - end[1]) + out * ny)
            sz += own * (end[2] + share * (begin[2] - end[2]) + out * nz)
            rx, ry, rz = sx - mass * begin[0], sy - mass * begin[1], sz - mass * begin[2]
            moments[joint] = GRAVITY * (ax * ry - ay * rx)
            rate = arm.speeds[joint]
            if rate:
                px += rate * (ay * rz - az * ry)
                py += rate * (az * rx - ax * rz)
                pz += rate * (ax * ry - ay * rx)
        return moments, math.sqrt(px * px + py * py + pz * pz)
