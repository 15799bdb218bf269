"""`lightpose calibrate response`: the camera's response, from images of one scene at many exposure times."""

import csv
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from acquisition.calibrate import response, response_results
from acquisition.calibrate.response_frames import ResponseFrame
from acquisition.formats.folders.refusal import refusal, text
from acquisition.models import cell_config
from acquisition.models.calibration import Calibration
from acquisition.store.folder import sha256_of, write_value
from api.cli.calibration_folder import read_grey, refuse_overwriting

RESPONSE_FILE = "response.csv"
"""File in the folder of images; each line: image, lamp (on or off), exposure time in s, optionally time taken in s."""


def calibrate_response(folder: Path, base: Path, out: Path) -> dict[str, Any]:
    """Calibrates the camera's response from a folder's images.

    `base` is a calibration.json, of which all but the sensor is kept. Writes `response.json`, `photon_transfer.png` and
    `calibration.json`. Raises RigError folder.invalid, config.invalid, calibration.infeasible, before anything is
    written.
    """
    refuse_overwriting(*(out / name for name in ("response.json", "photon_transfer.png", "calibration.json")))
    calibration = cell_config.load_calibration(base)
    frames = _frames(folder, calibration)
    found = response.estimate(frames, calibration.sensor.bits)
    result = response_results.result(found, {frame.name: sha256_of(folder / frame.name) for frame in frames})
    out.mkdir(parents=True, exist_ok=True)
    response_results.draw(found, out / "photon_transfer.png")
    write_value(out / "calibration.json", response_results.with_response(calibration, result))
    write_value(out / "response.json", result)
    console = Console(stderr=True, markup=False)
    sigma = np.sqrt(np.diag(found.covariance))
    names = (
        "black level",
        "electrons per value",
        "read noise, electrons",
        "full well, electrons",
        "bend at full scale",
    )
    for name, value, one_sigma in zip(names, found.values, sigma, strict=True):
        console.print(f"{name}: {value:.4g} ± {one_sigma:.2g}")
    for sentence in response_results.advice(result) or [f"Name {out / 'calibration.json'} in the cell file to use it."]:
        console.print(sentence)
    return result.model_dump(mode="json")


def _frames(folder: Path, calibration: Calibration) -> list[ResponseFrame]:
    """Reads `response.csv`. Raises RigError folder.invalid naming the line."""
    path = folder / RESPONSE_FILE
    frames: list[ResponseFrame] = []
    for number, line in enumerate((one for one in csv.reader(text(path).splitlines()) if one), 1):
        try:
            name, lamp, exposure, *taken = (value.strip() for value in line)
            exposure_s, taken_at = float(exposure), float(taken[0]) if taken and taken[0] else float(number)
        except ValueError as error:
            if number == 1:
                continue  # the names of the columns
            raise refusal(path, f"line {number}: give image, lamp and exposure_s") from error
        if lamp not in ("on", "off") or not (np.isfinite(exposure_s) and exposure_s > 0):
            raise refusal(path, f"line {number}: lamp must be on or off, the exposure time above 0 s")
        if not (folder / name).is_file():
            raise refusal(path, f"line {number}: there is no {name} in the folder")
        frames.append(
            ResponseFrame(name, exposure_s, lamp == "on", taken_at, partial(read_grey, folder / name, calibration))
        )
    return frames
