"""`lightpose calibrate lobe`: the lamp's intensity and lobe, from images of a matt plane in a ChArUco frame."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from acquisition.calibrate import charuco, lamp_lobe, lamp_results, matt_plane, plane_shading
from acquisition.calibrate.board_results import now
from acquisition.calibrate.charuco import CharucoBoard, View
from acquisition.calibrate.plane_shading import Known, Placing, PlaneImage
from acquisition.formats.folders.refusal import refusal, text
from acquisition.models import cell_config
from acquisition.models.base import FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.calibration_result import LobeResult
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.rounding import percent
from acquisition.store.folder import sha256_of, write_value
from acquisition.waypoints import measured_pose
from api.cli.calibration_folder import (
    read_grey,
    read_hand_eye,
    read_lamp,
    read_value,
    refuse_degrees,
    refuse_overwriting,
)

PLANE_FILE = "plane.csv"
"""File in the folder of images: for each a line with image, lamp-off image, exposure time, placing, six joints."""


@dataclass(frozen=True)
class LobeFiles:
    """The input files: cell file, calibration.json to start from, hand_eye.json, lamp.json, board.json of the plane."""

    cell: Path
    base: Path
    hand_eye: Path
    lamp: Path
    board: Path


@dataclass(frozen=True)
class _Shot:
    image: str
    dark: str
    exposure_s: float
    placing: str
    joints: FloatArray


def calibrate_lobe(folder: Path, files: LobeFiles, albedo: float, albedo_sigma: float, out: Path) -> dict[str, Any]:
    """Calibrates the lamp's intensity and lobe from images of a matt plane of known `albedo` in two or more placings.

    The last of several placings in `plane.csv` is held out and verifies the result. Writes `lobe.json`, `lobe.png` and
    `calibration.json`. Raises RigError folder.invalid, config.invalid, request.invalid and calibration.infeasible,
    before anything is written.
    """
    if not 0.05 <= albedo <= 1 or not 0 <= albedo_sigma <= 0.5:
        raise RigError(ErrorCode.REQUEST_INVALID, "give --albedo between 0.05 and 1, --albedo-sigma between 0 and 0.5")
    refuse_overwriting(*(out / name for name in ("lobe.json", "lobe.png", "calibration.json")))
    cell, calibration = cell_config.load(files.cell), cell_config.load_calibration(files.base)
    board = read_value(files.board, CharucoBoard, "description of a board")
    hand_eye = read_hand_eye(files.hand_eye, calibration, files.base)
    lamp = read_lamp(files.lamp, calibration, files.base)
    shots = _shots(folder / PLANE_FILE)
    names = list(dict.fromkeys(shot.placing for shot in shots))
    frames = {
        shot.image: (read_grey(folder / shot.image, calibration), read_grey(folder / shot.dark, calibration))
        for shot in shots
    }
    placings = [_placing(name, shots, frames, board, calibration) for name in names]
    images: list[PlaneImage] = []
    for shot in shots:
        number = names.index(shot.placing)
        tool = measured_pose.tools(shot.joints[None], cell.arm, calibration)[0]
        seen = matt_plane.patches(
            shot.image, *frames[shot.image], shot.exposure_s, (number, placings[number]), tool, board, calibration
        )
        images.append(plane_shading.usable(seen, placings[number], calibration))
    last = len(placings) - 1
    fitted = [one for one in images if len(one.values) and (last == 0 or one.placing < last)]
    known = Known(
        calibration, albedo, albedo_sigma, np.array(lamp.covariance), np.array(hand_eye.covariance), board.size_m
    )
    found = lamp_lobe.fit(fitted, placings[:last] if last else placings, known)
    after = found.calibrated(calibration).model_copy(update={"made_at": now()})
    unused = [one for one in images if last and one.placing == last]
    verified = lamp_lobe.normal_error_deg(unused, placings[last], after, found.flat_field) if unused else None
    hashes = {one.name: sha256_of(folder / one.name) for one in images}
    result = lamp_results.lobe_result(found, images, fitted, hashes, verified, calibration.sensor.full_scale_dn)
    out.mkdir(parents=True, exist_ok=True)
    lamp_results.draw_lobe(found, calibration, out / "lobe.png")
    write_value(out / "calibration.json", after)
    write_value(out / "lobe.json", result)
    _show(result)
    return result.model_dump(mode="json")


def _shots(path: Path) -> list[_Shot]:
    """Reads `plane.csv`. Raises RigError folder.invalid naming the line."""
    shots: list[_Shot] = []
    for number, line in enumerate((one for one in csv.reader(text(path).splitlines()) if one), 1):
        try:
            image, dark, exposure, placing, *joints = (value.strip() for value in line)
            numbers = np.array([float(value) for value in (exposure, *joints)])
        except ValueError as error:
            if number == 1:
                continue  # the names of the columns
            raise refusal(path, f"line {number}: give image, dark, exposure_s, placing and six joints") from error
        if len(numbers) != 7 or not np.isfinite(numbers).all() or numbers[0] <= 0:
            raise refusal(path, f"line {number}: give an exposure time above 0 s and six joints in rad")
        refuse_degrees(path, number, numbers[1:])
        shots.append(_Shot(image, dark, float(numbers[0]), placing, numbers[1:]))
    if not shots:
        raise refusal(path, "names no images")
    return shots


def _placing(
    name: str, shots: Sequence[_Shot], frames: dict[str, tuple[np.ndarray, np.ndarray]], board: CharucoBoard,
    calibration: Calibration,
) -> Placing:  # fmt: skip
    views = [charuco.detect(frames[shot.image][0], board, shot.image) for shot in shots if shot.placing == name]
    seen: list[View] = [view for view in views if view is not None]
    if not seen:
        raise RigError(
            ErrorCode.CALIBRATION_INFEASIBLE,
            f"No image of placing {name} shows the plane's frame: check its description, focus and exposure",
        )
    return matt_plane.placing(seen, board, calibration)


def _show(result: LobeResult) -> None:
    console = Console(stderr=True, markup=False)
    console.print(
        f"intensity {result.lamp_intensity:.3f} full scales per second, known to {percent(result.intensity_sigma, 2)}"
        f"; {len(result.lobe.knots_rad)} knots to {np.degrees(result.lobe.knots_rad[-1]):.0f}°; images differ by "
        f"{percent(result.image_sigma, 2)}, patches by {percent(result.patch_sigma, 2)}"
    )
    if result.verified_deg is None:
        console.print("not verified: lay the plane down a second time, tilted, and take images of it there too")
    else:
        console.print(f"verified on the held-out placing: mean error of the normals {result.verified_deg:.2f}°")
