"""Interpretation of a UR controller's status: safety bits, robot modes, runtime states.

Pure functions, so that the driver process (which must distinguish a protective stop from a failed move) and the safety
monitor (which latches it) agree about a reading. Source: Universal Robots' RTDE guide.
"""

from dataclasses import dataclass

from acquisition.models.errors import ErrorCode

ROBOT_RUNNING = 7
PROGRAM_PLAYING = 2

ROBOT_MODES = {
    -1: "no controller",
    0: "disconnected",
    1: "waiting for the safety confirmation",
    2: "booting",
    3: "powered off",
    4: "powered on",
    5: "idle, brakes on",
    6: "back-drive",
    7: "running",
    8: "updating firmware",
}


@dataclass(frozen=True)
class Fault:
    """Why the arm must not move: a code and a sentence about this case."""

    code: ErrorCode
    detail: str


_NORMAL_OR_REDUCED = 0b11

# Bits of `safety_status_bits` above normal (0) and reduced (1), the gravest first. Bit 7 (emergency stopped) comes with
# 5 or 6; bit 10 (stopped for safety) with any other.
_STOPS: tuple[tuple[int, ErrorCode, str], ...] = (
    (5, ErrorCode.ARM_EMERGENCY_STOP, "Emergency stop: the system's emergency stop is active."),
    (6, ErrorCode.ARM_EMERGENCY_STOP, "Emergency stop: the robot's emergency stop is active."),
    (7, ErrorCode.ARM_EMERGENCY_STOP, "Emergency stop: an emergency stop is active."),
    (9, ErrorCode.ARM_PROTECTIVE_STOP, "Safety fault: the controller's safety system must be restarted."),
    (8, ErrorCode.ARM_PROTECTIVE_STOP, "Safety violation: a safety limit was exceeded."),
    (2, ErrorCode.ARM_PROTECTIVE_STOP, "Protective stop: the controller stopped the arm."),
    (4, ErrorCode.ARM_PROTECTIVE_STOP, "Safeguard stop: a guard (door, light curtain) is open."),
    (3, ErrorCode.ARM_PROTECTIVE_STOP, "Recovery mode: the arm stands outside its safety limits."),
    (10, ErrorCode.ARM_PROTECTIVE_STOP, "The controller stopped the arm for safety but reports no cause."),
)


def safety_fault(safety_bits: int) -> Fault | None:
    """Returns the gravest safety stop that `safety_status_bits` reports; None if normal or reduced."""
    for bit, code, detail in _STOPS:
        if safety_bits >> bit & 1:
            return Fault(code, detail)
    if not safety_bits & _NORMAL_OR_REDUCED:
        return Fault(
            ErrorCode.ARM_PROTECTIVE_STOP,
            f"The safety system does not report normal operation (bits {safety_bits:#x}).",
        )
    return None


def power_fault(robot_mode: int) -> Fault | None:
    """Returns why an arm in this robot mode cannot move; None if it is running."""
    if robot_mode == ROBOT_RUNNING:
        return None
    name = ROBOT_MODES.get(robot_mode, f"mode {robot_mode}")
    return Fault(ErrorCode.ARM_NOT_READY, f"The arm is not ready: {name}.")
