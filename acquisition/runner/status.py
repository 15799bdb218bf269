"""Status of the rig as a value, from cached readings only."""

from dataclasses import dataclass
from typing import Any

from acquisition.devices import ArmIdentity, ArmReading
from acquisition.models.calibration_check import CheckState
from acquisition.runner.safety_monitor import Latch


@dataclass(frozen=True)
class RigStatus:
    """The status of the rig; `reasons` are the problems that prevent a start."""

    cell: str
    fingerprint: str
    arm_address: str
    arm_model: str
    identity: ArmIdentity | None
    reading: ArmReading
    camera_ready: bool
    holder: str | None
    may_start: bool
    reasons: list[dict[str, Any]]
    calibration_made_at: str
    calibration_valid_until: str
    calibration_check: CheckState
    latched: Latch | None
