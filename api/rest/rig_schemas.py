"""Schemas of the rig: health, devices, readings, safety and recovery."""

from datetime import datetime
from typing import Literal

from pydantic import Field

from acquisition.devices import DriverPriority
from acquisition.models.base import Joints, Matrix4
from acquisition.models.calibration_check import CheckState
from acquisition.models.cell_config import Tool
from acquisition.models.errors import ErrorCode
from api.rest.schemas import Links, RequestBody, Resource


class Reason(Resource):
    """One reason why no session may start."""

    code: ErrorCode = Field(description="The stable code")
    detail: str = Field(description="What is wrong in this case, for people")
    remedy: str = Field(description="What to do, for people")


class Fault(Resource):
    """A safety fault that nobody has acknowledged."""

    code: ErrorCode = Field(description="The stable code")
    detail: str = Field(description="What happened in this case, for people")
    remedy: str = Field(description="What to do, for people")
    since: datetime = Field(description="When it was noticed, UTC")


class ArmResource(Resource):
    """Identity of the arm's controller."""

    model: str = Field(description="Model as the controller states it, such as `UR5`")
    serial: str = Field(description="The arm's serial number")
    software: str = Field(description="Version of the controller's software")


class ReadingResource(Resource):
    """The newest values from the arm's controller."""

    joints: Joints = Field(description="Joint angles from the base to the last wrist joint, rad, −2π to 2π")
    joint_speeds: Joints = Field(description="Joint speeds in the same order, rad/s")
    base_from_tool: Matrix4 = Field(description="Pose of the tool frame (TCP) in the base frame, homogeneous, rows; m")
    robot_mode: int = Field(
        description="Robot mode (RTDE): −1 no controller, 0 disconnected, 1 confirm safety, 2 booting, 3 power off, "
        "4 power on, 5 idle, 6 backdrive, 7 running, 8 updating firmware"
    )
    safety_bits: int = Field(
        description="Safety status bits (RTDE): bit 0 normal mode, 1 reduced mode, 2 protective stop, 3 recovery mode, "
        "4 safeguard stop, 5 system emergency stop, 6 robot emergency stop, 7 emergency stop, 8 violation, 9 fault, "
        "10 stopped due to safety"
    )
    program_running: bool = Field(description="Whether a program runs on the controller")
    speed_fraction: float = Field(description="Speed scaling on the pendant and by safety, 0 to 1")
    age_s: float = Field(description="Time since the controller sent it, s, ≥ 0; above 0.1 the link is slow")


class CalibrationResource(Resource):
    """Age and validity of the calibration."""

    made_at: str = Field(description="When it was made, ISO 8601")
    valid_until: str = Field(description="Until when it is valid, ISO 8601")
    valid: bool = Field(description="Whether it is valid now; if it is out of date, no session starts")
    check: CheckState = Field(description="When it was checked, with which result; sessions of kind `check` do that")


class RigResource(Resource):
    """The rig: its devices, and whether a session may start."""

    version: str = Field(description="Version of this software")
    cell: str = Field(description="Name of the cell, from the cell file")
    fingerprint: str = Field(description="SHA-256 of the cell file's values")
    arm_model: str = Field(description="Model of the arm in the cell file, such as `ur5e`")
    arm_address: str = Field(description="Address of the arm's controller in the cell file")
    arm: ArmResource | None = Field(description="Identity of the controller at that address")
    connected: bool = Field(description="Whether the arm's controller sends readings")
    driver_priority: DriverPriority | None = Field(
        description="Scheduling of the arm's driver that this machine has granted; below `real-time` other "
        "programs may make it stop the arm in mid-move, safely; null while there is no driver"
    )
    tool: Tool = Field(description="What is on the flange, as a person stated last (PUT /v1/rig/tool)")
    camera_ready: bool = Field(description="Whether the camera answers")
    reading: ReadingResource | None = Field(description="Newest values from the arm; null without a connection")
    holder: str | None = Field(description="The session that holds the rig; null: none")
    may_start: bool = Field(description="Whether a session may start now")
    reasons: list[Reason] = Field(description="Why no session may start now; empty if one may")
    calibration: CalibrationResource = Field(description="Age and validity of the calibration")
    faults: list[Fault] = Field(description="Safety faults that nobody has acknowledged")
    links: Links


class SafetyResource(Resource):
    """The latched faults: they stay until a person acknowledges that the cell is clear."""

    clear: bool = Field(
        description="Whether no fault is latched and the arm's controller is `connected`, which would report a stop"
    )
    connected: bool = Field(description="Whether the arm's controller sends readings; if not, its stops are not known")
    faults: list[Fault] = Field(description="The latched faults, oldest first")
    links: Links


class Health(Resource):
    """Answer of a health probe."""

    status: Literal["ok"] = Field(default="ok", description="`ok`; anything else is a problem object")


class RecoveryRequest(RequestBody):
    """One step of recovery from a stop."""

    step: Literal["unlock", "power", "brakes"] = Field(
        description="`unlock` a protective stop, then `power` on, then release the `brakes`; "
        "each when the one before has succeeded"
    )
