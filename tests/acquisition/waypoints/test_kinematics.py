"""Closed-form kinematics against an independent implementation."""

import numpy as np
import pytest
import ur_analytic_ik

from acquisition.models.errors import ErrorCode, RigError
from acquisition.waypoints.kinematics import ELBOW_LIMIT, JOINT_LIMIT, arm_model, forward, inverse, unwrap
from hardware_sim.controller import kinematics as independent
from hardware_sim.controller import poses

MODELS = ("ur3e", "ur5e", "ur10e", "ur16e")
NEWER = ("ur7e", "ur12e", "ur15", "ur20", "ur30")
"""The oracle does not know them."""
POSES = 2000


@pytest.fixture(params=MODELS)
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(params=MODELS + NEWER)
def any_name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def joints() -> np.ndarray:
    return np.random.default_rng(20).uniform(-np.pi, np.pi, (POSES, 6))


def test_forward_flange_agrees_with_oracle(name: str, joints: np.ndarray) -> None:
    oracle = getattr(ur_analytic_ik, name).forward_kinematics
    flange = forward(arm_model(name), joints)[:, 6]
    assert np.allclose(flange, [oracle(*row) for row in joints], atol=1e-12)


def test_inverse_branches_reach_pose_and_include_joints(any_name: str, joints: np.ndarray) -> None:
    model = arm_model(any_name)
    flange = forward(model, joints)[:, 6]
    branches = inverse(model, flange)
    solved = ~np.isnan(branches[..., 0])
    again = forward(model, branches[solved])[:, 6]
    assert np.allclose(again, np.repeat(flange[:, None], 8, axis=1)[solved], atol=1e-9)
    apart = np.abs(np.angle(np.exp(1j * (branches - joints[:, None])))).max(axis=2)
    assert np.nanmin(apart, axis=1).max() < 1e-7


def test_inverse_misses_no_branch(name: str, joints: np.ndarray) -> None:
    model = arm_model(name)
    solve = getattr(ur_analytic_ik, name).inverse_kinematics
    flange = forward(model, joints)[:, 6]
    count = (~np.isnan(inverse(model, flange)[..., 0])).sum(axis=1)
    assert count.tolist() == [len(solve(pose)) for pose in flange]


@pytest.mark.parametrize("name", NEWER)
def test_forward_newer_arm_agrees_with_controller(name: str, joints: np.ndarray) -> None:
    ours = forward(arm_model(name), joints[:200])[:, 6]
    theirs = [poses.matrix(independent.forward(independent.MODELS[name], row)) for row in joints[:200].tolist()]
    assert np.allclose(ours, theirs, atol=1e-12)


# Lengths from each joint frame to the next as `ur_description` has them (config/*/default_kinematics.yaml, link
# origins x, y, z), which states them in another form than the table of Denavit–Hartenberg lengths.
ORIGINS = {
    "ur7e": ((0, 0, 0.1625), (-0.425, 0, 0), (-0.3922, 0, 0.1333), (0, -0.0997, 0), (0, 0.0996, 0)),
    "ur12e": ((0, 0, 0.1807), (-0.6127, 0, 0), (-0.57155, 0, 0.17415), (0, -0.11985, 0), (0, 0.11655, 0)),
    "ur30": ((0, 0, 0.2363), (-0.637, 0, 0), (-0.5037, 0, 0.201), (0, -0.1593, 0), (0, 0.1543, 0)),
}


@pytest.mark.parametrize("name", sorted(ORIGINS))
def test_forward_joint_frames_are_those_of_ur_description(name: str) -> None:
    stretched = np.zeros((1, 6))
    (_, _, z), (a2, _, _), (a3, _, d4), (_, d5, _), (_, d6, _) = ORIGINS[name]
    expected = [a2 + a3, -d4 - d6, z + d5]
    assert np.allclose(forward(arm_model(name), stretched)[0, 6, :3, 3], expected, atol=1e-12)


REACH_M = {"ur7e": 0.85, "ur12e": 1.3, "ur15": 1.3, "ur20": 1.75, "ur30": 1.3}
"""Reach of the wrist's centre from the base's axis, as Universal Robots advertises it."""


@pytest.mark.parametrize("name", sorted(REACH_M))
def test_arm_model_newer_arm_has_advertised_reach(name: str) -> None:
    _, a2, a3, _, d5, _ = arm_model(name).dh
    assert abs(a2) + abs(a3) + d5 == pytest.approx(REACH_M[name], abs=0.07)


def test_inverse_pose_out_of_reach_has_no_branch(name: str) -> None:
    pose = np.eye(4)
    pose[0, 3] = 5.0
    assert np.isnan(inverse(arm_model(name), pose[None])).all()


def test_unwrap_joints_stay_within_pi_of_home() -> None:
    random = np.random.default_rng(3)
    home = np.array([4.0, -1.6, 1.8, -1.8, -1.6, 3.0])
    joints = random.uniform(-np.pi, np.pi, (500, 6))
    near = unwrap(joints, home)
    kept = ~np.isnan(near[:, 0])
    assert kept.any()
    assert not kept.all()
    assert np.allclose(np.exp(1j * near[kept]), np.exp(1j * joints[kept]))
    cable = np.delete(near[kept] - home, 2, axis=1)
    assert np.abs(cable).max() <= np.pi + 1e-12
    assert np.abs(near[kept]).max() <= JOINT_LIMIT
    assert np.abs(near[kept, 2]).max() <= ELBOW_LIMIT


def test_arm_model_unknown_arm_is_refused() -> None:
    with pytest.raises(RigError) as caught:
        arm_model("ur99")
    assert caught.value.code == ErrorCode.CONFIG_INVALID
    assert "ur99" in caught.value.detail
