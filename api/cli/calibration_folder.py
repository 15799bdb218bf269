"""Folders of calibration images: what is read from them, and what is written beside them, never over what is there."""

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from pydantic import ValidationError

from acquisition.formats.folders import image_files
from acquisition.formats.folders.refusal import refusal, text
from acquisition.models.base import FloatArray, Value
from acquisition.models.calibration import Calibration
from acquisition.models.errors import ErrorCode, RigError
from acquisition.store.folder import sha256_of

IMAGE_ENDINGS = (".png", ".tif", ".tiff")
"""Lossless formats: JPEG's blocks move corners and highlights."""

JOINTS_FILE = "joints.csv"
"""In the folder of images: `image, q1 … q6`, rad, a line for each."""

ValueT = TypeVar("ValueT", bound=Value)

SIX_NUMBERS = "six numbers in rad belong after the image's name"


@dataclass(frozen=True)
class CalibrationImage:
    """An image's file name, its content's hash, and its brightness (H, W), 8 or 16 bits."""

    name: str
    sha256: str
    values: np.ndarray

    @property
    def size(self) -> tuple[int, int]:
        """Width and height."""
        return self.values.shape[1], self.values.shape[0]


def images(
    folder: Path, joints: dict[str, FloatArray] | None, calibration: Calibration | None = None
) -> Iterator[CalibrationImage]:
    """Reads a folder's images one by one, in the order of their names; all of one size, that of `calibration` if given.

    With `joints` each image has to have its own. Raises RigError folder.invalid naming the file.
    """
    paths = sorted(path for path in folder.glob("*") if path.suffix.lower() in IMAGE_ENDINGS)
    if not paths:
        raise refusal(folder, f"holds no images ({', '.join(IMAGE_ENDINGS)})")
    if joints is not None and (missing := sorted(set(joints) - {path.name for path in paths})):
        raise refusal(folder / JOINTS_FILE, f"names {missing[0]}, which is not in the folder")
    first: tuple[int, int] | None = None
    for path in paths:
        if joints is not None and path.name not in joints:
            raise refusal(folder / JOINTS_FILE, f"states no joints for {path.name}")
        values = image_files.grey(image_files.decode(path)) if calibration is None else read_grey(path, calibration)
        made = CalibrationImage(path.name, sha256_of(path), values)
        first = first or made.size
        if made.size != first:
            raise refusal(path, f"has {made.size[0]} × {made.size[1]} pixels, the first image {first[0]} × {first[1]}")
        yield made


def read_grey(path: Path, calibration: Calibration) -> np.ndarray:
    """An image's brightness (H, W). Raises RigError folder.invalid unless it has the size of the calibration's."""
    values = image_files.grey(image_files.decode(path))
    if values.shape != (calibration.height, calibration.width):
        stated = f"the calibration {calibration.width} × {calibration.height}"
        raise refusal(path, f"has {values.shape[1]} × {values.shape[0]} pixels, {stated}")
    return values


def read_value(path: Path, kind: type[ValueT], what: str) -> ValueT:
    """Reads a value from its JSON; `what` says for people what the file should be. Raises RigError config.invalid."""
    try:
        return kind.model_validate_json(path.read_bytes())
    except (OSError, ValidationError) as error:
        raise RigError(ErrorCode.CONFIG_INVALID, f"{path}: no {what}: {error}") from error


def read_joints(path: Path) -> dict[str, FloatArray]:
    """Joints (6,), rad, of each image from a file like `joints.csv`. Raises RigError folder.invalid naming the line."""
    lines = [line for line in csv.reader(text(path).splitlines()) if line]
    joints: dict[str, FloatArray] = {}
    for number, (name, *values) in enumerate(lines, 1):
        try:
            six = np.array([float(value) for value in values])
        except ValueError as error:
            if number == 1:
                continue  # the names of the columns
            raise refusal(path, f"line {number}: {SIX_NUMBERS}") from error
        if len(six) != 6 or not np.isfinite(six).all():
            raise refusal(path, f"line {number}: {SIX_NUMBERS}")
        joints[name.strip()] = six
    return joints


def refuse_overwriting(*paths: Path) -> None:
    """Raises RigError config.invalid where one of the files is there: a calibration that is replaced is lost."""
    for path in paths:
        if path.exists():
            raise RigError(ErrorCode.CONFIG_INVALID, f"{path} is there already, and nothing is overwritten")
