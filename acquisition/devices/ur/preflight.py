"""Preflight: compares the controller's configuration with the cell file; a pure function."""

from dataclasses import dataclass

import numpy as np

from acquisition import geometry
from acquisition.devices import UNKNOWN, ArmIdentity, ArmReading, Finding
from acquisition.devices.ur import states
from acquisition.devices.ur.protocol import Inspection
from acquisition.models.base import FloatArray
from acquisition.models.cell_config import ArmConfig, JointGeometry

POSE_TOLERANCE = 1e-6  # m and rad; the controller keeps what it was given
PAYLOAD_TOLERANCE = 1e-3  # kg and m
FORWARD_TOLERANCE_M = 1e-3  # between the controller's own kinematics and pose: joint noise only
AS_BUILT_TOLERANCE_M = 2e-4  # between the controller's pose and the calibrated chain: joint noise only
AS_BUILT_TOLERANCE = 1e-6  # m and rad: numbers copied from the controller
_REMOTE_CONTROL = {
    "5": "Switch the pendant to remote control.",
    "x": "Select Automatic, then Remote, in the pendant's safety overview.",
}


_FORMER_NAMES = {"ur7": "ur5", "ur12": "ur10"}
"""Former names of the same arms, which software may still report: `RobotType` of UR's client library, as the primary
interface reports it, has numbers for UR5 and UR10, none for UR7e and UR12e."""


def _bare(model: str) -> str:
    """Returns a model as controllers name it, without the e of its series."""
    return model.casefold().removesuffix("e")


def _names(model: str) -> set[str]:
    """Returns the names that a controller may report for the model of a cell file."""
    name = _bare(model)
    return {name, _FORMER_NAMES.get(name, name)}


@dataclass(frozen=True)
class Answers:
    """The controller's answers; `inspection` is None if the control program does not run."""

    identity: ArmIdentity
    remote_control: bool
    reading: ArmReading
    inspection: Inspection | None
    expected_base_from_tool: FloatArray | None  # the cell file's kinematics at the present joints
    kinematics: list[JointGeometry] | None = None  # factory calibration, if the controller reports it


def findings(config: ArmConfig, answers: Answers) -> list[Finding]:
    """Returns all differences from the cell file, the gravest first; empty if the arm is ready."""
    differences: list[Finding] = []
    reading, identity = answers.reading, answers.identity
    safety = states.safety_fault(reading.safety_bits)
    if safety is not None:
        differences.append(Finding(safety.detail, "Look at the cell, clear the cause at the pendant, acknowledge."))
    power = states.power_fault(reading.robot_mode)
    if power is not None:
        differences.append(Finding(power.detail, "Power the arm on and release the brakes at the pendant."))
    if not answers.remote_control:
        differences.append(Finding("The controller is in local control.", _REMOTE_CONTROL[config.polyscope]))
    if identity.model != UNKNOWN and _bare(identity.model) not in _names(config.model):
        differences.append(
            Finding(
                f"The arm is a {identity.model}, the cell file says {config.model}.",
                "Correct `arm.model`, or connect the right arm.",
            )
        )
    if config.serial is not None and identity.serial == UNKNOWN:
        differences.append(
            Finding(
                f"The cell file states the serial number {config.serial}, but {identity.software} reports none.",
                "Update the controller, or remove `arm.serial`.",
            )
        )
    elif config.serial is not None and identity.serial != config.serial:
        differences.append(
            Finding(
                f"The arm's serial number is {identity.serial}, the cell file says {config.serial}.",
                "Correct `arm.serial`, or connect the right arm.",
            )
        )
    if reading.speed_fraction < 1e-3:
        differences.append(
            Finding("The speed slider is at 0, so no move would start.", "Move the slider at the pendant.")
        )
    if config.kinematics is not None and answers.kinematics is not None:
        differences += _kinematics_mismatch(config.kinematics, answers.kinematics)
    if answers.inspection is not None:
        differences += _inspection_mismatches(config, answers.inspection, answers.expected_base_from_tool)
    elif not differences:
        differences.append(Finding("The control program is not running.", "Connect to the arm again."))
    return differences


def _kinematics_mismatch(expected: list[JointGeometry], reported: list[JointGeometry]) -> list[Finding]:
    ours, theirs = (np.array([list(joint.model_dump().values()) for joint in chain]) for chain in (expected, reported))
    if np.allclose(ours, theirs, atol=AS_BUILT_TOLERANCE, rtol=0):
        return []
    return [
        Finding(
            "The controller's factory calibration differs from `arm.kinematics` in the cell file.",
            "Connect the right arm, or copy the controller's numbers: `lightpose check` prints them.",
        )
    ]


def _inspection_mismatches(config: ArmConfig, inspection: Inspection, expected: FloatArray | None) -> list[Finding]:
    differences: list[Finding] = []
    tool = geometry.pose(inspection.flange_from_tool[:3], inspection.flange_from_tool[3:])
    if not np.allclose(tool, config.flange_from_tool.matrix, atol=POSE_TOLERANCE):
        differences.append(
            Finding(
                "The controller's TCP differs from the cell file's.", "Check `arm.flange_from_tool` and the pendant."
            )
        )
    payload = [inspection.payload_kg, *inspection.payload_center_m]
    if not np.allclose(payload, [config.payload_kg, *config.payload_center_m], atol=PAYLOAD_TOLERANCE):
        differences.append(
            Finding("The controller's payload differs from the cell file's.", "Check `arm.payload_kg` and the pendant.")
        )
    measured = np.array(inspection.base_from_tool_measured[:3])
    forward = np.array(inspection.base_from_tool_forward[:3])
    if np.linalg.norm(forward - measured) > FORWARD_TOLERANCE_M:
        differences.append(
            Finding(
                f"The controller's kinematics and its measured pose differ by "
                f"{1e3 * np.linalg.norm(forward - measured):.1f} mm.",
                "Restart the controller; have its calibration checked.",
            )
        )
    if expected is not None:
        distance = float(np.linalg.norm(expected[:3, 3] - measured))
        calibrated = config.kinematics is not None
        if distance > (AS_BUILT_TOLERANCE_M if calibrated else config.nominal_kinematics_tolerance_m):
            remedy = (
                "`lightpose check` prints the arm's own calibration: put it into the cell file as `arm.kinematics`."
            )
            differences.append(
                Finding(
                    f"The tool is {1e3 * distance:.1f} mm from where {config.model}'s kinematics place it.",
                    "Check `arm.model` and `arm.flange_from_tool`. " + ("" if calibrated else remedy),
                )
            )
    return differences
