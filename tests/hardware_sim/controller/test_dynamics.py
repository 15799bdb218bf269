"""Torques, currents, momentum and elbow of the arm against recorded values and derivatives of energy and place."""

import numpy as np
import pytest

from acquisition.waypoints import kinematics as nominal
from hardware_sim.controller import poses
from hardware_sim.controller.arm import Arm
from hardware_sim.controller.dynamics import GRAVITY, Dynamics
from hardware_sim.controller.kinematics import MODELS
from hardware_sim.controller.registers import Registers

JOINTS = [0.4, -1.2, 1.1, -0.7, 0.9, 0.3]
SPEEDS = [0.3, -0.2, 0.5, 0.4, -0.6, 0.7]
RECORDED_JOINTS = [-1.6007, -1.7271, -2.203, -0.808, 1.5951, -0.031]
RECORDED_CURRENTS = [0.0, 2.1410127, 1.4926747, 0.2331386, 0.0017549, 0.0]
"""Of the UR5e in URSim that UR's client library recorded (`ROBOT_STATE` in `tests/test_primary_parser.cpp`)."""


def published(name: str, joints: list[float], speeds: list[float], payload: float = 0.0) -> Registers:
    arm, registers = Arm(MODELS[name], joints), Registers()
    arm.speeds, arm.payload, arm.payload_center = speeds, payload, [0.02, -0.03, 0.1]
    Dynamics(arm, registers).publish(0.0, brakes_open=True)
    return registers


def centers(name: str, joints: list[float], payload: float) -> tuple[np.ndarray, np.ndarray]:
    """Masses and their places in the base frame, from NumPy's kinematics: Denavit–Hartenberg frames of all links."""
    masses, along, offsets = MODELS[name].bodies
    frames = nominal.forward(nominal.arm_model(name), np.array([joints]))[0]
    places = []
    for link in range(6):
        place = np.array([0.0, 0.0, offsets[link], 1.0])
        if link in (1, 2):
            length = MODELS[name].a2 if link == 1 else MODELS[name].a3
            place[0] = -length - along[link - 1]
        places.append((frames[link + 1] @ place)[:3])
    places.append((frames[6] @ np.array([0.02, -0.03, 0.1, 1.0]))[:3])
    return np.array([*masses, payload]), np.array(places)


@pytest.mark.parametrize("name", sorted(set(MODELS) & {"ur3e", "ur5e", "ur10e", "ur16e"}))
def test_moments_are_the_gradient_of_potential_energy(name: str) -> None:
    moments = published(name, JOINTS, [0.0] * 6, payload=2.0).get("target_moment")
    step = 1e-6
    for joint in range(6):
        energies = []
        for sign in (1, -1):
            moved = JOINTS.copy()
            moved[joint] += sign * step
            masses, places = centers(name, moved, 2.0)
            energies.append(GRAVITY * float(masses @ places[:, 2]))
        assert moments[joint] == pytest.approx((energies[0] - energies[1]) / (2 * step), abs=1e-5)


def test_momentum_and_elbow_follow_joint_speeds() -> None:
    registers = published("ur5e", JOINTS, SPEEDS, payload=2.0)
    step = 1e-6
    ahead = [q + step * s for q, s in zip(JOINTS, SPEEDS, strict=True)]
    behind = [q - step * s for q, s in zip(JOINTS, SPEEDS, strict=True)]
    (masses, after), (_, before) = centers("ur5e", ahead, 2.0), centers("ur5e", behind, 2.0)
    momentum = np.linalg.norm(masses @ (after - before)) / (2 * step)
    assert registers.get("actual_momentum")[0] == pytest.approx(momentum, rel=1e-6)
    places = [nominal.forward(nominal.arm_model("ur5e"), np.array([q]))[0, 2, :3, 3] for q in (JOINTS, ahead, behind)]
    assert registers.get("elbow_position") == pytest.approx(places[0], abs=1e-9)
    assert registers.get("elbow_velocity") == pytest.approx((places[1] - places[2]) / (2 * step), abs=1e-6)


def test_currents_of_ur5e_are_those_recorded() -> None:
    registers = published("ur5e", RECORDED_JOINTS, [0.0] * 6)
    for name in ("target_current", "actual_current", "joint_control_output"):
        assert registers.get(name) == pytest.approx(RECORDED_CURRENTS, rel=0.015, abs=1e-4)


def test_every_model_has_masses() -> None:
    assert all(len(model.bodies.masses) == len(model.bodies.offsets) == 6 for model in MODELS.values())


def test_publish_brakes_closed_reports_torque_without_current() -> None:
    arm, registers = Arm(MODELS["ur5e"], JOINTS), Registers()
    Dynamics(arm, registers).publish(0.0, brakes_open=False)
    assert registers.get("actual_current") == [0.0] * 6
    assert abs(registers.get("target_moment")[1]) > 10.0


def test_publish_payload_shows_in_raw_wrench_and_accelerometer() -> None:
    registers = published("ur5e", JOINTS, [0.0] * 6, payload=2.0)
    wrench, felt = registers.get("ft_raw_wrench"), registers.get("actual_tool_accelerometer")
    assert np.linalg.norm(felt) == pytest.approx(GRAVITY)
    assert wrench[:3] == pytest.approx([-2.0 * a for a in felt])
    assert wrench[3:] == pytest.approx(np.cross([0.02, -0.03, 0.1], wrench[:3]))
    up = poses.rotate(Arm(MODELS["ur5e"], JOINTS).base_from_flange, felt)
    assert up == pytest.approx((0.0, 0.0, GRAVITY), abs=1e-12)


def test_publish_accelerations_end_with_the_move() -> None:
    arm, registers = Arm(MODELS["ur5e"], JOINTS), Registers()
    dynamics = Dynamics(arm, registers)
    for tick, speed in enumerate([0.0, 0.002, 0.004, 0.004, 0.0, 0.0]):
        arm.speeds = [speed] + [0.0] * 5
        dynamics.publish(tick * 0.002, brakes_open=True)
        expected = [0.0, 1.0, 1.0, 0.0, -2.0, 0.0][tick]
        assert registers.get("target_qdd")[0] == pytest.approx(expected)
