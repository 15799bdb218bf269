"""What must hold before a session may move the arm: the same rig, the arm where it was left, room on the disk.

Safety and the devices' readiness are asked elsewhere; here stands what a session knows of its own past. A move is
entered in the journal before it is made, so wherever the arm was cut off, it stands near that way: nobody has moved it
since.
"""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from acquisition.devices import ArmIdentity
from acquisition.models import cell_config
from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.recipe import Recipe
from acquisition.session import passes_wanted
from acquisition.store import SessionRow, Store
from acquisition.store.folder import require_space, write_bytes

NEAR_RAD = 0.1
"""A stop brakes along the way and blends cut its corners; a person who moves the arm moves it further."""

DARKS = 6
"""Lamp-off frames of one pass, at most about so many: one for each exposure time."""
RESULT_BYTES_PER_PIXEL = 80
"""All files of one result, at eight images."""


def same_rig(row: SessionRow, cell: CellConfig, calibration: Calibration, folder: Path) -> None:
    """Raises RigError rig.changed unless cell file and calibration are those that the session was created with."""
    if row.fingerprint != cell.fingerprint:
        raise RigError(ErrorCode.RIG_CHANGED, "The cell file is not the one that the session was created with")
    if cell_config.load_calibration(folder / "calibration.json") != calibration:
        raise RigError(ErrorCode.RIG_CHANGED, "The calibration is not the one that the session was created with")


def same_arm(folder: Path, identity: ArmIdentity) -> None:
    """Raises RigError rig.changed unless the arm is the one that the session began with; the first one is kept."""
    file = folder / "arm.txt"
    arm = f"{identity.model} {identity.serial}"
    if not file.exists():
        write_bytes(file, arm.encode())
    elif (first := file.read_text(encoding="utf-8")) != arm:
        raise RigError(ErrorCode.RIG_CHANGED, f"The session began with the arm {first}; this is {arm}")


def near_last_way(way: Sequence[Sequence[float]], joints: Sequence[float]) -> None:
    """Raises RigError arm.elsewhere unless joints (6, rad) lie near the way (K, 6) that the arm was sent last."""
    distance = _distance(np.array(way, dtype=float).reshape(-1, 6), np.array(joints, dtype=float))
    if distance > NEAR_RAD:
        raise RigError(
            ErrorCode.ARM_ELSEWHERE,
            f"A joint stands {distance:.2f} rad from the way that this session sent the arm last",
            distance_rad=round(distance, 4),
        )


def enough_space(store: Store, recipe: Recipe | None, calibration: Calibration) -> None:
    """Raises RigError store.disk_full unless a whole session of this recipe (none: one more file) fits on the disk."""
    if recipe is None:
        require_space(store.data, 0)
        return
    pixels, passes = calibration.width * calibration.height, passes_wanted(recipe)
    frames = recipe.lights_total + passes * DARKS
    require_space(store.data, pixels * (2 * frames + passes * RESULT_BYTES_PER_PIXEL))


def _distance(way: np.ndarray, joints: np.ndarray) -> float:
    """The largest joint's distance (rad) from the nearest place on the way; 0 where there is no way."""
    if not len(way):
        return 0.0
    nearest = min(float(np.abs(corner - joints).max()) for corner in way)
    for start, end in pairwise(way):
        leg = end - start
        length = float(leg @ leg)
        share = 0.0 if length == 0 else float(np.clip((joints - start) @ leg / length, 0, 1))
        nearest = min(nearest, float(np.abs(start + share * leg - joints).max()))
    return nearest
