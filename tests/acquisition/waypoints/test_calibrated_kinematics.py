"""Calibrated kinematics against an independent chain, and convergence of the refinement."""

import math

import numpy as np
import pytest

from acquisition.models.cell_config import JointGeometry
from acquisition.waypoints import calibrated_kinematics
from acquisition.waypoints.kinematics import arm_model, inverse
from acquisition.waypoints.kinematics import forward as nominal_forward
from hardware_sim.controller import kinematics as independent
from hardware_sim.controller import poses
from hardware_sim.controller.calibration import calibrated

MODELS = ("ur3e", "ur5e", "ur10e", "ur16e", "ur15", "ur20", "ur30")


def chain_of(name: str, seed: int) -> np.ndarray:
    """A random factory calibration from the simulated controller."""
    links = calibrated(independent.MODELS[name], seed).links
    return calibrated_kinematics.chain(
        [
            JointGeometry(
                theta_rad=link.offset,
                a_m=link.length,
                d_m=link.distance,
                alpha_rad=math.atan2(link.sin_twist, link.cos_twist),
            )
            for link in links
        ]
    )


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
