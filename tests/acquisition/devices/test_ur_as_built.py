"""An arm whose calibrated kinematics differ from nominal by millimetres: lamp poses agree with log and plan."""

from collections.abc import Iterator

import numpy as np
import pytest

from acquisition import geometry, lamp_pose
from acquisition.devices import MotionLimits
from acquisition.devices.ur import primary
from acquisition.devices.ur.arm import UrArm
from acquisition.models import cell_config
from acquisition.models.cell_config import CellConfig, JointGeometry
from acquisition.models.light_plan import Light
from acquisition.waypoints import calibrated_kinematics, kinematics
from acquisition.waypoints.reach import refusals
from acquisition.waypoints.roadmap import dome_lights
from acquisition.waypoints.routing import route
from hardware_sim import real_time_controller
from hardware_sim.controller.control import ControlClient
from hardware_sim.controller.options import ControllerOptions
from tests.acquisition.devices.arm_scenes import CELL, connected, moved
from tests.acquisition.waypoints.cells import CELLS

ADDRESS = "127.0.13.10"
SEED = 7
ERROR_M = 0.004  # rms over all poses; at the lights of the route it is 3.3 mm
CALIBRATION = cell_config.load_calibration(CELLS / CELL.calibration)
OBJECT_CENTER_M = np.array([0.0, 0.0, CELL.object.keep_out.height_m / 2])


@pytest.fixture(scope="module")
def control() -> Iterator[ControlClient]:
    with (
        real_time_controller.start(
            ADDRESS,
            ControllerOptions(home=CELL.arm.home, calibration_seed=SEED, calibration_error_m=ERROR_M, speed=10.0),
        ) as process,
        process.control() as client,
    ):
        yield client


@pytest.fixture(scope="module")
def cell(control: ControlClient) -> CellConfig:
    """The simulated cell with the calibration that the controller tells."""
    joints = primary.kinematics(ADDRESS, within_s=60.0)
    assert joints is not None
    return CELL.model_copy(update={"arm": CELL.arm.model_copy(update={"address": ADDRESS, "kinematics": joints})})


def directions(lights: list[Light]) -> np.ndarray:
    """Unit vectors (N, 3) from the object's centre to the lights, base frame."""
    base_from_view = lamp_pose.base_from_view(CALIBRATION)
    center = geometry.transform(CELL.object.keep_out.base_from_object.matrix, OBJECT_CENTER_M)
    away = geometry.transform(base_from_view, np.array([light.position for light in lights])) - center
    return away / np.linalg.norm(away, axis=1, keepdims=True)


def rms_deg(one: list[Light], other: list[Light]) -> float:
    """Root mean square of the angles between the directions to lights."""
    sines = np.linalg.norm(np.cross(directions(one), directions(other)), axis=1)
    return float(np.degrees(np.sqrt(np.mean(np.arcsin(sines) ** 2))))


def test_calibrated_kinematics_lights_match_log_and_plan(cell: CellConfig, control: ControlClient) -> None:
    lights = dome_lights(cell, CALIBRATION, 40)[::3]
    wanted = [light for light, no in zip(lights, refusals(lights, cell, CALIBRATION), strict=True) if no is None][:10]
    planned = route(wanted, cell.arm.home, cell, CALIBRATION)
    logged: list[Light] = []
    true: list[Light] = []
    with connected(UrArm(cell.arm, cell.lamp.output)) as arm:
        assert arm.preflight() == []
        for waypoint in planned.waypoints:
            limits = [MotionLimits(speed, cell.arm.max_joint_acceleration_rad_s2) for speed in waypoint.speeds]
            moved(arm, waypoint.path, limits)
            logged.append(lamp_pose.light_from_tool(arm.reading.base_from_tool, CALIBRATION))
            true.append(lamp_pose.light_from_tool(np.array(control.state()["base_from_tool"]), CALIBRATION))
    aimed = [waypoint.light for waypoint in planned.waypoints]
    joints = np.array([waypoint.joints for waypoint in planned.waypoints])
    flange = kinematics.forward(kinematics.arm_model(cell.arm.model), joints)[:, 6]
    drawn = [lamp_pose.light_from_tool(pose @ cell.arm.flange_from_tool.matrix, CALIBRATION) for pose in flange]
    off = [np.subtract(one.position, other.position) for one, other in zip(drawn, true, strict=True)]
    error_mm = 1e3 * np.sqrt(np.mean(np.sum(np.square(off), axis=1)))
    angles = ", ".join(
        f"{name} {rms_deg(true, others):.5f}°"
        for name, others in (("logged", logged), ("aimed", aimed), ("drawn", drawn))
    )
    print(f"\n{error_mm:.2f} mm rms off the drawings; directions from the true ones, rms: {angles}")
    assert error_mm > 3.0
    assert rms_deg(true, logged) < 0.1
    assert rms_deg(true, aimed) < 0.1
    assert rms_deg(true, drawn) > 0.1, "nominal kinematics would not have done"


def test_preflight_other_factory_calibration_is_reported(cell: CellConfig, control: ControlClient) -> None:
    joints = cell.arm.kinematics
    assert joints is not None
    others = [joints[0].model_copy(update={"a_m": joints[0].a_m + 0.001}), *joints[1:]]
    arm = UrArm(cell.arm.model_copy(update={"kinematics": others}), cell.lamp.output)
    chain = calibrated_kinematics.chain(others)

    def expected(joints: tuple[float, ...]) -> np.ndarray:
        return calibrated_kinematics.forward(chain, np.array([joints]))[0, 6] @ cell.arm.flange_from_tool.matrix

    arm.expected_pose = expected
    with connected(arm):
        sentences = [finding.what for finding in arm.preflight()]
    assert "factory calibration" in sentences[0]
    assert "1.0 mm" in sentences[1]


def test_preflight_reads_the_factory_calibration_once_for_each_driver(
    cell: CellConfig, control: ControlClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each press of a jog button begins with a preflight, which must not wait for the primary interface each time."""
    read: list[str] = []

    def kinematics_of(address: str) -> list[JointGeometry] | None:
        read.append(address)
        return cell.arm.kinematics

    monkeypatch.setattr(primary, "kinematics", kinematics_of)
    with connected(UrArm(cell.arm, cell.lamp.output)) as arm:
        assert arm.preflight() == arm.preflight() == []
        assert read == [ADDRESS]
        arm.close()
        arm.connect()
        assert arm.preflight() == []
    assert read == [ADDRESS] * 2
