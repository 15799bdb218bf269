"""`lightpose calibrate colour`: white balance and colour matrix from a folder's images of a 24-patch chart."""

import csv
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from acquisition import image_values, mosaic
from acquisition.calibrate import chart_reference, colour_chart
from acquisition.calibrate.board_results import now
from acquisition.calibrate.chart_reference import ChartReference
from acquisition.formats.folders import image_files
from acquisition.formats.folders.refusal import refusal, text
from acquisition.models import cell_config
from acquisition.models.base import FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.colour_result import ColourResult
from acquisition.models.errors import ErrorCode, RigError
from acquisition.store.folder import sha256_of, write_value
from api.cli.calibration_folder import refuse_overwriting

COLOUR_FILE = "colour.csv"
"""File in the folder of images: for each image a line with its name and a lamp-off image of the same exposure time."""

FAIR_DELTA_E = 3.0
"""Mean CIEDE2000 of held-out images above which the result is doubted."""


def calibrate_colour(
    folder: Path, base: Path, out: Path, reference_file: Path | None, corners: str | None
) -> dict[str, Any]:
    """Calibrates colours from a folder's images of a chart; `corners` as `x,y x,y x,y x,y` if it has no markers.

    `base` is a calibration.json, of which all but the colour is kept. Writes `colour.json` and `calibration.json`.
    Raises RigError folder.invalid, config.invalid, request.invalid, calibration.infeasible and target_not_seen, before
    anything is written.
    """
    refuse_overwriting(*(out / name for name in ("colour.json", "calibration.json")))
    calibration = cell_config.load_calibration(base)
    reference = chart_reference.published() if reference_file is None else chart_reference.read(reference_file)
    places = None if corners is None else _corners(corners)
    pairs = _pairs(folder)
    signals = np.array([_signals(lit, off, calibration, reference, places) for lit, off in pairs])
    found = colour_chart.fit(signals, reference)
    held_out = colour_chart.held_out_delta_e(signals, reference)
    made_at = now()
    result = ColourResult.model_validate(
        {
            "made_at": made_at, "version": metadata.version("lightpose"), "colour": found.calibration,
            "held_out_delta_e": held_out,
            "patches": [
                {"name": name, "reference_lab": stated, "found_lab": seen, "delta_e": apart}
                for name, stated, seen, apart in zip(
                    reference.names, reference.lab.tolist(), found.lab.mean(axis=0).tolist(), found.delta_e.tolist(),
                    strict=True,
                )
            ],
            "images": {path.name: sha256_of(path) for pair in pairs for path in pair},
        }
    )  # fmt: skip
    out.mkdir(parents=True, exist_ok=True)
    update = {"colour": found.calibration, "made_at": made_at}
    write_value(out / "calibration.json", calibration.model_copy(update=update))
    write_value(out / "colour.json", result)
    _show(result)
    return result.model_dump(mode="json")


def _show(result: ColourResult) -> None:
    console = Console(stderr=True, markup=False)
    colour = result.colour
    worst = max(result.patches, key=lambda patch: patch.delta_e)
    console.print(f"24 patches: ΔE2000 {colour.delta_e_mean:.2f} on average, {worst.delta_e:.2f} for {worst.name}")
    console.print("white, R G B over their mean: " + " ".join(f"{value:.3f}" for value in colour.white))
    if result.held_out_delta_e is None:
        console.print("only one image: take the chart in two or three positions, so that the matrix can be tested")
    else:
        console.print(f"held-out images: ΔE2000 {result.held_out_delta_e:.2f} on average")
        if result.held_out_delta_e > FAIR_DELTA_E:
            console.print("that is high: check that only the lamp lights the chart and nothing is mirrored in it")


def _pairs(folder: Path) -> list[tuple[Path, Path]]:
    """Returns the images with their lamp-off images. Raises RigError folder.invalid naming the line."""
    path = folder / COLOUR_FILE
    pairs: list[tuple[Path, Path]] = []
    for number, line in enumerate((one for one in csv.reader(text(path).splitlines()) if one), 1):
        names = [value.strip() for value in line]
        if len(names) != 2:
            raise refusal(path, f"line {number}: give the image and the lamp-off image")
        files = [folder / name for name in names]
        missing = [one.name for one in files if not one.is_file()]
        if number == 1 and len(missing) == 2:
            continue  # the names of the columns
        if missing:
            raise refusal(path, f"line {number}: there is no {missing[0]} in the folder")
        pairs.append((files[0], files[1]))
    if not pairs:
        raise refusal(path, "names no images")
    return pairs


def _signals(
    lit: Path, off: Path, calibration: Calibration, reference: ChartReference, places: FloatArray | None
) -> FloatArray:
    """Returns the values (24, 3) of an image's patches minus the lamp-off image, as fractions of full scale."""
    sensor = calibration.sensor
    image, dark = (image_files.decode(path) for path in (lit, off))
    if image.shape != dark.shape or image.shape[:2] != (calibration.height, calibration.width):
        raise refusal(
            lit,
            f"has {image.shape[1]} × {image.shape[0]} pixels, {off.name} {dark.shape[1]} × {dark.shape[0]}, the "
            f"calibration {calibration.width} × {calibration.height}: all must have the same size",
        )
    if image.ndim == 2 and sensor.mosaic is None:
        raise RigError(
            ErrorCode.CONFIG_INVALID,
            f"{lit.name} has one channel, but the sensor of --base has no mosaic: set `sensor.mosaic` to rggb, bggr, "
            "grbg or gbrg",
            file=str(lit),
        )
    light = image.astype(np.float64) - dark
    picture = light.mean(axis=-1) if light.ndim == 3 else mosaic.balanced_mean(light.astype(np.float32))
    matrix = colour_chart.locate(picture) if places is None else colour_chart.homography(places)
    clipped = np.where(image >= image_values.clipping_dn(sensor), np.inf, light)
    pattern = sensor.mosaic if light.ndim == 2 else None
    try:
        found = colour_chart.values(clipped, matrix, pattern, np.inf, reference.names)
    except RigError as error:
        raise RigError(error.code, f"{lit.name}: {error.detail}", file=str(lit)) from error
    return found / sensor.full_scale_dn


def _corners(given: str) -> FloatArray:
    try:
        places = np.array([[float(value) for value in point.split(",")] for point in given.split()])
    except ValueError as error:
        raise RigError(ErrorCode.REQUEST_INVALID, f"--corners {given}: {error}") from error
    if places.shape != (4, 2) or not np.isfinite(places).all():
        raise RigError(
            ErrorCode.REQUEST_INVALID,
            f"--corners {given}: give the centres of dark skin, bluish green, black and white as 'x,y x,y x,y x,y', px",
        )
    return places
