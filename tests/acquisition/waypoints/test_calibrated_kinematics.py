"""Calibrated kinematics against an independent chain, and convergence of the refinement."""

import math

import numpy as np
import pytest

from acquisition.models.cell_config import JointGeometry
from acquisition.models.errors import ErrorCode, RigError
from acquisition.waypoints import calibrated_kinematics
from acquisition.waypoints.collision import scene
from acquisition.waypoints.kinematics import arm_model, inverse
from acquisition.waypoints.kinematics import forward as nominal_forward
from hardware_sim.controller import kinematics as independent
from hardware_sim.controller import poses
from hardware_sim.controller.calibration import calibrated
from tests.acquisition.waypoints.cells import simulated_cell

MODELS = ("ur3e", "ur5e", "ur10e", "ur16e", "ur15", "ur20", "ur30")


UR5_OF_CB3 = ((0, 0.089159, 90), (-0.425, 0, 0), (-0.39225, 0, 0), (0, 0.10915, 90), (0, 0.09465, -90), (0, 0.0823, 0))
"""Rows a, d, α of the arm before the e-Series, which also calls itself UR5 (Universal Robots, "DH parameters")."""


def calibration_of(name: str, seed: int) -> list[JointGeometry]:
    """A random factory calibration from the simulated controller."""
    return [
        JointGeometry(
            theta_rad=link.offset,
            a_m=link.length,
            d_m=link.distance,
            alpha_rad=math.atan2(link.sin_twist, link.cos_twist),
        )
        for link in calibrated(independent.MODELS[name], seed).links
    ]


def chain_of(name: str, seed: int) -> np.ndarray:
    return calibrated_kinematics.chain(calibration_of(name, seed))


@pytest.mark.parametrize("name", MODELS)
def test_forward_calibrated_chain_agrees_with_controller(name: str) -> None:
    joints = np.random.default_rng(1).uniform(-3, 3, (50, 6))
    arm = calibrated(independent.MODELS[name], 4)
    theirs = [poses.matrix(independent.forward(arm, row)) for row in joints.tolist()]
    assert np.allclose(calibrated_kinematics.forward(chain_of(name, 4), joints)[:, 6], theirs, atol=1e-12)


@pytest.mark.parametrize("name", MODELS)
def test_refine_most_branches_converge(name: str) -> None:
    model, chain = arm_model(name), chain_of(name, 5)
    joints = np.random.default_rng(2).uniform(-3, 3, (500, 6))
    flange = calibrated_kinematics.forward(chain, joints)[:, 6]
    branches = inverse(model, flange)
    pose, branch = np.nonzero(~np.isnan(branches[..., 0]))
    refined = calibrated_kinematics.refine(chain, branches[pose, branch], flange[pose])
    arrived = ~np.isnan(refined[:, 0])
    assert arrived.mean() > 0.97
    assert np.allclose(calibrated_kinematics.forward(chain, refined[arrived])[:, 6], flange[pose[arrived]], atol=1e-6)
    unrefined = nominal_forward(model, refined[arrived])[:, 6, :3, 3] - flange[pose[arrived], :3, 3]
    assert np.linalg.norm(unrefined, axis=1).mean() > 1e-3, "the closed form alone is off by millimetres"


def test_refine_unreachable_pose_gives_nan() -> None:
    far = np.eye(4)
    far[0, 3] = 5.0
    assert np.isnan(calibrated_kinematics.refine(chain_of("ur5e", 1), np.zeros((1, 6)), far[None])).all()


@pytest.mark.parametrize("name", MODELS)
def test_departure_is_near_the_largest_of_random_poses(name: str) -> None:
    arm = simulated_cell()[0].arm.model_copy(update={"model": name, "kinematics": calibration_of(name, 2)})
    point = np.array([[0.1, 0.0, 0.15]])
    joints = np.random.default_rng(3).uniform(-math.pi, math.pi, (5000, 6))
    places = [
        frames[:, 6, :3, :3] @ point[0] + frames[:, 6, :3, 3]
        for frames in (
            calibrated_kinematics.forward(chain_of(name, 2), joints),
            nominal_forward(arm_model(name), joints),
        )
    ]
    largest = np.linalg.norm(places[0] - places[1], axis=1).max()
    assert calibrated_kinematics.departure_m(arm, point) > 0.8 * largest


def test_departure_of_a_longer_foot_is_its_length() -> None:
    arm = simulated_cell()[0].arm
    assert calibrated_kinematics.departure_m(arm, np.zeros((1, 3))) == 0
    theta, a, d, alpha = calibrated_kinematics.of_arm(arm).T.tolist()
    d[0] += 0.05
    rows = [
        JointGeometry(theta_rad=one[0], a_m=one[1], d_m=one[2], alpha_rad=one[3])
        for one in zip(theta, a, d, alpha, strict=True)
    ]
    raised = arm.model_copy(update={"kinematics": rows})
    assert calibrated_kinematics.departure_m(raised, np.zeros((1, 3))) == pytest.approx(0.05)


def test_scene_kinematics_of_another_arm_are_refused() -> None:
    """The UR5 before the e-Series names itself as a UR5e does, but its shoulder is 73 mm lower."""
    cell, calibration = simulated_cell()
    lower = [JointGeometry(theta_rad=0, a_m=a, d_m=d, alpha_rad=math.radians(twist)) for a, d, twist in UR5_OF_CB3]
    for stated, model in ((lower, "ur5e"), (calibration_of("ur10e", 1), "ur5e"), (calibration_of("ur5e", 1), "ur16e")):
        arm = cell.arm.model_copy(update={"model": model, "kinematics": stated})
        with pytest.raises(RigError, match=f"from where the links of a {model} have it") as refused:
            scene(cell.model_copy(update={"arm": arm}), calibration)
        assert refused.value.code is ErrorCode.CONFIG_INVALID
    own = cell.arm.model_copy(update={"kinematics": calibration_of("ur5e", 1)})
    scene(cell.model_copy(update={"arm": own}), calibration)
