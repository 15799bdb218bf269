"""Forces at the tool: a spring surface that it can touch, and the motion of `force_mode` (UR script manual).

This is the simplest model in which force control and the search for contact have an effect; it models neither a sensor
nor an arm's compliance. There is at most one surface, placed through the control port. It acts on the TCP alone, along
its normal, without friction. A push beyond `MOST_FORCE` causes a protective stop. In force mode the tool moves along
each compliant axis in proportion to the missing force or torque (an admittance, `MOBILITY`), at most at that axis's
speed limit. The other axes stand still; a move in force mode is refused.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from hardware_sim.controller import poses
from hardware_sim.controller.motion import STANDSTILL, State, Twist
from hardware_sim.controller.poses import Frame
from hardware_sim.controller.steering import ToolSpeed

MOST_FORCE = 150.0
"""Force limit at the TCP, N, of an e-Series safety configuration as delivered."""
LEAST_CONTACT = 1.0
"""Least force, N, that `tool_contact` takes as a contact."""
MOBILITY = (0.01, 0.01, 0.01, 0.1, 0.1, 0.1)
"""m/s per N and rad/s per Nm at a gain scaling of 1; at the default of 0.5, 10 N move the free tool at 50 mm/s."""
_ACCELERATION = 5.0  # m/s²; a spring of 20 kN/m is approached without oscillation


@dataclass(frozen=True)
class SpringSurface:
    """A plane in the base frame, m; `normal` (unit) points out of it, `stiffness` in N/m."""

    point: tuple[float, float, float]
    normal: tuple[float, float, float]
    stiffness: float

    def force_on(self, base_from_tool: Frame) -> Twist:
        """Force (N) and torque (Nm) on the tool at its TCP, base axes."""
        position = poses.position(base_from_tool)
        depth = sum(n * (p - x) for n, p, x in zip(self.normal, self.point, position, strict=True))
        if depth <= 0.0:
            return STANDSTILL
        return *(self.stiffness * depth * n for n in self.normal), 0.0, 0.0, 0.0


@dataclass(frozen=True)
class ForceTask:
    """Arguments of `force_mode`: task frame, its compliant axes, N and Nm to exert, speed limits in m/s and rad/s."""

    base_from_task: Frame
    compliant: Sequence[bool]
    wrench: Sequence[float]
    speeds: Sequence[float]

    def velocity(self, force: Sequence[float], gain: float) -> list[float]:
        """The tool's velocity in base while `force` (base axes) acts on it."""
        task_from_base = poses.invert(self.base_from_task)
        acting = (*poses.rotate(task_from_base, force[:3]), *poses.rotate(task_from_base, force[3:]))
        wanted = [
            max(-most, min(most, gain * mobility * (exerted + present))) if compliant else 0.0
            for compliant, exerted, present, most, mobility in zip(
                self.compliant, self.wrench, acting, self.speeds, MOBILITY, strict=True
            )
        ]
        return [*poses.rotate(self.base_from_task, wanted[:3]), *poses.rotate(self.base_from_task, wanted[3:])]


class ForceMotion(ToolSpeed):
    """The tool in force mode; `force` (base axes) acts on it, and the task may change while it runs."""

    task: ForceTask | None = None
    force: Twist = STANDSTILL
    gain = 1.0

    def step(self, dt: float, pace: float) -> State:
        self.acceleration = _ACCELERATION
        self.target = STANDSTILL if self.task is None else self.task.velocity(self.force, self.gain)
        return super().step(dt, pace)
