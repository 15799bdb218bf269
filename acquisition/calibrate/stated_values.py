"""What the set of the calibration in use states, without which a session of kind lamp or check cannot be made.

It is separate from the estimation from images, because the service, which computes nothing, refuses such a session when
it is created: it starts without kernels.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from pydantic import ValidationError

from acquisition.calibrate import lamp_targets
from acquisition.models.base import Value
from acquisition.models.calibration import Calibration
from acquisition.models.calibration_recipe import CheckRecipe, LampRecipe
from acquisition.models.calibration_result import AdjustmentValues, HandEyeResult, LampResult, LobeResult
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import ErrorCode, RigError

BASIS, HAND_EYE, LAMP, LOBE = "basis.json", "hand_eye.json", "lamp.json", "lobe.json"

_V = TypeVar("_V", bound=Value)
_A = TypeVar("_A", bound=AdjustmentValues)


@dataclass(frozen=True)
class StatedLamp:
    """The lamp and the camera's place as the files of the set in use state them."""

    hand_eye: HandEyeResult
    lamp: LampResult
    lobe: LobeResult


def require_for(
    recipe: LampRecipe | CheckRecipe, cell: CellConfig, calibration: Calibration, set_folder: Path | None
) -> None:
    """Raises unless the cell and the calibration in use state what a session goes on from.

    `set_folder` is the folder of the set in use, None for the cell file's calibration. Raises RigError
    calibration.infeasible, also without targets of the lamp: the request is at fault, not the service; store.corrupt.
    """
    if isinstance(recipe, LampRecipe):
        _require_targets(cell)
        hand_eye(set_folder)
    elif recipe.target == "plane":
        _require_targets(cell)
        lamp(set_folder, calibration)
    else:
        adjustment(set_folder, calibration, AdjustmentValues)


def hand_eye(set_folder: Path | None) -> HandEyeResult:
    """Reads the camera's place with its covariance. Raises RigError calibration.infeasible, store.corrupt."""
    found = _read(set_folder, HAND_EYE, HandEyeResult)
    if found is None:
        raise RigError(
            ErrorCode.CALIBRATION_INFEASIBLE,
            "The calibration in use states no uncertainty of the camera's pose: calibrate hand-eye first, and make "
            "that the calibration in use",
        )
    return found


def lamp(set_folder: Path | None, calibration: Calibration) -> StatedLamp:
    """Reads what the calibration in use states about its lamp, from the folder of its set.

    Raises RigError calibration.infeasible if it states nothing or states other values, store.corrupt.
    """
    lobe = _of_lamp(set_folder, LOBE, LobeResult)
    # A later calibration of the response does not change digital values, but the intensity is a fraction of full scale,
    # which depends on the black level.
    full_scale_dn = calibration.sensor.full_scale_dn
    stated_dn = lobe.lamp_intensity * (lobe.full_scale_dn or full_scale_dn)
    same = math.isclose(stated_dn, calibration.lamp_intensity * full_scale_dn, rel_tol=1e-9)
    if not same or lobe.lobe != calibration.lobe:
        raise _no_lamp("The lamp's values in use are not those of its calibration")
    return StatedLamp(_of_lamp(set_folder, HAND_EYE, HandEyeResult), _of_lamp(set_folder, LAMP, LampResult), lobe)


def adjustment(set_folder: Path | None, calibration: Calibration, kind: type[_A]) -> _A:
    """Reads the adjustment on which the calibration in use rests, from the folder of its set.

    Raises RigError calibration.infeasible if there is none or if it does not belong to these values, store.corrupt.
    """
    found = _read(set_folder, BASIS, kind)
    if found is None:
        raise _no_adjustment("The calibration in use states no covariance of camera, board and joints")
    f_x, f_y, c_x, c_y = found.camera[:4]
    matrix = [[f_x, 0.0, c_x], [0.0, f_y, c_y], [0.0, 0.0, 1.0]]
    same = np.allclose(found.base_from_camera, calibration.base_from_camera, atol=1e-9)
    if not same or not np.allclose(matrix, calibration.camera_matrix, atol=1e-6):
        raise _no_adjustment("The camera was calibrated after its place, or its place was not calibrated in a session")
    return found


def _require_targets(cell: CellConfig) -> None:
    try:
        lamp_targets.require_targets(cell)
    except RigError as error:
        raise RigError(ErrorCode.CALIBRATION_INFEASIBLE, error.detail) from error


def _of_lamp(set_folder: Path | None, name: str, kind: type[_V]) -> _V:
    found = _read(set_folder, name, kind)
    if found is None:
        raise _no_lamp(f"The calibration in use has no {name}")
    return found


def _read(set_folder: Path | None, name: str, kind: type[_V]) -> _V | None:
    file = None if set_folder is None else set_folder / name
    if file is None or not file.exists():
        return None
    try:
        return kind.model_validate_json(file.read_bytes())
    except ValidationError as error:
        raise RigError(ErrorCode.STORE_CORRUPT, f"{file}: {error}", file=name) from error


def _no_lamp(why: str) -> RigError:
    return RigError(
        ErrorCode.CALIBRATION_INFEASIBLE,
        f"{why}: there is nothing to check the lamp against. Calibrate the lamp in a session and use that calibration",
    )


def _no_adjustment(why: str) -> RigError:
    return RigError(
        ErrorCode.CALIBRATION_INFEASIBLE,
        f"{why}: there is nothing to check against. Calibrate hand-eye in a session and use that calibration",
    )
