"""Publication of the controller's state as RTDE variables.

Encoders are not simulated and stay 0; temperatures and voltages stay at the values of an idle arm. `dynamics` publishes
the variables that follow from the arm's masses, if a client reads them.
"""

from hardware_sim.controller import poses
from hardware_sim.controller.arm import Arm
from hardware_sim.controller.modes import JOINT_MODE, JOINT_POWER_OFF, SAFETY_BITS, RobotMode
from hardware_sim.controller.registers import OFFSETS, Registers
from hardware_sim.controller.robot import Robot

_STEADY_VALUES: dict[str, tuple[float, ...]] = {
    "joint_temperatures": (28.0,) * 6,
    "actual_joint_voltage": (48.0,) * 6,
    "actual_current_window": (2.0,) * 6,  # A, deviation from the target that a controller permits
    "actual_main_voltage": (48.0,),
    "actual_robot_voltage": (48.0,),
    "actual_robot_current": (0.5,),
    "actual_execution_time": (0.0002,),
    "tool_temperature": (28.0,),
}


def steady(registers: Registers) -> None:
    """Sets the variables that never change here: temperatures and supply."""
    for name, values in _STEADY_VALUES.items():
        registers.set(name, *values)


def pose(arm: Arm, registers: Registers) -> None:
    """Sets joints, speeds and tool pose; needed only if they have changed."""
    put = registers.set
    tool = poses.to_ur(arm.base_from_tool)
    for kind in ("actual", "target"):
        put(f"{kind}_q", *arm.joints)
        put(f"{kind}_qd", *arm.speeds)
        put(f"{kind}_TCP_pose", *tool)
        put(f"{kind}_TCP_speed", *arm.tool_velocity)
    put("tcp_offset", *arm.tcp)
    put("actual_TCP_force", *arm.tool_force)
    put("tcp_force_scalar", arm.pressure)


def modes(robot: Robot, pace: float) -> None:
    """Sets the variables that may change in every tick; `pace` is the present share of the programmed speed.

    Single values are written straight into the list, because this function is most of the cost of an idle arm's tick.
    """
    put, arm, inputs, outputs = robot.registers.set, robot.arm, robot.inputs, robot.outputs
    values, at, safety = robot.registers.values, OFFSETS, robot.safety
    powered, playing = safety.robot_mode >= RobotMode.POWER_ON, robot.playing
    joint_mode = JOINT_MODE.get(safety.robot_mode, JOINT_POWER_OFF)
    values[at["timestamp"]] = robot.timestamp
    values[at["runtime_state"]] = robot.runtime_state
    values[at["robot_mode"]] = safety.robot_mode
    values[at["safety_mode"]] = values[at["safety_status"]] = safety.safety_mode
    values[at["safety_status_bits"]] = SAFETY_BITS[safety.safety_mode]
    values[at["robot_status_bits"]] = powered | playing << 1 | powered << 3
    put("joint_mode", *[joint_mode] * 6)
    values[at["tool_mode"]] = joint_mode
    values[at["speed_scaling"]] = pace if playing else 0.0
    values[at["target_speed_fraction"]] = robot.slider
    values[at["actual_digital_input_bits"]] = inputs.levels
    values[at["actual_digital_output_bits"]] = outputs.levels
    put("standard_analog_input0", *inputs.analog[:2])
    put("tool_analog_input0", *inputs.analog[2:])
    values[at["standard_analog_output0"]] = outputs.analog(0)
    values[at["standard_analog_output1"]] = outputs.analog(1)
    standard0, standard1, tool0, tool1 = inputs.analog_is_voltage
    output0, output1 = outputs.analog_is_voltage
    values[at["analog_io_types"]] = standard0 | standard1 << 1 | output0 << 2 | output1 << 3
    values[at["tool_analog_input_types"]] = tool0 | tool1 << 1
    values[at["tool_output_voltage"]] = outputs.tool_voltage
    values[at["payload"]] = arm.payload
    put("payload_cog", *arm.payload_center)
    put("payload_inertia", *arm.payload_inertia)
