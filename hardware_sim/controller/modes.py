"""Robot, safety and runtime states with their numbers in RTDE (UR RTDE guide)."""

from enum import IntEnum


class RuntimeState(IntEnum):
    """`runtime_state`: state of the program."""

    STOPPING = 0
    STOPPED = 1
    PLAYING = 2
    PAUSING = 3
    PAUSED = 4
    RESUMING = 5


class RobotMode(IntEnum):
    """`robot_mode`."""

    NO_CONTROLLER = -1
    DISCONNECTED = 0
    CONFIRM_SAFETY = 1
    BOOTING = 2
    POWER_OFF = 3
    POWER_ON = 4
    IDLE = 5
    BACKDRIVE = 6
    RUNNING = 7


class SafetyMode(IntEnum):
    """`safety_mode`."""

    NORMAL = 1
    REDUCED = 2
    PROTECTIVE_STOP = 3
    RECOVERY = 4
    SAFEGUARD_STOP = 5
    SYSTEM_EMERGENCY_STOP = 6
    ROBOT_EMERGENCY_STOP = 7
    VIOLATION = 8
    FAULT = 9


_STOPPED_FOR_SAFETY = 1 << 10
_EMERGENCY = 1 << 7
SAFETY_BITS: dict[SafetyMode, int] = {
    SafetyMode.NORMAL: 1 << 0,
    SafetyMode.REDUCED: 1 << 1,
    SafetyMode.PROTECTIVE_STOP: 1 << 2 | _STOPPED_FOR_SAFETY,
    SafetyMode.RECOVERY: 1 << 3,
    SafetyMode.SAFEGUARD_STOP: 1 << 4 | _STOPPED_FOR_SAFETY,
    SafetyMode.SYSTEM_EMERGENCY_STOP: 1 << 5 | _EMERGENCY | _STOPPED_FOR_SAFETY,
    SafetyMode.ROBOT_EMERGENCY_STOP: 1 << 6 | _EMERGENCY | _STOPPED_FOR_SAFETY,
    SafetyMode.VIOLATION: 1 << 8 | _STOPPED_FOR_SAFETY,
    SafetyMode.FAULT: 1 << 9 | _STOPPED_FOR_SAFETY,
}

JOINT_MODE: dict[RobotMode, int] = {RobotMode.RUNNING: 253, RobotMode.IDLE: 255, RobotMode.BACKDRIVE: 238}
JOINT_POWER_OFF = 239
