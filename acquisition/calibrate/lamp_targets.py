"""Targets of the lamp's calibration as the cell file describes them: mirror sphere and matt plane.

They are separate from the estimation from their images (`lamp_session`), because the service, which computes nothing,
needs them too: it starts without kernels.
"""

from acquisition.calibrate.charuco import CharucoBoard
from acquisition.models.base import FloatArray
from acquisition.models.cell_config import CellConfig, LampTargetsConfig
from acquisition.models.errors import ErrorCode, RigError

SPHERE_PASS = 0
"""Pass of the sphere's images; each further pass is a placing of the plane."""

CLIPPED_HIGHLIGHT = "the highlight is clipped: close the aperture, use a darker ball, or expose for a shorter time"
"""Reason for a sphere whose highlight has no middle: the only reason to which the capture of images reacts."""


def require_targets(cell: CellConfig) -> LampTargetsConfig:
    """Returns sphere and plane of the cell. Raises RigError config.invalid if the cell file has none."""
    if cell.lamp_targets is None:
        raise RigError(
            ErrorCode.CONFIG_INVALID, "The cell file describes no mirror sphere and no matt plane: add [lamp_targets]"
        )
    return cell.lamp_targets


def plane_board(cell: CellConfig) -> CharucoBoard:
    """Returns the ChArUco frame of the cell's matt plane. Raises RigError config.invalid if there is none."""
    described = require_targets(cell).model_dump(include=set(CharucoBoard.model_fields))
    return CharucoBoard.model_validate(described)


def sphere_center(cell: CellConfig) -> FloatArray:
    """Place of the sphere's centre (3,), base frame, m, to a centimetre or two: on the middle of the object's place."""
    keep_out = cell.object.keep_out.base_from_object.matrix
    return keep_out[:3, 3] + keep_out[:3, 2] * require_targets(cell).sphere_radius_m
