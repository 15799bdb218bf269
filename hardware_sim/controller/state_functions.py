"""URScript's functions on kinematics, limits, tool, payload and the arm's state."""

from collections.abc import Callable
from typing import Any

from hardware_sim.controller import kinematics, limits, poses
from hardware_sim.controller.arm import HISTORY
from hardware_sim.controller.moves import CartesianMove, JointMove
from hardware_sim.controller.robot import Robot
from hardware_sim.controller.script_values import STEP_TIME, FunctionGroup, frame, integer_below, number, numbers
from hardware_sim.controller.semantics import Pose, ScriptError

STEADY_AFTER = 0.5  # s of motion time at rest


def _asks(read: Callable[[Robot], Any]) -> Callable[["StateFunctions"], Any]:
    """A function without arguments that reads the state of the robot."""

    def method(self: "StateFunctions") -> Any:
        return read(self.robot)

    return method


class StateFunctions(FunctionGroup):
    """Functions by which a program reads and sets the arm's state."""

    get_tcp_offset = _asks(lambda robot: Pose(robot.arm.tcp))
    get_target_payload = _asks(lambda robot: robot.arm.payload)
    get_target_payload_cog = _asks(lambda robot: robot.arm.payload_center[:])
    get_target_payload_inertia = _asks(lambda robot: robot.arm.payload_inertia[:])
    get_actual_joint_positions = _asks(lambda robot: robot.arm.joints[:])
    get_target_joint_positions = get_joint_positions = get_actual_joint_positions
    get_target_joint_speeds = get_actual_joint_speeds = _asks(lambda robot: robot.arm.speeds[:])
    get_target_tcp_pose = get_actual_tcp_pose = _asks(lambda robot: Pose(poses.to_ur(robot.arm.base_from_tool)))
    get_actual_tool_flange_pose = _asks(lambda robot: Pose(poses.to_ur(robot.arm.base_from_flange)))
    get_target_tcp_speed = get_actual_tcp_speed = _asks(lambda robot: Pose(robot.arm.tool_velocity))
    get_tool_accelerometer_reading = _asks(lambda robot: list(robot.registers.get("actual_tool_accelerometer")))
    get_tool_current = _asks(lambda robot: robot.registers.get("tool_output_current")[0])
    get_tcp_force = _asks(lambda robot: Pose(robot.arm.tool_force))
    force = _asks(lambda robot: robot.arm.pressure)
    zero_ftsensor = _asks(lambda robot: None)  # the simulated sensor has no offset
    is_steady = _asks(lambda robot: robot.arm.at_rest_ticks * STEP_TIME * robot.speed_factor >= STEADY_AFTER)

    def _solve(self, x: Any, qnear: Any) -> list[float] | None:
        near = self._arm.joints if qnear is None else numbers(qnear, 6, "qnear")
        tool = frame(x)
        flange = poses.compose(tool, poses.invert(self._arm.flange_from_tool))
        return kinematics.inverse(self._arm.model, flange, near)

    def get_inverse_kin(
        self, x: Any, qnear: Any = None, maxPositionError: float = 1e-10, maxOrientationError: float = 1e-10
    ) -> list[float]:
        del maxPositionError, maxOrientationError  # ignored: solutions are exact to 1e-9 m and rad
        joints = self._solve(x, qnear)
        if joints is None:
            raise ScriptError("get_inverse_kin: no solution")
        return joints

    def get_inverse_kin_has_solution(
        self, x: Any, qnear: Any = None, maxPositionError: float = 1e-10, maxOrientationError: float = 1e-10
    ) -> bool:
        del maxPositionError, maxOrientationError
        return self._solve(x, qnear) is not None

    def get_forward_kin(self, q: Any = None, tcp: Any = None) -> Pose:
        joints = self._arm.joints if q is None else numbers(q, 6, "q")
        tool = self._arm.flange_from_tool if tcp is None else frame(tcp, "tcp")
        return Pose(poses.to_ur(poses.compose(kinematics.forward(self._arm.model, joints), tool)))

    def is_within_safety_limits(self, value: Any) -> bool:
        if isinstance(value, Pose):
            return self._solve(value, None) is not None
        return limits.position_fault(numbers(value, 6, "the joints"), self._arm.model.unlimited_joints) is None

    def pose_trans(self, p_from: Any, p_from_to: Any) -> Pose:
        return Pose(poses.to_ur(poses.compose(frame(p_from), frame(p_from_to))))

    def pose_inv(self, p_from: Any) -> Pose:
        return Pose(poses.to_ur(poses.invert(frame(p_from))))

    def pose_sub(self, p_to: Any, p_from: Any) -> Pose:
        to, start = frame(p_to), frame(p_from)
        turn = poses.rotation_vector(poses.compose(to, poses.invert(start)))
        return Pose([to[3] - start[3], to[7] - start[7], to[11] - start[11], *turn])

    def pose_add(self, p_1: Any, p_2: Any) -> Pose:
        a, b = frame(p_1), frame(p_2)
        turn = poses.rotation_vector(poses.compose(a, b))
        return Pose([a[3] + b[3], a[7] + b[7], a[11] + b[11], *turn])

    def pose_dist(self, p_from: Any, p_to: Any) -> float:
        return poses.distance(frame(p_from), frame(p_to))[0]

    def interpolate_pose(self, p_from: Any, p_to: Any, alpha: float) -> Pose:
        return Pose(poses.to_ur(poses.interpolate(frame(p_from), frame(p_to), number(alpha, "alpha"))))

    def set_tcp(self, pose: Any) -> None:
        self._arm.set_tcp(numbers(pose, 6, "the TCP"))
        self._robot.tool_changed()

    def set_payload_mass(self, m: float) -> None:
        mass = number(m, "the payload's mass")
        if not 0.0 <= mass <= self._arm.model.payload:
            raise ScriptError(f"a payload of {m} kg is outside 0 to {self._arm.model.payload}")
        self._arm.payload = mass

    def set_payload_cog(self, CoG: Any, transition_time: float = 0.0) -> None:
        del transition_time
        self._arm.payload_center = numbers(CoG, 3, "cog")

    def set_payload(self, m: float, cog: Any = None) -> None:
        self.set_payload_mass(m)
        if cog is not None:
            self.set_payload_cog(cog)

    def set_gravity(self, d: Any) -> None:
        numbers(d, 3, "set_gravity: d")  # checked only: gravity always points down in the base frame

    def set_target_payload(self, m: float, cog: Any, inertia: Any = None, transition_time: float = 0.0) -> None:
        del transition_time
        self.set_payload(m, cog)
        if inertia is not None:
            self._arm.payload_inertia = numbers(inertia, 6, "inertia")

    def get_actual_joint_positions_history(self, steps: Any = 0) -> list[float]:
        if not isinstance(steps, int) or not 0 <= steps < HISTORY:
            what = "get_actual_joint_positions_history: steps"
            raise ScriptError(f"{what} must be an integer from 0 to {HISTORY - 1}, not {steps!r}")
        return self._arm.history[-1 - steps][:]

    def get_target_waypoint(self) -> Pose:
        moves = isinstance(self._arm.motion, JointMove | CartesianMove)
        return self.get_forward_kin(self._arm.target if moves else None)

    def get_freedrive_status(self) -> int:
        if self._arm.freedrive is None:
            return 0
        return 1 if kinematics.near_singularity(self._arm.model, self._arm.joints) else 0

    def get_joint_temp(self, j: Any) -> float:
        return self._robot.registers.get("joint_temperatures")[integer_below(j, "a joint's number", 6)]

    def tool_contact(self, direction: Any) -> int:
        towards = numbers(direction, 6, "direction")[:3]
        against = sum(f * d for f, d in zip(self._arm.tool_force, towards, strict=False)) < 0.0
        return self._arm.contact_ticks if against or not any(towards) else 0

    def force_mode_set_gain_scaling(self, scaling: float) -> None:
        self._robot.force_mode_settings["gain_scaling"] = number(scaling, "scaling")

    def force_mode_set_damping(self, damping: float) -> None:
        self._robot.force_mode_settings["damping"] = number(damping, "damping")
