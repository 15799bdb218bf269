"""Calibrations over HTTP: which there are, which is in use, what is refused, and the tool on the flange."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from acquisition.models.calibration import Calibration
from acquisition.models.calibration_recipe import CheckRecipe
from acquisition.models.calibration_result import AdjustmentValues, CalibrationSummary
from acquisition.models.calibration_set import CalibrationSet
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.recipe import Recipe
from acquisition.store.folder import write_value
from api import ProblemError
from tests.api.conftest import Running

ID = "20261123-120000-abcdef"


def keep(service: Running, folder: Path, camera: str = "sim 30100", **changed: object) -> Calibration:
    """A set as a session would have made it."""
    values = service.client.calibration().values.model_copy(update={"lobe_exponent": 1.25, **changed})
    folder.mkdir()
    write_value(folder / "calibration.json", values)
    summary = CalibrationSummary(kind="hand-eye", images=20, used=19, estimated=True, position_sigma_mm=0.3)
    made = CalibrationSet(
        id=ID, kind="hand-eye", fingerprint=values.fingerprint, before="0" * 64, made_at=values.made_at, version="0",
        width=values.width, height=values.height, camera=camera, arm="UR5 1", images={}, summary=summary,
    )  # fmt: skip
    service.service.store.calibrations.add(made, folder)
    return values


def test_chosen_calibration_is_used_and_survives_restart(start: Callable[..., Any], tmp_path: Path) -> None:
    with start() as service:
        values = keep(service, tmp_path / "made")
        before = service.client.calibration()
        listed = service.http.get("/v1/rig/calibrations").json()["items"]
        assert [(one["id"], one["active"], one["fits"]) for one in listed] == [("cell", True, ""), (ID, False, "")]
        assert service.client.create(Recipe()).calibration == before.fingerprint
        reach_file = service.service.runner.planning.reach_file
        assert service.client.activate_calibration(ID).values == values
        assert service.service.runner.planning.reach_file != reach_file
        assert service.client.create(Recipe()).calibration == values.fingerprint
    with start() as again:
        assert again.client.calibration().id == ID
        assert again.client.calibration().values == values
        assert again.http.get(f"/v1/rig/calibrations/{ID}/calibration.json").json()["lobe_exponent"] == 1.25
        assert again.client.activate_calibration("cell").fingerprint == before.fingerprint


def test_chosen_calibration_whose_folder_is_missing_is_named_at_start(
    start: Callable[..., Any], tmp_path: Path
) -> None:
    with start() as service:
        keep(service, tmp_path / "made")
        service.client.activate_calibration(ID)
        folder = service.service.store.data / "calibrations" / ID
    folder.rename(tmp_path / "elsewhere")

    with pytest.raises(RigError) as refused, start():
        pass

    assert refused.value.code is ErrorCode.STORE_CORRUPT  # its remedy: restore it from a backup
    assert str(folder) in refused.value.detail


def test_calibration_of_another_camera_is_refused_by_name(own: Running, tmp_path: Path) -> None:
    keep(own, tmp_path / "made", camera="pylon 4711", width=640)
    with pytest.raises(ProblemError) as refused:
        own.client.activate_calibration(ID)
    assert refused.value.problem.code is ErrorCode.CALIBRATION_DOES_NOT_FIT
    assert "640 × 1024" in refused.value.problem.detail
    assert "pylon 4711" in refused.value.problem.detail
    assert own.client.calibration().id == "cell"
    with pytest.raises(ProblemError) as unknown:
        own.client.activate_calibration("20000101-000000-000000")
    assert unknown.value.problem.code is ErrorCode.CALIBRATION_NOT_FOUND
    of_cell = own.http.get("/v1/rig/calibrations/cell/calibration.json")
    assert of_cell.json()["code"] == ErrorCode.CALIBRATION_NOT_FOUND
    assert "GET /v1/rig/calibration " in of_cell.json()["detail"]


@pytest.mark.parametrize(
    ("recipe", "said"),
    [
        ({"kind": "check", "target": "plane"}, "has no lobe.json"),
        ({"kind": "check", "target": "board"}, "states no covariance of camera, board and joints"),
        ({"kind": "lamp"}, "calibrate hand-eye first"),
    ],
)
def test_session_without_what_it_goes_on_from_is_not_created(own: Running, recipe: dict[str, str], said: str) -> None:
    """It would pause in its first step and hold the rig, and no resume would help."""
    refused = own.http.post("/v1/sessions", json=recipe)
    assert (refused.status_code, refused.json()["code"]) == (422, ErrorCode.CALIBRATION_INFEASIBLE)
    assert said in refused.json()["detail"]
    assert list(own.client.sessions()) == []
    assert list((own.settings.data / "sessions").iterdir()) == []


def test_check_of_a_set_no_longer_in_use_is_refused_at_start(own: Running, tmp_path: Path) -> None:
    """The cell file's calibration may have the same values, but it states no covariance."""
    before = own.client.calibration().values
    keep(own, tmp_path / "made", lobe_exponent=before.lobe_exponent)
    (f_x, _, c_x), (_, f_y, c_y), _ = before.camera_matrix
    basis = AdjustmentValues(
        camera=(f_x, f_y, c_x, c_y, 0.0, 0.0, 0.0, 0.0, 0.0), warp_m=(0.0, 0.0, 0.0),
        base_from_camera=before.base_from_camera, flange_from_board=before.base_from_camera, scale=0.0,
        joint_offsets_rad=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), covariance=(), corner_sigma_px=0.1, arm_sigma=(1e-4, 1e-4),
    )  # fmt: skip
    write_value(own.service.store.calibrations.folder(ID) / "basis.json", basis)
    own.client.activate_calibration(ID)
    made = own.client.create(CheckRecipe(kind="check"))
    own.client.activate_calibration("cell")
    own.client.state_tool("board")
    with pytest.raises(ProblemError, match="states no covariance") as refused:
        own.client.start(made.id)
    assert refused.value.code is ErrorCode.CALIBRATION_INFEASIBLE
    assert own.client.rig().holder is None


def test_session_of_another_tool_is_refused_at_start(start: Callable[..., Any]) -> None:
    with start() as service:
        assert service.client.rig().tool == "lamp"
        board = service.http.post("/v1/sessions", json={"kind": "camera"})
        assert board.status_code == 201
        refused = service.http.post(f"/v1/sessions/{board.json()['id']}/actions", json={"action": "start"})
        assert refused.json()["code"] == ErrorCode.RIG_OTHER_TOOL
        assert refused.json()["needed"] == "board"
        assert service.client.state_tool("board").tool == "board"
        capture = service.client.create(Recipe())
        with pytest.raises(ProblemError) as other:
            service.client.start(capture.id)
        assert other.value.problem.code is ErrorCode.RIG_OTHER_TOOL
    with start() as again:
        assert again.client.rig().tool == "board"


def test_recipe_of_a_calibration_is_checked(shared: Running) -> None:
    wrong = shared.http.post("/v1/sessions", json={"kind": "camera", "target_mm": 0.3})
    assert wrong.status_code == 422
    assert "hand-eye" in wrong.text
    made = shared.http.post("/v1/sessions", json={"kind": "hand-eye", "target_mm": 0.3}).json()
    assert made["recipe"]["kind"] == "hand-eye"
    assert made["stage"] == "plan"
    assert made["estimate"] is None
