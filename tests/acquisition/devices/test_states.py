"""Safety and power states decoded from the controller's bits and modes."""

import pytest

from acquisition.devices.ur import states
from acquisition.models.errors import ErrorCode


@pytest.mark.parametrize(
    ("bits", "code", "word"),
    [
        (1 << 2 | 1 << 10, ErrorCode.ARM_PROTECTIVE_STOP, "Protective"),
        (1 << 3, ErrorCode.ARM_PROTECTIVE_STOP, "Recovery"),
        (1 << 4 | 1 << 10, ErrorCode.ARM_PROTECTIVE_STOP, "Safeguard"),
        (1 << 5 | 1 << 7 | 1 << 10, ErrorCode.ARM_EMERGENCY_STOP, "system"),
        (1 << 6 | 1 << 7 | 1 << 10, ErrorCode.ARM_EMERGENCY_STOP, "robot"),
        (1 << 2 | 1 << 6 | 1 << 7, ErrorCode.ARM_EMERGENCY_STOP, "robot"),
        (1 << 8 | 1 << 10, ErrorCode.ARM_PROTECTIVE_STOP, "violation"),
        (1 << 9 | 1 << 10, ErrorCode.ARM_PROTECTIVE_STOP, "Safety fault"),
        (1 << 10, ErrorCode.ARM_PROTECTIVE_STOP, "reports no cause"),
        (0, ErrorCode.ARM_PROTECTIVE_STOP, "does not report normal operation"),
    ],
)
def test_safety_fault_each_bit_gives_its_code(bits: int, code: ErrorCode, word: str) -> None:
    fault = states.safety_fault(bits)
    assert fault is not None
    assert fault.code == code
    assert word in fault.detail


@pytest.mark.parametrize("bits", [1, 2, 3])
def test_safety_fault_normal_and_reduced_give_none(bits: int) -> None:
    assert states.safety_fault(bits) is None


def test_power_fault_only_running_mode_gives_none() -> None:
    ready = [mode for mode in range(-1, 12) if states.power_fault(mode) is None]
    assert ready == [states.ROBOT_RUNNING]
    fault = states.power_fault(5)
    assert fault is not None
    assert fault.code == ErrorCode.ARM_NOT_READY
    assert "brakes" in fault.detail
