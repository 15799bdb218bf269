"""Forces at the tool: a spring surface that it can touch, and the motion of `force_mode` (UR script manual).

The simplest model in which force control and the search for contact have an effect, not one of a sensor or of an arm's
compliance. There is one surface at most, ordered at the control port, and it acts on the TCP alone, along its normal,
without friction; a push beyond `MOST_FORCE` is a protective stop. In force mode the tool moves along each compliant
axis in proportion to the force or torque that is missing (an admittance, `MOBILITY`), at most at that axis's limit of
speed; the other axes stand still: a move in force mode is refused.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from hardware_sim.controller import poses
from hardware_sim.controller.motion import STANDSTILL, State, Twist
from hardware_sim.controller.poses import Frame
from hardware_sim.controller.steering import ToolSpeed

MOST_FORCE = 150.0
"""N at the TCP: the force limit of an e-Series safety configuration as delivered."""
LEAST_CONTACT = 1.0
"""N from which `tool_contact` sees a contact."""
MOBILITY = (0.01, 0.01, 0.01, 0.1, 0.1, 0.1)
"""m/s per N and rad/s per Nm at a gain scaling of 1: 10 N move the free tool at 50 mm/s at the default of 0.5."""
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
    """What `force_mode` asks for: axes of the task frame, N and Nm that the tool shall exert, m/s and rad/s."""

    base_from_task: Frame
    compliant: Sequence[bool]
    wrench: Sequence[float]
    speeds: Sequence[float]

    def velocity(self, force: Sequence[float], gain: float) -> list[float]:
        """The tool's velocity in base where `force` acts on it (base axes)."""
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
    """The tool in force mode; `force` (base axes) is what acts on it, the task may change while it runs."""

    task: ForceTask | None = None
    force: Twist = STANDSTILL
    gain = 1.0

    def step(self, dt: float, pace: float) -> State:
        self.acceleration = _ACCELERATION
        self.target = STANDSTILL if self.task is None else self.task.velocity(self.force, self.gain)
        return super().step(dt, pace)
