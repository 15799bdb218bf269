"""URScript's motion functions.

They are generators: each claims the arm in every tick in which it waits, and a motion that nobody claims is braked, so
that a killed thread, a finished program and a lost command all end at rest. A move with a blend radius returns when
the tool is that near to its corner; the next move then starts while the rest of it fades out (`motion.Blend`).
"""

from collections.abc import Callable, Generator
from typing import Any, TypeVar

from hardware_sim.controller import kinematics, poses
from hardware_sim.controller.motion import JointMove, JointServo, JointSpeed, LinearMove, Motion, MotionError, ToolSpeed
from hardware_sim.controller.poses import Frame
from hardware_sim.controller.program import Pose, ScriptError
from hardware_sim.controller.script_values import STEP_TIME, Bound, frame, not_negative, numbers, positive

Waiting = Generator[None, None, None]
Begun = TypeVar("Begun", bound=Motion)


class MotionFunctions(Bound):
    """What moves or stops the arm."""

    def _begun(self, begin: Callable[[], Begun]) -> Begun | None:
        """What `begin` makes, or None with a protective stop where the arm cannot follow it."""
        try:
            return begin()
        except MotionError as error:
            self._controller.protective_stop(str(error))
            return None

    def _wait_for(self, begin: Callable[[], Motion]) -> Waiting:
        """Waits until a motion has ended; begins it anew where a stop has thrown it out (resumed after an unlock)."""
        self._controller.require_main_program()
        while True:
            motion = self._begun(begin)
            if motion is None:
                yield
                continue
            while self._arm.motion is motion and not motion.finished:
                self._controller.claim()
                yield
            if motion.finished:
                return

    def _move(self, begin: Callable[[], JointMove | LinearMove], radius: float) -> Waiting:
        """As `_wait_for`, but returns at the corner's blend radius (m) where there is one."""
        if radius <= 0.0:
            yield from self._wait_for(lambda: self._arm.start(begin()))
            return
        self._controller.require_main_program()
        while True:
            move = self._begun(begin)
            if move is None:
                yield
                continue
            running = self._arm.start(move)
            corner = poses.compose(kinematics.forward(self._arm.model, move.end), self._arm.flange_from_tool)
            while self._arm.motion is running and not running.finished:
                if move.time > 0.5 * move.profile.duration:
                    way, _ = poses.distance(self._arm.base_from_tool, corner)
                    if way <= radius:
                        self._arm.corner = move.end
                        return
                self._controller.claim()
                yield
            if running.finished:
                return

    def _come_to_rest(self, brake: Callable[[float], Motion], deceleration: float) -> Waiting:
        # A new move starts from rest; what a killed one left behind is braked first.
        if self._arm.moving and self._arm.corner is None:
            yield from self._wait_for(lambda: brake(deceleration))

    def _joints_of(self, target: Any) -> list[float]:
        if not isinstance(target, Pose):
            return numbers(target, 6, "the target")
        flange = poses.compose(frame(target, "the target"), poses.invert(self._arm.flange_from_tool))
        joints = kinematics.inverse(self._arm.model, flange, self._arm.next_start)
        if joints is None:
            raise ScriptError("no solution for the target pose")
        return joints

    def _frame_of(self, target: Any) -> Frame:
        if isinstance(target, Pose):
            return frame(target, "the target")
        joints = numbers(target, 6, "the target")
        return poses.compose(kinematics.forward(self._arm.model, joints), self._arm.flange_from_tool)

    def movej(self, q: Any, a: float = 1.4, v: float = 1.05, t: float = 0.0, r: float = 0.0) -> Waiting:
        acceleration, speed = positive(a, "a"), positive(v, "v")
        seconds, radius = not_negative(t, "t"), not_negative(r, "r")
        target = self._joints_of(q)
        if any(abs(angle) > kinematics.JOINT_LIMIT for angle in target):
            raise ScriptError("movej: the target is outside the joint limits")
        yield from self._come_to_rest(self._arm.brake, acceleration)
        yield from self._move(lambda: self._arm.joint_move(target, speed, acceleration, seconds), radius)

    def movel(self, pose: Any, a: float = 1.2, v: float = 0.25, t: float = 0.0, r: float = 0.0) -> Waiting:
        acceleration, speed = positive(a, "a"), positive(v, "v")
        seconds, radius = not_negative(t, "t"), not_negative(r, "r")
        target = self._frame_of(pose)
        yield from self._come_to_rest(self._arm.brake_tool, acceleration)
        yield from self._move(lambda: self._arm.linear_move(target, speed, acceleration, seconds), radius)

    def movep(self, pose: Any, a: float = 1.2, v: float = 0.25, r: float = 0.0) -> Waiting:
        # The real controller keeps the tool's speed constant round the corner; here it blends as movel does.
        yield from self.movel(pose, a, v, 0.0, r)

    def stopj(self, a: float) -> Waiting:
        deceleration = positive(a, "a")
        yield from self._wait_for(lambda: self._arm.brake(deceleration))

    def stopl(self, a: float, aRot: float = 0.0) -> Waiting:
        del aRot
        deceleration = positive(a, "a")
        yield from self._wait_for(lambda: self._arm.brake_tool(deceleration))

    def _hold(self, motion: Motion, seconds: float) -> Waiting:
        self._controller.require_main_program()
        for _ in range(max(1, round(not_negative(seconds, "t") / STEP_TIME))):
            if self._arm.motion is not motion:
                return
            self._controller.claim()
            yield
        self._controller.claim()

    def speedj(self, qd: Any, a: float = 1.4, t: float = 0.0) -> Waiting:
        target, acceleration = numbers(qd, 6, "qd"), positive(a, "a")
        motion = self._arm.motion
        if not isinstance(motion, JointSpeed):
            motion = self._arm.motion = JointSpeed(self._arm.model, self._arm.joints, self._arm.speeds)
        motion.target, motion.acceleration = target, acceleration
        yield from self._hold(motion, t)

    def speedl(self, xd: Any, a: float = 1.2, t: float = 0.0, aRot: float = 0.0) -> Waiting:
        del aRot
        target, acceleration = numbers(xd, 6, "xd"), positive(a, "a")
        motion = self._arm.motion
        if not isinstance(motion, ToolSpeed):
            motion = ToolSpeed(self._arm.follower(), self._arm.base_from_tool, self._arm.tool_velocity)
            self._arm.motion = motion
        motion.target, motion.acceleration = target, acceleration
        yield from self._hold(motion, t)

    def servoj(
        self,
        q: Any,
        a: float = 0.0,
        v: float = 0.0,
        t: float = STEP_TIME,
        lookahead_time: float = 0.1,
        gain: float = 300.0,
    ) -> Waiting:
        del a, v  # not used by the real controller either
        target = numbers(q, 6, "q")
        motion = self._arm.motion
        if not isinstance(motion, JointServo):
            motion = self._arm.motion = JointServo(self._arm.model, self._arm.joints, self._arm.speeds)
        motion.target = target
        motion.lookahead = min(0.2, max(0.03, float(lookahead_time)))
        motion.gain = min(2000.0, max(100.0, float(gain)))
        yield from self._hold(motion, t)

    def protective_stop(self) -> Waiting:
        self._controller.protective_stop("asked for by the program")
        yield
