"""`lightpose check` reports every problem with its remedy in one run."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from acquisition.models import cell_config
from api.cli import checking
from api.cli.commands import app
from api.rest import keys
from api.rest.keys import Role
from hardware_sim import nominal, real_time_controller
from hardware_sim.controller.options import ControllerOptions

CELL_FILE = Path(__file__).parents[3] / "tests" / "data" / "cell.test.toml"
NOBODY, ARM = "127.0.15.30", "127.0.15.31"


def change(cell_file: Path, line: str, instead: str) -> None:
    """Replaces the first match of a pattern of lines in a cell file."""
    cell_file.write_text(re.sub(line, instead, cell_file.read_text(), count=1, flags=re.MULTILINE))


def test_check_several_problems_reports_all(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    nominal.write(tmp_path, NOBODY, 64, CELL_FILE)
    (tmp_path / "calibration.json").write_text('{"width": 64}')
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "keys.json").write_text("broken")

    assert not checking.check(tmp_path / "cell.toml", offline=False, data=tmp_path / "data")

    said = capsys.readouterr().out
    for wrong in ("keys.json", "calibration.json", "arm.unreachable", "camera.unreachable"):
        assert wrong in said
    assert said.count("what to do:") == said.count("WRONG") == 5  # the arm's calibration cannot be asked either


def test_check_unreadable_cell_file_reports_only_that(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "cell.toml").write_text("name = ")

    assert not checking.check(tmp_path / "cell.toml", offline=False)

    assert capsys.readouterr().out.count("WRONG config.invalid") == 1


def test_check_expired_calibration_is_reported_and_keys_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    nominal.write(tmp_path, NOBODY, 64, CELL_FILE)
    file = tmp_path / "calibration.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), "valid_days": 1.0}))
    keys.add(keys.path_in(tmp_path / "data"), "lab", Role.OPERATOR)

    assert not checking.check(tmp_path / "cell.toml", offline=True, data=tmp_path / "data")

    said = capsys.readouterr().out
    assert "calibration expired on 2026-11-02" in said
    assert "number of keys: 1" in said
    assert "positions on the dome" in said
    assert said.count("WRONG") == said.count("what to do:") == 1


@pytest.mark.parametrize(
    ("made_at", "home", "said"),
    [
        ("2026-11-30", None, "made_at: '2026-11-30' is not a date and time with a time zone"),
        ("2026-11-30T09:00:00", None, "is not a date and time with a time zone"),
        ("yesterday", None, "is not a date and time with a time zone"),
        (None, "[180.0, -90.0, 100.0, -100.0, -90.0, 90.0]", "arm.home: angles are in rad"),
        (None, "[3.14, -1.6, 1.8, -1.77, -1.57]", "arm.home.5: Field required"),
        (None, "[3.14, 0.6, 1.8, -1.77, -1.57, 1.57]", "Correct `home`"),
    ],
)
def test_check_wrong_value_is_one_finding_that_says_what_to_correct(
    made_at: str | None, home: str | None, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    nominal.write(tmp_path, NOBODY, 64, CELL_FILE)
    file, cell_file = tmp_path / "calibration.json", tmp_path / "cell.toml"
    if made_at is not None:
        file.write_text(json.dumps({**json.loads(file.read_text()), "made_at": made_at}))
    if home is not None:
        change(cell_file, r"^home = .*", f"home = {home}")

    assert not checking.check(cell_file, offline=True)

    out = capsys.readouterr().out
    assert said in out
    assert out.count("WRONG") == out.count("what to do:") == 1


def _mirrored(pose: list[list[float]]) -> list[list[float]]:
    return [[row[0], -row[1], *row[2:]] for row in pose[:3]] + pose[3:]


def _transposed(pose: list[list[float]]) -> list[list[float]]:
    return [list(column) for column in zip(*pose, strict=True)]


def _in_mm(pose: list[list[float]]) -> list[list[float]]:
    return [[*row[:3], 1000 * row[3]] for row in pose[:3]] + pose[3:]


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        ("base_from_camera", _mirrored, "base_from_camera mirrors"),
        ("base_from_camera", _transposed, "the last row of base_from_camera must be [0, 0, 0, 1]"),
        ("base_from_camera", _in_mm, "m before the camera, at pixel"),
        ("tool_from_lamp", _mirrored, "tool_from_lamp mirrors"),
        ("camera_matrix", _transposed, "camera_matrix must be [[f_x, 0, c_x], [0, f_y, c_y], [0, 0, 1]]"),
        ("camera_matrix", lambda matrix: [[0.0, *matrix[0][1:]], *matrix[1:]], "with f_x and f_y above 0"),
        ("width", lambda _: 0, "width: Input should be greater than 0"),
        ("valid_days", lambda _: 1e12, "valid_days: Input should be less than or equal to"),
        ("sensor", lambda sensor: sensor | {"black_level_dn": 5000.0}, "black_level_dn must be below 4095"),
    ],
)
def test_check_of_an_impossible_calibration_says_what_is_wrong(
    name: str, change: Callable[[Any], Any], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The arm reached lights for all of these, so that the check passed."""
    nominal.write(tmp_path, NOBODY, 64, CELL_FILE)
    file = tmp_path / "calibration.json"
    stated = json.loads(file.read_text())
    file.write_text(json.dumps(stated | {name: change(stated[name])}))

    assert not checking.check(tmp_path / "cell.toml", offline=True)

    out = capsys.readouterr().out
    assert said in out
    assert out.count("WRONG") == out.count("what to do:") == 1


@pytest.mark.parametrize(
    ("line", "instead", "said"),
    [
        (r"\[0.55, 0.0, 0.95\]\nend_m = .*", "[550, 0.0, 950]\nend_m = [550, 0.0, 1100]", "camera is never in the way"),
        (r"^point_m = .*", "point_m = [0, 0, -20]", "table is never in the way: 20.1 m from the arm"),
        (r"^radius_m = 0.45", "radius_m = 450", "the cell file, where lengths are in m"),
        (r"^radius_m = 0.085", "radius_m = 85", "the cell file, where lengths are in m"),
        (r"^radius_m = 0.45", "radius_m = 450", "too-far"),
    ],
)
def test_check_lengths_in_millimetres_are_named(
    line: str, instead: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    nominal.write(tmp_path, NOBODY, 64, CELL_FILE)
    cell_file = tmp_path / "cell.toml"
    assert checking.check(cell_file, offline=True)
    assert "in m" not in capsys.readouterr().out
    change(cell_file, line, instead)
    checking.check(cell_file, offline=True)
    assert said in capsys.readouterr().out


@pytest.mark.parametrize(
    ("line", "instead", "said"),
    [
        (
            "^flange_from_tool = .*",
            "flange_from_tool = { position_m = [0.0, 0.0, 0.1], rotation_vector_rad = [0.0, 105.0, 0.0] }",
            "not in degrees",
        ),
        (r"^\[dome\]$", "[dome]\nmin_slant_deg = 80", "min_slant_deg must be below max_slant_deg"),
        (r"^\[camera\]$", "[camera]\nmin_exposure_s = 2.0", "min_exposure_s must not be above max_exposure_s"),
    ],
)
def test_check_names_wrong_units_and_ranges(
    line: str, instead: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    nominal.write(tmp_path, NOBODY, 64, CELL_FILE)
    cell_file = tmp_path / "cell.toml"
    change(cell_file, line, instead)

    assert not checking.check(cell_file, offline=True)

    assert said in capsys.readouterr().out


@pytest.mark.parametrize(
    ("file", "content", "said"),
    [
        ("calibration.json", "{bad", "calibration.json: Invalid JSON"),
        ("cell.toml", None, "camera: `kind` must be one of 'sim', 'pylon'"),
    ],
)
def test_check_message_has_neither_empty_fields_nor_names_of_functions(
    file: str, content: str | None, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    nominal.write(tmp_path, NOBODY, 64, CELL_FILE)
    path = tmp_path / file
    path.write_text(content or path.read_text().replace("[camera]", '[camera]\nkind = "canon"'))

    assert not checking.check(tmp_path / "cell.toml", offline=True)

    assert said in capsys.readouterr().out


def test_check_other_arm_reports_each_difference(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    nominal.write(tmp_path, ARM, 64, CELL_FILE)
    cell_file = tmp_path / "cell.toml"
    change(cell_file, r'^model = "ur5e"', 'model = "ur5e"\nserial = "12345"')
    (tmp_path / "calibration.json").unlink()
    with real_time_controller.start(ARM, ControllerOptions(model="ur10e", home=cell_config.load(cell_file).arm.home)):
        assert not checking.check(cell_file, offline=False)

    said = capsys.readouterr().out
    assert "ok    arm: UR10" in said
    assert "The arm is a UR10, the cell file says ur5e." in said
    assert "the cell file says 12345." in said
    assert "put the arm's own under [arm]:\nkinematics = [\n" in said
    assert "camera.unreachable" in said


def test_check_takes_the_data_folder_from_the_environment(tmp_path: Path) -> None:
    """As the service does: its keys may be broken, which nobody sees if another folder is checked, or none."""
    nominal.write(tmp_path, NOBODY, 64, CELL_FILE)
    keys.path_in(tmp_path).write_text("{")
    arguments = ["check", "--offline", "--cell", str(tmp_path / "cell.toml")]
    done = CliRunner().invoke(app, arguments, env={"LIGHTPOSE_DATA": str(tmp_path)})
    assert done.exit_code == 1
    assert str(keys.path_in(tmp_path)) in done.output
