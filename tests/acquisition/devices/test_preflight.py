"""Preflight compares the arm's values with the cell file: each difference is a finding, and nothing else is."""

from dataclasses import replace

import numpy as np
import pytest

from acquisition import geometry
from acquisition.devices import ArmIdentity, ArmReading
from acquisition.devices.ur.preflight import Answers, findings
from acquisition.devices.ur.protocol import Inspection
from tests.acquisition.devices.arm_scenes import CELL

ARM = CELL.arm.model_copy(update={"serial": "20215500042"})
TOOL = (*ARM.flange_from_tool.position_m, *ARM.flange_from_tool.rotation_vector_rad)
POSE = (0.3, 0.2, 0.4, 0.0, 3.0, 0.0)
READING = ArmReading(
    connected=True,
    joints=(0.0,) * 6,
    joint_speeds=(0.0,) * 6,
    base_from_tool=geometry.pose(POSE[:3], POSE[3:]),
    timestamp=1.0,
    robot_mode=7,
    safety_bits=1,
    runtime_state=2,
    program_running=True,
    speed_fraction=1.0,
    digital_outputs=0,
    received_at=0.0,
)
INSPECTION = Inspection(TOOL, ARM.payload_kg, ARM.payload_center_m, POSE, POSE)
GOOD = Answers(
    ArmIdentity("UR5", "20215500042", "URSoftware 5.11.1.108318"),
    remote_control=True,
    reading=READING,
    inspection=INSPECTION,
    expected_base_from_tool=READING.base_from_tool,
)


def turned(pose: tuple[float, ...]) -> np.ndarray:
    return geometry.pose((pose[0], pose[1], pose[2] + 0.02), pose[3:])


def test_findings_matching_arm_are_empty() -> None:
    assert findings(ARM, GOOD) == []
    assert findings(ARM, replace(GOOD, reading=replace(READING, safety_bits=2))) == [], "reduced mode is allowed"
    assert findings(ARM, replace(GOOD, expected_base_from_tool=None)) == []


@pytest.mark.parametrize(
    ("told", "named", "fits"),
    [
        ("UR7e", "ur7e", True),
        ("UR7", "ur7e", True),
        ("UR5", "ur7e", True),  # its number in the primary interface is the UR5's
        ("UR10", "ur12e", True),
        ("UR12e", "ur12e", True),
        ("UR20", "ur20", True),
        ("UR7", "ur5e", False),
        ("UR10", "ur7e", False),
        ("UR5", "ur12e", False),
        ("UR10", "ur16e", False),
    ],
)
def test_findings_new_names_of_arms_are_known(told: str, named: str, fits: bool) -> None:
    answers = replace(GOOD, identity=replace(GOOD.identity, model=told))
    found = findings(ARM.model_copy(update={"model": named}), answers)
    expected = [] if fits else [f"The arm is a {told}, the cell file says {named}."]
    assert [finding.what for finding in found] == expected


@pytest.mark.parametrize(
    ("answers", "words"),
    [
        (replace(GOOD, remote_control=False), "local control"),
        (replace(GOOD, identity=replace(GOOD.identity, model="UR10")), "UR10"),
        (replace(GOOD, identity=replace(GOOD.identity, serial="1")), "serial number is 1"),
        (replace(GOOD, reading=replace(READING, speed_fraction=0.0)), "slider"),
        (replace(GOOD, reading=replace(READING, safety_bits=1 << 4)), "Safeguard"),
        (replace(GOOD, reading=replace(READING, robot_mode=5)), "brakes on"),
        (replace(GOOD, inspection=None), "is not running"),
        (replace(GOOD, inspection=replace(INSPECTION, flange_from_tool=(0.0, *TOOL[1:]))), "TCP"),
        (replace(GOOD, inspection=replace(INSPECTION, payload_kg=1.0)), "payload"),
        (replace(GOOD, inspection=replace(INSPECTION, payload_center_m=(0.0, 0.0, 0.0))), "payload"),
        (replace(GOOD, inspection=replace(INSPECTION, base_from_tool_forward=(0.31, *POSE[1:]))), "10.0 mm"),
        (replace(GOOD, expected_base_from_tool=turned(POSE)), "20.0 mm"),
    ],
)
def test_findings_each_mismatch_is_named(answers: Answers, words: str) -> None:
    differences = findings(ARM, answers)
    assert len(differences) == 1
    assert words in differences[0].what
    assert differences[0].remedy
