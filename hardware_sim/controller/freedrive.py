"""Freedrive (`freedrive_mode`, `teach_mode`; UR script manual), and the motion of an arm that a hand pushes.

`Freedrive` is the state that a program puts the arm into. `HandMove` is the motion itself, also with open brakes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from hardware_sim.controller import poses
from hardware_sim.controller.motion import Joints, State
from hardware_sim.controller.poses import Frame

_AXES = ("x", "y", "z", "rx", "ry", "rz")
_PLAY = 1e-3  # m and rad, by which a blocked axis yields


@dataclass(frozen=True)
class Freedrive:
    """The state into which a program has put the arm; `by` is the function that it called."""

    by: str
    free_axes: tuple[bool, ...] = (True,) * 6
    base_from_feature: Frame = poses.IDENTITY

    def resists(self, base_from_tool: Frame, target: Frame) -> str | None:
        """Why the tool cannot be guided to a target, as a sentence; None if all axes that it needs are free."""
        shift, turn = poses.difference(base_from_tool, target)
        feature_from_base = poses.invert(poses.with_position(self.base_from_feature, (0.0, 0.0, 0.0)))
        moved: Sequence[float] = (*poses.rotate(feature_from_base, shift), *poses.rotate(feature_from_base, turn))
        for name, free, amount in zip(_AXES, self.free_axes, moved, strict=True):
            if not free and abs(amount) > _PLAY:
                return f"{self.by} does not free the axis {name}"
        return None


class HandMove:
    """Moves all joints evenly to where a person puts them, whatever slider and program demand."""

    velocity = None

    def __init__(self, joints: Sequence[float], target: Sequence[float], seconds: float) -> None:
        self._start: Joints = list(joints)
        self._target: Joints = list(target)
        self._seconds = seconds
        self._time = 0.0
        self.finished = False

    def step(self, dt: float, pace: float) -> State:
        del pace
        self._time += dt
        self.finished = self._time >= self._seconds
        if self.finished:
            return self._target[:], [0.0] * 6
        displacement = [b - a for a, b in zip(self._start, self._target, strict=True)]
        share = self._time / self._seconds
        return [a + share * w for a, w in zip(self._start, displacement, strict=True)], [
            w / self._seconds for w in displacement
        ]
