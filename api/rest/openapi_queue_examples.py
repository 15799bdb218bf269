"""Examples of the bodies of queue and archive for the OpenAPI description: coins, one after another."""

from datetime import UTC, datetime

from pydantic import BaseModel

from acquisition.models.errors import ErrorCode
from acquisition.models.recipe import Recipe
from acquisition.store.queue_table import EntryState, QueueState
from api.rest.outbox import ArchiveResource
from api.rest.queue import QueueActionRequest, QueueEntryRequest, QueueEntryResource, QueueOrder, QueueResource
from api.rest.schemas import Problem

_CREATED_AT = datetime(2026, 11, 21, 10, 15, tzinfo=UTC)

_ENTRY = QueueEntryResource(
    id=3,
    object_name="denarius 12",
    recipe=Recipe(planned_lights=8),
    unattended=False,
    state=EntryState.WAITING,
    session_id=None,
    added_by="lab@127.0.0.1",
    added=_CREATED_AT,
    ended=None,
    links={"self": "/v1/queue/entries/3", "queue": "/v1/queue"},
)
QUEUE_VALUES: tuple[BaseModel, ...] = (
    ArchiveResource(
        address="s3://objects/archive",
        archived=212,
        waiting=1,
        reason="archive.unreachable: s3://objects/archive: Could not connect to the endpoint URL",
        reason_at=_CREATED_AT,
        problem="archive.unreachable: s3://objects/archive: Could not connect to the endpoint URL",
        problem_at=_CREATED_AT,
    ),
    QueueEntryRequest(object_name="denarius 12", recipe=Recipe(planned_lights=8)),
    _ENTRY,
    QueueOrder(entries=[3, 2]),
    QueueActionRequest(action="resume"),
    QueueResource(
        state=QueueState.STOPPED,
        reason=Problem.of(
            ErrorCode.QUEUE_OBJECT_TO_PLACE,
            "The next object is 'denarius 12' (entry 3)",
            {"entry": 3, "object_name": "denarius 12"},
            "/v1/queue",
        ),
        changed_by="service",
        changed=_CREATED_AT,
        next_object="denarius 12",
        entries=[_ENTRY],
        links={"self": "/v1/queue", "actions": "/v1/queue/actions"},
    ),
)
