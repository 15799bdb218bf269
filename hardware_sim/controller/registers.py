"""RTDE variables and registers: names, types and present values (UR RTDE guide).

Names and types are those of PolyScope 5.11. They include `tcp_offset`, which the guide left out until later (UR client
library, pull requests 110 and 213). Later variables (`collision_detection_ratio`, `time_scale_source`,
`actual_current_as_torque`, …) are absent, because clients tell versions apart by them.

All outputs are in one flat list. A recipe is then an `itemgetter` and a precompiled `struct`, so that 500 packets a
second with 180 numbers each cost little.
"""

from collections.abc import Sequence
from itertools import accumulate

# RTDE type → struct code and number of values.
TYPES: dict[str, tuple[str, int]] = {
    "DOUBLE": ("d", 1),
    "UINT64": ("Q", 1),
    "UINT32": ("I", 1),
    "INT32": ("i", 1),
    "UINT8": ("B", 1),
    "BOOL": ("?", 1),
    "VECTOR6D": ("6d", 6),
    "VECTOR3D": ("3d", 3),
    "VECTOR6INT32": ("6i", 6),
    "VECTOR6UINT32": ("6I", 6),
}
REGISTERS = 48
BIT_REGISTERS = 128

_OUTPUTS = {
    "VECTOR6D": "target_q target_qd target_qdd target_current target_moment actual_q actual_qd actual_current "
    "actual_current_window joint_control_output actual_TCP_pose actual_TCP_speed actual_TCP_force target_TCP_pose "
    "target_TCP_speed tcp_offset joint_temperatures actual_joint_voltage ft_raw_wrench payload_inertia",
    "DOUBLE": "timestamp actual_execution_time speed_scaling target_speed_fraction actual_momentum actual_main_voltage "
    "actual_robot_voltage actual_robot_current standard_analog_input0 standard_analog_input1 standard_analog_output0 "
    "standard_analog_output1 payload joint_position_deviation_ratio tool_analog_input0 tool_analog_input1 "
    "tool_output_current tool_temperature tcp_force_scalar io_current euromap67_24V_voltage euromap67_24V_current",
    "VECTOR3D": "actual_tool_accelerometer payload_cog elbow_position elbow_velocity",
    "UINT64": "actual_digital_input_bits actual_digital_output_bits",
    "UINT32": "runtime_state robot_status_bits safety_status_bits analog_io_types tool_analog_input_types "
    "tool_mode euromap67_input_bits euromap67_output_bits script_control_line",
    "UINT8": "tool_output_mode tool_digital_output0_mode tool_digital_output1_mode",
    "INT32": "robot_mode safety_mode safety_status tool_output_voltage encoder0_raw encoder1_raw",
    "VECTOR6INT32": "joint_mode",
}
"""Variables that the controller reports, by type; numbered ones are adjacent."""
_INPUTS = {
    "UINT32": "speed_slider_mask",
    "DOUBLE": "speed_slider_fraction standard_analog_output_0 standard_analog_output_1",
    "UINT8": "standard_digital_output_mask standard_digital_output configurable_digital_output_mask "
    "configurable_digital_output tool_digital_output_mask tool_digital_output standard_analog_output_mask "
    "standard_analog_output_type",
    "VECTOR6D": "external_force_torque",
}


def _types(names: dict[str, str]) -> dict[str, str]:
    return {name: kind for kind, of in names.items() for name in of.split()}


def _registers(bank: str) -> dict[str, str]:
    types = {f"{bank}_bit_register_{i}": "BOOL" for i in range(64, BIT_REGISTERS)}
    types |= {f"{bank}_bit_registers0_to_31": "UINT32", f"{bank}_bit_registers32_to_63": "UINT32"}
    types |= {f"{bank}_int_register_{i}": "INT32" for i in range(REGISTERS)}
    return types | {f"{bank}_double_register_{i}": "DOUBLE" for i in range(REGISTERS)}


# Inputs can be read back under their own names.
OUTPUT_TYPES = _types(_OUTPUTS) | _registers("output") | _registers("input")
INPUT_TYPES = _types(_INPUTS) | _registers("input")
_WIDTHS = [TYPES[kind][1] for kind in OUTPUT_TYPES.values()]
OFFSETS = dict(zip(OUTPUT_TYPES, accumulate(_WIDTHS, initial=0), strict=False))
INT_OUT = OFFSETS["output_int_register_0"]
DOUBLE_OUT = OFFSETS["output_double_register_0"]
INT_IN = OFFSETS["input_int_register_0"]
DOUBLE_IN = OFFSETS["input_double_register_0"]


class Registers:
    """The flat list of values, ending in a zero; registers keep theirs between programs, as on a real controller."""

    def __init__(self) -> None:
        self.values: list[float] = [
            0.0 if TYPES[kind][0][-1] == "d" else 0 for kind in OUTPUT_TYPES.values() for _ in range(TYPES[kind][1])
        ] + [0]

    def set(self, name: str, *values: float) -> None:
        """Sets an output by name."""
        at = OFFSETS[name]
        self.values[at : at + len(values)] = values

    def get(self, name: str) -> Sequence[float]:
        """The values of an output by name."""
        at = OFFSETS[name]
        return self.values[at : at + TYPES[OUTPUT_TYPES[name]][1]]

    def bit(self, bank: str, number: int) -> bool:
        """A boolean register of the bank "input" or "output"; the first 64 share two words, the others are separate."""
        slot, shift = _bit(bank, number)
        return bool(int(self.values[slot]) >> shift & 1)

    def set_bit(self, number: int, level: bool) -> None:
        """Sets a boolean output register."""
        slot, shift = _bit("output", number)
        self.values[slot] = (int(self.values[slot]) & ~(1 << shift)) | level << shift


def _bit(bank: str, number: int) -> tuple[int, int]:
    if number >= 64:
        return OFFSETS[f"{bank}_bit_register_{number}"], 0
    return OFFSETS[f"{bank}_bit_registers{'0_to_31' if number < 32 else '32_to_63'}"], number % 32
