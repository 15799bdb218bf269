"""Folders of calibration images: reading their content, and writing results without overwriting anything."""

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike
from pydantic import ValidationError

from acquisition.formats.folders import image_files
from acquisition.formats.folders.refusal import refusal, text
from acquisition.formats.session_files import refuse_in_session
from acquisition.models.base import FloatArray, Value
from acquisition.models.calibration import Calibration
from acquisition.models.calibration_result import HandEyeResult, LampResult
from acquisition.models.errors import ErrorCode, RigError, wrong_fields
from acquisition.store.folder import sha256_of

IMAGE_ENDINGS = (".png", ".tif", ".tiff")
"""Lossless formats; the blocks of JPEG displace corners and highlights."""

JOINTS_FILE = "joints.csv"
"""File in the folder of images: for each image a line `image, q1 … q6`, rad."""

ValueT = TypeVar("ValueT", bound=Value)

SIX_NUMBERS = "write six joint angles in rad after the image's name, separated by commas"

MAX_JOINT_RAD = 6.5
"""Largest angle of the first five joints: they turn by 360° either way, the sixth of some arms without end."""


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
    """Reads a folder's images one by one, by name. All must have one size, that of `calibration` if given.

    With `joints` each image must have its own. Raises RigError folder.invalid naming the file.
    """
    if not folder.is_dir():
        raise refusal(folder, "is not a folder: name the one that holds the images")
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
            raise refusal(
                path,
                f"has {made.size[0]} × {made.size[1]} pixels, but the first image has {first[0]} × {first[1]}",
            )
        yield made


def read_grey(path: Path, calibration: Calibration) -> np.ndarray:
    """Reads an image's brightness (H, W). Raises RigError folder.invalid unless it has the calibration's size."""
    values = image_files.grey(image_files.decode(path))
    if values.shape != (calibration.height, calibration.width):
        stated = f"but the calibration has {calibration.width} × {calibration.height}"
        raise refusal(path, f"has {values.shape[1]} × {values.shape[0]} pixels, {stated}")
    return values


def read_value(path: Path, kind: type[ValueT], what: str) -> ValueT:
    """Reads a value from its JSON; `what` describes the file in the message. Raises RigError request.invalid."""
    try:
        return kind.model_validate_json(path.read_bytes())
    except OSError as error:
        raise RigError(ErrorCode.REQUEST_INVALID, f"{path}: cannot be read: {error.strerror}") from error
    except ValidationError as error:
        raise RigError(ErrorCode.REQUEST_INVALID, f"{path}: is not a valid {what}: {wrong_fields(error)}") from error


def read_hand_eye(path: Path, calibration: Calibration, base: Path) -> HandEyeResult:
    """Reads a hand_eye.json. Raises RigError request.invalid unless it states the camera's pose of `calibration`."""
    found = read_value(path, HandEyeResult, "hand_eye.json of `calibrate hand-eye`")
    _require_same(found.base_from_camera, calibration.base_from_camera, path, "camera", base)
    return found


def read_lamp(path: Path, calibration: Calibration, base: Path) -> LampResult:
    """Reads a lamp.json. Raises RigError request.invalid unless it states the lamp's place of `calibration`."""
    found = read_value(path, LampResult, "lamp.json of `calibrate lamp`")
    place = np.array(calibration.tool_from_lamp)[:3, 3]
    _require_same(found.tool_from_lamp_m, place, path, "lamp", base)
    return found


def _require_same(found: ArrayLike, stated: ArrayLike, path: Path, what: str, base: Path) -> None:
    if not np.allclose(found, stated, atol=1e-9):
        raise RigError(
            ErrorCode.REQUEST_INVALID,
            f"{path}: states another place of the {what} than {base}: give with --base the calibration.json that was "
            "made with this file, or a later one",
        )


def read_joints(path: Path) -> dict[str, FloatArray]:
    """Reads the joints (6,), rad, of each image from a file like `joints.csv`. Raises RigError folder.invalid."""
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
        refuse_degrees(path, number, six)
        joints[name.strip()] = six
    return joints


def refuse_degrees(path: Path, line: int, joints: FloatArray) -> None:
    """Refuses joints (6,) that no arm can have if they are in rad. Raises RigError folder.invalid naming the line."""
    largest = float(np.max(np.abs(joints[:5])))
    if largest > MAX_JOINT_RAD:
        raise refusal(path, f"line {line}: no joint turns by {largest:g} rad: write the joints in rad, not in degrees")


def refuse_overwriting(*paths: Path) -> None:
    """Raises RigError request.invalid if one of the files exists, because a replaced calibration is lost, and
    folder.invalid if it would lie in a session's folder."""
    for path in paths:
        refuse_in_session(path, "--out")
        if path.exists():
            raise RigError(ErrorCode.REQUEST_INVALID, f"{path} exists and is not overwritten: give another --out")
