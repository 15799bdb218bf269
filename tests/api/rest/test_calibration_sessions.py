"""Calibration sessions over HTTP: kinds and their ages, the board in the live image, planned views, estimates."""

import time
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from acquisition.calibrate import board_view, charuco
from acquisition.formats.frames import FolderFrames
from acquisition.models.calibration_check import CheckResult, PartTest
from acquisition.models.calibration_recipe import BoardRecipe
from acquisition.models.calibration_result import CalibrationSummary
from acquisition.models.light_plan import Light, LightPlan
from acquisition.models.shot import FrameQuality, Observations, Shot, ShotKey
from acquisition.runner import calibration_checks
from acquisition.runner.board_jobs import board_poses
from acquisition.session_state import Trigger
from acquisition.store.folder import write_frame, write_manifest, write_value
from acquisition.waypoints import mounted_tool
from tests.api.conftest import Running
from tests.api.rest.test_calibrations import ID, keep

JOINTS = (3.0, -1.2, 1.5, -0.9, -1.4, 0.2)
LIGHT = Light(position=(0.0, 0.1, -0.5), axis=(0.0, 0.0, -1.0))
SQUARE_PX = 24


def board_session(service: Running) -> str:
    made = service.http.post("/v1/sessions", json={"kind": "hand-eye", "target_mm": 0.3})
    assert made.status_code == 201
    return str(made.json()["id"])


def drawn_board(service: Running) -> np.ndarray:
    """A frame that shows the cell's board, and nothing else."""
    board = charuco.of_cell(mounted_tool.require_board(service.service.cell))
    squares = board.opencv().generateImage((board.columns * SQUARE_PX, board.rows * SQUARE_PX))
    return 64 + 14 * np.pad(squares, 40, constant_values=255).astype(np.uint16)


def take(service: Running, session_id: str, number: int, pixels: np.ndarray) -> None:
    folder = service.service.store.folder(session_id)
    frame = write_frame(folder, f"passes/0/shots/{number}.tiff", pixels)
    quality = FrameQuality(saturated=0.0, bright_level=0.5, accepted=True)
    shot = Shot(
        key=ShotKey(pass_number=0, number=number), kind="light", frame=frame, exposure_s=0.1, light_number=number,
        taken_at=time.time(), quality=quality,
    )  # fmt: skip
    service.service.store.journal.add_shot(session_id, shot)


def test_calibration_kinds_name_recipe_tool_and_age(own: Running, tmp_path: Path) -> None:
    keep(own, tmp_path / "made")
    kinds = {one["kind"]: one for one in own.http.get("/v1/rig/calibration-kinds").json()["items"]}
    schemas = own.http.get("/openapi.json").json()["components"]["schemas"]
    assert {"camera", "hand-eye"} <= set(kinds)
    for kind, one in kinds.items():
        field = schemas[one["recipe"]]["properties"]["kind"]
        assert kind in field.get("enum", [field.get("const")])
        assert one["tool"] in ("lamp", "board")
        assert one["explanation"]
    assert kinds["camera"]["calibration"] is None
    assert kinds["camera"]["age_days"] is None
    assert kinds["hand-eye"]["calibration"] == ID
    assert kinds["hand-eye"]["age_days"] > 0


@pytest.mark.parametrize("shows_board", [True, False])
def test_preview_target_is_found_in_frame_or_says_why(own: Running, shows_board: bool) -> None:
    session_id = board_session(own)
    own.service.store.journal.trigger(session_id, Trigger.START, "test")
    pixels = drawn_board(own)
    take(own, session_id, 0, pixels if shows_board else np.full_like(pixels, 900))
    found = own.http.get("/v1/rig/preview/target").json()
    board = mounted_tool.require_board(own.service.cell)
    assert (found["height_px"], found["width_px"]) == pixels.shape
    assert found["corners"] == (board.columns - 1) * (board.rows - 1)
    assert found["seen"] is shows_board
    assert len(found["corners_px"]) == (found["corners"] if shows_board else 0)
    assert ("10 mm" in found["why_not"]) is not shows_board
    if shows_board:
        first = np.array(sorted(map(tuple, found["corners_px"])))[0]
        assert first == pytest.approx([40 + SQUARE_PX - 0.5] * 2, abs=0.1)


def test_planned_views_show_next_board_where_arm_holds_it(own: Running) -> None:
    session_id = board_session(own)
    address = f"/v1/sessions/{session_id}/passes/0/views"
    assert own.http.get(address).status_code == 404
    store = own.service.store
    folder = store.folder(session_id)
    plan = LightPlan(lights=[LIGHT] * 2, method="views", reasons=["first", "second"], joints=[JOINTS] * 2)
    digest = write_value(folder / "passes/0/plan.json", plan)
    store.journal.add_artifact(session_id, "plan", 0, "passes/0/plan.json", digest, {}, "plan.ready")
    assert own.http.get(address).json()["next"] is None  # no route yet: which one is taken first is not known
    store.journal.add_artifact(session_id, "route", 0, "passes/0/route.json", digest, {"order": [1, 0]}, "x.ready")
    take(own, session_id, 1, drawn_board(own))
    planned = own.http.get(address).json()
    calibration = own.service.calibration
    expected = board_view.expected(JOINTS, own.service.cell, calibration)
    assert expected is not None
    assert (planned["width_px"], planned["height_px"]) == (calibration.width, calibration.height)
    assert planned["next"] == 0
    assert planned["estimate"] is None
    assert [(one["reason"], one["taken"]) for one in planned["views"]] == [("first", False), ("second", True)]
    assert planned["views"][0]["view"] == expected.model_dump(mode="json")


@pytest.mark.long
@pytest.mark.timeout(1_200)
def test_foreseen_views_are_those_that_a_session_plans(own: Running) -> None:
    recipe = {"kind": "hand-eye", "max_images": 12}
    foreseen = own.http.post("/v1/dry-runs/views", json=recipe, timeout=600)
    assert foreseen.status_code == 200, foreseen.text
    views = foreseen.json()["views"]
    assert [one["number"] for one in views] == list(range(8))
    assert all(one["view"]["corners"] == len(one["view"]["corners_px"]) for one in views[:4])  # wholly in the image
    plan = board_poses(
        BoardRecipe(kind="hand-eye", max_images=12),
        own.service.cell,
        own.service.calibration,
        Observations.of((), FolderFrames(Path())),
        None,
    )
    expected = [board_view.expected(joints, own.service.cell, own.service.calibration) for joints in plan.joints or []]
    assert [one["view"] for one in views] == [one.model_dump(mode="json") for one in expected if one is not None]
    assert own.http.get("/v1/sessions").json()["items"] == []


def test_foreseen_views_of_other_recipe_are_refused_by_name(own: Running) -> None:
    refused = own.http.post("/v1/dry-runs/views", json={"kind": "lamp"})
    assert refused.status_code == 422
    assert "kind" in {one["field"] for one in refused.json()["errors"]}


def test_estimates_are_listed_with_their_files(own: Running) -> None:
    session_id = board_session(own)
    address = f"/v1/sessions/{session_id}/estimates"
    assert own.http.get(address).json()["items"] == []
    store = own.service.store
    folder = store.folder(session_id) / "estimates/0"
    folder.mkdir(parents=True)
    (folder / "hand_eye.json").write_text('{"views": [{"image": "a.tiff", "rms_px": 0.05}]}')
    digest = write_manifest(folder, {"number": 0})
    summary = CalibrationSummary(kind="hand-eye", images=8, used=7, estimated=True, position_sigma_mm=0.4)
    body = {**summary.model_dump(mode="json"), "seconds": 2.0, "passes": [0]}
    store.journal.add_artifact(session_id, "estimate", 0, "estimates/0/manifest.json", digest, body, "estimate.ready")
    (made,) = own.http.get(address).json()["items"]
    assert made["summary"]["position_sigma_mm"] == 0.4
    href = {one["name"]: one["href"] for one in made["artefacts"]}["hand_eye.json"]
    assert own.http.get(href).json()["views"][0]["rms_px"] == 0.05
    assert own.http.get(f"{address}/0/journal.sqlite").status_code == 404
    assert own.http.get(f"{address}/1/hand_eye.json").status_code == 404
    assert own.http.get("/v1/sessions/20000101-000000-000000/estimates").status_code == 404


def test_rig_states_check_of_calibration_in_use_with_age(own: Running, tmp_path: Path) -> None:
    before = own.http.get("/v1/rig").json()["calibration"]["check"]
    assert before["checks"] == {}
    assert "a daily check is suggested" in before["warnings"][0]
    test = PartTest(
        name="camera", change=(1e-3,), sigma=(1e-4,), chi_square=100.0, freedom=1, probability=0.0, sentence="by 1 mm"
    )
    found = CheckResult(
        target="board", made_at=datetime.now(UTC).isoformat(), version="1", passed=False, probability=0.0,
        fingerprint=own.service.calibration.fingerprint, false_alarm=0.01, changed=(test,), tests=(test,), worst="a",
        images=(), advice=(),
    )  # fmt: skip
    (tmp_path / "check.json").write_text(found.model_dump_json())
    calibration_checks.record(own.service.store, "20261123-080000-000000", tmp_path)
    after = own.http.get("/v1/rig").json()["calibration"]["check"]
    assert after["checks"]["board"]["changed"] == ["camera"]
    assert 0 <= after["ages_h"]["board"] < 0.1
    assert "by 1 mm" in after["warnings"][0]
    kinds = {one["kind"]: one for one in own.http.get("/v1/rig/calibration-kinds").json()["items"]}
    assert kinds["check"]["age_days"] == pytest.approx(0, abs=0.01)
