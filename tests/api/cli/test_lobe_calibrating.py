"""`lightpose calibrate lobe` on frames of the simulated cell, whose lamp is a LED that no calibration has made."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

from acquisition import geometry
from acquisition.calibrate.charuco import CharucoBoard
from acquisition.models import cell_config
from acquisition.models.base import as_matrix4
from acquisition.models.calibration_result import HandEyeResult, LampResult
from acquisition.models.errors import ErrorCode, RigError
from acquisition.waypoints import kinematics
from api.cli import lobe_calibrating
from hardware_sim import nominal, targets, true_cell
from hardware_sim.world import ExposureInterval, World
from tests.acquisition.calibrate.mirror_sphere import tools
from tests.acquisition.calibrate.test_lamp_lobe import ANGLES

PIXELS, SEED, EXPOSURE_S = 512, 3, 0.025
CELL = cell_config.load(nominal.default_cell_file())
TRUE = true_cell.perturbed(nominal.calibration(PIXELS), SEED)


def files(folder: Path) -> lobe_calibrating.LobeFiles:
    """What earlier calibrations found: the camera and the lamp's place as they are, intensity and lobe nominal."""
    known = nominal.calibration(PIXELS).model_copy(
        update={
            "camera_matrix": tuple(tuple(row) for row in TRUE.camera_matrix.tolist()),
            "base_from_camera": as_matrix4(TRUE.base_from_camera),
            "tool_from_lamp": as_matrix4(TRUE.tool_from_lamp),
        }
    )
    covariance = [[1e-8 * (a == b) for b in range(6)] for a in range(6)]
    stated: dict[str, Any] = {"made_at": "2026-11-23T00:00:00Z", "version": "1"}
    pose = HandEyeResult.model_validate(
        stated
        | {
            "base_from_camera": known.base_from_camera, "covariance": covariance, "position_sigma_m": 1e-4,
            "rotation_sigma_rad": 1e-4, "flange_from_board": as_matrix4(np.eye(4)), "square_scale": 1.0,
            "joint_offsets_rad": [0.0] * 6, "joint_offset_sigmas_rad": [0.0] * 6, "arm_sigma_m": 3e-5,
            "arm_sigma_rad": 3e-5, "views": [],
        }
    )  # fmt: skip
    lamp = LampResult.model_validate(
        stated
        | {
            "tool_from_lamp_m": TRUE.tool_from_lamp[:3, 3].tolist(), "position_sigma_m": 3e-4,
            "covariance": [[9e-8 * (a == b) for b in range(3)] for a in range(3)], "sphere_center_m": [0.55, 0.0, 0.03],
            "sphere_radius_m": 0.025, "highlight_sigma_px": 0.1, "images": [],
        }
    )  # fmt: skip
    plane = targets.PLANE
    board = CharucoBoard(
        columns=plane.columns, rows=plane.rows, square_m=plane.square_m, border_squares=plane.border_squares
    )
    for name, value in (("base", known), ("hand_eye", pose), ("lamp", lamp), ("plane", board)):
        (folder / f"{name}.json").write_text(value.model_dump_json(), encoding="utf-8")
    return lobe_calibrating.LobeFiles(
        nominal.default_cell_file(), *(folder / f"{name}.json" for name in ("base", "hand_eye", "lamp", "plane"))
    )


def write_images(folder: Path, placings: int, count: int) -> None:
    """Images of the plane in its first placings, by the simulated world."""
    lines = ["image,dark,exposure_s,placing,q1,q2,q3,q4,q5,q6"]
    for placing in range(placings):
        world = World(CELL, nominal.calibration(PIXELS), f"matt-plane#{placing}", SEED, "realistic", perturbed=True)
        made = 0
        for tool in tools(4 * count, 10 + placing, tilt_deg=38.0, slant_deg=55.0):
            flange = tool @ geometry.inverse(CELL.arm.flange_from_tool.matrix)
            solutions = kinematics.inverse(kinematics.arm_model("ur5e"), flange[None])[0]
            reached = solutions[np.isfinite(solutions).all(axis=1)]
            if not len(reached) or made == count:
                continue
            made += 1
            joints = reached[0] - TRUE.joint_offsets  # as the controller states them; the chain below is without
            name = f"{placing}{made:02}"
            for kind, level in (("lit", 1.0), ("dark", 0.0)):
                frame = world.frame([ExposureInterval(1.0, tuple(joints), level)], EXPOSURE_S, 0)
                tifffile.imwrite(folder / f"{name}_{kind}.tiff", frame)
            numbers = ",".join(f"{value:.9f}" for value in reached[0])
            lines.append(f"{name}_lit.tiff,{name}_dark.tiff,{EXPOSURE_S},{placing},{numbers}")
    (folder / "plane.csv").write_text("\n".join(lines), encoding="utf-8")


@pytest.mark.long
def test_calibrate_lobe_of_simulated_led_is_found_and_verified(tmp_path: Path) -> None:
    known = files(tmp_path)
    (tmp_path / "images").mkdir()
    write_images(tmp_path / "images", 3, 20)
    outcome = lobe_calibrating.calibrate_lobe(tmp_path / "images", known, 0.85, 0.002, tmp_path / "out")
    assert outcome["lamp_intensity"] == pytest.approx(TRUE.lamp_intensity, rel=0.005)
    found = cell_config.load_calibration(tmp_path / "out" / "calibration.json")
    from acquisition import photometry

    table = photometry.lobe_table(found.lobe)
    ahead = np.cos(ANGLES)
    lobe = ahead**found.lobe_exponent * np.interp(ahead, np.linspace(0, 1, len(table)), table)
    true = TRUE.lobe.relative(np.stack([0 * ANGLES, 0 * ANGLES, ahead], axis=1))
    assert lobe == pytest.approx(true, rel=0.01)
    assert outcome["verified_deg"] < 0.3
    assert (tmp_path / "out" / "lobe.png").stat().st_size > 1000
    assert json.loads((tmp_path / "out" / "lobe.json").read_text(encoding="utf-8")) == outcome
    with pytest.raises(RigError, match="overwritten"):
        lobe_calibrating.calibrate_lobe(tmp_path / "images", known, 0.85, 0.002, tmp_path / "out")


@pytest.mark.parametrize(
    ("name", "value", "elsewhere", "says"),
    [
        ("hand_eye", "base_from_camera", np.eye(4).tolist(), "place of the camera"),
        ("lamp", "tool_from_lamp_m", [0.0, 0.0, 0.1], "place of the lamp"),
    ],
)
def test_calibrate_lobe_of_another_calibration_is_refused(
    name: str, value: str, elsewhere: Any, says: str, tmp_path: Path
) -> None:
    known = files(tmp_path)
    other = json.loads((tmp_path / f"{name}.json").read_text(encoding="utf-8"))
    (tmp_path / f"{name}.json").write_text(json.dumps(other | {value: elsewhere}), encoding="utf-8")
    with pytest.raises(RigError, match=f"{name}.json: states another {says}"):
        lobe_calibrating.calibrate_lobe(tmp_path / "images", known, 0.85, 0.01, tmp_path / "out")


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("", "names no images"),
        ("a.png,b.png,0.1,flat,1,2,3", "line 1"),
        ("x\na,b,-1,flat,0,0,0,0,0,0", "line 2"),
        ("a,b,1,flat,0,90,0,0,0,0", "not in degrees"),
    ],
)
def test_calibrate_lobe_bad_plane_file_names_the_line(content: str, says: str, tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    (tmp_path / "images" / "plane.csv").write_text(content, encoding="utf-8")
    with pytest.raises(RigError, match=says) as caught:
        lobe_calibrating.calibrate_lobe(tmp_path / "images", files(tmp_path), 0.85, 0.01, tmp_path / "out")
    assert caught.value.code is ErrorCode.FOLDER_INVALID
    assert not (tmp_path / "out").exists()
