"""The functions of URScript that this controller has.

Motion functions are generators: they claim the arm in every tick they wait, and a motion that nobody claims is braked,
so that a killed thread, a finished program and a lost command all end at rest. What is not simulated is refused as a
runtime exception that names the function; nothing answers "done" without having been done.
"""

import logging
import math
from collections.abc import Callable, Generator, Sequence
from typing import TYPE_CHECKING, Any, NoReturn

from hardware_sim.controller import kinematics, poses
from hardware_sim.controller.compiler import Vocabulary
from hardware_sim.controller.motion import JointServo, JointSpeed, Motion, ToolSpeed
from hardware_sim.controller.poses import Frame
from hardware_sim.controller.program import Pose, ScriptError
from hardware_sim.controller.registers import DOUBLE_IN, DOUBLE_OUT, INT_IN, INT_OUT, REGISTERS

if TYPE_CHECKING:
    from hardware_sim.controller.controller import Controller

Waiting = Generator[None, None, None]
LOG = logging.getLogger("hardware_sim.controller")
STEP_TIME = 0.002
STEADY_AFTER = 0.5  # s of motion time at rest

WAITING = frozenset(["movej", "movel", "movep", "stopj", "stopl", "speedj", "speedl", "servoj", "sleep", "sync", "protective_stop"])
IMMEDIATE = frozenset(
    ["textmsg", "read_input_float_register", "read_input_integer_register", "read_input_boolean_register", "read_output_float_register", "read_output_integer_register", "write_output_float_register", "write_output_integer_register", "get_inverse_kin", "get_inverse_kin_has_solution", "get_forward_kin", "set_tcp", "get_tcp_offset", "set_payload", "set_target_payload", "get_target_payload", "get_target_payload_cog", "get_target_payload_inertia", "is_within_safety_limits", "is_steady", "rtde_set_watchdog", "pose_trans", "pose_inv", "pose_sub", "pose_add", "pose_dist", "interpolate_pose", "force_mode_set_gain_scaling", "force_mode_set_damping", "get_steptime", "get_actual_joint_positions", "get_target_joint_positions", "get_actual_joint_speeds", "get_actual_joint_positions_history", "get_actual_tcp_pose", "get_target_tcp_pose", "get_actual_tool_flange_pose", "get_target_tcp_speed", "get_actual_tcp_speed", "get_target_waypoint", "set_digital_out", "set_standard_digital_out", "set_configurable_digital_out", "set_tool_digital_out", "get_digital_out", "get_standard_digital_out", "popup", "norm", "sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "pow", "log", "ceil", "floor", "d2r", "r2d", "length", "to_str"]
)
REFUSED = frozenset(
    ["servoc", "force_mode", "end_force_mode", "zero_ftsensor", "teach_mode", "end_teach_mode", "freedrive_mode", "end_freedrive_mode", "get_freedrive_status", "tool_contact", "ft_rtde_input_enable", "enable_external_ft_sensor", "set_gravity", "direct_torque", "get_mass_matrix", "get_coriolis_and_centrifugal_torques", "get_target_joint_accelerations", "get_jacobian", "get_jacobian_time_derivative", "get_joint_torques", "movec", "get_tcp_force", "force_mode_set_gain"]
)
VOCABULARY = Vocabulary(immediate=IMMEDIATE | REFUSED, waiting=WAITING)


def numbers(value: Any, count: int, what: str) -> list[float]:
    """`value` as a list of `count` finite numbers. Raises ScriptError naming `what`."""
    if not isinstance(value, list) or len(value) != count:
        raise ScriptError(f"{what} must be {count} numbers, not {value!r}")
    try:
        found = [float(v) for v in value]
    except (TypeError, ValueError) as error:
        raise ScriptError(f"{what} must be {count} numbers, not {value!r}") from error
    if not all(map(math.isfinite, found)):
        raise ScriptError(f"{what} holds a number that is not finite")
    return found


def positive(value: float, what: str) -> float:
    """`value` as a number above zero. Raises ScriptError naming `what`."""
    number = float(value)
    if not (number > 0.0 and math.isfinite(number)):
        raise ScriptError(f"{what} must be above zero, not {value!r}")
    return number


class Functions:
    """URScript's functions, bound to one controller; methods without underscore are visible to programs."""

    def __init__(self, controller: "Controller") -> None:
        self._controller = controller
        self._arm = controller.arm
        self._values = controller.registers.values

    def table(self) -> dict[str, Callable[..., Any]]:
        """All functions by name."""
        table: dict[str, Callable[..., Any]] = {name: getattr(self, name) for name in IMMEDIATE | WAITING}
        return table | {name: _refusal(name) for name in REFUSED}

    # --- registers, messages, time -------------------------------------------------------------------------------

    def textmsg(self, message: Any, value: Any = "") -> None:
        LOG.debug("textmsg %s%s", message, value)

    popup = textmsg

    def _slot(self, base: int, index: Any) -> int:
        number = int(index)
        if not 0 <= number < REGISTERS:
            raise ScriptError(f"there is no register {index}")
        return base + number

    def read_input_float_register(self, address: int) -> float:
        return self._values[self._slot(DOUBLE_IN, address)]

    def read_input_integer_register(self, address: int) -> int:
        return int(self._values[self._slot(INT_IN, address)])

    def read_input_boolean_register(self, address: int) -> bool:
        registers = self._controller.registers
        if 0 <= address < 64:
            word = registers.get(f"input_bit_registers{'0_to_31' if address < 32 else '32_to_63'}")[0]
            return bool(int(word) >> (address % 32) & 1)
        if address >= 128:
            raise ScriptError(f"there is no register {address}")
        return bool(registers.get(f"input_bit_register_{address}")[0])

    def read_output_float_register(self, address: int) -> float:
        return self._values[self._slot(DOUBLE_OUT, address)]

    def read_output_integer_register(self, address: int) -> int:
        return int(self._values[self._slot(INT_OUT, address)])

    def write_output_float_register(self, address: int, value: float) -> None:
        self._values[self._slot(DOUBLE_OUT, address)] = float(value)

    def write_output_integer_register(self, address: int, value: int) -> None:
        number = int(value)
        if not -(2**31) <= number < 2**31:
            raise ScriptError(f"{value} does not fit an integer register")
        self._values[self._slot(INT_OUT, address)] = number

    def sync(self) -> Waiting:
        yield

    def sleep(self, t: float) -> Waiting:
        for _ in range(max(1, round(t / STEP_TIME))):
            yield

    def get_steptime(self) -> float:
        return STEP_TIME

    def rtde_set_watchdog(self, variable_name: str, min_frequency: float, action: str = "pause") -> None:
        if action.lower() not in ("ignore", "pause", "stop"):
            raise ScriptError(f"rtde_set_watchdog: unknown action {action!r}")
        self._controller.set_watchdog(variable_name, positive(min_frequency, "min_frequency"), action.lower())

    # --- motion --------------------------------------------------------------------------------------------------

    def _wait_for(self, begin: Callable[[], Motion]) -> Waiting:
        """Waits until a motion has ended; begins it anew where a stop has thrown it out (resumed after an unlock)."""
        self._controller.require_main_program()
        while True:
            motion = begin()
            while self._arm.motion is motion and not motion.finished:
                self._controller.claim()
                yield
            if motion.finished:
                return

    def _come_to_rest(self, deceleration: float) -> Waiting:
        # A new move starts from rest; what a killed one left behind is braked first.
        if self._arm.moving:
            yield from self._wait_for(lambda: self._arm.brake(deceleration))

    def _joints_of(self, target: Any) -> list[float]:
        if isinstance(target, Pose):
            return self.get_inverse_kin(target)
        return numbers(target, 6, "the target")

    def _frame_of(self, target: Any) -> Frame:
        if isinstance(target, Pose):
            return poses.from_ur(numbers(target, 6, "the target"))
        joints = numbers(target, 6, "the target")
        return poses.compose(kinematics.forward(self._arm.model, joints), self._arm.flange_from_tool)

    def movej(self, q: Any, a: float = 1.4, v: float = 1.05, t: float = 0.0, r: float = 0.0) -> Waiting:
        acceleration, speed = positive(a, "a"), positive(v, "v")
        target = self._joints_of(q)
        del r  # every waypoint is a stop
        if any(abs(angle) > kinematics.JOINT_LIMIT for angle in target):
            raise ScriptError("movej: the target is outside the joint limits")
        yield from self._come_to_rest(acceleration)
        yield from self._wait_for(lambda: self._arm.start_joint_move(target, speed, acceleration, t))

    def movel(self, pose: Any, a: float = 1.2, v: float = 0.25, t: float = 0.0, r: float = 0.0) -> Waiting:
        acceleration, speed = positive(a, "a"), positive(v, "v")
        target = self._frame_of(pose)
        del r
        if self._arm.moving:
            yield from self._wait_for(lambda: self._arm.brake_tool(acceleration))
        yield from self._wait_for(lambda: self._arm.start_linear_move(target, speed, acceleration, t))

    def movep(self, pose: Any, a: float = 1.2, v: float = 0.25, r: float = 0.0) -> Waiting:
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
        for _ in range(max(1, round(seconds / STEP_TIME))):
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
        target, acceleration = numbers(list(xd), 6, "xd"), positive(a, "a")
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

    # --- kinematics and limits -----------------------------------------------------------------------------------

    def _solve(self, x: Any, qnear: Any) -> list[float] | None:
        near = self._arm.joints if qnear is None else numbers(qnear, 6, "qnear")
        tool = poses.from_ur(numbers(list(x), 6, "the pose"))
        flange = poses.compose(tool, poses.invert(self._arm.flange_from_tool))
        return kinematics.inverse(self._arm.model, flange, near)

    def get_inverse_kin(
        self,
        x: Any,
        qnear: Any = None,
        maxPositionError: float = 1e-10,
        maxOrientationError: float = 1e-10,
    ) -> list[float]:
        del maxPositionError, maxOrientationError  # the closed form is exact
        joints = self._solve(x, qnear)
        if joints is None:
            raise ScriptError("get_inverse_kin: no solution")
        return joints

    def get_inverse_kin_has_solution(
        self,
        x: Any,
        qnear: Any = None,
        maxPositionError: float = 1e-10,
        maxOrientationError: float = 1e-10,
    ) -> bool:
        del maxPositionError, maxOrientationError
        return self._solve(x, qnear) is not None

    def get_forward_kin(self, q: Any = None, tcp: Any = None) -> Pose:
        joints = self._arm.joints if q is None else numbers(q, 6, "q")
        tool = self._arm.flange_from_tool if tcp is None else poses.from_ur(numbers(list(tcp), 6, "tcp"))
        return Pose(poses.to_ur(poses.compose(kinematics.forward(self._arm.model, joints), tool)))

    def is_within_safety_limits(self, value: Any) -> bool:
        if isinstance(value, Pose):
            return self._solve(value, None) is not None
        return all(abs(q) <= kinematics.JOINT_LIMIT for q in numbers(value, 6, "the joints"))

    def pose_trans(self, p_from: Any, p_from_to: Any) -> Pose:
        return Pose(poses.to_ur(poses.compose(_frame(p_from), _frame(p_from_to))))

    def pose_inv(self, p_from: Any) -> Pose:
        return Pose(poses.to_ur(poses.invert(_frame(p_from))))

    def pose_sub(self, p_to: Any, p_from: Any) -> Pose:
        to, start = _frame(p_to), _frame(p_from)
        turn = poses.rotation_vector(poses.compose(to, poses.invert(start)))
        return Pose([to[3] - start[3], to[7] - start[7], to[11] - start[11], *turn])

    def pose_add(self, p_1: Any, p_2: Any) -> Pose:
        a, b = _frame(p_1), _frame(p_2)
        turn = poses.rotation_vector(poses.compose(a, b))
        return Pose([a[3] + b[3], a[7] + b[7], a[11] + b[11], *turn])

    def pose_dist(self, p_from: Any, p_to: Any) -> float:
        return poses.distance(_frame(p_from), _frame(p_to))[0]

    def interpolate_pose(self, p_from: Any, p_to: Any, alpha: float) -> Pose:
        return Pose(poses.to_ur(poses.interpolate(_frame(p_from), _frame(p_to), float(alpha))))

    # --- the arm's state -----------------------------------------------------------------------------------------

    def set_tcp(self, pose: Any) -> None:
        self._arm.set_tcp(numbers(list(pose), 6, "the TCP"))
        self._controller.tool_changed()

    def get_tcp_offset(self) -> Pose:
        return Pose(self._arm.tcp)

    def set_payload(self, m: float, cog: Any = None) -> None:
        mass = float(m)
        if not 0.0 <= mass <= self._arm.model.payload:
            raise ScriptError(f"set_payload: {m} kg is outside 0 to {self._arm.model.payload}")
        self._arm.payload = mass
        if cog is not None:
            self._arm.payload_center = numbers(list(cog), 3, "cog")

    def set_target_payload(self, m: float, cog: Any, inertia: Any = None, transition_time: float = 0.0) -> None:
        del transition_time
        self.set_payload(m, cog)
        if inertia is not None:
            self._arm.payload_inertia = numbers(list(inertia), 6, "inertia")

    def get_target_payload(self) -> float:
        return self._arm.payload

    def get_target_payload_cog(self) -> list[float]:
        return self._arm.payload_center[:]

    def get_target_payload_inertia(self) -> list[float]:
        return self._arm.payload_inertia[:]

    def is_steady(self) -> bool:
        return self._arm.at_rest_ticks * STEP_TIME * self._controller.speed_factor >= STEADY_AFTER

    def get_actual_joint_positions(self) -> list[float]:
        return self._arm.joints[:]

    get_target_joint_positions = get_actual_joint_positions

    def get_actual_joint_speeds(self) -> list[float]:
        return self._arm.speeds[:]

    def get_actual_joint_positions_history(self, steps: int = 0) -> list[float]:
        history = self._arm.history
        return history[-1 - min(int(steps), len(history) - 1)][:]

    def get_actual_tcp_pose(self) -> Pose:
        return Pose(poses.to_ur(self._arm.base_from_tool))

    get_target_tcp_pose = get_actual_tcp_pose

    def get_actual_tool_flange_pose(self) -> Pose:
        return Pose(poses.to_ur(self._arm.base_from_flange))

    def get_target_tcp_speed(self) -> Pose:
        return Pose(self._arm.tool_velocity)

    get_actual_tcp_speed = get_target_tcp_speed

    def get_target_waypoint(self) -> Pose:
        return self.get_forward_kin(self._arm.target)

    def force_mode_set_gain_scaling(self, scaling: float) -> None:
        self._controller.force_mode_settings["gain_scaling"] = float(scaling)

    def force_mode_set_damping(self, damping: float) -> None:
        self._controller.force_mode_settings["damping"] = float(damping)

    # --- outputs -------------------------------------------------------------------------------------------------

    def _set_output(self, n: int, first: int, count: int, level: Any) -> None:
        if not 0 <= int(n) < count:
            raise ScriptError(f"there is no digital output {n}")
        self._controller.outputs.set_bit(first + int(n), bool(level))

    def set_digital_out(self, n: int, b: bool) -> None:
        self._set_output(n, 0, 18, b)

    def set_standard_digital_out(self, n: int, b: bool) -> None:
        self._set_output(n, 0, 8, b)

    def set_configurable_digital_out(self, n: int, b: bool) -> None:
        self._set_output(n, 8, 8, b)

    def set_tool_digital_out(self, n: int, b: bool) -> None:
        self._set_output(n, 16, 2, b)

    def get_digital_out(self, n: int) -> bool:
        if not 0 <= int(n) < 18:
            raise ScriptError(f"there is no digital output {n}")
        return bool(self._controller.outputs.levels >> int(n) & 1)

    get_standard_digital_out = get_digital_out

    # --- arithmetic ----------------------------------------------------------------------------------------------

    def norm(self, a: Any) -> float:
        return math.hypot(*a) if isinstance(a, list) else abs(a)

    sqrt = staticmethod(math.sqrt)
    sin = staticmethod(math.sin)
    cos = staticmethod(math.cos)
    tan = staticmethod(math.tan)
    asin = staticmethod(math.asin)
    acos = staticmethod(math.acos)
    atan = staticmethod(math.atan)
    atan2 = staticmethod(math.atan2)
    pow = staticmethod(math.pow)
    ceil = staticmethod(math.ceil)
    floor = staticmethod(math.floor)
    d2r = staticmethod(math.radians)
    r2d = staticmethod(math.degrees)
    length = staticmethod(len)
    to_str = staticmethod(str)

    def log(self, base: float, value: float) -> float:
        return math.log(value, base)


def _frame(pose: Sequence[float]) -> Frame:
    return poses.from_ur(numbers(list(pose), 6, "the pose"))


def _refusal(name: str) -> Callable[..., NoReturn]:
    def refuse(*arguments: Any, **keywords: Any) -> NoReturn:
        del arguments, keywords
        raise ScriptError(f"{name} is not simulated by this controller")

    return refuse
