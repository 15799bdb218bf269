"""Routes of the rig: health, status, stop, safety acknowledgement and recovery, parking, reach.

Stop is `async def`: before the devices are commanded to halt it uses no thread, no database and no lock. The route
serves stops on a connection that is already open. A stop on a new connection is carried out by the listener's thread
(`stop_request`), however busy or blocked the rest of the service is.
"""

import time
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any

import anyio.to_thread
from fastapi import APIRouter, Request
from fastapi.responses import Response

from acquisition.models.base import as_joints, as_matrix4
from acquisition.models.cell_config import Tool
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.problem_table import PROBLEMS
from acquisition.runner.safety_monitor import Latch
from acquisition.runner.status import RigStatus
from api.rest import problems
from api.rest.authentication import STOP_PATH
from api.rest.dependencies import Actor, ServiceOf
from api.rest.rig_schemas import (
    ArmResource,
    CalibrationResource,
    Fault,
    Health,
    ReadingResource,
    Reason,
    RecoveryRequest,
    RigResource,
    SafetyResource,
)
from api.rest.schemas import Accepted, as_datetime
from api.rest.turns import in_turn

router = APIRouter()

VERSION = version("lightpose")
"""Version of the installed package."""

RIG_LINKS = {
    "self": "/v1/rig",
    "scene": "/v1/rig/scene",
    "calibration": "/v1/rig/calibration",
    "calibrations": "/v1/rig/calibrations",
    "tool": "/v1/rig/tool",
    "stop": STOP_PATH,
    "safety": "/v1/rig/safety",
    "reach": "/v1/rig/reach",
    "reach_page": "/v1/rig/reach.html",
    "park": "/v1/rig/park",
    "jog": "/v1/rig/jog",
    "preview": "/v1/rig/preview.jpg",
    "preview_figures": "/v1/rig/preview/figures",
    "sessions": "/v1/sessions",
    "events": "/v1/events",
}


@router.get("/health/live", tags=["health"])
async def live() -> Health:
    """Confirms that the service answers."""
    return Health()


@router.get("/health/ready", tags=["health"], responses=problems.responses_of(ErrorCode.RIG_NOT_READY))
def ready(service: ServiceOf, request: Request) -> Health:
    """Confirms that the devices answer; 503 names one that does not. (`GET /v1/rig` says whether a session may start.)

    It needs no key. Where keys are in use, it therefore omits facts about the cell, such as addresses.
    """
    status = service.runner.status()
    if not status.camera_ready or not status.reading.connected:
        reasons = [reason.model_dump(mode="json") for reason in _reasons(status.reasons)]
        if request.app.state.keys.required:
            reasons = [{**reason, "detail": PROBLEMS[reason["code"]].title} for reason in reasons]
        detail = "; ".join(reason["detail"] for reason in reasons) or "The devices are not connected"
        raise RigError(ErrorCode.RIG_NOT_READY, detail, reasons=reasons)
    return Health()


@router.get("/v1/rig", tags=["rig"])
def rig(service: ServiceOf) -> RigResource:
    """Returns the devices' status, the session that holds the rig, and whether another may start, else the reasons."""
    return _resource(service.runner.status(), service.runner.choices.tool)


@router.post(STOP_PATH, tags=["rig"], status_code=202)
async def stop(service: ServiceOf, actor: Actor) -> Accepted:
    """Halts all motion and switches the lamp off at once. The session that holds the rig is stopped.

    Nothing starts, resumes, parks or jogs until a person acknowledges (`POST /v1/rig/safety/acknowledgement`).
    """
    service.runner.halt(actor)
    return stop_accepted()


def stop_accepted() -> Accepted:
    """Returns the answer to a stop; the listener's thread sends it too."""
    return Accepted(links={"rig": RIG_LINKS["self"], "events": RIG_LINKS["events"], "safety": RIG_LINKS["safety"]})


@router.get("/v1/rig/safety", tags=["rig"])
def safety(service: ServiceOf) -> SafetyResource:
    """Returns the unacknowledged safety faults, and whether the arm's controller would say if it reported a stop."""
    return _safety(service.runner.status())


@router.post(
    "/v1/rig/safety/acknowledgement", tags=["rig"], responses=problems.responses_of(ErrorCode.SAFETY_STILL_FAULTED)
)
def acknowledge(service: ServiceOf, actor: Actor) -> SafetyResource:
    """Acknowledges the faults: a person has inspected the cell and finds it clear. Sessions may start again.

    It is accepted without a connection to the arm's controller too, but `clear` is then false: starting or resuming
    connects, and is refused if the controller reports a stop.
    """
    service.runner.acknowledge(actor)
    return _safety(service.runner.status())


@router.post(
    "/v1/rig/safety/recovery",
    tags=["rig"],
    status_code=202,
    responses=problems.responses_of(
        ErrorCode.SAFETY_RECOVERY_FORBIDDEN,
        ErrorCode.SAFETY_NOT_ACKNOWLEDGED,
        ErrorCode.SAFETY_RECOVERY_REFUSED,
        *problems.BODY_CODES,
        ErrorCode.RIG_NOT_READY,
        ErrorCode.ARM_UNREACHABLE,
    ),
)
async def recover(service: ServiceOf, actor: Actor, request: RecoveryRequest) -> Accepted:
    """Unlocks a protective stop, powers the arm on or releases its brakes. The arm itself does not move.

    Disabled unless the cell file allows it, and only for the operator who has just acknowledged, even if that was
    refused because the stop persists. The latch stays until the cell is acknowledged again.
    """
    await anyio.to_thread.run_sync(service.runner.recover, request.step, actor, limiter=service.limits.start)
    return Accepted(links={"safety": RIG_LINKS["safety"], "rig": RIG_LINKS["self"]})


@router.post(
    "/v1/rig/park",
    tags=["rig"],
    status_code=202,
    responses=problems.responses_of(
        ErrorCode.RIG_BUSY,
        ErrorCode.RIG_NOT_READY,
        ErrorCode.SAFETY_NOT_ACKNOWLEDGED,
        ErrorCode.WAYPOINTS_COLLISION,
        ErrorCode.ARM_UNREACHABLE,
        ErrorCode.ARM_IN_USE,
        ErrorCode.ARM_NOT_READY,
        ErrorCode.ARM_PREFLIGHT,
        ErrorCode.ARM_PROTECTIVE_STOP,
        ErrorCode.ARM_EMERGENCY_STOP,
        ErrorCode.CAMERA_UNREACHABLE,
        ErrorCode.DRIVER_LOST,
    ),
)
async def park(service: ServiceOf, actor: Actor) -> Accepted:
    """Moves the arm home from its present position on a certified path. Without such a path a person must move it.

    No session may hold the rig. The event `rig.parked` reports the outcome; `POST /v1/rig/stop` stops the motion.
    """
    await anyio.to_thread.run_sync(service.runner.moves.park, actor, limiter=service.limits.start)
    return Accepted(links={"rig": RIG_LINKS["self"], "stop": RIG_LINKS["stop"], "events": RIG_LINKS["events"]})


@router.get(
    "/v1/rig/reach",
    tags=["rig"],
    response_class=Response,
    responses={
        200: {"description": "A ReachMap", "content": {"application/json": {"schema": {"type": "object"}}}},
        **problems.responses_of(ErrorCode.RIG_BUSY, ErrorCode.RIG_NOT_READY, ErrorCode.SERVICE_OVERLOADED),
    },
)
async def reach(service: ServiceOf) -> Response:
    """Returns which light positions the arm can reach, else why not; computed once per cell, in about a minute."""
    content = await in_turn(service.limits.reach, service.runner.planning.reach)
    return Response(content, media_type="application/json")


def _resource(status: RigStatus, tool: Tool) -> RigResource:
    reading = status.reading
    identity = status.identity
    valid_until = datetime.fromisoformat(status.calibration_valid_until)
    return RigResource(
        version=VERSION,
        cell=status.cell,
        fingerprint=status.fingerprint,
        arm_model=status.arm_model,
        arm_address=status.arm_address,
        arm=None if identity is None else ArmResource.model_validate(identity, from_attributes=True),
        connected=reading.connected,
        driver_priority=reading.driver_priority,
        tool=tool,
        camera_ready=status.camera_ready,
        reading=None
        if not reading.connected
        else ReadingResource(
            joints=as_joints(reading.joints),
            joint_speeds=as_joints(reading.joint_speeds),
            base_from_tool=as_matrix4(reading.base_from_tool),
            robot_mode=reading.robot_mode,
            safety_bits=reading.safety_bits,
            program_running=reading.program_running,
            speed_fraction=reading.speed_fraction,
            age_s=round(time.monotonic() - reading.received_at, 4),
        ),
        holder=status.holder,
        may_start=status.may_start,
        reasons=_reasons(status.reasons),
        calibration=CalibrationResource(
            made_at=status.calibration_made_at,
            valid_until=status.calibration_valid_until,
            valid=datetime.now(UTC) < valid_until,
            check=status.calibration_check,
        ),
        faults=_faults(status.latched),
        links=RIG_LINKS,
    )


def _reasons(reasons: Iterable[Mapping[str, Any]]) -> list[Reason]:
    return [Reason(code=ErrorCode(item["code"]), detail=item["detail"], remedy=item["remedy"]) for item in reasons]


def _safety(status: RigStatus) -> SafetyResource:
    latch, reading = status.latched, status.reading
    known = reading.connected or reading.taking_control  # the driver is silent for seconds while it takes control
    links = {
        "self": RIG_LINKS["safety"],
        "acknowledgement": "/v1/rig/safety/acknowledgement",
        "recovery": "/v1/rig/safety/recovery",
    }
    return SafetyResource(clear=known and latch is None, connected=known, faults=_faults(latch), links=links)


def _faults(latch: Latch | None) -> list[Fault]:
    if latch is None:
        return []
    remedy = PROBLEMS[latch.code].remedy
    return [Fault(code=latch.code, detail=latch.detail, remedy=remedy, since=as_datetime(latch.since))]
