"""Publication of the controller's state as RTDE variables.

Encoders are not simulated: they stay 0, temperatures and voltages at what an idle arm has. What follows from the arm's
masses is published by `dynamics`, where somebody reads it.
"""

from hardware_sim.controller import poses
from hardware_sim.controller.arm import Arm
from hardware_sim.controller.modes import JOINT_MODE, JOINT_POWER_OFF, SAFETY_BITS, RobotMode
from hardware_sim.controller.registers import OFFSETS, Registers
from hardware_sim.controller.robot import RobotState

_STEADY_VALUES: dict[str, tuple[float, ...]] = {
    "joint_temperatures": (28.0,) * 6,
    "actual_joint_voltage": (48.0,) * 6,
    "actual_current_window": (2.0,) * 6,  # A off the target that a controller allows
    "actual_main_voltage": (48.0,),
    "actual_robot_voltage": (48.0,),
    "actual_robot_current": (0.5,),
    "actual_execution_time": (0.0002,),
    "tool_temperature": (28.0,),
}


def steady(registers: Registers) -> None:
    """Sets what never changes here: temperatures and supply."""
    for name, values in _STEADY_VALUES.items():
        registers.set(name, *values)


def pose(arm: Arm, registers: Registers) -> None:
    """Sets joints, speeds and tool pose; only needed when they changed."""
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


def modes(robot: RobotState, pace: float) -> None:
    """Sets what may change in every tick; `pace` is the share of the programmed speed that is in force."""
    values, arm = robot.registers.values, robot.arm
    powered = robot.robot_mode >= RobotMode.POWER_ON
    values[_TIMESTAMP] = robot.timestamp
    values[_RUNTIME_STATE] = robot.runtime_state
    values[_ROBOT_MODE] = robot.robot_mode
    values[_SAFETY_MODE] = values[_SAFETY_STATUS] = robot.safety_mode
    values[_SAFETY_BITS] = SAFETY_BITS[robot.safety_mode]
    values[_ROBOT_BITS] = int(powered) | int(robot.playing) << 1 | int(powered) << 3
    values[_JOINT_MODE : _JOINT_MODE + 6] = [JOINT_MODE.get(robot.robot_mode, JOINT_POWER_OFF)] * 6
    values[_SPEED_SCALING] = pace if robot.playing else 0.0
    values[_SPEED_FRACTION] = robot.slider
    inputs = robot.inputs
    values[_DIGITAL_INPUTS] = inputs.levels
    values[_ANALOG_INPUT_0 : _ANALOG_INPUT_0 + 2] = inputs.analog[:2]
    values[_TOOL_ANALOG_INPUT_0 : _TOOL_ANALOG_INPUT_0 + 2] = inputs.analog[2:]
    values[_TOOL_ANALOG_TYPES] = inputs.analog_is_voltage[2] | inputs.analog_is_voltage[3] << 1
    values[_TOOL_VOLTAGE] = robot.outputs.tool_voltage
    values[_DIGITAL_OUTPUTS] = robot.outputs.levels
    values[_ANALOG_OUTPUT_0] = robot.outputs.analog(0)
    values[_ANALOG_OUTPUT_1] = robot.outputs.analog(1)
    first, second = robot.outputs.analog_is_voltage
    values[_ANALOG_TYPES] = inputs.analog_is_voltage[0] | inputs.analog_is_voltage[1] << 1 | first << 2 | second << 3
    values[_TOOL_MODE] = values[_JOINT_MODE]
    values[_PAYLOAD] = arm.payload
    values[_PAYLOAD_COG : _PAYLOAD_COG + 3] = arm.payload_center
    values[_PAYLOAD_INERTIA : _PAYLOAD_INERTIA + 6] = arm.payload_inertia


_TIMESTAMP = OFFSETS["timestamp"]
_RUNTIME_STATE = OFFSETS["runtime_state"]
_ROBOT_MODE = OFFSETS["robot_mode"]
_SAFETY_MODE = OFFSETS["safety_mode"]
_SAFETY_STATUS = OFFSETS["safety_status"]
_SAFETY_BITS = OFFSETS["safety_status_bits"]
_ROBOT_BITS = OFFSETS["robot_status_bits"]
_JOINT_MODE = OFFSETS["joint_mode"]
_SPEED_SCALING = OFFSETS["speed_scaling"]
_SPEED_FRACTION = OFFSETS["target_speed_fraction"]
_DIGITAL_INPUTS = OFFSETS["actual_digital_input_bits"]
_ANALOG_INPUT_0 = OFFSETS["standard_analog_input0"]
_TOOL_ANALOG_INPUT_0 = OFFSETS["tool_analog_input0"]
_TOOL_ANALOG_TYPES = OFFSETS["tool_analog_input_types"]
_TOOL_VOLTAGE = OFFSETS["tool_output_voltage"]
_DIGITAL_OUTPUTS = OFFSETS["actual_digital_output_bits"]
_ANALOG_OUTPUT_0 = OFFSETS["standard_analog_output0"]
_ANALOG_OUTPUT_1 = OFFSETS["standard_analog_output1"]
_ANALOG_TYPES = OFFSETS["analog_io_types"]
_TOOL_MODE = OFFSETS["tool_mode"]
_PAYLOAD = OFFSETS["payload"]
_PAYLOAD_COG = OFFSETS["payload_cog"]
_PAYLOAD_INERTIA = OFFSETS["payload_inertia"]
