"""`lightpose calibrate …` on folders of rendered images: results, files, and what is refused."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from acquisition.models import cell_config
from acquisition.models.calibration_result import CameraResult, HandEyeResult
from api.cli.commands import app
from tests.acquisition.calibrate import synthetic

ROOT = Path(__file__).parents[3]
CELL = ROOT / "hardware_sim" / "cells" / "cell.sim.toml"
BASE = ROOT / "hardware_sim" / "cells" / "calibration.sim.json"
SIZE = (640, 480)
KNOWN = replace(
    synthetic.truth(1),
    camera=np.array([1680.0, 1682.0, 322.0, 236.0, -0.1, 0.12, 4e-4, -3e-4, 0.0]),
    warp=np.zeros(2),
    scale=0.0,
)


def lightpose(*arguments: object) -> tuple[int, str]:
    done = CliRunner().invoke(app, [str(argument) for argument in arguments])
    return done.exit_code, done.output


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight images of the board on the flange, one of an empty table, joints and the board's description."""
    made = tmp_path_factory.mktemp("views")
    joints = synthetic.joints_of(KNOWN, 8, 1)
    lines = ["image,q1,q2,q3,q4,q5,q6"]
    for number, pose in enumerate(synthetic.camera_from_boards(KNOWN, joints, 1)):
        cv2.imwrite(str(made / f"{number}.png"), synthetic.image(KNOWN, pose, SIZE))
        lines.append(f"{number}.png," + ",".join(f"{value:.9f}" for value in joints[number]))
    cv2.imwrite(str(made / "empty.png"), np.full(SIZE[::-1], 90, np.uint8))
    lines.append("empty.png,0,0,0,0,0,0")
    (made / "joints.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (made / "board.json").write_text(synthetic.BOARD.model_dump_json(), encoding="utf-8")
    return made


def test_board_is_drawn_and_described(tmp_path: Path) -> None:
    code, output = lightpose("calibrate", "board", "--out", tmp_path / "board.pdf", "--square-mm", 15)
    assert code == 0, output
    assert (tmp_path / "board.pdf").read_bytes().startswith(b"%PDF")
    assert json.loads((tmp_path / "board.json").read_text(encoding="utf-8"))["square_m"] == 0.015
    code, output = lightpose("calibrate", "board", "--out", tmp_path / "board.pdf")
    assert code == 2
    assert "is not overwritten" in output
    code, output = lightpose("calibrate", "board", "--out", tmp_path / "other.pdf", "--square-mm", 0)
    assert code == 2
    assert "--square-mm" in output
    code, output = lightpose("calibrate", "board", "--out", tmp_path / "new" / "board.svg")
    assert code == 0, output
    assert (tmp_path / "new" / "board.json").exists()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--columns", 22, "--rows", 24), "264 markers"),
        (("--border", 4), "--border 4: it leaves no blank middle"),
        (("--border", -1), "--border: "),
    ],
)
def test_board_of_impossible_squares_is_refused(options: tuple[object, ...], says: str, tmp_path: Path) -> None:
    code, output = lightpose("calibrate", "board", "--out", tmp_path / "board.pdf", *options)
    assert code == 2
    assert says in output
    assert not (tmp_path / "board.pdf").exists()


@pytest.mark.parametrize(
    ("address", "says"), [("http://127.0.0.1:9", "does not answer"), ("127.0.0.1:9", "address is not valid")]
)
def test_service_that_does_not_answer_is_named(address: str, says: str) -> None:
    code, output = lightpose("calibrate", "check", "--address", address)
    assert code == 2
    assert says in output


def test_folder_that_is_not_there_is_named(folder: Path, tmp_path: Path) -> None:
    code, output = lightpose("calibrate", "camera", tmp_path / "none", "--board", folder / "board.json")
    assert code == 2
    assert "is not a folder" in output


def test_folder_beside_an_address_is_refused(tmp_path: Path) -> None:
    code, output = lightpose("calibrate", "camera", tmp_path, "--address", "http://127.0.0.1:9")
    assert code == 2
    assert "not both" in output


def test_results_where_a_file_is_are_refused_without_traceback(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    code, output = lightpose(
        "calibrate", "camera", folder, "--board", folder / "board.json", "--out", tmp_path / "file"
    )
    assert code == 2
    assert "cannot be read or written" in output


def test_hand_eye_of_folder_finds_camera_and_pose(folder: Path, tmp_path: Path) -> None:
    out, candidates = tmp_path / "found", tmp_path / "candidates.csv"
    wanted = synthetic.joints_of(KNOWN, 1, 99)[0]
    lines = ["away,0,0,0,0,0,0", "tilted," + ",".join(map(str, wanted))]
    candidates.write_text("\n".join(lines), encoding="utf-8")
    code, output = lightpose(
        "calibrate", "hand-eye", folder, "--cell", CELL, "--board", folder / "board.json", "--out", out, "--base", BASE,
        "--candidates", candidates, "--json",
    )  # fmt: skip
    assert code == 0, output
    assert "empty.png: the board is not seen" in output
    found = HandEyeResult.model_validate_json((out / "hand_eye.json").read_bytes())
    assert json.loads(output.splitlines()[-1]) == found.model_dump(mode="json") | {"next_view": "tilted"}
    assert "take next: tilted" in output
    pose = np.array(found.base_from_camera)
    assert np.linalg.norm(pose[:3, 3] - KNOWN.base_from_camera[:3, 3]) < 3 * found.position_sigma_m + 1e-3
    assert found.position_sigma_m < 2e-3
    camera = CameraResult.model_validate_json((out / "camera.json").read_bytes())
    assert camera.camera_matrix[0][0] == pytest.approx(1680, rel=4e-3)
    assert [view.rms_px is None for view in camera.views] == [False] * 8 + [True]
    calibration = cell_config.load_calibration(out / "calibration.json")
    assert (calibration.width, calibration.height) == SIZE
    assert calibration.base_from_camera == found.base_from_camera
    assert calibration.lamp_intensity == cell_config.load_calibration(BASE).lamp_intensity
    picture = cv2.imread(str(out / "projection_sigma.png"))
    assert picture is not None
    assert picture.std() > 10
    code, output = lightpose("calibrate", "camera", folder, "--board", folder / "board.json", "--out", out)
    assert code == 2
    assert "camera.json exists and is not overwritten" in output


def test_hand_eye_with_lines_of_joints_exchanged_is_refused(folder: Path, tmp_path: Path) -> None:
    given = tmp_path / "given"
    shutil.copytree(folder, given)
    lines = (given / "joints.csv").read_text(encoding="utf-8").splitlines()
    (first, *one), (second, *other) = lines[3].split(","), lines[8].split(",")
    lines[3], lines[8] = ",".join([first, *other]), ",".join([second, *one])
    (given / "joints.csv").write_text("\n".join(lines), encoding="utf-8")
    code, output = lightpose(
        "calibrate", "hand-eye", given, "--cell", CELL, "--board", given / "board.json", "--out", tmp_path / "out"
    )
    assert code == 2
    assert "joints.csv" in output
    assert first in output or second in output
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda path: (path / "joints.csv").unlink(), "joints.csv: is missing"),
        (lambda path: (path / "joints.csv").write_text("0.png,1,2,3\n"), "line 1: write six joint angles"),
        (lambda path: (path / "joints.csv").write_text("0.png,0,0,0,0,0,0\nno.png,0,0,0,0,0,0\n"), "names no.png"),
        (lambda path: (path / "joints.csv").write_text("empty.png,0,0,0,0,0,0\n"), "states no joints for 0.png"),
        (lambda path: (path / "0.png").write_bytes(b"no image"), "0.png: is not an image"),
        (lambda path: cv2.imwrite(str(path / "0.png"), np.zeros((9, 9), np.uint8)), "pixels, but the first image has"),
        (
            lambda path: (path / "joints.csv").write_text("0.png,0,90,0,0,0,0\nempty.png,0,0,0,0,0,0\n"),
            "line 1: no joint turns by 90 rad",
        ),
        (
            lambda path: (path / "board.json").write_text("{}"),
            "description of a board: columns: Field required; rows: Field required",
        ),
        (
            lambda path: (path / "0.png").write_bytes((path / "empty.png").read_bytes()),
            "none of its 2 images shows the board",
        ),
        (lambda path: [one.unlink() for one in path.glob("*.png")], "holds no images"),
    ],
)
def test_bad_folder_is_refused_by_name(change: object, says: str, folder: Path, tmp_path: Path) -> None:
    given = tmp_path / "given"
    given.mkdir()
    for name in ("0.png", "empty.png", "joints.csv", "board.json"):
        (given / name).write_bytes((folder / name).read_bytes())
    lines = (given / "joints.csv").read_text(encoding="utf-8").splitlines()
    (given / "joints.csv").write_text("\n".join([lines[1], lines[-1]]), encoding="utf-8")
    change(given)  # type: ignore[operator]
    arguments = ("--cell", CELL, "--board", given / "board.json", "--out", tmp_path / "out")
    code, output = lightpose("calibrate", "hand-eye", given, *arguments)
    assert code == 2
    assert says in output.replace("\n", " ")
    assert not (tmp_path / "out").exists()
