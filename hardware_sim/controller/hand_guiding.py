"""Hand guiding: the motion of an arm that a person pushes, with its brakes open or in freedrive.

No program takes part in it; whether a program allows it is the state in `freedrive.Freedrive`.
"""

from collections.abc import Sequence

from hardware_sim.controller.motion import Joints, State


class HandMove:
    """All joints go evenly to where the person puts them, whatever slider and program say."""

    velocity = None

    def __init__(self, joints: Sequence[float], target: Sequence[float], seconds: float) -> None:
        self._start: Joints = list(joints)
        self._target: Joints = list(target)
        self._seconds = seconds
        self._time = 0.0
        self.finished = False

    def step(self, dt: float, pace: float) -> State:
        """See Motion."""
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
