"""Preconditions of a start, a resume or a recovery: the same rig, a calibration that is in date, the arm near its last
path, space on the disk, a person who has looked.

The monitor checks safety, and `readiness` the devices. Each move is written to the journal before it is made
(write-ahead), so an arm that was interrupted is near that path unless somebody has moved it since.
"""

from collections.abc import Sequence
from datetime import datetime
from itertools import pairwise
from pathlib import Path

import numpy as np

from acquisition.calibrate import stated_values
from acquisition.capture import exposure
from acquisition.devices import ArmIdentity, ArmReading
from acquisition.devices.ur import states
from acquisition.models import cell_config
from acquisition.models.calibration import Calibration
from acquisition.models.calibration_recipe import AnyRecipe, CheckRecipe, LampRecipe
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.recipe import Recipe
from acquisition.runner.rig_choices import RigChoices
from acquisition.runner.safety_monitor import SafetyMonitor
from acquisition.session import max_passes
from acquisition.session_state import State
from acquisition.store import SessionRow, Store
from acquisition.store.folder import require_space, write_bytes

MAX_PATH_DISTANCE_RAD = 0.1
"""Largest accepted distance, rad, of a joint from the last path. A stop brakes along the path, and blends cut its
corners; a person who moves the arm moves it further."""

RECOVERY_WITHIN_S = 60.0
"""Time, s, after an operator's acknowledgement within which the same operator may recover the arm over HTTP."""

DARKS_PER_PASS = 6
"""Lamp-off frames assumed for one pass: one for each exposure time."""
RESULT_BYTES_PER_PIXEL = 80
"""Bytes per pixel of all files of one result, at eight images."""


def require_same_rig(row: SessionRow, cell: CellConfig, choices: RigChoices, folder: Path) -> None:
    """Raises RigError rig.changed unless cell file and calibration are those that the session was created with, and
    rig.other_tool unless the tool that it needs is on the flange."""
    choices.require_tool(row.recipe)
    if row.fingerprint != cell.fingerprint:
        raise RigError(ErrorCode.RIG_CHANGED, "The cell file is not the one that the session was created with")
    if cell_config.load_calibration(folder / "calibration.json") != choices.calibration:
        raise RigError(ErrorCode.RIG_CHANGED, "The calibration is not the one that the session was created with")


def require_power(reading: ArmReading) -> None:
    """Raises RigError arm.not_ready if the connected arm is off or braked: only a person powers it on."""
    fault = states.power_fault(reading.robot_mode) if reading.connected else None
    if fault is not None:
        raise RigError(fault.code, fault.detail)


def require_in_date(calibration: Calibration) -> None:
    """Raises RigError rig.not_ready if the calibration has expired."""
    if datetime.now().astimezone() > calibration.valid_until:
        since = f"The calibration has been out of date since {calibration.valid_until}: calibrate again"
        raise RigError(ErrorCode.RIG_NOT_READY, since)


def require_stated(recipe: AnyRecipe, cell: CellConfig, choices: RigChoices) -> None:
    """Raises RigError calibration.infeasible or store.corrupt unless the cell and the calibration in use state what the
    session goes on from. It would otherwise pause in its first step, and no resume would help."""
    if isinstance(recipe, LampRecipe | CheckRecipe):
        stated_values.require_for(recipe, cell, choices.calibration, choices.calibration_folder)


def require_same_arm(folder: Path, identity: ArmIdentity) -> None:
    """Raises RigError rig.changed unless the arm is the one that the session began with; the first call records it."""
    file = folder / "arm.txt"
    arm = f"{identity.model} {identity.serial}"
    if not file.exists():
        write_bytes(file, arm.encode())
    elif (first := file.read_text(encoding="utf-8")) != arm:
        raise RigError(ErrorCode.RIG_CHANGED, f"The session began with arm {first}, but the connected arm is {arm}")


def require_near_path(path: Sequence[Sequence[float]], joints: Sequence[float]) -> None:
    """Raises RigError arm.elsewhere unless joints (6, rad) lie near the path (K, 6) of the last move."""
    distance = _distance(np.array(path, dtype=float).reshape(-1, 6), np.array(joints, dtype=float))
    if distance > MAX_PATH_DISTANCE_RAD:
        raise RigError(
            ErrorCode.ARM_ELSEWHERE,
            f"A joint is {distance:.2f} rad away from the last path of this session",
            distance_rad=round(distance, 4),
        )


def require_recovery(cell: CellConfig, monitor: SafetyMonitor, holder: SessionRow | None, actor: str) -> None:
    """Raises RigError safety.recovery_forbidden unless the cell file allows recovery over HTTP, safety.not_acknowledged
    unless the same actor has acknowledged within RECOVERY_WITHIN_S, safety.recovery_refused while a session runs."""
    if not cell.arm.remote_recovery:
        raise RigError(ErrorCode.SAFETY_RECOVERY_FORBIDDEN, "The cell file does not allow recovery over HTTP")
    if not monitor.acknowledged_within(actor, RECOVERY_WITHIN_S):
        raise RigError(
            ErrorCode.SAFETY_NOT_ACKNOWLEDGED,
            f"{actor} has not acknowledged within the last {RECOVERY_WITHIN_S:.0f} s that the cell is clear",
        )
    if holder is not None and holder.state not in (State.PAUSED, State.INTERRUPTED):
        raise RigError(ErrorCode.SAFETY_RECOVERY_REFUSED, f"Session {holder.id} is {holder.state}: stop it first")


def require_exposures(recipe: AnyRecipe, cell: CellConfig) -> None:
    """Raises RigError request.invalid for exposures that the camera cannot make."""
    if isinstance(recipe, Recipe):
        exposure.require_in_range(recipe.exposure, cell.camera)


def require_space_for_session(store: Store, recipe: AnyRecipe | None, calibration: Calibration) -> None:
    """Raises RigError store.disk_full unless a whole session of this recipe (none: one more file) fits on the disk."""
    if recipe is None:
        require_space(store.data, 0)
        return
    pixels, passes = calibration.width * calibration.height, max_passes(recipe)
    if not isinstance(recipe, Recipe):
        require_space(store.data, pixels * 2 * (recipe.max_images + passes))
        return
    planned = recipe.exposure.plan == "planned"
    each = recipe.exposure.max_frames_per_light if planned else 1
    frames = recipe.lights_total * each + passes * DARKS_PER_PASS * (1 + planned)
    require_space(store.data, pixels * (2 * frames + passes * RESULT_BYTES_PER_PIXEL))


def _distance(path: np.ndarray, joints: np.ndarray) -> float:
    """The distance (rad, maximum norm) of joints (6,) from a piecewise linear path (K, 6); 0 for an empty path."""
    if not len(path):
        return 0.0
    nearest = min(float(np.abs(corner - joints).max()) for corner in path)
    for start, end in pairwise(path):
        leg = end - start
        length = float(leg @ leg)
        share = 0.0 if length == 0 else float(np.clip((joints - start) @ leg / length, 0, 1))
        nearest = min(nearest, float(np.abs(start + share * leg - joints).max()))
    return nearest
