"""State of the arm: joints, tool, payload and present motion, without modes and program.

Reported and true joints differ only by `joint_offset`, a fault on demand.
"""

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from hardware_sim.controller import kinematics, limits, poses
from hardware_sim.controller.blend import Blend
from hardware_sim.controller.curves import Line
from hardware_sim.controller.force import LEAST_CONTACT, MOST_FORCE, ForceMotion, SpringSurface
from hardware_sim.controller.freedrive import Freedrive
from hardware_sim.controller.kinematics import ArmModel
from hardware_sim.controller.motion import STANDSTILL, Follower, Joints, Motion, MotionError, Twist
from hardware_sim.controller.moves import JointMove, ProgrammedMove, ToolMove
from hardware_sim.controller.poses import Frame
from hardware_sim.controller.process_path import ProcessPath
from hardware_sim.controller.steering import JointBrake, LinearBrake

Steering = TypeVar("Steering", bound=Motion)
HISTORY = 500  # ticks of joint positions that are kept for get_actual_joint_positions_history


@dataclass(frozen=True)
class Corner:
    """The end of the present move, where the next one may still blend into it within `radius` (m)."""

    move: ProgrammedMove
    radius: float


class Arm:
    """Joints, tool and payload of the arm, and the motion that changes them."""

    def __init__(self, model: ArmModel, joints: Sequence[float]) -> None:
        self.model = model
        self.joints: Joints = [float(q) for q in joints]
        self.speeds: Joints = [0.0] * 6
        self.target: Joints = self.joints[:]
        self.motion: Motion | None = None
        self.blend: Blend | None = None  # with the remainder of the move before the present one
        self.corner: Corner | None = None
        self.aborted: Motion | None = None  # a move that must not be started again
        self.freedrive: Freedrive | None = None  # while a person's hand may move the arm
        self.moves_started = 0
        self.tcp: list[float] = [0.0] * 6
        self.flange_from_tool: Frame = poses.IDENTITY
        self.payload = 0.0
        self.payload_center: list[float] = [0.0] * 3
        self.payload_inertia: list[float] = [0.0] * 6
        self.joint_offset: Joints = [0.0] * 6
        self.at_rest_ticks = HISTORY
        self.surface: SpringSurface | None = None
        self.tool_force: Twist = STANDSTILL  # N and Nm on the tool at its TCP, base axes
        self.contact_ticks = 0  # during which the tool has touched the surface
        self.history: deque[Joints] = deque([self.joints] * HISTORY, maxlen=HISTORY)
        self.axes, self.base_from_flange = kinematics.chain(model, self.joints)
        self.base_from_tool = self.base_from_flange
        self.tool_velocity: Twist = STANDSTILL

    @property
    def moving(self) -> bool:
        return any(self.speeds)

    @property
    def pressure(self) -> float:
        """The force at the tool, N."""
        return math.hypot(*self.tool_force[:3])

    @property
    def true_joints(self) -> Joints:
        """The arm's true joints, rad."""
        return [q + o for q, o in zip(self.joints, self.joint_offset, strict=True)]

    def tool_at(self, joints: Sequence[float]) -> Frame:
        """`base_from_tool` at joints (6) in rad."""
        return poses.compose(kinematics.forward(self.model, joints), self.flange_from_tool)

    def set_tcp(self, pose: Sequence[float]) -> None:
        """Sets the tool: a UR pose, flange frame."""
        self.tcp = [float(v) for v in pose]
        self.flange_from_tool = poses.from_ur(self.tcp)
        self.refresh()

    def refresh(self) -> None:
        """Recomputes the poses that follow from the joints."""
        self.axes, self.base_from_flange = kinematics.chain(self.model, self.joints)
        self.base_from_tool = poses.compose(self.base_from_flange, self.flange_from_tool)
        if self.surface is not None:
            self.tool_force = self.surface.force_on(self.base_from_tool)
        source = self.blend or self.motion
        known = None if source is None else source.velocity
        if not any(self.speeds):
            self.tool_velocity = STANDSTILL
        elif known is not None:
            self.tool_velocity = known
        else:
            self.tool_velocity = kinematics.velocity(self.axes, self.speeds, poses.position(self.base_from_tool))

    def touch(self, surface: SpringSurface | None) -> None:
        """Replaces the surface that the tool can touch."""
        self.surface, self.tool_force = surface, STANDSTILL
        self.refresh()

    # --- moves -----------------------------------------------------------------------------------------------

    @property
    def next_start(self) -> Joints:
        """The joints at which the next move begins: here, or at the corner that is being blended."""
        return self.joints if self.corner is None else self.corner.move.end

    def follower(self) -> Follower:
        """A follower of tool poses that starts where the next move does."""
        speeds = self.speeds if self.corner is None else STANDSTILL
        return Follower(self.model, self.next_start, speeds, self.flange_from_tool)

    def line_to(self, target: Frame) -> Line:
        """The tool's straight line from where the next move begins."""
        return Line(self.tool_at(self.next_start), target)

    def start(self, move: ProgrammedMove, radius: float, warn: Callable[[str], None]) -> float:
        """Begins a move, blended into the present one if that left a corner.

        `radius` (m) is that of the blend at the move's end. Returns it, or zero if that blend would overlap the one
        before or is longer than the move. `warn` receives a message for each omitted blend.
        """
        corner, self.corner = self.corner, None
        begin = self.tool_at(self.joints if corner is None else corner.move.end)
        length, _ = poses.distance(begin, self.tool_at(move.end))
        radius = self.admitted(length, radius, corner, warn)
        self.target = move.end
        self.moves_started += 1
        if corner is not None and self.motion is corner.move:
            first = corner.radius if corner.radius <= length else 0.0
            if first < corner.radius:
                warn(f"the move is shorter than the blend before it ({corner.radius:g} m): the arm stops between them")
            self.blend = Blend(corner.move, move, first, self.tool_at)
        self.motion = move
        return radius

    def admitted(self, length: float, radius: float, corner: Corner | None, warn: Callable[[str], None]) -> float:
        """The blend radius at the end of a move of `length` m: zero, with a warning, if blends would overlap."""
        before = 0.0 if corner is None else corner.radius
        if radius > 0.0 and before + radius > length:
            warn(f"overlapping blends: radius {radius:g} m after {before:g} m on {length:.4f} m is omitted")
            return 0.0
        return radius

    def process(
        self, line: Line, speed: float, acceleration: float, radius: float, warn: Callable[[str], None]
    ) -> tuple[ProcessPath, float]:
        """Begins a process path, or extends the present one by a line; returns the path and the admitted blend radius
        (see `start`). Raises MotionError.
        """
        corner = self.corner
        path = None if corner is None else corner.move
        if corner is not None and isinstance(path, ProcessPath) and self.motion is path and corner.radius < line.length:
            admitted = self.admitted(line.length, radius, corner, warn)
            if path.extend(line, corner.radius, speed, acceleration):
                self.corner = None
                self.target = path.end
                self.moves_started += 1
                return path, admitted
            warn("the corner is too sharp or too near for an arc")
        path = ProcessPath(self.follower(), line, speed, acceleration)
        return path, self.start(path, radius, warn)

    # --- stops -----------------------------------------------------------------------------------------------

    def steer(self, motion: Steering) -> Steering:
        """Replaces whatever moves the arm by a motion, and returns the motion."""
        self.corner = self.blend = None
        self.motion = motion
        return motion

    def brake(self, deceleration: float) -> JointBrake:
        """Begins to bring all joints to rest, the fastest at `deceleration` in rad/s²."""
        return self.steer(JointBrake(self.joints, self.speeds, deceleration))

    def abort(self, deceleration: float) -> None:
        """Brakes all joints to end a joint or tool move, which must not be started again; ignores other motions."""
        if isinstance(self.motion, JointMove | ToolMove):
            self.aborted = self.motion
            self.brake(deceleration)

    def brake_tool(self, deceleration: float) -> LinearBrake:
        """Begins to bring the tool to rest on its line, at `deceleration` in m/s²."""
        self.corner = None
        brake = LinearBrake(self.follower(), self.base_from_tool, self.tool_velocity, self.speeds, deceleration)
        return self.steer(brake)

    # --- time ------------------------------------------------------------------------------------------------

    def done(self, move: Motion) -> bool:
        """Whether a move has ended."""
        return move.finished and self.blend is None

    def step(self, dt: float, pace: float) -> None:
        """Advances by `dt` seconds of motion time. Raises MotionError: the arm is then where it was, or its tool is too
        fast or pushes too hard.
        """
        motion, before = self.motion, self.pressure
        if motion is None:
            return
        if isinstance(motion, ForceMotion):
            motion.force = self.tool_force
        if self.blend is None and motion.finished:
            self.speeds = [0.0] * 6
        else:
            joints, speeds = (self.blend or motion).step(dt, pace)
            if not isinstance(motion, JointBrake):
                outwards = [q if q * s > 0.0 else 0.0 for q, s in zip(joints, speeds, strict=True)]
                fault = limits.position_fault(outwards, self.model.unlimited_joints)
                if fault is not None:
                    raise MotionError(fault)
            self.joints, self.speeds = joints, speeds
        self.refresh()
        if self.blend is not None and self.blend.finished:
            self.blend = None
        if self.done(motion):
            self.motion = None
            self.corner = None
        if not isinstance(motion, JointBrake):
            fault = limits.tool_fault(self.tool_velocity)
            if before < self.pressure > MOST_FORCE:
                fault = f"the tool pushes with {self.pressure:.0f} N, its limit is {MOST_FORCE:.0f}"
            if fault is not None:
                raise MotionError(fault)

    def end_tick(self) -> None:
        """Counts ticks at rest and in contact, and keeps the history of joints."""
        self.at_rest_ticks = 0 if any(self.speeds) else self.at_rest_ticks + 1
        self.contact_ticks = self.contact_ticks + 1 if self.pressure >= LEAST_CONTACT else 0
        self.history.append(self.joints)
