"""`lightpose calibrate lamp` on a folder of images of a highlight: result, files, and what is refused."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from acquisition import geometry
from acquisition.calibrate import lamp_position
from acquisition.models import cell_config
from acquisition.models.base import as_matrix4
from acquisition.models.calibration_result import HandEyeResult, LampResult
from acquisition.waypoints import kinematics
from api.cli.commands import app
from tests.acquisition.calibrate import mirror_sphere as sphere

ROOT = Path(__file__).parents[3]
CELL = ROOT / "hardware_sim" / "cells" / "cell.sim.toml"
BASE = ROOT / "hardware_sim" / "cells" / "calibration.sim.json"
KNOWN = sphere.truth(5)


def lightpose(folder: Path, out: Path, radius_mm: float = 1000 * sphere.RADIUS_M) -> tuple[int, str]:
    arguments = [folder, "--cell", CELL, "--base", BASE, "--hand-eye", folder / "hand_eye.json", "--out", out, "--json"]
    done = CliRunner().invoke(app, ["calibrate", "lamp", *map(str, arguments), "--radius-mm", str(radius_mm)])
    return done.exit_code, done.output


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Highlights of a displaced lamp at joints that the arm reaches, one dark image, joints, and a hand-eye result."""
    made = tmp_path_factory.mktemp("sphere")
    model, flange_from_tool = kinematics.arm_model("ur5e"), cell_config.load(CELL).arm.flange_from_tool.matrix
    tools = sphere.tools(60, 5)
    solutions = kinematics.inverse(model, tools @ geometry.inverse(flange_from_tool))
    reached = [n for n in range(len(tools)) if np.isfinite(solutions[n]).all(axis=1).any()][:20]
    joints = [next(one for one in solutions[n] if np.isfinite(one).all()) for n in reached]
    lines: list[str] = []
    v, u = np.mgrid[:1024, :1024].astype(np.float32)
    for number, (seen, six) in enumerate(zip(sphere.highlights(KNOWN, tools[reached], 5), joints, strict=True)):
        light = 2500 * np.exp(-((u - seen.pixel[0]) ** 2 + (v - seen.pixel[1]) ** 2) / (2 * 1.8**2))
        cv2.imwrite(str(made / f"{number}.png"), (64 + light).astype(np.uint16))
        lines.append(f"{number}.png," + ",".join(f"{value:.9f}" for value in six))
    cv2.imwrite(str(made / "dark.png"), np.full((1024, 1024), 64, np.uint16))
    (made / "joints.csv").write_text("\n".join([*lines, "dark.png,0,0,0,0,0,0"]), encoding="utf-8")
    hand_eye = HandEyeResult(
        made_at="2026-11-23T00:00:00Z", version="0",
        base_from_camera=cell_config.load_calibration(BASE).base_from_camera,
        covariance=tuple(map(tuple, sphere.POSE_COVARIANCE.tolist())), position_sigma_m=1e-4, rotation_sigma_rad=1e-4,
        flange_from_board=as_matrix4(np.eye(4)), square_scale=1.0, joint_offsets_rad=(0.0,) * 6,
        joint_offset_sigmas_rad=(0.0,) * 6, arm_sigma_m=0.0, arm_sigma_rad=0.0, views=(),
    )  # fmt: skip
    (made / "hand_eye.json").write_text(hand_eye.model_dump_json(), encoding="utf-8")
    return made


def test_lamp_of_folder_is_found_and_written(folder: Path, tmp_path: Path) -> None:
    code, output = lightpose(folder, tmp_path / "out")
    assert code == 0, output
    found = LampResult.model_validate_json((tmp_path / "out" / "lamp.json").read_bytes())
    assert json.loads(output.splitlines()[-1]) == found.model_dump(mode="json")
    error = np.array(found.tool_from_lamp_m) - KNOWN.lamp_m
    assert np.linalg.norm(error) < 2e-3
    assert error @ np.linalg.solve(np.array(found.covariance), error) < 16.3  # 99.9 % of three degrees of freedom
    assert [image.image for image in found.images if image.residual_px is None] == ["dark.png"]
    assert "dark.png: no highlight" in output
    calibration = cell_config.load_calibration(tmp_path / "out" / "calibration.json")
    assert np.array(calibration.tool_from_lamp)[:3, 3] == pytest.approx(found.tool_from_lamp_m)
    assert calibration.tool_from_lamp_covariance == found.covariance
    assert calibration.lamp_position_sigma_m == lamp_position.ARM_REPEATABILITY_M  # the arm of this folder is perfect
    code, output = lightpose(folder, tmp_path / "out")
    assert code == 2
    assert "is not overwritten" in output


def test_lamp_bad_input_is_refused_and_nothing_written(folder: Path, tmp_path: Path) -> None:
    few = tmp_path / "few"
    few.mkdir()
    for name in ("0.png", "1.png", "hand_eye.json"):
        (few / name).write_bytes((folder / name).read_bytes())
    lines = (folder / "joints.csv").read_text(encoding="utf-8").splitlines()[:2]
    (few / "joints.csv").write_text("\n".join(lines), encoding="utf-8")
    for radius_mm, says in ((25.0, "2 highlights: 8 are needed"), (0.0, "--radius-mm")):
        code, output = lightpose(few, tmp_path / "out", radius_mm)
        assert code == 2
        assert says in output
    other = json.loads((few / "hand_eye.json").read_text(encoding="utf-8"))
    other["base_from_camera"][2][3] += 1e-4
    (few / "hand_eye.json").write_text(json.dumps(other), encoding="utf-8")
    assert "states another place of the camera" in lightpose(few, tmp_path / "out")[1]
    (few / "hand_eye.json").write_text("{}", encoding="utf-8")
    assert "is not a valid hand_eye.json" in lightpose(few, tmp_path / "out")[1]
    assert not (tmp_path / "out").exists()
