"""Blending of two moves by superposition: the next begins while the one before slows down, and the arm adds both.

Both are inside their ramps, where their displacements are convex functions of time. So the speed has no jump and never
exceeds that of the faster move, and the tool stays within the blend radius of the corner. The ramps of one move do not
overlap, so its two blends do not either. Two tool moves are added in tool space, where straight paths keep the radius
exactly. Otherwise joints are added, and samples of the sum determine how early the next move may begin.
"""

from collections.abc import Callable, Sequence

from hardware_sim.controller import poses
from hardware_sim.controller.motion import Follower, Joints, MotionError, State, Twist
from hardware_sim.controller.moves import CartesianMove, ProgrammedMove
from hardware_sim.controller.poses import Frame

ForwardKinematics = Callable[[Sequence[float]], Frame]
_SAMPLES = 6
_INSIDE = 0.98  # share of the radius, so that the path between two samples stays inside too
_ROUNDS = 8


class Blend:
    """The superposition of the end of a move and the start of the next one."""

    def __init__(
        self, before: ProgrammedMove, following: ProgrammedMove, radius: float, tool_at: ForwardKinematics
    ) -> None:
        """`following` begins where `before` ends; `radius` in m, `tool_at` is the tool's forward kinematics. A radius
        of zero makes the arm stop at the corner.
        """
        self._before = before
        self._following = following
        self._corner = before.end
        self._base_from_corner = tool_at(before.end)
        self._follower: Follower | None = None
        if isinstance(before, CartesianMove) and isinstance(following, CartesianMove):
            self._follower = following.follower = before.follower
        self._overlap = self._admitted(radius, tool_at) if radius > 0.0 else 0.0
        self._begun = False
        self.velocity: Twist | None = None
        self.finished = False

    def _admitted(self, radius: float, tool_at: ForwardKinematics) -> float:
        """The longest overlap in s that keeps the tool inside the radius."""
        overlap = min(self._before.ramp_out, self._following.ramp_in, self._before.time_left)
        try:
            for _ in range(_ROUNDS):
                away = max(self._away(overlap, number / _SAMPLES, tool_at) for number in range(_SAMPLES + 1))
                if away <= _INSIDE * radius:
                    return overlap
                # In a ramp the distance grows with the square of the time.
                overlap *= min(0.95, (0.95 * _INSIDE * radius / away) ** 0.5)
        except MotionError:
            pass  # the sum leaves the arm's reach: no blend
        return 0.0

    def _away(self, overlap: float, share: float, tool_at: ForwardKinematics) -> float:
        """The tool's distance in m from the corner at a share of the overlap."""
        left, gone = (1.0 - share) * overlap, share * overlap
        before, following = self._before, self._following
        if isinstance(before, CartesianMove) and isinstance(following, CartesianMove):
            tool = self._joined_frames(before.frame_before_end(left), following.frame_after(gone))
        else:
            tool = tool_at(self._joined(before.joints_before_end(left), following.joints_after(gone)))
        return poses.distance(tool, self._base_from_corner)[0]

    def _joined(self, before: Sequence[float], following: Sequence[float]) -> Joints:
        return [b + f - c for b, f, c in zip(before, following, self._corner, strict=True)]

    def _joined_frames(self, before: Frame, following: Frame) -> Frame:
        corner = self._base_from_corner
        turned = poses.compose(before, poses.compose(poses.invert(corner), following))
        place = (before[i] + following[i] - corner[i] for i in (3, 7, 11))
        return poses.with_position(turned, tuple(place))

    def step(self, dt: float, pace: float) -> State:
        """See Motion: one step of the sum."""
        seconds = dt * pace
        early = max(0.0, self._before.time_left - self._overlap)
        late = 0.0 if seconds <= early else seconds - early
        if self._begun:
            late = seconds
        self._begun = self._begun or late > 0.0
        if self._follower is not None:
            state = self._step_tool(self._follower, seconds, late, dt, pace)
        else:
            state = self._step_joints(seconds, late, dt, pace)
        self.finished = self._before.finished
        return state

    def _step_joints(self, seconds: float, late: float, dt: float, pace: float) -> State:
        joints, speeds = self._before.step(dt, pace)
        if late > 0.0:
            share = late / seconds
            more, more_speeds = self._following.step(dt * share, pace)
            joints = self._joined(joints, more)
            speeds = [a + b for a, b in zip(speeds, more_speeds, strict=True)]
        return joints, speeds

    def _step_tool(self, follower: Follower, seconds: float, late: float, dt: float, pace: float) -> State:
        before, following = self._before, self._following
        assert isinstance(before, CartesianMove)  # noqa: S101 - as there is a follower
        assert isinstance(following, CartesianMove)  # noqa: S101
        frame, rate = before.advance(seconds), before.rate
        if late > 0.0:
            frame = self._joined_frames(frame, following.advance(late))
            rate = tuple(a + b for a, b in zip(rate, following.rate, strict=True))
        self.velocity = tuple(pace * r for r in rate)
        return follower.follow(frame, dt)
