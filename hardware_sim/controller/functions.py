"""Table of URScript's built-in functions: those that this controller has, and those that it refuses.

A function that is not simulated raises a runtime exception that names it; no function pretends to have been done. A
name that URScript does not have is an error in the program's text.
"""

import inspect
from collections.abc import Callable
from typing import Any, NoReturn

from hardware_sim.controller.compiler import Vocabulary
from hardware_sim.controller.io_functions import IoFunctions
from hardware_sim.controller.motion_functions import MotionFunctions
from hardware_sim.controller.register_functions import InterpreterFunctions, RegisterFunctions
from hardware_sim.controller.robot import Robot
from hardware_sim.controller.script_values import FunctionGroup
from hardware_sim.controller.semantics import ScriptError
from hardware_sim.controller.socket_functions import SocketFunctions
from hardware_sim.controller.state_functions import StateFunctions
from hardware_sim.controller.value_functions import Arithmetic, Strings

_REFUSED = """get_joint_torques ft_rtde_input_enable enable_external_ft_sensor direct_torque screw_driving
    end_screw_driving high_holding_torque_enable high_holding_torque_disable get_mass_matrix
    get_coriolis_and_centrifugal_torques get_target_joint_accelerations get_jacobian get_jacobian_time_derivative
    get_controller_temp wrench_trans servoc path_offset_enable path_offset_disable path_offset_set
    path_offset_set_alpha_filter path_offset_set_max_offset path_offset_get conveyor_pulse_decode
    set_conveyor_tick_count get_conveyor_tick_count track_conveyor_linear track_conveyor_circular
    stop_conveyor_tracking encoder_enable_pulse_decode encoder_enable_set_tick_count encoder_get_tick_count
    encoder_set_tick_count encoder_unwind_delta_tick_count reset_revolution_counter get_euromap_input
    get_euromap_output set_standard_digital_input_action set_configurable_digital_input_action
    set_tool_digital_input_action set_euromap_output set_euromap_runstate_dependent_choice read_port_bit
    read_port_register write_port_bit write_port_register modbus_add_signal modbus_delete_signal
    modbus_get_signal_status modbus_send_custom_command modbus_set_digital_input_action modbus_set_output_register
    modbus_set_output_signal modbus_set_runstate_dependent_choice modbus_set_signal_update_frequency rpc_factory
    get_interpreter_mode_status inv transpose size"""
"""Functions that URScript has and this controller lacks: dynamics, conveyors, path offsets, fieldbuses, matrices."""
REFUSED = frozenset(_REFUSED.split())

_GROUPS: tuple[type[FunctionGroup], ...] = (
    RegisterFunctions,
    IoFunctions,
    SocketFunctions,
    InterpreterFunctions,
    MotionFunctions,
    StateFunctions,
    Arithmetic,
    Strings,
)
_MEMBERS = {
    name: member
    for group in _GROUPS
    for name, member in inspect.getmembers(group)
    if not name.startswith("_") and callable(member)
}
_WAITING = frozenset(name for name, member in _MEMBERS.items() if inspect.isgeneratorfunction(member))
VOCABULARY = Vocabulary(immediate=(frozenset(_MEMBERS) - _WAITING) | REFUSED, waiting=_WAITING)


def table(robot: Robot) -> dict[str, Callable[..., Any]]:
    """All functions by name, bound to one robot."""
    groups = [group(robot) for group in _GROUPS]
    bound: dict[str, Callable[..., Any]] = {
        name: getattr(group, name) for name in _MEMBERS for group in groups if hasattr(group, name)
    }
    return bound | {name: _refusal(name) for name in REFUSED}


def _refusal(name: str) -> Callable[..., NoReturn]:
    def refuse(*arguments: Any, **keywords: Any) -> NoReturn:
        del arguments, keywords
        raise ScriptError(f"{name} is not simulated by this controller")

    return refuse
