"""The controller's kinematics against an independent solver."""

import math

import numpy as np
import pytest
import ur_analytic_ik

from hardware_sim.controller import kinematics, poses

MODELS = sorted(kinematics.MODELS)
KNOWN = [name for name in MODELS if hasattr(ur_analytic_ik, name)]
SAMPLES = 2000


def random_joints(seed: int) -> list[list[float]]:
    return np.random.default_rng(seed).uniform(-3.1, 3.1, (SAMPLES, 6)).tolist()


@pytest.mark.parametrize("name", KNOWN)
def test_forward_matches_oracle(name: str) -> None:
    model, oracle = kinematics.MODELS[name], getattr(ur_analytic_ik, name)
    for joints in random_joints(1):
        ours = np.array(poses.matrix(kinematics.forward(model, joints)))
        assert np.allclose(ours, oracle.forward_kinematics(*joints), atol=1e-12)


@pytest.mark.parametrize("name", KNOWN)
def test_solutions_include_all_of_oracle(name: str) -> None:
    model, oracle = kinematics.MODELS[name], getattr(ur_analytic_ik, name)
    for joints in random_joints(2):
        flange = kinematics.forward(model, joints)
        result = np.array(kinematics.solutions(model, flange))
        expected = np.array(oracle.inverse_kinematics(np.array(poses.matrix(flange)))).reshape(-1, 6)
        assert len(result) == len(expected)
        away = np.remainder(result[:, None] - expected[None] + math.pi, 2 * math.pi) - math.pi
        assert np.abs(away).max(axis=2).min(axis=0).max() < 1e-6


@pytest.mark.parametrize("name", MODELS)
def test_inverse_of_forward_returns_joints(name: str) -> None:
    model = kinematics.MODELS[name]
    for joints in random_joints(3)[:500]:
        turned = [q + 2 * math.pi * (q < 0) for q in joints]
        flange = kinematics.forward(model, turned)
        assert kinematics.inverse(model, flange, turned) == pytest.approx(turned, abs=1e-9)


def test_inverse_singular_wrist_keeps_last_joint() -> None:
    model = kinematics.MODELS["ur5e"]
    joints = [0.3, -1.2, 1.5, -0.4, 0.0, 0.7]
    flange = kinematics.forward(model, joints)
    assert kinematics.inverse(model, flange, joints) == pytest.approx(joints, abs=1e-6)


def test_inverse_out_of_reach_returns_none() -> None:
    model = kinematics.MODELS["ur3e"]
    assert kinematics.solutions(model, poses.from_ur([3.0, 0.0, 0.3, 0.0, 3.1, 0.0])) == []
    assert kinematics.inverse(model, poses.from_ur([0.0, 0.0, 0.3, 0.0, 0.0, 0.0]), [0.0] * 6) is None


def test_velocity_equals_derivative_of_pose() -> None:
    model = kinematics.MODELS["ur10e"]
    tool = poses.from_ur([0.1, -0.05, 0.2, 0.3, 0.4, 0.5])
    rates = [0.3, -0.4, 0.5, 0.6, -0.7, 0.8]
    step = 1e-6
    for joints in random_joints(4)[:50]:
        ahead, behind = (
            poses.compose(kinematics.forward(model, [q + s * r for q, r in zip(joints, rates, strict=True)]), tool)
            for s in (step, -step)
        )
        middle = poses.compose(kinematics.forward(model, joints), tool)
        result = kinematics.velocity(kinematics.chain(model, joints)[0], rates, poses.position(middle))
        linear = [(ahead[i] - behind[i]) / (2 * step) for i in (3, 7, 11)]
        turning = [w / (2 * step) for w in poses.rotation_vector(poses.compose(ahead, poses.invert(behind)))]
        assert result == pytest.approx(linear + turning, abs=1e-6)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 1.0, math.pi - 1e-9, math.pi])
def test_rotation_vector_near_zero_and_pi_round_trips(angle: float) -> None:
    for axis in np.random.default_rng(5).normal(size=(20, 3)):
        vector = axis / np.linalg.norm(axis) * angle
        frame = poses.from_ur([0.1, 0.2, 0.3, *vector])
        again = poses.from_ur(poses.to_ur(frame))
        assert again == pytest.approx(frame, abs=1e-9)
