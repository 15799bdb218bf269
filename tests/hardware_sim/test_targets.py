"""Calibration targets before the simulated camera: what is rendered against formulas of the acquisition side."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from acquisition import geometry, photometry
from acquisition.calibrate import board_view, charuco, highlight, lamp_position
from acquisition.calibrate.charuco import CharucoBoard
from acquisition.models import cell_config
from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import BoardConfig, LampTargetsConfig, Pose
from acquisition.models.errors import ErrorCode, RigError
from acquisition.waypoints import kinematics
from hardware_sim import lamp_lobe, nominal, object_spec, targets, true_cell
from hardware_sim.charuco_print import PAPER_ALBEDO, CharucoPrint
from hardware_sim.target_stage import TargetStage
from hardware_sim.targets import TargetSpec
from hardware_sim.world import ExposureInterval, World

PIXELS = 256
CELL = cell_config.load(nominal.default_cell_file())
CALIBRATION = nominal.calibration(PIXELS)
LIT = (-2.6641, -0.9534, 1.6785, 2.607, 1.8307, 2.423)
"""The lamp on the dome at 45° from the view axis, looking at its centre."""


def world(name: str, profile: Any = "ideal", known: Calibration = CALIBRATION, **more: Any) -> World:
    return World(CELL, known, name, 3, profile, **more)


def image(made: World, joints: Any = LIT, exposure_s: float = 0.03, lamp: float = 1.0) -> np.ndarray:
    black = made.calibration.sensor.black_level_dn
    return made.frame([ExposureInterval(1.0, tuple(joints), lamp)], exposure_s, 0) - black


def board_of(made: CharucoPrint) -> CharucoBoard:
    return CharucoBoard(
        columns=made.columns, rows=made.rows, square_m=made.square_m, marker_share=made.marker_share,
        legacy_pattern=made.legacy_pattern,
    )  # fmt: skip


def true_corners_px(made: World, board: CharucoBoard, view: charuco.View, joints: Any) -> np.ndarray:
    """Where the true, warped print's corners are in the image, by OpenCV's projection."""
    assert made.target is not None
    facts = made.target.facts
    flat = board.corners_m[view.corners]
    u, v = (2 * flat[:, :2] / np.array(board.size_m) - 1).T
    z = facts["warp_m"][0] * (1 - u**2) + facts["warp_m"][1] * (1 - v**2) + facts["twist_m"] * u * v
    points = np.column_stack([facts["square_scale"] * flat[:, :2], z])
    mount = np.eye(4)
    if made.target.spec.mount == "flange":
        mount = geometry.inverse(CELL.object.keep_out.base_from_object.matrix) @ made.base_from_flange(joints)
    lens = made.lens
    seen = geometry.transform(geometry.inverse(lens.object_from_camera) @ mount @ made.target.mount_from_target, points)
    return cv2.projectPoints(seen, np.zeros(3), np.zeros(3), lens.matrix, lens.distortion)[0].reshape(-1, 2)


def joints_before_camera(made: World) -> np.ndarray:
    """Joints at which the board on the flange faces the camera at half a metre, tilted by 20°."""
    assert made.target is not None
    middle = geometry.pose((0.0, 0.0, 0.52), (0.3, 0.15, 0.0))
    middle = middle @ geometry.pose((-0.045, -0.035, 0.0), (0.0, 0.0, 0.0))
    flange = np.array(CALIBRATION.base_from_camera) @ middle @ geometry.inverse(made.target.mount_from_target)
    solutions = kinematics.inverse(kinematics.arm_model("ur5e"), flange[None])[0]
    return solutions[np.isfinite(solutions).all(axis=1)][0]


@pytest.mark.parametrize(
    "made",
    [targets.BOARD, CharucoPrint(9, 6, 0.01, legacy_pattern=True), CharucoPrint(8, 7, 0.01, legacy_pattern=True)],
)
def test_charuco_print_agrees_with_opencv_board(made: CharucoPrint) -> None:
    side = 140
    board = board_of(made)
    drawn = board.opencv().generateImage((board.columns * side, board.rows * side))
    rows, columns = np.mgrid[0 : drawn.shape[0] : 7, 0 : drawn.shape[1] : 7]
    rows, columns = rows + 3, columns + 3  # middles of blocks that no edge crosses: a bit has 15 pixels
    points = np.stack([columns.ravel() + 0.5, rows.ravel() + 0.5], axis=-1) / side * board.square_m
    dark = made.albedo(points) < PAPER_ALBEDO / 2
    inside = cv2.erode((drawn == 0).astype(np.uint8), np.ones((5, 5))) == cv2.dilate(
        (drawn == 0).astype(np.uint8), np.ones((5, 5))
    )
    clear = inside[rows, columns].ravel()
    assert clear.mean() > 0.5
    assert np.array_equal(dark[clear], drawn[rows, columns].ravel()[clear] == 0)


@pytest.mark.long
@pytest.mark.parametrize(("name", "least"), [("charuco#2", 40), ("matt-plane", 30)])
def test_board_on_table_shows_its_true_corners(name: str, least: int) -> None:
    made = world(name, known=nominal.calibration(512))
    board = board_of(targets.BOARD if name.startswith("charuco") else targets.PLANE)
    view = charuco.detect(image(made).astype(np.uint16), board, name)
    assert view is not None
    assert len(view.corners) >= least
    off = view.pixels - true_corners_px(made, board, view, LIT)
    assert np.sqrt(np.mean(off**2)) < 0.06
    assert np.abs(off.mean(axis=0)).max() < 0.02


@pytest.mark.parametrize(
    ("pixels", "rms_px"), [(PIXELS, 0.25), pytest.param(512, 0.08, marks=pytest.mark.long)]
)  # of 256 pixels a marker's bit has 2.4, and OpenCV's refinement runs into it
def test_board_on_flange_moves_with_arm_in_room_light(pixels: int, rms_px: float) -> None:
    made = world("charuco@flange", "realistic", nominal.calibration(pixels))
    joints = joints_before_camera(made)
    seen = image(made, joints, 0.9, lamp=0.0)
    view = charuco.detect(seen.clip(0).astype(np.uint16), board_of(targets.BOARD), "flange")
    assert view is not None
    assert len(view.corners) >= 40
    off = view.pixels - true_corners_px(made, board_of(targets.BOARD), view, joints)
    assert np.sqrt(np.mean(off**2)) < rms_px
    assert np.abs(off.mean(axis=0)).max() < 0.05
    assert not made.truth().mask.any()
    elsewhere = image(made, [joints[0] + 0.5, *joints[1:]], 0.9, lamp=0.0)
    assert elsewhere.max() < 0.3 * seen.max()


def test_mirror_sphere_shows_lamp_where_reflection_says() -> None:
    made = world("mirror-sphere", known=nominal.calibration(512))
    assert made.target is not None
    seen = image(made, exposure_s=2e-4)
    spot = highlight.find(seen, made.calibration.sensor.full_scale_dn)
    assert not isinstance(spot, str)
    center = geometry.transform(CELL.object.keep_out.base_from_object.matrix, made.target.mount_from_target[:3, 3])
    camera = np.array(CALIBRATION.base_from_camera)
    lamp = made.base_from_lamp(LIT)[:3, 3]
    point = lamp_position.reflection(center, made.target.facts["radius_m"], camera[:3, 3], lamp[None])
    lens = made.lens
    expected = cv2.projectPoints(
        geometry.transform(geometry.inverse(camera), point), np.zeros(3), np.zeros(3), lens.matrix, lens.distortion
    )[0].ravel()
    assert spot.pixel == pytest.approx(expected, abs=0.1)


@pytest.mark.long
def test_mirror_sphere_reflects_table_and_room() -> None:
    made = world("mirror-sphere", "realistic")
    ball = cv2.erode(made.truth().mask.astype(np.uint8), np.ones((5, 5))) > 0
    room = image(made, exposure_s=0.9, lamp=0.0)[ball]
    facing = made.truth().normals[ball][:, 2]
    sky, table = room[facing > 0.75], room[facing < 0.6]
    assert sky.mean() == pytest.approx(0.6 * 0.4 * 0.9 * made.calibration.sensor.full_scale_dn, rel=0.1)
    assert table.mean() < 0.15 * sky.mean()


@pytest.mark.parametrize("perturbed", [False, True])
def test_matt_plane_brightness_follows_inverse_square_and_lobe(perturbed: bool) -> None:
    made = world("matt-plane", perturbed=perturbed)
    assert made.target is not None
    seconds = 0.02
    true = made.truth()
    inner = cv2.erode((true.albedo > 0.8).astype(np.uint8), np.ones((9, 9))) > 0
    assert inner.sum() > 500
    # The true camera sees the plane; its points are found by its own rays, not by the renderer's samples.
    rows, columns = np.nonzero(inner)
    lens, plane = made.lens, made.target.mount_from_target
    rays = lens.directions(columns.astype(float), rows.astype(float)).astype(float)
    reach = ((plane[:3, 3] - lens.eye) @ plane[:3, 2]) / (rays @ plane[:3, 2])
    points = lens.eye + reach[:, None] * rays
    lamp = geometry.inverse(CELL.object.keep_out.base_from_object.matrix) @ made.base_from_lamp(LIT)
    away = points - lamp[:3, 3]
    distance = np.linalg.norm(away, axis=1)
    direction = geometry.rotate(geometry.inverse(lamp), away / distance[:, None])
    lobe = true_cell.perturbed(CALIBRATION, 3) if perturbed else true_cell.nominal(CALIBRATION)
    facing = np.abs(away @ plane[:3, 2]) / distance
    expected = lobe.lamp_intensity * seconds * PAPER_ALBEDO * facing * (0.45 / distance) ** 2
    expected *= lobe.lobe.relative(direction) * lobe.sensitivity(PIXELS, PIXELS)[inner]
    found = image(made, exposure_s=seconds)[inner] / made.calibration.sensor.full_scale_dn
    ratio = found / expected
    assert ratio.mean() == pytest.approx(1, abs=2e-3)
    assert ratio.std() < 5e-3  # the board sags by tenths of a millimetre; values are rounded


def test_grey_tile_is_as_bright_as_its_albedo() -> None:
    tile, plane = (image(world(name)) for name in ("grey-tile", "matt-plane"))
    middle = PIXELS // 2
    around = np.s_[middle - 5 : middle + 5, middle - 5 : middle + 5]
    assert tile[around].mean() / plane[around].mean() == pytest.approx(0.18 / PAPER_ALBEDO, rel=0.02)


def test_every_placing_fits_keep_out_and_differs() -> None:
    poses = set()
    for kind in ("charuco", "matt-plane", "mirror-sphere", "grey-tile"):
        for placing in range(6):
            spec = object_spec.as_spec(str(TargetSpec(kind, "table", placing)))
            scene = object_spec.build(spec, placing, CELL)
            assert scene.mesh.triangles[..., 2].min() > 0.002
            poses.add(scene.mesh.triangles[0].tobytes())
    assert len(poses) == 24


def test_targets_are_those_of_the_cell_file() -> None:
    on_flange = Pose(position_m=(-0.048, 0.036, 0.06), rotation_vector_rad=(np.pi, 0.0, 0.0))
    board = BoardConfig(columns=8, rows=6, square_m=0.012, legacy_pattern=True, flange_from_board=on_flange)
    plane = LampTargetsConfig(sphere_radius_m=0.02, columns=9, rows=8, square_m=0.01, border_squares=2, albedo=0.6)
    other = CELL.model_copy(update={"board": board, "lamp_targets": plane})
    nominal_of = targets.nominal_of(other)
    flat = targets.build(targets.parse("matt-plane"), 3, nominal_of)
    assert flat.facts["albedo"] == 0.6
    assert flat.facts["size"] == pytest.approx([0.09, 0.08], rel=2e-3)
    ball = targets.build(targets.parse("mirror-sphere"), 3, nominal_of)
    assert ball.facts["radius_m"] == pytest.approx(0.02, abs=1e-4)
    made = World(other, nominal.calibration(PIXELS), "charuco@flange", 3, "realistic")
    assert made.target is not None
    middle = geometry.pose((0.0, 0.0, 0.52), (0.3, 0.15, 0.0)) @ geometry.pose((-0.048, -0.036, 0.0), (0.0, 0.0, 0.0))
    flange = np.array(CALIBRATION.base_from_camera) @ middle @ geometry.inverse(on_flange.matrix)
    solutions = kinematics.inverse(kinematics.arm_model("ur5e"), flange[None])[0]
    joints = solutions[np.isfinite(solutions).all(axis=1)][0]
    view, why = board_view.seen(image(made, joints, 0.9, lamp=0.0).clip(0).astype(np.uint16), board)
    assert view is not None, why
    expected = board_view.expected(tuple(joints), other, CALIBRATION)
    assert expected is not None
    assert len(view.corners) == len(expected.corners_px) == expected.corners
    off = np.array(expected.corners_px) - true_corners_px(made, charuco.of_cell(board), view, joints)
    assert np.abs(off).max() < 12  # as far as screws and print let it


def test_target_names_are_read_as_written_and_others_refused() -> None:
    for name in ("charuco", "matt-plane#2", "mirror-sphere@flange", "empty"):
        assert str(targets.parse(name)) == name
    for name in ("charuco@ceiling", "matt-plane#", "board", "charuco#-1"):
        with pytest.raises(RigError) as caught:
            targets.parse(name)
        assert caught.value.code is ErrorCode.REQUEST_INVALID
        assert "mirror-sphere" in caught.value.detail
    assert object_spec.as_spec("vase").source == "built-in"
    with pytest.raises(RigError, match="reflectance"):
        object_spec.target(object_spec.choose("charuco", None, None, None, "lambert"), 1, CELL)


@pytest.mark.parametrize(
    ("name", "said"),
    [("empty@flange", "write empty"), ("empty#2", "write empty"), ("charuco@flange#4", "write charuco@flange")],
)
def test_target_name_of_what_does_not_go_together_is_refused(name: str, said: str) -> None:
    """The cell said that it had placed them: an empty flange, and a board whose placing on the flange is the same."""
    with pytest.raises(RigError, match=said) as caught:
        targets.parse(name)
    assert caught.value.code is ErrorCode.REQUEST_INVALID


def test_perturbed_cell_is_off_by_stated_amounts(tmp_path: Path) -> None:
    known = true_cell.nominal(CALIBRATION)
    for seed in range(3):
        true = true_cell.perturbed(CALIBRATION, seed)
        assert np.linalg.norm(true.tool_from_lamp[:3, 3] - known.tool_from_lamp[:3, 3]) == pytest.approx(0.010)
        off = geometry.inverse(known.base_from_camera) @ true.base_from_camera
        assert np.linalg.norm(off[:3, 3]) == pytest.approx(0.005)
        assert np.degrees(np.arccos((np.trace(off[:3, :3]) - 1) / 2)) == pytest.approx(0.5)
        assert abs(true.camera_matrix[0, 0] / known.camera_matrix[0, 0] - 1) == pytest.approx(0.01)
        assert abs(true.lamp_intensity / known.lamp_intensity - 1) == pytest.approx(0.05)
        assert np.degrees(np.sqrt(np.mean(true.joint_offsets[1:5] ** 2))) == pytest.approx(0.1)
    made = world("matt-plane", perturbed=True)
    made.save_calibration_truth(tmp_path / "truth.json")
    written = json.loads((tmp_path / "truth.json").read_text(encoding="utf-8"))
    assert written["target"] == "matt-plane"
    assert len(written["lobe_by_degree"]) == 91
    assert np.array(written["object_from_target"]).shape == (4, 4)


def test_led_lobe_is_no_cosine_power() -> None:
    angle = np.radians(np.arange(1, 41))
    for seed in range(5):
        lobe = lamp_lobe.led(np.random.default_rng(seed))
        fall = lobe.relative(np.stack([0 * angle, 0 * angle, np.cos(angle)], axis=1))
        exponent = np.linalg.lstsq(np.log(np.cos(angle))[:, None], np.log(fall), rcond=None)[0]
        assert np.abs(fall / np.cos(angle) ** exponent - 1).max() > 0.01
        assert fall.min() > 0.5


def test_lamp_of_plain_lobe_agrees_with_light_vectors() -> None:
    """The two sides' models of a lamp, each written on its own."""
    made = world("empty")
    pose = geometry.inverse(CELL.object.keep_out.base_from_object.matrix) @ made.base_from_lamp(LIT)
    from hardware_sim.render import Lamp

    lamp = Lamp.posed(pose, 1.0, CALIBRATION.reference_m, true_cell.nominal(CALIBRATION).lobe)
    points = np.random.default_rng(1).uniform(-0.08, 0.08, (50, 3))
    up = np.tile([0.0, 0.0, 1.0], (50, 1))
    array = np.concatenate([lamp.position, lamp.axis])[None].astype(np.float32)
    vectors = photometry.light_vectors(points.T.astype(np.float32), array, CALIBRATION)[0]
    assert lamp.irradiance(points, up) == pytest.approx(vectors[2], rel=1e-5)


def test_stage_without_target_shows_table_alone() -> None:
    made = world("empty", "realistic")
    assert isinstance(made._stage, TargetStage)  # pyright: ignore[reportPrivateUsage]
    assert 0 < image(made).mean() < 0.05 * made.calibration.sensor.full_scale_dn
