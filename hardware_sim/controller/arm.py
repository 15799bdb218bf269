"""The arm itself: joints, tool, payload and the motion it is in; no modes, no program.

Reported joints and true joints differ only by `joint_offset`, a fault on demand: the arm is then not where it says.
"""

from collections import deque
from collections.abc import Sequence

from hardware_sim.controller import kinematics, poses
from hardware_sim.controller.kinematics import JOINT_LIMIT, ArmModel
from hardware_sim.controller.motion import (
    Blend,
    Follower,
    JointBrake,
    JointMove,
    Joints,
    LinearBrake,
    LinearMove,
    Motion,
    MotionError,
    linear_profile,
    planned_joint_move,
)
from hardware_sim.controller.poses import Frame

_HISTORY = 500  # ticks of joint positions kept for get_actual_joint_positions_history


class Arm:
    """Where the arm is and what moves it."""

    def __init__(self, model: ArmModel, joints: Sequence[float]) -> None:
        self.model = model
        self.joints: Joints = [float(q) for q in joints]
        self.speeds: Joints = [0.0] * 6
        self.target: Joints = self.joints[:]
        self.motion: Motion | None = None
        self.corner: Joints | None = None  # where the present move ends, while the next may still blend into it
        self.moves_started = 0
        self.tcp: list[float] = [0.0] * 6
        self.flange_from_tool: Frame = poses.IDENTITY
        self.payload = 0.0
        self.payload_center: list[float] = [0.0] * 3
        self.payload_inertia: list[float] = [0.0] * 6
        self.joint_offset: Joints = [0.0] * 6
        self.at_rest_ticks = _HISTORY
        self.history: deque[Joints] = deque([self.joints[:]], maxlen=_HISTORY)
        self.base_from_flange = kinematics.forward(model, self.joints)
        self.base_from_tool = self.base_from_flange
        self.tool_velocity: tuple[float, ...] = (0.0,) * 6

    @property
    def moving(self) -> bool:
        """Whether any joint turns."""
        return any(self.speeds)

    @property
    def true_joints(self) -> Joints:
        """Where the arm really is, in rad."""
        return [q + o for q, o in zip(self.joints, self.joint_offset, strict=True)]

    def set_tcp(self, pose: Sequence[float]) -> None:
        """Sets the tool: a UR pose, flange frame."""
        self.tcp = [float(v) for v in pose]
        self.flange_from_tool = poses.from_ur(self.tcp)
        self.refresh()

    def refresh(self) -> None:
        """Recomputes the poses that follow from the joints."""
        self.base_from_flange = kinematics.forward(self.model, self.joints)
        self.base_from_tool = tool = poses.compose(self.base_from_flange, self.flange_from_tool)
        known = None if self.motion is None else self.motion.velocity
        if not any(self.speeds):
            self.tool_velocity = (0.0,) * 6
        elif known is not None:
            self.tool_velocity = known
        else:
            point = (tool[3], tool[7], tool[11])
            self.tool_velocity = kinematics.tool_velocity(self.model, self.joints, self.speeds, point)

    @property
    def next_start(self) -> Joints:
        """The joints at which the next move begins: here, or at the corner that is being blended."""
        return self.joints if self.corner is None else self.corner

    def follower(self) -> Follower:
        """A follower of tool poses that starts where the next move does."""
        return Follower(self.model, self.next_start, self.flange_from_tool)

    def joint_move(self, target: Sequence[float], speed: float, acceleration: float, seconds: float) -> JointMove:
        """A joint move from where the next move begins."""
        return planned_joint_move(self.model, self.next_start, target, speed, acceleration, seconds)

    def linear_move(self, target: Frame, speed: float, acceleration: float, seconds: float) -> LinearMove:
        """A straight move of the tool from where the next move begins. Raises MotionError."""
        start = poses.compose(kinematics.forward(self.model, self.next_start), self.flange_from_tool)
        profile = linear_profile(start, target, speed, acceleration, seconds)
        return LinearMove(self.follower(), start, target, profile)

    def start(self, move: JointMove | LinearMove) -> Motion:
        """Begins a move, blended into the present one where that left a corner."""
        self.target = move.end
        self.moves_started += 1
        self.motion = Blend(self.motion, self.corner, move) if self.motion and self.corner else move
        self.corner = None
        return self.motion

    def brake(self, deceleration: float) -> JointBrake:
        """Begins to bring all joints to rest, the fastest at `deceleration` in rad/s²."""
        self.corner = None
        brake = JointBrake(self.joints, self.speeds, deceleration)
        self.motion = brake
        return brake

    def brake_tool(self, deceleration: float) -> LinearBrake:
        """Begins to bring the tool to rest on its line, at `deceleration` in m/s²."""
        self.corner = None
        brake = LinearBrake(self.follower(), self.base_from_tool, self.tool_velocity, deceleration)
        self.motion = brake
        return brake

    def step(self, dt: float, pace: float) -> None:
        """Advances by `dt` seconds of motion time. Raises MotionError and leaves the arm where it was."""
        motion = self.motion
        if motion is None:
            return
        if motion.finished:
            self.speeds = [0.0] * 6
        else:
            joints, speeds = motion.step(dt, pace)
            for number, (q, s) in enumerate(zip(joints, speeds, strict=True)):
                if abs(q) > JOINT_LIMIT and q * s > 0.0 and not isinstance(motion, JointBrake):
                    raise MotionError(f"joint {number} is at its limit")
            self.joints, self.speeds = joints, speeds
        self.refresh()
        if motion.finished:
            self.motion = None
            self.corner = None

    def end_tick(self) -> None:
        """Counts ticks at rest and keeps the history of joints."""
        self.at_rest_ticks = 0 if any(self.speeds) else self.at_rest_ticks + 1
        self.history.append(self.joints)
