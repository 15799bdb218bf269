"""Calibrated arms: their deviation from the nominal arm, and that the controller knows it exactly."""

import math
from contextlib import ExitStack

import numpy as np
import pytest

from acquisition.waypoints import kinematics as nominal
from hardware_sim.controller import kinematics, poses
from hardware_sim.controller.calibration import TYPICAL_ERROR_M, calibrated
from hardware_sim.controller.kinematics import MODELS, ArmModel
from tests.hardware_sim.controller.cells import HOME, connect
from tests.hardware_sim.controller.programs import run

SEEDS = (1, 2, 3)


def random_joints(count: int, seed: int) -> list[list[float]]:
    return np.random.default_rng(seed).uniform(-3.1, 3.1, (count, 6)).tolist()


def product_of_links(arm: ArmModel, joints: list[float]) -> np.ndarray:
    """Forward kinematics from the textbook's four matrices per link."""
    result = np.eye(4)
    for link, q in zip(arm.links, joints, strict=True):
        turn, twist = np.eye(4), np.eye(4)
        c, s = math.cos(q + link.offset), math.sin(q + link.offset)
        turn[:2, :2] = [[c, -s], [s, c]]
        turn[2, 3] = link.distance
        twist[1:3, 1:3] = [[link.cos_twist, -link.sin_twist], [link.sin_twist, link.cos_twist]]
        twist[0, 3] = link.length
        result = result @ turn @ twist
    return result


def test_calibrated_without_seed_returns_nominal_arm() -> None:
    assert calibrated(MODELS["ur5e"], None) is MODELS["ur5e"]


@pytest.mark.parametrize("name", sorted(MODELS))
@pytest.mark.parametrize("seed", SEEDS)
def test_calibrated_arm_differs_from_nominal_by_millimetres(name: str, seed: int) -> None:
    arm = calibrated(MODELS[name], seed)
    joints = random_joints(100, 7)
    drawn = nominal.forward(nominal.arm_model(name), np.array(joints))[:, 6, :3, 3]
    built = np.array([poses.position(kinematics.forward(arm, q)) for q in joints])
    errors = np.linalg.norm(drawn - built, axis=1)
    assert math.sqrt(float(np.mean(errors**2))) == pytest.approx(TYPICAL_ERROR_M, rel=0.25)
    assert errors.max() < 4 * TYPICAL_ERROR_M


@pytest.mark.parametrize("error_m", [0.0005, 0.003])
def test_calibrated_arm_has_the_requested_rms_error(error_m: float) -> None:
    joints = random_joints(100, 8)
    places = [
        np.array([poses.position(kinematics.forward(arm, q)) for q in joints])
        for arm in (MODELS["ur5e"], calibrated(MODELS["ur5e"], 4, error_m))
    ]
    errors = np.linalg.norm(places[0] - places[1], axis=1)
    assert math.sqrt(float(np.mean(errors**2))) == pytest.approx(error_m, rel=0.25)


def test_calibrated_same_seed_returns_same_arm() -> None:
    arms = [calibrated(MODELS["ur5e"], seed) for seed in (4, 4, 5)]
    assert arms[0] == arms[1]
    assert arms[0].links != arms[2].links


@pytest.mark.parametrize("name", sorted(MODELS))
def test_forward_calibrated_equals_product_of_links(name: str) -> None:
    arm = calibrated(MODELS[name], 1)
    for joints in random_joints(50, 8):
        ours = np.array(poses.matrix(kinematics.forward(arm, joints)))
        assert np.allclose(ours, product_of_links(arm, joints), atol=1e-12)


@pytest.mark.parametrize("name", sorted(MODELS))
def test_inverse_calibrated_reaches_pose_and_original_joints(name: str) -> None:
    arm = calibrated(MODELS[name], 2)
    for joints in random_joints(15, 9):
        flange = kinematics.forward(arm, joints)
        assert kinematics.inverse(arm, flange, joints) == pytest.approx(joints, abs=1e-6)
        for solution in kinematics.solutions(arm, flange):
            away, turn = poses.difference(kinematics.forward(arm, solution), flange)
            assert math.hypot(*away) < 1e-9
            assert math.hypot(*turn) < 1e-9


def test_solutions_calibrated_cover_nearly_all_branches() -> None:
    arm, drawn = calibrated(MODELS["ur10e"], 3), MODELS["ur10e"]
    result = expected = 0
    for joints in random_joints(40, 10):
        result += len(kinematics.solutions(arm, kinematics.forward(arm, joints)))
        expected += len(kinematics.solutions(drawn, kinematics.forward(drawn, joints)))
    assert result >= 0.97 * expected


def test_movel_calibrated_arm_stays_straight() -> None:
    record = run(
        " p0 = get_forward_kin()\n movel(pose_trans(p0, p[0.1, 0.05, 0.08, 0.2, 0, 0.3]), v=0.3)", calibration_seed=6
    )
    places = record.tools
    displacement = places[-1] - places[0]
    share = np.clip((places - places[0]) @ displacement / (displacement @ displacement), 0, 1)
    assert np.linalg.norm(places - places[0] - share[:, None] * displacement, axis=1).max() < 1e-6
    assert np.linalg.norm(displacement) == pytest.approx(math.hypot(0.1, 0.05, 0.08), abs=1e-8)


def test_client_calibrated_arm_reads_true_pose() -> None:
    with ExitStack() as stack:
        cell = connect(stack, calibration_seed=2)
        pose = cell.receive.getActualTCPPose()
        built = poses.to_ur(kinematics.forward(calibrated(MODELS["ur5e"], 2), HOME))
        assert pose == pytest.approx(built, abs=1e-9)
        drawn = nominal.forward(nominal.arm_model("ur5e"), np.array([HOME]))[0, 6, :3, 3]
        assert 3e-4 < np.linalg.norm(drawn - pose[:3]) < 4 * TYPICAL_ERROR_M
        assert cell.control.getForwardKinematics() == pytest.approx(pose, abs=1e-9)
        assert cell.control.getInverseKinematics(pose) == pytest.approx(HOME, abs=1e-6)
        with cell.process.control() as control:
            assert control.state()["calibration_seed"] == 2
            assert np.array(control.state()["base_from_tool"])[:3, 3] == pytest.approx(pose[:3], abs=1e-9)
