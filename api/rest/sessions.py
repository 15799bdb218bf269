"""Routes of sessions: creation, lists, deletion, actions, passes.

A resource is built from the journal for each request. Creating a session moves nothing; only an action does. Start and
resume may wait for devices. Actions therefore have thread limits of their own, so that reading continues however many
callers wait for a dead device. A stop has threads that no other request may occupy.
"""

import json
from functools import partial
from typing import Annotated, Any, cast
from urllib.parse import urlencode

import anyio.to_thread
from fastapi import APIRouter, Body, Depends, Header, Query, Request, Response

from acquisition import session_state
from acquisition.models.calibration_recipe import AnyRecipe
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import LightPlan
from acquisition.models.recipe import Recipe
from acquisition.models.route import Route
from acquisition.runner import estimates
from acquisition.session_state import State, Trigger
from acquisition.store import Action, SessionFilter, SessionRow
from acquisition.store.folder import read_value, remove
from api.rest import images, problems, results, stored_files
from api.rest.dependencies import (
    IDEMPOTENCY_KEY,
    Actor,
    CallerOf,
    Number,
    ServiceOf,
    SessionId,
    Time,
    refuse_unknown_query,
)
from api.rest.keys import Caller, Role
from api.rest.paging import Limit, Offset, page
from api.rest.schemas import (
    ActionAccepted,
    ActionRequest,
    ActionResource,
    Page,
    PassResource,
    PassSummary,
    Problem,
    SessionAction,
    SessionEdit,
    SessionResource,
    ShotResource,
    as_datetime,
)
from api.rest.wiring import Service

router = APIRouter(tags=["sessions"])

_ACTOR_OF_ROLE = {
    Role.VIEWER: session_state.Actor.VIEWER,
    Role.OPERATOR: session_state.Actor.OPERATOR,
    Role.ADMIN: session_state.Actor.OPERATOR,
}


# ------------------------------------------------------------------------------------------------------------ sessions


@router.post(
    "/v1/sessions",
    status_code=201,
    responses={
        200: {"model": SessionResource, "description": "The session that this Idempotency-Key made before"},
        **problems.responses_of(
            *problems.BODY_CODES,
            ErrorCode.CALIBRATION_INFEASIBLE,
            ErrorCode.STORE_DISK_FULL,
        ),
    },
)
def create(
    service: ServiceOf,
    response: Response,
    caller: CallerOf,
    recipe: Annotated[AnyRecipe, Body(description="`{}`: the default session")] = Recipe(),  # noqa: B008 - frozen
    idempotency_key: Annotated[str | None, Header(min_length=1, max_length=200, description=IDEMPOTENCY_KEY)] = None,
) -> SessionResource:
    """Creates a session from a recipe. Nothing moves. The same Idempotency-Key never creates a second session."""
    row, new = service.runner.create(recipe, idempotency_key)
    response.status_code = 201 if new else 200
    response.headers["Location"] = f"/v1/sessions/{row.id}"
    return _resource(service, row, caller)


@router.get(
    "/v1/sessions",
    responses=problems.responses_of(ErrorCode.REQUEST_INVALID),
    dependencies=[Depends(refuse_unknown_query)],
)
def sessions(  # noqa: PLR0913 - a parameter of the query each
    service: ServiceOf,
    request: Request,
    caller: CallerOf,
    state: Annotated[
        list[State], Query(max_length=len(State), description="Only sessions in one of these states")
    ] = [],  # noqa: B006
    label: Annotated[
        str, Query(max_length=200, description="Only sessions whose label contains this, case ignored")
    ] = "",
    since: Annotated[Time | None, Query(description="Only sessions created at or after this time")] = None,
    until: Annotated[Time | None, Query(description="Only sessions created before this time")] = None,
    limit: Limit = 20,
    after: Annotated[
        int | None, Query(ge=1, le=2**62, description="Number of the last session of the page before")
    ] = None,
) -> Page[SessionResource]:
    """Lists sessions, newest first, by state, part of the label, and time of creation. Unknown parameters are refused.

    A session whose files are missing or damaged is listed with that problem in `damage`.
    """
    wanted = SessionFilter(
        states=tuple(state),
        label=label,
        since=None if since is None else since.timestamp(),
        until=None if until is None else until.timestamp(),
    )
    rows = service.store.journal.sessions(limit + 1, after, wanted)
    more = None
    if len(rows) > limit:
        given = [pair for pair in request.query_params.multi_items() if pair[0] not in ("after", "limit", "ticket")]
        more = f"/v1/sessions?{urlencode([*given, ('limit', limit), ('after', rows[limit - 1].number)])}"
    listed = (_listed(service, row, caller) for row in rows[:limit])
    return Page[SessionResource](items=[one for one in listed if one is not None], next=more)


@router.get(
    "/v1/sessions/{session_id}", responses={**problems.NOT_FOUND, **problems.responses_of(ErrorCode.STORE_CORRUPT)}
)
def read(service: ServiceOf, session_id: SessionId, caller: CallerOf) -> SessionResource:
    """Returns one session: state, progress, allowed actions, answer."""
    return _resource(service, service.store.journal.session(session_id), caller)


@router.patch(
    "/v1/sessions/{session_id}",
    responses={
        **problems.NOT_FOUND,
        **problems.responses_of(
            ErrorCode.RESULT_NOT_READY,
            ErrorCode.NORMALS_INFEASIBLE,
            *problems.BODY_CODES,
            ErrorCode.STORE_DISK_FULL,
        ),
    },
)
def edit(
    service: ServiceOf, session_id: SessionId, actor: Actor, caller: CallerOf, change: SessionEdit
) -> SessionResource:
    """Changes a session's label or notes, or chooses which result is its answer, in any state.

    The recipe stays as it was ordered. Until a person chooses, the answer is the last result of origin `session`.
    """
    journal = service.store.journal
    journal.session(session_id)
    if change.answer is not None:
        results.choose_answer(service, session_id, change.answer, actor)
    if change.label is not None or change.notes is not None:
        journal.describe_session(session_id, change.label, change.notes, actor)
    return _resource(service, journal.session(session_id), caller)


@router.delete(
    "/v1/sessions/{session_id}",
    status_code=204,
    response_class=Response,  # without a media type, as without a body
    responses={**problems.NOT_FOUND, **problems.responses_of(ErrorCode.SESSION_ACTION_NOT_ALLOWED)},
)
def delete(service: ServiceOf, session_id: SessionId) -> None:
    """Deletes a session that does not hold the rig, with all its files. A running solve of it is ended first."""
    folder = service.store.folder(session_id)
    service.store.journal.delete_session(session_id)
    service.resolving.end_of(session_id)
    remove(folder)


# ------------------------------------------------------------------------------------------------------------- actions


@router.post(
    "/v1/sessions/{session_id}/actions",
    status_code=202,
    responses={
        **problems.NOT_FOUND,
        **problems.responses_of(
            ErrorCode.SESSION_ACTION_NOT_ALLOWED,
            ErrorCode.RIG_BUSY,
            ErrorCode.RIG_CHANGED,
            ErrorCode.RIG_OTHER_TOOL,
            ErrorCode.CALIBRATION_INFEASIBLE,
            ErrorCode.REQUEST_INVALID,
            ErrorCode.SAFETY_NOT_ACKNOWLEDGED,
            ErrorCode.ARM_PROTECTIVE_STOP,
            ErrorCode.ARM_EMERGENCY_STOP,
            ErrorCode.RIG_NOT_READY,
            ErrorCode.ARM_UNREACHABLE,
            ErrorCode.ARM_PREFLIGHT,
            ErrorCode.ARM_ELSEWHERE,
            ErrorCode.STORE_DISK_FULL,
            ErrorCode.CAMERA_UNREACHABLE,
        ),
    },
)
async def act(service: ServiceOf, session_id: SessionId, request: ActionRequest, actor: Actor) -> ActionAccepted:
    """Starts, pauses, resumes or stops a session. Repeating a request is not an error."""
    trigger = Trigger(request.action)
    limits = service.limits
    limiter = {Trigger.STOP: limits.stop, Trigger.PAUSE: limits.pause}.get(trigger, limits.start)
    state = await anyio.to_thread.run_sync(
        partial(service.runner.act, session_id, trigger, actor, from_here=request.from_here), limiter=limiter
    )
    return ActionAccepted(state=state, links={"session": f"/v1/sessions/{session_id}"})


@router.get("/v1/sessions/{session_id}/actions", responses=problems.NOT_FOUND)
def actions(
    service: ServiceOf,
    request: Request,
    session_id: SessionId,
    limit: Limit = 100,
    after: Offset = 0,
) -> Page[ActionResource]:
    """Lists the actions on a session with their actors, oldest first, including those of the service itself."""
    service.store.journal.session(session_id)
    items = [_action(item) for item in service.store.journal.actions(session_id)]
    return page(request, items, limit, after)


# -------------------------------------------------------------------------------------------------------------- passes


@router.get("/v1/sessions/{session_id}/passes", responses=problems.NOT_FOUND)
def passes(
    service: ServiceOf, request: Request, session_id: SessionId, limit: Limit = 100, after: Offset = 0
) -> Page[PassSummary]:
    """Lists the passes that have a plan."""
    service.store.journal.session(session_id)
    shots = service.store.journal.shots(session_id)
    # A review that replaced a plan has left the one before in the journal.
    newest = {plan.number: plan for plan in service.store.journal.artifacts(session_id, "plan")}
    items = [
        PassSummary(
            number=plan.number,
            method=plan.body["method"],
            lights=plan.body["lights"],
            shots=sum(shot.key.pass_number == plan.number for shot in shots),
            predicted_sigma_deg=plan.body["predicted_sigma_deg"],
            links={"self": f"/v1/sessions/{session_id}/passes/{plan.number}"},
        )
        for _, plan in sorted(newest.items())
    ]
    return page(request, items, limit, after)


@router.get("/v1/sessions/{session_id}/passes/{number}", responses=problems.NOT_FOUND)
def one_pass(service: ServiceOf, session_id: SessionId, number: Number) -> PassResource:
    """Returns one pass: its lights, the path through them, its images."""
    folder = service.store.folder(session_id)
    plan = stored_files.newest(service, session_id, "plan", number)
    if plan is None:
        raise RigError(ErrorCode.REQUEST_NOT_FOUND, f"Session {session_id} has no pass {number} (yet)")
    route = stored_files.newest(service, session_id, "route", number)
    pass_path = f"/v1/sessions/{session_id}/passes/{number}"
    return PassResource(
        number=number,
        plan=read_value(LightPlan, folder, plan.path),
        route=None if route is None else read_value(Route, folder, route.path),
        shots=[
            ShotResource(shot=shot, links=images.links(pass_path, shot))
            for shot in service.store.journal.shots(session_id)
            if shot.key.pass_number == number
        ],
        gain_pictures=[f"{pass_path}/lights/{light}/gain.png" for light in range(len(plan.body.get("pictures", [])))],
        links={"self": pass_path, "session": f"/v1/sessions/{session_id}"},
    )


# ----------------------------------------------------------------------------------------------------------- resources


def _listed(service: Service, row: SessionRow, caller: Caller) -> SessionResource | None:
    """Returns a session for a list, with `damage` if its files are damaged; None if it has been deleted meanwhile."""
    try:
        try:
            return _resource(service, row, caller)
        except RigError as error:
            if error.code is not ErrorCode.STORE_CORRUPT:
                raise
            return _resource(service, row, caller, damage=error)
    except RigError as error:
        if error.code is not ErrorCode.SESSION_NOT_FOUND:
            raise
        return None


def _resource(service: Service, row: SessionRow, caller: Caller, damage: RigError | None = None) -> SessionResource:
    """Builds the resource of a session, with `damage` without its files. Raises RigError store.corrupt."""
    whole = damage is None
    progress = service.runner.progress(row.id) if whole else service.runner.announced_progress(row)
    plans = service.store.journal.artifacts(row.id, "plan")
    session_path, estimate = f"/v1/sessions/{row.id}", estimates.newest(service.store, row.id)
    return SessionResource(
        id=row.id,
        number=row.number,
        state=row.state,
        arm=session_state.ARM_STATE[row.state],
        stage=progress.stage,
        progress=progress.progress,
        seconds_left=progress.time_left.seconds if progress.time_left and row.state is State.RUNNING else None,
        time_left=progress.time_left,
        reason=None if row.reason is None else _reason(row.reason, session_path),
        conclusion=plans[-1].body.get("conclusion") if plans else None,
        allowed_actions=cast(
            list[SessionAction],
            [str(action) for action in session_state.allowed_actions(row.state, _ACTOR_OF_ROLE[caller.role])],
        ),
        recipe=row.recipe,
        label=row.label,
        notes=row.notes,
        cell=json.loads(row.cell)["name"],
        created=as_datetime(row.created_at),
        started=None if row.started_at is None else as_datetime(row.started_at),
        ended=None if row.ended_at is None else as_datetime(row.ended_at),
        calibration=service.store.calibration_of(row.id) if whole else None,
        estimate=None if estimate is None else estimates.summary_of(estimate),
        answer=results.answer(service, row.id) if whole else None,
        damage=None if damage is None else Problem.of(damage.code, damage.detail, damage.context, session_path),
        links={
            "self": session_path,
            "actions": f"{session_path}/actions",
            "events": f"/v1/events?session_id={row.id}&after=0",
            "passes": f"{session_path}/passes",
            "results": f"{session_path}/results",
        },
    )


def _reason(stored: dict[str, Any], instance: str) -> Problem:
    context = {key: value for key, value in stored.items() if key not in ("code", "detail")}
    return Problem.of(ErrorCode(stored["code"]), stored["detail"], context, instance)


def _action(item: Action) -> ActionResource:
    return ActionResource(action=item.action, actor=item.actor, outcome=item.outcome, at=as_datetime(item.at))
