"""URScript's motion functions (UR script manual, module motion).

They are generators. Each claims the arm in every tick in which it waits; a motion that none claims is braked, so that a
killed thread, a finished program and a lost command all end at rest. A move with a blend radius returns when the next
one may take over. That one then starts while the first one fades out (`blend`), or continues its path (`process_path`).
"""

from collections.abc import Callable, Generator
from typing import Any, TypeVar

from hardware_sim.controller import kinematics, limits, poses
from hardware_sim.controller.arm import Corner
from hardware_sim.controller.curves import Arc, Curve
from hardware_sim.controller.force import ForceMotion, ForceTask
from hardware_sim.controller.freedrive import Freedrive
from hardware_sim.controller.motion import STANDSTILL, Motion, MotionError
from hardware_sim.controller.moves import ProgrammedMove, ToolMove, curve_profile, plan_joint_move
from hardware_sim.controller.poses import Frame
from hardware_sim.controller.script_values import STEP_TIME, FunctionGroup, frame, not_negative, numbers, positive
from hardware_sim.controller.semantics import Pose, ScriptError
from hardware_sim.controller.steering import JointServo, JointSpeed, ToolSpeed

Waiting = Generator[None, None, None]
Begun = TypeVar("Begun")
_SHORTEST_PROCESS = 1e-4  # m: a shorter line has no direction, and the tool only turns
_GUIDING_DECELERATION = 4.0  # rad/s²
_FORCE_DECELERATION = 2.0  # m/s², where force mode ends


class MotionFunctions(FunctionGroup):
    """Functions that move or stop the arm."""

    def _require_arm(self, name: str) -> None:
        """Raises ScriptError if the program may not move the arm now."""
        self._robot.require_main_program()
        if self._arm.freedrive is not None:
            raise ScriptError(f"{name}: the arm is in {self._arm.freedrive.by}: end that first")
        if isinstance(self._arm.motion, ForceMotion) and name != "force_mode":
            raise ScriptError(f"{name}: a move in force mode is not simulated by this controller: end force mode first")

    def _begun(self, begin: Callable[[], Begun]) -> Begun | None:
        """The motion that `begin` makes; None, with a protective stop, if the arm cannot follow it."""
        try:
            return begin()
        except MotionError as error:
            self._robot.protective_stop(str(error))
            return None

    def _wait_for(self, begin: Callable[[], Motion]) -> Waiting:
        """Waits until a motion has ended; begins it again if a stop has replaced it (resumed after an unlock)."""
        while True:
            motion = self._begun(begin)
            if motion is None:
                yield
                continue
            while self._arm.motion is motion and not self._arm.done(motion):
                self._robot.claim()
                yield
            if motion.finished:
                return

    def _move(self, begin: Callable[[], tuple[ProgrammedMove, float]]) -> Waiting:
        """As `_wait_for`, but returns when the next move may take over; `begin` also returns the blend's radius."""
        arm = self._arm
        while True:
            begun = self._begun(begin)
            if begun is None:
                yield
                continue
            move, radius = begun
            base_from_end = arm.tool_at(move.end)
            while arm.motion is move and not arm.done(move):
                if radius > 0.0 and arm.blend is None and move.hands_over(arm.base_from_tool, base_from_end, radius):
                    arm.corner = Corner(move, radius)
                    return
                self._robot.claim()
                yield
            if move.finished or arm.aborted is move:
                return

    def _started(self, plan: Callable[[], ProgrammedMove], radius: float) -> Callable[[], tuple[ProgrammedMove, float]]:
        def begin() -> tuple[ProgrammedMove, float]:
            move = plan()
            return move, self._arm.start(move, radius, self._robot.report)

        return begin

    def _come_to_rest(self, brake: Callable[[float], Motion], deceleration: float) -> Waiting:
        # A new move starts from rest, so a motion that a killed one left behind is braked first.
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

    def _frame_of(self, target: Any, what: str = "the target") -> Frame:
        if isinstance(target, Pose):
            return frame(target, what)
        return self._arm.tool_at(numbers(target, 6, what))

    def movej(self, q: Any, a: float = 1.4, v: float = 1.05, t: float = 0.0, r: float = 0.0) -> Waiting:
        self._require_arm("movej")
        acceleration, speed = positive(a, "a"), positive(v, "v")
        seconds, radius = not_negative(t, "t"), not_negative(r, "r")
        target = self._joints_of(q)
        fault = limits.position_fault(target, self._arm.model.unlimited_joints)
        if fault is not None:
            raise ScriptError(f"movej: the target is outside the joint limits: {fault}")
        yield from self._come_to_rest(self._arm.brake, acceleration)
        arm = self._arm
        plan = lambda: plan_joint_move(  # noqa: E731
            arm.model, arm.next_start, target, arm.flange_from_tool, speed, acceleration, seconds
        )
        yield from self._move(self._started(plan, radius))

    def movel(self, pose: Any, a: float = 1.2, v: float = 0.25, t: float = 0.0, r: float = 0.0) -> Waiting:
        self._require_arm("movel")
        target = self._frame_of(pose)
        yield from self._tool_move(lambda: self._arm.line_to(target), a, v, t, r)

    def movec(
        self, pose_via: Any, pose_to: Any, a: float = 1.2, v: float = 0.25, r: float = 0.0, mode: int = 0
    ) -> Waiting:
        self._require_arm("movec")
        if mode not in (0, 1):
            raise ScriptError(f"movec: mode must be 0 (free rotation) or 1 (fixed to the tangent), not {mode!r}")
        via, target = self._frame_of(pose_via, "pose_via"), self._frame_of(pose_to, "pose_to")

        def curve() -> Curve:
            try:
                return Arc(self._arm.tool_at(self._arm.next_start), poses.position(via), target, bool(mode))
            except ValueError as error:
                raise ScriptError(f"movec: {error}") from error

        yield from self._tool_move(curve, a, v, 0.0, r)

    def _tool_move(self, curve: Callable[[], Curve], a: Any, v: Any, t: Any, r: Any) -> Waiting:
        acceleration, speed = positive(a, "a"), positive(v, "v")
        seconds, radius = not_negative(t, "t"), not_negative(r, "r")
        yield from self._come_to_rest(self._arm.brake_tool, acceleration)

        def plan() -> ToolMove:
            path = curve()
            return ToolMove(self._arm.follower(), path, curve_profile(path, speed, acceleration, seconds))

        yield from self._move(self._started(plan, radius))

    def movep(self, pose: Any, a: float = 1.2, v: float = 0.25, r: float = 0.0) -> Waiting:
        self._require_arm("movep")
        acceleration, speed, radius = positive(a, "a"), positive(v, "v"), not_negative(r, "r")
        target = self._frame_of(pose)
        yield from self._come_to_rest(self._arm.brake_tool, acceleration)
        line = self._arm.line_to(target)
        if line.length < _SHORTEST_PROCESS:
            yield from self.movel(pose, acceleration, speed, 0.0, radius)
            return

        def begin() -> tuple[ProgrammedMove, float]:
            arm = self._arm
            return arm.process(arm.line_to(target), speed, acceleration, radius, self._robot.report)

        yield from self._move(begin)

    def stopj(self, a: float) -> Waiting:
        deceleration = positive(a, "a")
        self._robot.require_main_program()
        yield from self._wait_for(lambda: self._arm.brake(deceleration))

    def stopl(self, a: float, aRot: float = 0.0) -> Waiting:
        del aRot
        deceleration = positive(a, "a")
        self._robot.require_main_program()
        yield from self._wait_for(lambda: self._arm.brake_tool(deceleration))

    def _hold(self, motion: Motion, seconds: float) -> Waiting:
        for _ in range(max(1, round(not_negative(seconds, "t") / STEP_TIME))):
            if self._arm.motion is not motion:
                return
            self._robot.claim()
            yield
        self._robot.claim()

    def speedj(self, qd: Any, a: float = 1.4, t: float = 0.0) -> Waiting:
        self._require_arm("speedj")
        # Clients stream accelerations down to rounding errors; the speed then stays constant.
        target, acceleration = numbers(qd, 6, "qd"), not_negative(a, "a")
        motion = self._arm.motion
        if not isinstance(motion, JointSpeed):
            motion = self._arm.steer(JointSpeed(self._arm.model, self._arm.joints, self._arm.speeds))
        motion.target, motion.acceleration = target, acceleration
        yield from self._hold(motion, t)

    def speedl(self, xd: Any, a: float = 1.2, t: float = 0.0, aRot: float = 0.0) -> Waiting:
        del aRot
        self._require_arm("speedl")
        target, acceleration = numbers(xd, 6, "xd"), not_negative(a, "a")
        motion = self._arm.motion
        if not isinstance(motion, ToolSpeed):
            self._arm.corner = None
            arm = self._arm
            motion = arm.steer(ToolSpeed(arm.follower(), arm.base_from_tool, arm.tool_velocity))
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
        self._require_arm("servoj")
        target = numbers(q, 6, "q")
        fault = limits.position_fault(target, self._arm.model.unlimited_joints)
        if fault is not None:
            raise ScriptError(f"servoj: the target is outside the joint limits: {fault}")
        motion = self._arm.motion
        if not isinstance(motion, JointServo):
            motion = self._arm.steer(JointServo(self._arm.model, self._arm.joints, self._arm.speeds))
        motion.target = target
        motion.lookahead = min(0.2, max(0.03, float(lookahead_time)))
        motion.gain = min(2000.0, max(100.0, float(gain)))
        yield from self._hold(motion, t)

    def force_mode(self, task_frame: Any, selection_vector: Any, wrench: Any, type: Any, limits: Any) -> Waiting:  # noqa: A002
        self._require_arm("force_mode")
        if type != 2:
            raise ScriptError(f"force_mode: type {type} is not simulated by this controller, only 2")
        task = ForceTask(
            frame(task_frame, "task_frame"),
            [bool(axis) for axis in numbers(selection_vector, 6, "selection_vector")],
            numbers(wrench, 6, "wrench"),
            [not_negative(limit, "limits") for limit in numbers(limits, 6, "limits")],
        )
        motion = self._arm.motion
        if not isinstance(motion, ForceMotion):
            yield from self._come_to_rest(self._arm.brake, _GUIDING_DECELERATION)
            motion = self._arm.steer(ForceMotion(self._arm.follower(), self._arm.base_from_tool, STANDSTILL))
        motion.task, motion.gain = task, self._robot.force_mode_settings.get("gain_scaling", 1.0)

    def end_force_mode(self) -> Waiting:
        self._robot.require_main_program()
        if isinstance(self._arm.motion, ForceMotion):
            yield from self._wait_for(lambda: self._arm.brake_tool(_FORCE_DECELERATION))

    def protective_stop(self) -> Waiting:
        self._robot.protective_stop("requested by the program")
        yield

    def _enter_freedrive(self, guiding: Freedrive) -> Waiting:
        self._require_arm(guiding.by)
        yield from self._come_to_rest(self._arm.brake, _GUIDING_DECELERATION)
        self._arm.freedrive = guiding

    def freedrive_mode(self, freeAxes: Any = None, feature: Any = None) -> Waiting:
        axes = [1.0] * 6 if freeAxes is None else numbers(freeAxes, 6, "freeAxes")
        base_from_feature = poses.IDENTITY if feature is None else frame(feature, "feature")
        yield from self._enter_freedrive(
            Freedrive("freedrive_mode", tuple(bool(free) for free in axes), base_from_feature)
        )

    def teach_mode(self) -> Waiting:
        yield from self._enter_freedrive(Freedrive("teach_mode"))

    def end_freedrive_mode(self) -> Waiting:
        self._robot.require_main_program()
        self._arm.freedrive = None
        yield from self._come_to_rest(self._arm.brake, _GUIDING_DECELERATION)

    end_teach_mode = end_freedrive_mode
