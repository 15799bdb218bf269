"""Routes of light plans: dry runs, forecast and replacement of a plan under review, gain maps of planned lights.

All of them answer before the arm moves, so that a person can judge a plan by its lights, its path and its gain.
"""

import anyio.to_thread
from fastapi import APIRouter, Request
from fastapi.responses import FileResponse, Response

from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_forecast import LightForecast
from acquisition.models.recipe import Recipe
from api.rest import problems, sessions, stored_files
from api.rest.dependencies import Actor, Number, ServiceOf, SessionId
from api.rest.schemas import DryRunResource, OwnLights, PassResource
from api.rest.turns import in_turn

router = APIRouter(tags=["sessions"])

_UNREACHABLE_LIGHTS = (ErrorCode.PLAN_INFEASIBLE, ErrorCode.WAYPOINTS_UNREACHABLE, ErrorCode.WAYPOINTS_COLLISION)


@router.post(
    "/v1/dry-runs",
    responses=problems.responses_of(
        *problems.BODY_CODES,
        *_UNREACHABLE_LIGHTS,
        ErrorCode.RIG_BUSY,
        ErrorCode.SESSION_STEP_FAILED,
        ErrorCode.COMPUTE_LOST,
        ErrorCode.SERVICE_OVERLOADED,
    ),
)
async def dry_run(service: ServiceOf, recipe: Recipe) -> DryRunResource:
    """Plans the first pass of a recipe: its lights, the path through them, its duration. Nothing moves or is stored.

    With method `optimal` these are the pilot's lights, because later plans depend on the pilot's images. `forecast`
    states the accuracy to expect against the number of images, for an assumed object.
    """
    proposal = await in_turn(service.limits.reach, service.runner.planning.dry_run, recipe)
    return DryRunResource(
        plan=proposal.plan, route=proposal.route, seconds=proposal.seconds, forecast=proposal.forecast
    )


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
        ErrorCode.COMPUTE_LOST,
        ErrorCode.SERVICE_OVERLOADED,
    ),
)
async def replace_plan(
    service: ServiceOf, session_id: SessionId, number: Number, request: OwnLights, actor: Actor
) -> PassResource:
    """Replaces the lights of a plan that waits for review by a person's own lights, each of which must be reachable.

    The session stays paused. The plan may be replaced again, and `resume` executes it.
    """
    await in_turn(service.limits.reach, service.runner.planning.replace_plan, session_id, number, request.lights, actor)
    return await anyio.to_thread.run_sync(sessions.one_pass, service, session_id, number)


@router.post(
    "/v1/sessions/{session_id}/passes/{number}/plan/forecast",
    response_model=LightForecast,
    responses={
        **stored_files.binary("image/png", description="The forecast; with `Accept: image/png` its picture of σ"),
        **problems.responses_of(
            ErrorCode.SESSION_NOT_FOUND,
            ErrorCode.REQUEST_NOT_FOUND,
            ErrorCode.SESSION_ACTION_NOT_ALLOWED,
            *problems.BODY_CODES,
            ErrorCode.PLAN_INFEASIBLE,
            ErrorCode.RIG_BUSY,
            ErrorCode.SESSION_STEP_FAILED,
            ErrorCode.COMPUTE_LOST,
            ErrorCode.SERVICE_OVERLOADED,
        ),
    },
)
async def forecast_plan(
    service: ServiceOf, session_id: SessionId, number: Number, request: OwnLights, http_request: Request
) -> Response:
    """Forecasts σ for other lights of a plan under review, with the gain of each and whether the arm can serve it.

    Nothing is committed; `PUT …/plan` does that. With `Accept: image/png` the answer is a picture of σ over the object,
    dark where σ is small. The picture costs no further computation directly after a request for the figures of the same
    lights. Forecasts are computed one after another, so send the next request when the last one is answered.
    """
    forecast, picture = await in_turn(
        service.limits.forecasts, service.runner.planning.forecast, session_id, number, request.lights
    )
    headers = {"Cache-Control": "no-store", "Vary": "Accept"}
    if "image/png" not in http_request.headers.get("accept", ""):
        return Response(forecast.model_dump_json(), media_type="application/json", headers=headers)
    if picture is None:
        raise RigError(
            ErrorCode.REQUEST_NOT_FOUND,
            f"No result precedes pass {number}, so σ cannot be forecast for its lights",
        )
    return Response(picture, media_type="image/png", headers=headers)


@router.get(
    "/v1/sessions/{session_id}/passes/{number}/lights/{light}/gain.png",
    response_class=FileResponse,
    responses={
        **stored_files.binary("image/png", description="The picture"),
        **problems.NOT_FOUND,
        **problems.responses_of(ErrorCode.STORE_CORRUPT),
    },
)
def gain(service: ServiceOf, session_id: SessionId, number: Number, light: Number) -> FileResponse:
    """Returns the gain map of a planned light: its reduction of σ, black for none, white for `brightest_gain_deg`."""
    service.store.journal.session(session_id)
    plan = stored_files.newest(service, session_id, "plan", number)
    digests: list[str] = plan.body.get("pictures", []) if plan is not None else []
    if light >= len(digests):
        raise RigError(
            ErrorCode.REQUEST_NOT_FOUND, f"Pass {number} has no gain map of light {light}: only planned lights have one"
        )
    path = service.store.folder(session_id) / f"passes/{number}/gain_{light}.png"
    return stored_files.revalidated_png(path, digests[light])
