"""Route of the calibration in use: its values, where they come from, and how long they are valid.

Read only: a calibration takes effect when the service is started with a cell file that names it, because a session's
images are solved with the calibration that they were taken with, and waypoints are certified with it.
"""

from datetime import UTC, datetime

from fastapi import APIRouter
from pydantic import Field

from acquisition.models.calibration import Calibration
from api.rest.dependencies import ServiceOf
from api.rest.rig_schemas import CalibrationResource
from api.rest.schemas import Links

router = APIRouter(tags=["rig"])


class RigCalibration(CalibrationResource):
    """The calibration in use, complete."""

    age_days: float = Field(description="Days since it was made")
    file: str = Field(description="The file, as the cell file names it")
    fingerprint: str = Field(description="SHA-256 of its values; sessions of another calibration differ in it")
    values: Calibration = Field(description="As in the file: m, rad, pixels; poses are `a_from_b`")
    links: Links


@router.get("/v1/rig/calibration")
def calibration(service: ServiceOf) -> RigCalibration:
    """The calibration in use: camera, lamp, sensor and their uncertainties, with age, source and validity."""
    status, known = service.runner.status(), service.calibration
    now = datetime.now(UTC)
    return RigCalibration(
        made_at=status.calibration_made_at,
        valid_until=status.calibration_valid_until,
        valid=now < datetime.fromisoformat(status.calibration_valid_until),
        age_days=(now - datetime.fromisoformat(status.calibration_made_at)).total_seconds() / 86_400,
        file=service.cell.calibration,
        fingerprint=known.fingerprint,
        values=known,
        links={"self": "/v1/rig/calibration", "rig": "/v1/rig"},
    )
