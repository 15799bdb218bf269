"""What a calibration session plans and concludes, on views of a known truth; the arm's poses in the simulated cell."""

from pathlib import Path

import numpy as np
import pytest

from acquisition import geometry, lamp_pose
from acquisition.calibrate import board_session
from acquisition.calibrate.board_results import AdjustmentRecord
from acquisition.calibrate.board_session import BoardImages
from acquisition.formats.frames import FolderFrames
from acquisition.models import cell_config
from acquisition.models.calibration_recipe import BoardRecipe
from acquisition.models.cell_config import BoardConfig
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.shot import Observations
from acquisition.runner import board_jobs
from acquisition.waypoints import board_poses, calibrated_kinematics, kinematics, motion, mounted_tool
from acquisition.waypoints.collision import scene
from acquisition.waypoints.roadmap import connected_views, roadmap
from hardware_sim import nominal
from tests.acquisition.calibrate.synthetic import BOARD, SIZE, joints_of, truth, views

CELL = cell_config.load(Path(__file__).parents[3] / "tests" / "data" / "cell.test.toml")
OF_TRUTH = CELL.model_copy(
    update={
        "board": mounted_tool.require_board(CELL).model_copy(
            update={"square_m": BOARD.square_m, "columns": BOARD.columns, "rows": BOARD.rows}
        )
    }
)


def captured(seed: int, count: int) -> BoardImages:
    seen = views(truth(seed), joints_of(truth(seed), count, seed), seed)
    return BoardImages(tuple(seen), {view.name: "0" * 64 for view in seen}, SIZE)


def test_board_in_cell_is_thicker_than_its_plate() -> None:
    board = mounted_tool.require_board(CELL)
    corners = mounted_tool.plate_corners(board)
    for corner in corners:
        near = min(
            np.linalg.norm(np.cross(np.array(one.end_m) - one.start_m, corner - one.start_m))
            / np.linalg.norm(np.array(one.end_m) - one.start_m)
            - one.radius_m
            for one in mounted_tool.plate(board)
        )
        assert near < 1e-9


def test_board_views_are_free_certified_and_before_the_camera() -> None:
    cell, calibration = mounted_tool.with_tool(CELL, "board"), nominal.calibration(128)
    joints = connected_views(cell, calibration, 40, seed=3)
    assert len(joints) == 40
    arm = scene(cell, calibration)
    assert arm.free(joints).all()
    assert roadmap(cell, calibration).connected(joints, arm).all()
    with_lamp = scene(CELL, calibration)
    assert len(arm.capsules) == len(with_lamp.capsules) + board_plates()


def test_board_limits_speed_whichever_tool_file_names() -> None:
    of_file = CELL.model_copy(update={"arm": CELL.arm.model_copy(update={"tool": "board"})})
    board = mounted_tool.require_board(CELL)
    board = board.model_copy(update={"square_m": 2 * board.square_m})
    random = np.random.default_rng(0)
    starts = random.uniform(-np.pi, np.pi, (60, 6))
    ends = starts + random.uniform(-0.5, 0.5, (60, 6))
    for cell in (CELL, of_file):
        mounted = mounted_tool.with_tool(cell.model_copy(update={"board": board}), "board")
        assert mounted_tool.with_tool(mounted, "board") == mounted
        assert mounted.arm.flange_from_tool == CELL.arm.flange_from_tool, "the controller's TCP stays"
        fastest = [
            plate_speed(start, end, float(speed), board)
            for start, end, speed in zip(starts, ends, motion.legs(starts, ends, mounted).speeds, strict=True)
        ]
        assert max(fastest) <= CELL.arm.max_tool_speed_m_s
        assert max(fastest) > 0.95 * CELL.arm.max_tool_speed_m_s


def plate_speed(start: np.ndarray, end: np.ndarray, speed: float, board: BoardConfig) -> float:
    """Speed, m/s, of the plate's fastest corner on a segment whose leading joint turns with `speed`, rad/s."""
    joints = start + np.linspace(0, 1, 1000)[:, None] * (end - start)
    flanges = kinematics.forward(kinematics.arm_model(CELL.arm.model), joints)[:, 6]
    corners = np.stack([geometry.transform(flange, mounted_tool.plate_corners(board)) for flange in flanges])
    step_s = np.abs(end - start).max() / speed / 999
    return float(np.linalg.norm(np.diff(corners, axis=0), axis=2).max() / step_s)


def test_board_poses_state_where_the_lamp_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(board_jobs, "CANDIDATES", 16)
    of_file = CELL.model_copy(update={"arm": CELL.arm.model_copy(update={"tool": "board"})})
    calibration, recipe = nominal.calibration(128), BoardRecipe(kind="hand-eye")
    planned = board_jobs.board_poses(recipe, of_file, calibration, Observations.of([], FolderFrames(Path())), None)
    joints = np.array(planned.joints)
    tools = calibrated_kinematics.forward(calibrated_kinematics.of_arm(CELL.arm), joints)[:, 6]
    lamps = tools @ CELL.arm.flange_from_tool.matrix
    assert planned.lights == [lamp_pose.light_from_tool(tool, calibration) for tool in lamps]


def test_adjustment_record_keeps_every_digit() -> None:
    calibration = nominal.calibration(128)
    known = board_session.prior(mounted_tool.with_tool(CELL, "board"), calibration)
    stored = AdjustmentRecord.model_validate_json(AdjustmentRecord.of(known).model_dump_json()).adjusted
    assert np.array_equal(stored.covariance, known.covariance)
    assert np.array_equal(stored.parameters.camera, known.parameters.camera)
    assert np.array_equal(stored.parameters.flange_from_board, known.parameters.flange_from_board)


def board_plates() -> int:
    return len(mounted_tool.plate(mounted_tool.require_board(CELL)))


def test_first_views_are_planned_from_the_calibration_in_use() -> None:
    cell, calibration = mounted_tool.with_tool(CELL, "board"), nominal.calibration(128)
    joints = connected_views(cell, calibration, 60, seed=1)
    basis = board_session.prior(cell, calibration)
    chosen = board_session.further_views(basis, list(joints), 8, BoardRecipe(kind="hand-eye"), cell, calibration)
    assert len({number for number, _ in chosen}) == 8
    losses = [float(reason.partition(": ")[2].removesuffix(" mm rms")) for _, reason in chosen]
    assert losses == sorted(losses, reverse=True)
    assert losses[-1] < 0.2 * losses[0]


@pytest.mark.long
def test_estimate_reaches_and_misses_what_is_asked() -> None:
    images = captured(4, 15)
    recipe = BoardRecipe(kind="hand-eye", target_mm=2.0)
    found = board_session.estimate(images, recipe, OF_TRUTH)
    assert board_session.summary(found, images, recipe, 0.1).reached
    stricter = recipe.model_copy(update={"target_mm": 0.001})
    missed = board_session.summary(found, images, stricter, 0.1)
    assert not missed.reached
    assert "not reached" in missed.advice[0]


@pytest.mark.long
def test_wrong_side_of_squares_is_named() -> None:
    images = captured(5, 15)
    board = mounted_tool.require_board(OF_TRUTH)
    wrong = OF_TRUTH.model_copy(update={"board": board.model_copy(update={"square_m": 1.03 * board.square_m})})
    with pytest.raises(RigError, match=r"squares are .* % smaller than stated") as refused:
        board_session.estimate(images, BoardRecipe(kind="hand-eye"), wrong)
    assert refused.value.code is ErrorCode.CALIBRATION_BOARD_WRONG


def test_board_too_large_for_camera_is_refused() -> None:
    cell = mounted_tool.with_tool(CELL, "board")
    board = mounted_tool.require_board(cell).model_copy(update={"square_m": 0.1})
    with pytest.raises(RigError, match="another size of board") as refused:
        board_poses.sample(cell.model_copy(update={"board": board}), nominal.calibration(128), 10, seed=1)
    assert refused.value.code is ErrorCode.CONFIG_INVALID
