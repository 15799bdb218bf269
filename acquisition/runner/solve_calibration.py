"""Calibration with which a session's images are solved again: that of the capture, or a set that was made since.

Lights are stored as the capture's calibration gives them; for another one they follow from the measured tool poses.
"""

from acquisition.models import cell_config
from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.shot import Observations
from acquisition.store import Store
from acquisition.waypoints import measured_pose


def values(store: Store, session_id: str, identity: str | None) -> Calibration:
    """Returns the calibration of a set (None: of the capture). Raises RigError calibration.not_found, store.corrupt."""
    if identity is not None:
        return store.calibrations.calibration(identity)
    return cell_config.load_calibration(store.folder(session_id) / "calibration.json")


def lit_by(images: Observations, cell: CellConfig, calibration: Calibration) -> Observations:
    """Returns the images with their lights computed by another calibration."""
    return images.lit_as(lambda tool, joints: measured_pose.light(tool, joints, cell.arm, calibration))


def require_fits(store: Store, session_id: str, identity: str) -> None:
    """Raises RigError calibration.not_found, and calibration.does_not_fit unless a set has the session's image size."""
    made, captured = store.calibrations.get(identity), values(store, session_id, None)
    if (made.width, made.height) != (captured.width, captured.height):
        raise RigError(
            ErrorCode.CALIBRATION_DOES_NOT_FIT,
            f"Calibration {identity} is for images of {made.width} × {made.height} pixels, but the session's images "
            f"have {captured.width} × {captured.height}",
            id=identity,
        )
