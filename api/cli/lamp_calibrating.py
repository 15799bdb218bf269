"""`lightpose calibrate lamp`: the lamp's position in the tool's frame, from images of a mirror sphere."""

from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from acquisition.calibrate import highlight, lamp_position, lamp_results
from acquisition.calibrate.lamp_position import Highlight
from acquisition.models import cell_config
from acquisition.models.calibration import Calibration
from acquisition.models.calibration_result import LampResult
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import ErrorCode, RigError
from acquisition.store.folder import write_value
from acquisition.waypoints import measured_pose
from api.cli.calibration_folder import (
    JOINTS_FILE,
    images,
    read_hand_eye,
    read_joints,
    refuse_overwriting,
)


def calibrate_lamp(
    folder: Path, cell_file: Path, base: Path, hand_eye_file: Path, radius_mm: float, out: Path
) -> dict[str, Any]:
    """Calibrates the lamp's position from images of a mirror sphere of `radius_mm` and the arm's joints at each.

    `base` is a calibration.json with camera and `base_from_camera`; `hand_eye_file` is the hand_eye.json with the
    uncertainty of the latter. Writes `lamp.json` and `calibration.json`. Raises RigError folder.invalid,
    config.invalid, request.invalid and calibration.infeasible, before anything is written.
    """
    if not 1 <= radius_mm <= 200:
        raise RigError(ErrorCode.REQUEST_INVALID, f"--radius-mm {radius_mm:g}: give the sphere's radius, 1–200 mm")
    refuse_overwriting(out / "lamp.json", out / "calibration.json")
    cell, calibration = cell_config.load(cell_file), cell_config.load_calibration(base)
    hand_eye = read_hand_eye(hand_eye_file, calibration, base)
    used, why_not, hashes = _highlights(folder, cell, calibration)
    keep_out = cell.object.keep_out.base_from_object.matrix
    center = keep_out[:3, 3] + keep_out[:3, 2] * radius_mm / 1000
    window_m = 0.0 if cell.lamp_targets is None else cell.lamp_targets.window_radius_m
    found = lamp_position.fit(
        used, calibration, np.array(hand_eye.shared_covariance), radius_mm / 1000, center, window_m
    )
    result = lamp_results.lamp_result(found, used, why_not, hashes)
    out.mkdir(parents=True, exist_ok=True)
    changed = found.calibrated(calibration, hand_eye)
    write_value(out / "calibration.json", changed.model_copy(update={"made_at": result.made_at}))
    write_value(out / "lamp.json", result)
    _show(result)
    return result.model_dump(mode="json")


def _highlights(
    folder: Path, cell: CellConfig, calibration: Calibration
) -> tuple[list[Highlight], dict[str, str], dict[str, str]]:
    """Returns the highlights of a folder's images, why some have none, and all hashes, the latter two by name."""
    joints = read_joints(folder / JOINTS_FILE)
    used: list[Highlight] = []
    why_not: dict[str, str] = {}
    hashes: dict[str, str] = {}
    for image in images(folder, joints, calibration):
        hashes[image.name] = image.sha256
        spot = highlight.find(image.values, _clipped_from(image.values, calibration.sensor.bits))
        if isinstance(spot, str):
            why_not[image.name] = spot
        else:
            at = joints[image.name]
            tool = measured_pose.tools(at[None], cell.arm, calibration)[0]
            used.append(Highlight(image.name, spot.pixel, tool, measured_pose.by_offsets(at, cell.arm, calibration)))
    return used, why_not, hashes


def _clipped_from(values: np.ndarray, bits: int) -> float:
    """Returns the value at which an image clips: the sensor's `bits`, unless a 16-bit file is scaled up from these."""
    if values.dtype == np.uint8:
        return 255.0
    return float(2**bits - 1) if values.max() < 2**bits else 65535.0


def _show(result: LampResult) -> None:
    console = Console(stderr=True, markup=False)
    for one in result.images:
        if one.residual_px is None:
            console.print(f"{one.image}: {one.why_not}", style="yellow")
        else:
            console.print(f"{one.image}: {one.residual_px:.2f} px", style="dim")
    place = ", ".join(f"{1000 * value:.2f}" for value in result.tool_from_lamp_m)
    console.print(f"lamp at {place} mm in the tool's frame, known to {1000 * result.position_sigma_m:.2f} mm per axis")
