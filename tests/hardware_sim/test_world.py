from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from acquisition import geometry
from acquisition.models import cell_config
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import ErrorCode, RigError
from hardware_sim import nominal, render, truth, world
from hardware_sim.controller import kinematics, poses
from hardware_sim.controller.calibration import calibrated
from hardware_sim.controller.kinematics import MODELS
from hardware_sim.render import Lamp
from hardware_sim.world import ExposureInterval, World

PIXELS = 128
JOINTS = (-2.6641, -0.9534, 1.6785, 2.607, 1.8307, 2.423)
"""The lamp on the dome at 45° from the view axis, looking at its centre."""


@pytest.fixture(scope="module")
def cell() -> CellConfig:
    return cell_config.load(nominal.default_cell_file())


@pytest.fixture(scope="module")
def direct(cell: CellConfig) -> World:
    return World(cell, nominal.calibration(PIXELS), "bumps", 1, "direct")


@pytest.fixture(scope="module")
def ideal(cell: CellConfig) -> World:
    return World(cell, nominal.calibration(PIXELS), "bumps", 1, "ideal")


@pytest.fixture(scope="module")
def realistic(cell: CellConfig) -> World:
    return World(cell, nominal.calibration(PIXELS), "part", 1, "realistic")


def lamp(direction: np.ndarray) -> Lamp:
    """A nominal lamp on the dome, object frame."""
    return Lamp(np.array([0, 0, 0.03]) + 0.45 * direction, -direction, 1.0, 0.45, 0.8)


def test_truth_normals_agree_with_textbook_solve(cell: CellConfig, ideal: World) -> None:
    """Near lights at known places, true depth, least squares: frames, signs and units all have to be right."""
    scene, true = ideal, ideal.truth()
    calibration = scene.calibration
    object_from_view = geometry.inverse(cell.object.keep_out.base_from_object.matrix) @ geometry.base_from_view(
        np.array(calibration.base_from_camera)
    )
    rows, columns = np.nonzero(true.mask)
    rays = scene.lens.directions(columns.astype(float), rows.astype(float)).astype(float)
    points = scene.lens.eye + rays * true.depth[rows, columns][:, None]
    lamps = [lamp(geometry.direction(np.radians(s), a)) for s, a in ((10, 0.3), (35, 0.1), (35, 2.2), (35, 4.3))]
    values, vectors, clear = [], [], np.ones(len(points), bool)
    for one in lamps:
        values.append(scene.lamp_image(one)[rows, columns])
        displacement = one.position - points
        distance = np.linalg.norm(displacement, axis=1, keepdims=True)
        ahead = -(displacement @ one.axis)[:, None] / distance
        vectors.append(displacement / distance * ahead**0.8 * (0.45 / distance) ** 2)
        free = render.lit_mask(
            points.astype(np.float32),
            geometry.rotate(object_from_view, true.normals[rows, columns]).astype(np.float32),
            one.position,
            scene._tracer,  # pyright: ignore[reportPrivateUsage]
            scene.scene,
        )
        clear &= free
    result = np.array(
        [np.linalg.lstsq(a, b, rcond=None)[0] for a, b in zip(np.stack(vectors, 1), np.stack(values, 1), strict=True)]
    )
    albedo = np.linalg.norm(result, axis=1)
    in_view = geometry.rotate(geometry.inverse(object_from_view), result / albedo[:, None])
    error = np.degrees(
        np.arctan2(
            np.linalg.norm(np.cross(in_view, true.normals[rows, columns]), axis=1),
            (in_view * true.normals[rows, columns]).sum(axis=1),
        )
    )
    inner = clear & (true.normals[rows, columns, 2] > 0.4)
    assert inner.sum() > 2000
    assert np.median(error[inner]) < 0.1
    assert np.median(np.abs(albedo[inner] / true.albedo[rows, columns][inner] - 1)) < 0.003


def test_frame_depends_on_request_and_not_on_call_order(cell: CellConfig, direct: World) -> None:
    moments = [ExposureInterval(1.0, JOINTS, 1.0)]
    first = direct.frame(moments, 0.05, 0)
    others = [
        direct.frame(moments, 0.05, 1),
        direct.frame(moments, 0.051, 0),
        direct.frame([ExposureInterval(1.0, (*JOINTS[:5], JOINTS[5] + 2e-4), 1.0)], 0.05, 0),
        direct.frame([ExposureInterval(1.0, JOINTS, 0.0)], 0.05, 0),
    ]
    again = World(cell, nominal.calibration(PIXELS), "bumps", 1, "direct").frame(moments, 0.05, 0)
    assert np.array_equal(first, again)
    nearly = [ExposureInterval(1.0, tuple(joint + 1e-7 for joint in JOINTS), 1.0)]
    assert np.abs(direct.frame(nearly, 0.05, 0).astype(int) - first).max() <= 1
    for other in others:
        assert not np.array_equal(first, other)


def test_frame_intensity_varies_by_its_sigma(direct: World) -> None:
    true = direct.truth()
    brightness = []
    for attempt in range(24):
        frame = direct.frame([ExposureInterval(1.0, JOINTS, 1.0)], 0.1, attempt).astype(float) - 64
        brightness.append(frame[true.mask].mean())
    spread = np.std(brightness) / np.mean(brightness)
    # 1 % of intensity, and 1 mm of 0.5 m adds up to 0.4 % through the distance.
    assert 0.006 < spread < 0.018


def test_frame_signal_is_linear_in_exposure_and_level(ideal: World) -> None:
    mask = ideal.truth().mask
    one, two, half = (
        ideal.frame([ExposureInterval(1.0, JOINTS, level)], exposure, 0)[mask].astype(float) - 64
        for level, exposure in ((1.0, 0.02), (1.0, 0.04), (0.5, 0.04))
    )
    bright = one > 50
    assert bright.sum() > 1000
    assert two[bright] == pytest.approx(2 * one[bright], abs=1.6)
    assert half[bright] == pytest.approx(one[bright], abs=1.1)
    dark = ideal.frame([ExposureInterval(1.0, JOINTS, 0.0)], 0.04, 0)
    assert np.all(dark == 64)


def test_frame_moving_arm_smears(ideal: World) -> None:
    ends = [(*JOINTS[:1], JOINTS[1] + shift, *JOINTS[2:]) for shift in (0.0, 0.2)]
    parts = [ideal.frame([ExposureInterval(1.0, joints, 1.0)], 0.04, 0).astype(float) for joints in ends]
    both = ideal.frame([ExposureInterval(0.5, joints, 1.0) for joints in ends], 0.04, 0)
    assert both == pytest.approx((parts[0] + parts[1]) / 2, abs=1.1)


def test_realistic_world_adds_ambient_and_interreflections(cell: CellConfig, realistic: World) -> None:
    mask = realistic.truth().mask
    dark = realistic.frame([ExposureInterval(1.0, JOINTS, 0.0)], 0.1, 0).astype(float) - 64
    # 0.4 full scales per second on white, albedo near 0.5, part of the sky hidden.
    level = dark[mask].mean() / 4031
    assert 0.3 * 0.4 * 0.1 * 0.5 < level < 1.1 * 0.4 * 0.1 * 0.5
    repeated = [realistic.frame([ExposureInterval(1.0, JOINTS, 0.0)], 0.004, k)[mask].mean() - 64 for k in range(12)]
    assert np.std(repeated) / np.mean(repeated) > 0.02  # flicker

    direction = geometry.direction(np.radians(45), 1.0)
    with_bounces = realistic.lamp_image(lamp(direction))
    plain = World(cell, nominal.calibration(PIXELS), "part", 1, "ideal").lamp_image(lamp(direction))
    ratio = with_bounces[mask].mean() / plain[mask].mean()
    assert 1.01 < ratio < 1.2
    shadow = mask & (plain == 0)
    assert with_bounces[shadow].min() >= 0
    assert with_bounces[shadow].mean() > 0.002


def test_true_camera_differs_from_calibration_by_profile(cell: CellConfig, realistic: World) -> None:
    object_from_base = geometry.inverse(cell.object.keep_out.base_from_object.matrix)
    error = geometry.inverse(object_from_base @ np.array(realistic.calibration.base_from_camera)) @ (
        realistic.lens.object_from_camera
    )
    assert np.linalg.norm(error[:3, 3]) == pytest.approx(1e-4, rel=1e-6)
    assert np.degrees(Rotation.from_matrix(error[:3, :3]).magnitude()) == pytest.approx(0.02, rel=1e-4)


def test_truth_of_sphere_is_analytic(cell: CellConfig, tmp_path: Path) -> None:
    scene = World(cell, nominal.calibration(PIXELS), "sphere-matt", 4, "ideal")
    true = scene.truth()
    radius = scene.scene.height_m / 2
    assert true.depth[true.mask].min() == pytest.approx(0.9 - 2 * radius, abs=2e-5)
    row, column = np.unravel_index(int(np.where(true.mask, true.depth, 9).argmin()), true.mask.shape)
    assert true.normals[row, column] == pytest.approx([0, 0, 1], abs=0.05)
    rows, columns = np.nonzero(true.mask)
    left, top = columns.argmin(), rows.argmin()
    assert true.normals[rows[left], columns[left], 0] < -0.8
    assert true.normals[rows[top], columns[top], 1] > 0.8
    assert not true.normals[~true.mask].any()
    true.save(tmp_path / "truth.npz")
    again = truth.load(tmp_path / "truth.npz")
    assert np.array_equal(again.normals, true.normals)
    assert again.mask.dtype == bool


@pytest.mark.parametrize("content", [None, b"", b"not a file of numpy", b"PK\x03\x04 half a zip"])
def test_truth_damaged_file_is_named(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "truth.npz"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(RigError, match=r"truth\.npz") as caught:
        truth.load(path)
    assert caught.value.code == ErrorCode.STORE_CORRUPT


def test_visibility_agrees_with_lamp_image(direct: World) -> None:
    joints = JOINTS
    mask = direct.truth().mask
    visibility = direct.visibility(joints)
    frame = direct.frame([ExposureInterval(1.0, joints, 1.0)], 0.1, 0).astype(float) - 64
    assert not visibility[~mask].any()
    assert 0.2 < visibility[mask].mean() < 1.0
    assert np.percentile(frame[visibility], 5) > 3
    assert np.median(frame[mask & ~visibility]) < 6


def test_world_object_outside_keep_out_raises(cell: CellConfig) -> None:
    narrow = cell.object.keep_out.model_copy(update={"radius_m": 0.05})
    small = cell.model_copy(update={"object": cell.object.model_copy(update={"keep_out": narrow})})
    with pytest.raises(RigError, match="does not fit") as caught:
        World(small, nominal.calibration(PIXELS), "part", 1, "ideal")
    assert caught.value.code == ErrorCode.CONFIG_INVALID


def test_repository_calibration_is_the_nominal_one() -> None:
    deployed = cell_config.load_calibration(nominal.default_cell_file().parent / "calibration.sim.json")
    assert deployed == nominal.calibration(1024)


def test_profiles_are_all_defined() -> None:
    assert set(world.PROFILES) == {"ideal", "direct", "realistic"}


def test_lamp_is_fixed_to_flange(cell: CellConfig, direct: World) -> None:
    # Published Denavit–Hartenberg values of the UR5e: d, a, α of each joint.
    links = [
        (0.1625, 0.0, np.pi / 2),
        (0.0, -0.425, 0.0),
        (0.0, -0.3922, 0.0),
        (0.1333, 0.0, np.pi / 2),
        (0.0997, 0.0, -np.pi / 2),
        (0.0996, 0.0, 0.0),
    ]
    flange = np.eye(4)
    for angle, (d, a, twist) in zip(JOINTS, links, strict=True):
        flange = flange @ geometry.pose([0, 0, d], [0, 0, angle]) @ geometry.pose([a, 0, 0], [twist, 0, 0])
    expected = flange @ cell.arm.flange_from_tool.matrix
    result = direct.base_from_lamp(JOINTS)
    assert result == pytest.approx(expected, abs=1e-9)
    centre = np.array([0.55, 0, 0.03])
    displacement = centre - result[:3, 3]
    assert np.linalg.norm(displacement) == pytest.approx(0.45, abs=1e-3)
    assert result[:3, 2] == pytest.approx(displacement / np.linalg.norm(displacement), abs=1e-3)


def test_lamp_follows_calibrated_arm(cell: CellConfig) -> None:
    scene = World(cell, nominal.calibration(32), "sphere", 1, "ideal", arm_calibration=(5, 0.002))
    built = calibrated(MODELS[cell.arm.model], 5)
    flange = np.array(poses.matrix(kinematics.forward(built, JOINTS)))
    drawn = np.array(poses.matrix(kinematics.forward(MODELS[cell.arm.model], JOINTS)))
    assert np.allclose(scene.base_from_lamp(JOINTS), flange @ cell.arm.flange_from_tool.matrix, atol=1e-12)
    assert 2e-4 < np.linalg.norm((flange - drawn)[:3, 3]) < 8e-3
