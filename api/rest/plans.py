"""Routes of light plans: dry runs, the replacement of a plan under review, and the gain map of each planned light.

All of them answer before the arm moves, so that a person can judge a plan by its lights, its path and its gain.
"""

import anyio.to_thread
from fastapi import APIRouter
from fastapi.responses import FileResponse

from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.recipe import Recipe
from api.rest import problems, sessions, stored_files
from api.rest.dependencies import Actor, Number, ServiceOf, SessionId
from api.rest.schemas import DryRunResource, OwnLights, PassResource

router = APIRouter(tags=["sessions"])

_UNREACHABLE_LIGHTS = (ErrorCode.PLAN_INFEASIBLE, ErrorCode.WAYPOINTS_UNREACHABLE, ErrorCode.WAYPOINTS_COLLISION)


@router.post(
    "/v1/dry-runs",
    responses=problems.responses_of(
        *problems.BODY_CODES, *_UNREACHABLE_LIGHTS, ErrorCode.RIG_BUSY, ErrorCode.SESSION_STEP_FAILED
    ),
)
async def dry_run(service: ServiceOf, recipe: Recipe) -> DryRunResource:
    """Plans a recipe's first pass: its lights, the path through them, its duration. Nothing moves, nothing is stored.

    With method `optimal` these are the pilot's lights; the later plans depend on the pilot's images.
    """
    proposal = await anyio.to_thread.run_sync(service.runner.planning.dry_run, recipe, limiter=service.limits.reach)
    return DryRunResource(plan=proposal.plan, route=proposal.route, seconds=proposal.seconds)


@router.put(
    "/v1/sessions/{session_id}/passes/{number}/plan",
    responses=problems.responses_of(
        ErrorCode.SESSION_NOT_FOUND,
        ErrorCode.SESSION_ACTION_NOT_ALLOWED,
        *problems.BODY_CODES,
        *_UNREACHABLE_LIGHTS,
        ErrorCode.STORE_DISK_FULL,
        ErrorCode.RIG_NOT_READY,
        ErrorCode.SESSION_STEP_FAILED,
    ),
)
async def replace_plan(
    service: ServiceOf, session_id: SessionId, number: Number, request: OwnLights, actor: Actor
) -> PassResource:
    """Replaces the lights of a plan that waits for review by a person's own; each must be reachable.

    The session stays paused: the plan may be replaced again, and `resume` executes it.
    """
    await anyio.to_thread.run_sync(
        service.runner.planning.replace_plan, session_id, number, request.lights, actor, limiter=service.limits.reach
    )
    return await anyio.to_thread.run_sync(sessions.one_pass, service, session_id, number)


@router.get(
    "/v1/sessions/{session_id}/passes/{number}/lights/{light}/gain.png",
    response_class=FileResponse,
    responses={
        200: {"content": {"image/png": {}}},
        **problems.NOT_FOUND,
        **problems.responses_of(ErrorCode.STORE_CORRUPT),
    },
)
def gain(service: ServiceOf, session_id: SessionId, number: Number, light: Number) -> FileResponse:
    """Gain map of a planned light: where on the object it reduces the normals' σ, from black (not at all) to white
    (`brightest_gain_deg` of the plan)."""
    service.store.journal.session(session_id)
    plan = stored_files.newest(service, session_id, "plan", number)
    digests: list[str] = plan.body.get("pictures", []) if plan is not None else []
    if light >= len(digests):
        raise RigError(
            ErrorCode.REQUEST_NOT_FOUND, f"Pass {number} has no gain map of light {light}: only planned lights have one"
        )
    path = service.store.folder(session_id) / f"passes/{number}/gain_{light}.png"
    return stored_files.revalidated_png(path, digests[light])
