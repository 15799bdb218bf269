"""Calibration sessions that meet what goes wrong in a lab: each fault is named, nothing is overwritten, and the session
goes on once it is put right."""

import time
from collections.abc import Generator
from pathlib import Path

import numpy as np
import pytest

from acquisition.models.base import as_matrix4
from acquisition.models.calibration import Calibration
from acquisition.models.calibration_recipe import BoardRecipe, LampRecipe
from acquisition.models.calibration_result import CalibrationSummary, HandEyeResult
from acquisition.models.calibration_set import CELL_FILE, CalibrationSet
from acquisition.models.errors import ErrorCode
from acquisition.runner.board_shots import START_EXPOSURE_S
from acquisition.runner.rig_choices import camera_name
from acquisition.session_state import ENDED, State, Trigger
from hardware_sim import nominal, placing
from tests.acquisition.runner.simulated_rig import (
    Rig,
    acknowledge,
    end_what_is_left,
    move_by_hand,
    new,
    reason_of,
    refusal,
    simulated_rig,
    wait_for,
)

pytestmark = [pytest.mark.long, pytest.mark.timeout(900)]
ADDRESS, SLOW_CAMERA = "127.0.6.37", "127.0.6.44"
BOARD, LAMP = BoardRecipe(kind="hand-eye", max_images=8), LampRecipe(kind="lamp", max_images=36)
KNOWN = "20261101-000000-known"
"""The calibration in use: that of the cell file, with the covariance of a hand–eye calibration."""


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[Rig, None, None]:
    folder = tmp_path_factory.mktemp("faults")
    with simulated_rig(
        folder, ADDRESS, cell_file=nominal.default_cell_file(), profile="realistic", shown="empty", pixels=512
    ) as made:
        _keep_known(made, folder)
        made.runner.choices.choose_calibration(KNOWN, "a")
        yield made


@pytest.fixture(autouse=True)
def _nothing_is_overwritten(rig: Rig) -> Generator[None, None, None]:
    end_what_is_left(rig)
    before = _files(rig)
    yield
    assert before.items() <= _files(rig).items()
    assert rig.runner.choices.calibration_id == KNOWN


def _keep_known(rig: Rig, folder: Path) -> None:
    known, estimate = rig.runner.choices.values(CELL_FILE), folder / "known"
    estimate.mkdir()
    sigma = np.array([1e-4] * 3 + [2e-4] * 3)
    result = HandEyeResult(
        made_at=known.made_at, version="0", base_from_camera=known.base_from_camera,
        covariance=np.diag(sigma**2).tolist(), position_sigma_m=1e-4, rotation_sigma_rad=2e-4,
        flange_from_board=as_matrix4(np.eye(4)), square_scale=1.0, joint_offsets_rad=(0.0,) * 6,
        joint_offset_sigmas_rad=(0.0,) * 6, arm_sigma_m=3e-5, arm_sigma_rad=3e-5, views=(),
    )  # fmt: skip
    (estimate / "calibration.json").write_text(known.model_dump_json(), encoding="utf-8")
    (estimate / "hand_eye.json").write_text(result.model_dump_json(), encoding="utf-8")
    stated = Calibration.model_validate_json((estimate / "calibration.json").read_text(encoding="utf-8"))
    summary = CalibrationSummary(kind="hand-eye", images=0, used=0, estimated=True)
    cell = rig.runner.choices.cell
    arm = rig.runner.choices._arm_name() or ""  # pyright: ignore[reportPrivateUsage]
    rig.store.calibrations.add(
        CalibrationSet(
            id=KNOWN, kind="hand-eye", fingerprint=stated.fingerprint, before=stated.fingerprint,
            made_at=stated.made_at, version="0", width=stated.width, height=stated.height, camera=camera_name(cell),
            arm=arm, images={}, summary=summary,
        ),
        estimate,
    )  # fmt: skip


def _files(rig: Rig) -> dict[str, bytes]:
    folder = rig.store.calibrations.folder(KNOWN).parent
    return {str(file.relative_to(folder)): file.read_bytes() for file in folder.rglob("*") if file.is_file()}


def place(name: str) -> None:
    placing.place(ADDRESS, 30100, name)


def paused(rig: Rig, recipe: BoardRecipe | LampRecipe) -> str:
    """A session that has come to a pause."""
    rig.runner.state_tool(recipe.tool, "a")
    session_id = new(rig, recipe)
    rig.runner.act(session_id, Trigger.START, "a")
    assert wait_for(rig, session_id, State.PAUSED, State.INTERRUPTED, *ENDED, within_s=300) is State.PAUSED
    return session_id


def images_after_resuming(rig: Rig, session_id: str, wanted: int) -> None:
    """Resumes a session and returns when it has accepted `wanted` images."""
    rig.runner.act(session_id, Trigger.RESUME, "a")
    deadline = time.monotonic() + 300
    while sum(shot.quality.accepted for shot in rig.store.journal.shots(session_id)) < wanted:
        assert time.monotonic() < deadline, rig.store.journal.session(session_id)
        assert rig.store.journal.session(session_id).state is State.RUNNING, reason_of(rig, session_id)
        time.sleep(0.02)


def test_board_that_is_not_there_is_named_and_waited_for(rig: Rig) -> None:
    place("empty")
    session_id = paused(rig, BOARD)
    reason = reason_of(rig, session_id)
    assert reason["code"] == ErrorCode.CALIBRATION_TARGET_NOT_SEEN
    assert "is it mounted, lit and in focus" in reason["detail"]
    place("charuco@flange")
    images_after_resuming(rig, session_id, 2)


def test_arm_moved_by_hand_between_views_waits_for_a_person(rig: Rig) -> None:
    place("charuco@flange")
    rig.runner.state_tool("board", "a")
    session_id = new(rig, BOARD)
    images_of_start(rig, session_id)
    joints = list(rig.control.state()["joints"])
    rig.control.fault("protective_stop")
    wait_for(rig, session_id, State.INTERRUPTED)
    move_by_hand(rig, [joints[0] + 0.2, *joints[1:]])
    acknowledge(rig)
    assert refusal(rig, session_id).code is ErrorCode.ARM_ELSEWHERE
    taken = len(rig.store.journal.shots(session_id))
    rig.runner.act(session_id, Trigger.RESUME, "a", from_here=True)
    deadline = time.monotonic() + 300
    while len(rig.store.journal.shots(session_id)) < taken + 2:
        assert time.monotonic() < deadline, rig.store.journal.session(session_id)
        time.sleep(0.02)


def images_of_start(rig: Rig, session_id: str) -> None:
    rig.runner.act(session_id, Trigger.START, "a")
    deadline = time.monotonic() + 300
    while not rig.store.journal.shots(session_id):
        assert time.monotonic() < deadline, rig.store.journal.session(session_id)
        time.sleep(0.005)


def test_arm_that_is_not_where_it_says_is_noticed_by_repeated_view(rig: Rig) -> None:
    place("charuco@flange")
    rig.runner.state_tool("board", "a")
    session_id = new(rig, BOARD)
    images_of_start(rig, session_id)
    rig.control.fault("protective_stop")
    wait_for(rig, session_id, State.INTERRUPTED)
    acknowledge(rig)
    rig.control.fault("joint_offset", offsets_rad=[0.02, 0, 0, 0, 0, 0])
    rig.runner.act(session_id, Trigger.RESUME, "a")
    assert wait_for(rig, session_id, State.PAUSED, *ENDED, within_s=300) is State.PAUSED
    rig.control.fault("joint_offset", offsets_rad=[0.0] * 6)
    reason = reason_of(rig, session_id)
    assert reason["code"] == ErrorCode.SCENE_MOVED
    assert "the board or the camera has moved" in reason["detail"]
    images_after_resuming(rig, session_id, 2)


def test_sphere_that_is_not_there_is_named_and_waited_for(rig: Rig) -> None:
    place("empty")
    session_id = paused(rig, LAMP)
    reason = reason_of(rig, session_id)
    assert reason["code"] == ErrorCode.CALIBRATION_TARGET_NOT_SEEN
    place("mirror-sphere")
    images_after_resuming(rig, session_id, 2)


def test_lamp_that_is_off_is_named_and_waited_for(rig: Rig) -> None:
    place("mirror-sphere")
    rig.control.fault("lamp", fraction=0.0)
    session_id = paused(rig, LAMP)
    reason = reason_of(rig, session_id)
    rig.control.fault("lamp", fraction=1.0)
    assert reason["code"] == ErrorCode.CALIBRATION_TARGET_NOT_SEEN
    images_after_resuming(rig, session_id, 2)


@pytest.fixture
def slow_cell(tmp_path: Path) -> Path:
    """The cell with a camera whose shortest exposure time is twice the first view's, a thousand times a highlight's."""
    text = nominal.default_cell_file().read_text(encoding="utf-8")
    slow = f"[camera]\nmin_exposure_s = {2 * START_EXPOSURE_S}\n"
    file = tmp_path / "slow.toml"
    file.write_text(text.replace("[camera]\n", slow), encoding="utf-8")
    return file


def test_shortest_exposure_time_of_a_slow_camera(slow_cell: Path, tmp_path: Path) -> None:
    """Views of the board begin with it; a highlight that clips at it is named, and is no moved or missing target."""
    with simulated_rig(
        tmp_path, SLOW_CAMERA, cell_file=slow_cell, profile="realistic", shown="empty", pixels=512
    ) as rig:
        placing.place(SLOW_CAMERA, 30100, "charuco@flange")
        rig.runner.state_tool("board", "a")
        session_id = new(rig, BOARD)
        images_of_start(rig, session_id)
        (shot, *_) = rig.store.journal.shots(session_id)
        assert shot.quality.accepted
        assert shot.exposure_s >= 2 * START_EXPOSURE_S
        rig.runner.act(session_id, Trigger.STOP, "a")
        wait_for(rig, session_id, *ENDED)
        _keep_known(rig, tmp_path)
        rig.runner.choices.choose_calibration(KNOWN, "a")
        placing.place(SLOW_CAMERA, 30100, "mirror-sphere")
        reason = reason_of(rig, paused(rig, LAMP))
        assert reason["code"] == ErrorCode.CAPTURE_FRAME_REJECTED, reason
        assert "the highlight is clipped" in reason["detail"]
