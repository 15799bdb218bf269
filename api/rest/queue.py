"""Routes of the queue: sessions that run one after another, each with the name of its object.

Adding, ordering and removing entries moves nothing. The queue continues by itself only after a person has resumed it,
and stops before every object that has to be placed. The rules are in `acquisition.runner.session_queue`.
"""

from datetime import datetime
from functools import partial
from typing import Annotated, Any, Literal

import anyio.to_thread
from fastapi import APIRouter, Header, Response
from fastapi import Path as InPath
from pydantic import Field

from acquisition.models.errors import ErrorCode
from acquisition.models.recipe import Recipe
from acquisition.store.queue_table import EntryState, QueueEntry, QueueState
from api.rest import problems
from api.rest.dependencies import Actor, ServiceOf
from api.rest.schemas import Links, Problem, RequestBody, Resource, as_datetime
from api.rest.wiring import Service

router = APIRouter(tags=["queue"])

EntryId = Annotated[int, InPath(ge=1, le=2**62, description="The entry's number")]
_PATH = "/v1/queue"


class QueueEntryRequest(RequestBody):
    """A session to be queued."""

    object_name: str = Field(
        min_length=1, max_length=200, description="Name of the session's object; entries of one name are of one object"
    )
    recipe: Recipe = Field(
        default=Recipe(), description="The session's recipe; without a label it gets the object's name"
    )
    unattended: bool = Field(
        default=False,
        description="Whether it begins without a person's confirmation although the session before was of another "
        "object: only where nobody reaches into the cell to change the object",
    )


class QueueOrder(RequestBody):
    """A new order of the waiting entries."""

    entries: list[int] = Field(max_length=1000, description="Numbers of all waiting entries, the next one first")


class QueueActionRequest(RequestBody):
    """An action on the queue."""

    action: Literal["resume", "pause"] = Field(
        description="`resume`: the next entry's object is in place and the cell is clear, sessions may begin; `pause`: "
        "the present session goes on, and no further one begins"
    )
    entry: int | None = Field(
        default=None,
        ge=1,
        le=2**62,
        description="With `resume`: the entry whose object the person means; refused when another one is next, such "
        "as after a change of the order",
    )


class QueueEntryResource(Resource):
    """One entry of the queue."""

    id: int = Field(description="The entry's number")
    object_name: str = Field(description="Name of its session's object")
    recipe: Recipe = Field(description="Its session's recipe")
    unattended: bool = Field(
        description="Whether it begins without a person's confirmation although the object changes"
    )
    state: EntryState = Field(
        description="`running`: its session has begun and not ended, paused and interrupted included; `done`: it has "
        "completed; `failed`: it was stopped, deleted, or has failed"
    )
    session_id: str | None = Field(description="Its session, once there is one")
    added_by: str = Field(description="Who added it")
    added: datetime = Field(description="When it was added, UTC")
    ended: datetime | None = Field(description="When its session ended, UTC")
    links: Links = Field(description="Addresses: `self`, `queue`, and `session` once there is one")


class QueueResource(Resource):
    """The queue: whether it continues by itself, why not, and its entries."""

    state: QueueState = Field(
        description="`running`: it begins the next session by itself; `stopped`: a person has to resume it"
    )
    reason: Problem | None = Field(description="Why it stopped by itself; null: a person paused it, or it became empty")
    changed_by: str = Field(description="Who resumed or stopped it last; `service`: itself")
    changed: datetime | None = Field(description="When, UTC; null: nobody has resumed or stopped it yet")
    next_object: str | None = Field(description="Object of the next session; null: no entry waits")
    entries: list[QueueEntryResource] = Field(
        description="The last 20 entries that have ended, oldest first; the one that runs; those that wait, in order"
    )
    links: Links = Field(description="Addresses: `self`, `entries`, `order`, `actions`, `events`")


@router.get(_PATH)
def queue(service: ServiceOf) -> QueueResource:
    """Returns the queue: its state, its entries, and the reason if it has stopped by itself."""
    return _queue(service)


@router.post(
    _PATH + "/entries",
    status_code=201,
    responses={
        200: {"model": QueueEntryResource, "description": "The entry that this Idempotency-Key made before"},
        **problems.responses_of(*problems.BODY_CODES, ErrorCode.STORE_DISK_FULL),
    },
)
def enqueue(
    service: ServiceOf,
    response: Response,
    actor: Actor,
    request: QueueEntryRequest,
    idempotency_key: Annotated[
        str | None, Header(min_length=1, max_length=200, description="The same key never makes a second entry")
    ] = None,
) -> QueueEntryResource:
    """Adds an entry at the end of the queue. No session begins unless the queue is running."""
    entry, new = service.store.journal.add_queue_entry(
        request.object_name, request.recipe, actor, unattended=request.unattended, idempotency_key=idempotency_key
    )
    response.status_code = 201 if new else 200
    response.headers["Location"] = f"{_PATH}/entries/{entry.id}"
    return _entry(entry)


@router.get(_PATH + "/entries/{entry_id}", responses=problems.responses_of(ErrorCode.REQUEST_NOT_FOUND))
def queue_entry(service: ServiceOf, entry_id: EntryId) -> QueueEntryResource:
    """Returns one entry of the queue."""
    return _entry(service.store.journal.queue_entry(entry_id))


@router.delete(
    _PATH + "/entries/{entry_id}",
    status_code=204,
    response_class=Response,  # without a media type, as without a body
    responses=problems.responses_of(
        ErrorCode.REQUEST_NOT_FOUND, ErrorCode.QUEUE_ENTRY_BEGUN, ErrorCode.STORE_DISK_FULL
    ),
)
def remove_queue_entry(service: ServiceOf, entry_id: EntryId, actor: Actor) -> None:
    """Removes an entry whose session has not begun or has ended. The session itself is kept."""
    service.store.journal.remove_queue_entry(entry_id, actor)


@router.put(_PATH + "/order", responses=problems.responses_of(*problems.BODY_CODES, ErrorCode.STORE_DISK_FULL))
def order_queue(service: ServiceOf, request: QueueOrder, actor: Actor) -> QueueResource:
    """Changes the order of the waiting entries."""
    service.store.journal.order_queue(request.entries, actor)
    return _queue(service)


@router.post(
    _PATH + "/actions",
    status_code=202,
    responses=problems.responses_of(
        *problems.BODY_CODES,
        ErrorCode.RIG_BUSY,
        ErrorCode.QUEUE_OBJECT_TO_PLACE,
        ErrorCode.SAFETY_NOT_ACKNOWLEDGED,
        ErrorCode.ARM_PROTECTIVE_STOP,
        ErrorCode.ARM_EMERGENCY_STOP,
        ErrorCode.STORE_DISK_FULL,
    ),
)
async def act_on_queue(service: ServiceOf, request: QueueActionRequest, actor: Actor) -> QueueResource:
    """Resumes or pauses the queue. By resuming, a person states that the next object is in place and the cell is clear.

    The start of the next session is checked like any other. If it is refused, the queue stops again, and the event
    `queue.changed` carries the problem as `reason`.
    """
    queue_ = service.queue
    change = (
        partial(queue_.resume, actor, request.entry) if request.action == "resume" else partial(queue_.pause, actor)
    )
    await anyio.to_thread.run_sync(change, limiter=service.limits.queue)
    return await anyio.to_thread.run_sync(_queue, service)


def _queue(service: Service) -> QueueResource:
    status, entries = service.store.journal.queue_status(), service.queue.entries()
    waiting = [entry for entry in entries if entry.state is EntryState.WAITING]
    return QueueResource(
        state=status.state,
        reason=None if status.reason is None else _problem(status.reason),
        changed_by=status.changed_by,
        changed=as_datetime(status.changed_at) if status.changed_at > 0 else None,
        next_object=waiting[0].object_name if waiting else None,
        entries=[_entry(entry) for entry in entries],
        links={
            "self": _PATH,
            "entries": f"{_PATH}/entries",
            "order": f"{_PATH}/order",
            "actions": f"{_PATH}/actions",
            "events": "/v1/events?type=queue.changed",
        },
    )


def _entry(entry: QueueEntry) -> QueueEntryResource:
    session = {} if entry.session_id is None else {"session": f"/v1/sessions/{entry.session_id}"}
    return QueueEntryResource(
        id=entry.id,
        object_name=entry.object_name,
        recipe=entry.recipe,
        unattended=entry.unattended,
        state=entry.state,
        session_id=entry.session_id,
        added_by=entry.added_by,
        added=as_datetime(entry.added_at),
        ended=None if entry.ended_at is None else as_datetime(entry.ended_at),
        links={"self": f"{_PATH}/entries/{entry.id}", "queue": _PATH, **session},
    )


def _problem(stored: dict[str, Any]) -> Problem:
    context = {key: value for key, value in stored.items() if key not in ("code", "detail")}
    return Problem.of(ErrorCode(stored["code"]), stored["detail"], context, _PATH)
