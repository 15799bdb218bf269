"""Routes of jogging: a person moves the arm while a button is held, in certified steps with a dead-man.

The page sends a request when the button is pressed and about every 0.1 s while it is held, all with the same `hold`.
When the requests cease, the arm decelerates. The rest is done by the runner (`runner.operator_moves`).
"""

from functools import partial
from typing import Annotated

import anyio.to_thread
from fastapi import APIRouter, Body
from pydantic import Field

from acquisition.models.base import Value
from acquisition.models.errors import ErrorCode
from acquisition.models.jog import JogMotion
from acquisition.runner.operator_moves import HOLD_S
from api.rest import problems
from api.rest.authentication import STOP_PATH
from api.rest.dependencies import Actor, ServiceOf
from api.rest.schemas import Links, Resource

router = APIRouter(tags=["rig"])

_LINKS = {"release": "/v1/rig/jog/release", "stop": STOP_PATH, "rig": "/v1/rig", "events": "/v1/events"}


class JogRequest(JogMotion):
    """A press of a jog button, or its renewal. It moves one joint, or the tool along one axis."""

    hold: str = Field(
        min_length=8,
        max_length=64,
        pattern=r"^[A-Za-z0-9_-]+$",
        description="Name of this press, such as a UUID: the same in all its renewals, a new one for each press; "
        "refused once the motion of the press has ended, for whatever reason",
    )
    once: bool = Field(default=False, description="End after one step, however long the button is held")

    @property
    def motion(self) -> JogMotion:
        """The requested motion."""
        return JogMotion.model_validate({name: getattr(self, name) for name in JogMotion.model_fields})


class JogRelease(Value):
    """Release of a jog button."""

    hold: str | None = Field(
        default=None,
        max_length=64,
        description="Name of the press; a request of it that arrives later moves nothing",
    )


Released = Annotated[JogRelease | None, Body(description="The press that is released; without it any jog ends")]


class JogResource(Resource):
    """State of a jog. The event `rig.jogged` reports its end."""

    moving: bool = Field(description="Whether the arm moves; false while it is made ready, and after a release")
    hold_s: float = Field(description="How long the arm goes on without a renewal, s")
    links: Links = Field(description="Addresses: `release`, `stop`, `rig`, `events`")


@router.post(
    "/v1/rig/jog",
    status_code=202,
    responses=problems.responses_of(
        *problems.BODY_CODES,
        ErrorCode.RIG_BUSY,
        ErrorCode.ARM_JOG_ENDED,
        ErrorCode.RIG_NOT_READY,
        ErrorCode.SAFETY_NOT_ACKNOWLEDGED,
        ErrorCode.WAYPOINTS_COLLISION,
        ErrorCode.WAYPOINTS_UNREACHABLE,
        ErrorCode.SESSION_STEP_FAILED,
        ErrorCode.COMPUTE_LOST,
        ErrorCode.ARM_UNREACHABLE,
        ErrorCode.ARM_IN_USE,
        ErrorCode.ARM_NOT_READY,
        ErrorCode.ARM_PREFLIGHT,
        ErrorCode.ARM_MOVE_FAILED,
        ErrorCode.ARM_PROTECTIVE_STOP,
        ErrorCode.ARM_EMERGENCY_STOP,
        ErrorCode.CAMERA_UNREACHABLE,
        ErrorCode.DEVICE_DISCONNECTED,
        ErrorCode.DRIVER_LOST,
    ),
)
async def jog(service: ServiceOf, actor: Actor, request: JogRequest) -> JogResource:
    """Moves a joint, or the tool along an axis, slowly while requests with the same `hold` keep arriving.

    Each step is checked for collisions and limits like any path, and the arm stops before an obstacle. Without a
    renewal within `hold_s` it decelerates. No session may hold the rig, and the queue must not run.
    """
    move = partial(service.runner.moves.jog, request.hold, request.motion, actor, once=request.once)
    moving = await anyio.to_thread.run_sync(move, limiter=service.limits.jog)
    return JogResource(moving=moving, hold_s=HOLD_S, links=_LINKS)


@router.post(
    "/v1/rig/jog/release",
    status_code=202,
    responses=problems.responses_of(*problems.BODY_CODES, ErrorCode.RIG_BUSY),
)
async def release_jog(service: ServiceOf, released: Released = None) -> JogResource:
    """Ends a jog at once, as when the button is released. Answers when the arm is at rest. Harmless without a jog."""
    hold = None if released is None else released.hold
    await anyio.to_thread.run_sync(service.runner.moves.release, hold, limiter=service.limits.release)
    return JogResource(moving=False, hold_s=HOLD_S, links=_LINKS)
