"""Plans before the arm moves: dry runs, and a person's own lights at the review of a plan."""

import anyio.to_thread
from fastapi import APIRouter

from acquisition.models.errors import ErrorCode
from acquisition.models.recipe import Recipe
from api.rest import problems, sessions
from api.rest.context import Actor, Number, ServiceOf, SessionId
from api.rest.schemas import DryRunResource, OwnLights, PassResource

router = APIRouter(tags=["sessions"])

_BODY = (ErrorCode.REQUEST_INVALID, ErrorCode.REQUEST_TOO_LARGE, ErrorCode.REQUEST_MEDIA_TYPE)
_LIGHTS = (ErrorCode.PLAN_INFEASIBLE, ErrorCode.WAYPOINTS_UNREACHABLE, ErrorCode.WAYPOINTS_COLLISION)


@router.post(
    "/v1/dry-runs", responses=problems.declared(*_BODY, *_LIGHTS, ErrorCode.RIG_BUSY, ErrorCode.SESSION_STEP_FAILED)
)
async def dry_run(service: ServiceOf, recipe: Recipe) -> DryRunResource:
    """What a recipe's first pass would do: its lights, the way through them, the time. Nothing moves, nothing is kept.

    Of method `optimal` these are the pilot's lights; what is planned afterwards depends on what they show.
    """
    found = await anyio.to_thread.run_sync(service.runner.planning.dry_run, recipe, limiter=service.limits.reach)
    return DryRunResource(plan=found.plan, route=found.route, seconds=found.seconds)


@router.put(
    "/v1/sessions/{session_id}/passes/{number}/plan",
    responses=problems.declared(
        ErrorCode.SESSION_NOT_FOUND,
        ErrorCode.SESSION_ACTION_NOT_ALLOWED,
        *_BODY,
        *_LIGHTS,
        ErrorCode.STORE_DISK_FULL,
        ErrorCode.RIG_NOT_READY,
        ErrorCode.SESSION_STEP_FAILED,
    ),
)
async def replace_plan(
    service: ServiceOf, session_id: SessionId, number: Number, request: OwnLights, actor: Actor
) -> PassResource:
    """Puts a person's own lights in the place of a plan that waits for review; each must be reachable.

    The session stays paused: what is there now may be replaced again, and `resume` takes it.
    """
    await anyio.to_thread.run_sync(
        service.runner.planning.replace_plan, session_id, number, request.lights, actor, limiter=service.limits.reach
    )
    return await anyio.to_thread.run_sync(sessions.one_pass, service, session_id, number)
