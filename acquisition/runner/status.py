"""What can be said of rig and session at a glance, without asking any device."""

from dataclasses import dataclass
from typing import Any

from acquisition.devices import ArmIdentity, ArmReading
from acquisition.runner.safety_monitor import Latch
from acquisition.session import Stage


@dataclass(frozen=True)
class RigStatus:
    """What can be said of the rig at once, without asking any device."""

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
    latched: Latch | None


@dataclass(frozen=True)
class SessionProgress:
    """How far a session is."""

    stage: Stage
    progress: float
    seconds_left: float | None
