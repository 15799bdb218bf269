"""Routes of calibrations: the one in use with its values, the list of all, their files, and the choice of another one.

A chosen calibration applies to sessions created afterwards. A session's images are solved with the calibration that
they were taken with, and waypoints are certified with it. A calibration therefore cannot be chosen while a session
runs, and none is chosen automatically: a calibration session makes a set and leaves the choice to a person.
"""

from datetime import UTC, datetime
from typing import Annotated

from fastapi import APIRouter, Request
from fastapi import Path as InPath
from fastapi.responses import FileResponse
from pydantic import Field

from acquisition.models.calibration import Calibration
from acquisition.models.calibration_result import CalibrationSummary
from acquisition.models.calibration_set import CELL_FILE, CalibrationSet
from acquisition.models.cell_config import Tool
from acquisition.models.errors import ErrorCode, RigError
from acquisition.store.folder import sha256_of
from acquisition.waypoints import mounted_tool
from api.rest import problems, stored_files
from api.rest.dependencies import Actor, ServiceOf
from api.rest.paging import Limit, Offset, page
from api.rest.rig_schemas import CalibrationResource
from api.rest.schemas import Links, Page, RequestBody, Resource
from api.rest.wiring import Service

router = APIRouter(tags=["rig"])


class RigCalibration(CalibrationResource):
    """The calibration in use with all its values."""

    id: str = Field(description="Identifier: `cell` for that of the cell file, else the session that made it")
    age_days: float = Field(description="Days since it was made")
    file: str = Field(description="The file, as the cell file names it, or in the data folder")
    fingerprint: str = Field(description="SHA-256 of its values; sessions captured with it record this")
    values: Calibration = Field(description="As in the file: m, rad, pixels; poses are `a_from_b`")
    links: Links


class CalibrationSetResource(Resource):
    """One of the available calibrations, in use or not."""

    id: str = Field(description="Identifier: `cell` for that of the cell file, else the session that made it")
    active: bool = Field(description="Whether it is in use")
    fits: str = Field(description="Reasons why this rig cannot use it; empty: it can")
    fingerprint: str = Field(description="SHA-256 of its values; sessions captured with it record this")
    made_at: str = Field(description="When it was made, ISO 8601")
    kind: str | None = Field(description="What was calibrated: `camera`, `hand-eye`; null for the cell file's")
    camera: str | None = Field(description="The camera: its kind and serial number; null: not recorded")
    arm: str | None = Field(description="The arm: model and serial number; null: not recorded")
    summary: CalibrationSummary | None = Field(description="Figures of its estimate; null for the cell file's")
    links: Links


class CalibrationChoice(RequestBody):
    """The calibration to be used."""

    id: str = Field(min_length=1, max_length=80, description="One of GET /v1/rig/calibrations; `cell`: the cell file's")


class ToolStatement(RequestBody):
    """A person's statement of what is on the arm's flange."""

    tool: Tool = Field(description="`lamp`, or `board`: the calibration board of the cell file")


class ToolResource(Resource):
    """What is on the arm's flange, as last stated by a person. Paths are certified for this tool."""

    tool: Tool = Field(description="`lamp`, or `board`")
    warning: str = Field(default="", description="Warning about its payload, for people; empty: none")
    links: Links


@router.get("/v1/rig/calibration")
def calibration(service: ServiceOf) -> RigCalibration:
    """Returns the calibration in use: camera, lamp, sensor and their uncertainties, with age, source and validity."""
    return _in_use(service)


@router.get("/v1/rig/calibrations")
def calibrations(
    service: ServiceOf, request: Request, limit: Limit = 100, after: Offset = 0
) -> Page[CalibrationSetResource]:
    """Lists the calibrations: the cell file's first, then those made by sessions, oldest first."""
    choices = service.runner.choices
    of_cell = choices.values(CELL_FILE)
    first = CalibrationSetResource(
        id=CELL_FILE,
        active=choices.calibration_id == CELL_FILE,
        fits="",
        fingerprint=of_cell.fingerprint,
        made_at=of_cell.made_at,
        kind=None,
        camera=None,
        arm=None,
        summary=None,
        links={"active": "/v1/rig/calibrations/active"},
    )
    made = [_resource(service, one) for one in service.store.calibrations.all()]
    return page(request, [first, *made], limit, after)


@router.put(
    "/v1/rig/calibrations/active",
    responses=problems.responses_of(
        ErrorCode.CALIBRATION_NOT_FOUND,
        ErrorCode.CALIBRATION_DOES_NOT_FIT,
        ErrorCode.RIG_BUSY,
        ErrorCode.STORE_CORRUPT,
        ErrorCode.STORE_DISK_FULL,
        *problems.BODY_CODES,
    ),
)
def choose_calibration(service: ServiceOf, choice: CalibrationChoice, actor: Actor) -> RigCalibration:
    """Puts a calibration into use for sessions created from now on. The choice survives a restart.

    Refused while a session holds the rig, and for a calibration of another camera, image size or arm.
    """
    service.runner.choices.choose_calibration(choice.id, actor)
    return _in_use(service)


@router.get(
    "/v1/rig/calibrations/{calibration_id}/{name}",
    response_class=FileResponse,
    responses={
        **stored_files.binary("application/json", "image/png", description="The file"),
        **problems.responses_of(ErrorCode.CALIBRATION_NOT_FOUND, ErrorCode.REQUEST_NOT_FOUND),
    },
)
def calibration_file(
    service: ServiceOf,
    calibration_id: Annotated[str, InPath(max_length=80, description="Identifier of the calibration, its `id`")],
    name: Annotated[str, InPath(max_length=100, description="File name, one of its `links`")],
) -> FileResponse:
    """Returns one file of a calibration: values with covariance and residuals, corners, pictures."""
    if calibration_id == CELL_FILE:
        detail = "The cell file's calibration has no files here; GET /v1/rig/calibration has its values while in use"
        raise RigError(ErrorCode.CALIBRATION_NOT_FOUND, detail)
    path = service.store.calibrations.file(calibration_id, name)
    return stored_files.file_response(path, f"{calibration_id}-{name}", sha256_of(path))


@router.get("/v1/rig/tool")
def tool(service: ServiceOf) -> ToolResource:
    """Returns what is on the arm's flange, as last stated by a person."""
    mounted = service.runner.choices.tool
    warning = mounted_tool.payload_warning(service.cell, mounted)
    return ToolResource(tool=mounted, warning=warning, links={"self": "/v1/rig/tool", "rig": "/v1/rig"})


@router.put(
    "/v1/rig/tool",
    responses=problems.responses_of(
        ErrorCode.RIG_BUSY, ErrorCode.CONFIG_INVALID, ErrorCode.STORE_DISK_FULL, *problems.BODY_CODES
    ),
)
def state_tool(service: ServiceOf, statement: ToolStatement, actor: Actor) -> ToolResource:
    """States what is on the flange now. Paths of sessions, parking and jogging are certified for this tool.

    Nothing moves. The controller receives the payload of this tool. Refused while a session holds the rig.
    """
    service.runner.state_tool(statement.tool, actor)
    return tool(service)


def _in_use(service: Service) -> RigCalibration:
    status, choices = service.runner.status(), service.runner.choices
    known, now, identity = choices.calibration, datetime.now(UTC), choices.calibration_id
    return RigCalibration(
        id=identity,
        made_at=status.calibration_made_at,
        valid_until=status.calibration_valid_until,
        valid=now < datetime.fromisoformat(status.calibration_valid_until),
        check=status.calibration_check,
        age_days=(now - datetime.fromisoformat(status.calibration_made_at)).total_seconds() / 86_400,
        file=service.cell.calibration if identity == CELL_FILE else f"calibrations/{identity}/calibration.json",
        fingerprint=known.fingerprint,
        values=known,
        links={"self": "/v1/rig/calibration", "rig": "/v1/rig", "calibrations": "/v1/rig/calibrations"},
    )


def _resource(service: Service, made: CalibrationSet) -> CalibrationSetResource:
    path = f"/v1/rig/calibrations/{made.id}"
    return CalibrationSetResource(
        id=made.id,
        active=service.runner.choices.calibration_id == made.id,
        fits="; ".join(service.runner.choices.differences(made)),
        fingerprint=made.fingerprint,
        made_at=made.made_at,
        kind=made.kind,
        camera=made.camera,
        arm=made.arm,
        summary=made.summary,
        links={name: f"{path}/{name}" for name in service.store.calibrations.files(made.id)},
    )
