"""Closed-form kinematics against an independent implementation."""

import numpy as np
import pytest
import ur_analytic_ik

from acquisition.models.errors import ErrorCode, RigError
from acquisition.waypoints.kinematics import ELBOW_LIMIT, JOINT_LIMIT, arm_model, forward, inverse, unwrap

MODELS = ("ur3e", "ur5e", "ur10e", "ur16e")
POSES = 2000


@pytest.fixture(params=MODELS)
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def joints() -> np.ndarray:
    return np.random.default_rng(20).uniform(-np.pi, np.pi, (POSES, 6))


def test_forward_flange_agrees_with_oracle(name: str, joints: np.ndarray) -> None:
    oracle = getattr(ur_analytic_ik, name).forward_kinematics
    flange = forward(arm_model(name), joints)[:, 6]
    assert np.allclose(flange, [oracle(*row) for row in joints], atol=1e-12)


def test_inverse_branches_reach_pose_and_include_joints(name: str, joints: np.ndarray) -> None:
    model = arm_model(name)
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
