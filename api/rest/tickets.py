"""Routes of callers: the owner of a key, the list of keys, and tickets for images and events.

A browser sends no key when it loads an image or follows events; a page uses a ticket instead. Keys are made and revoked
only on the service's machine (`lightpose keys`). Whoever steals an admin's key can then neither make keys that outlive
it nor lock the others out, and no secret is ever sent.
"""

import time
from datetime import UTC, datetime, timedelta

from fastapi import APIRouter, Request

from acquisition.models.errors import ErrorCode
from api.rest import problems
from api.rest.dependencies import CallerOf
from api.rest.key_schemas import CallerResource, KeyResource, TicketResource
from api.rest.keys import TICKET_LIFETIME_S, KeyRing
from api.rest.schemas import Page

router = APIRouter(tags=["rig"])


@router.get("/v1/caller", responses=problems.responses_of(ErrorCode.REQUEST_UNAUTHENTICATED))
async def caller(caller: CallerOf) -> CallerResource:
    """Returns the name and role of the caller's key, so that a page offers only what the key allows."""
    return CallerResource(name=caller.name, role=caller.role)


@router.get(
    "/v1/keys",
    responses=problems.responses_of(ErrorCode.REQUEST_UNAUTHENTICATED, ErrorCode.REQUEST_FORBIDDEN),
)
async def keys(request: Request) -> Page[KeyResource]:
    """Lists the keys of the service with roles, age and last use, for admins.

    They are made and revoked on the service's machine: `lightpose keys add`, `lightpose keys revoke`.
    """
    ring: KeyRing = request.app.state.keys
    return Page[KeyResource](
        items=[
            KeyResource(
                name=key.name,
                role=key.role,
                created=datetime.fromtimestamp(key.created_at, UTC),
                last_used=None if used is None else datetime.fromtimestamp(used, UTC),
            )
            for key, used in ring.listed()
        ]
    )


@router.post("/v1/tickets", status_code=201, responses=problems.responses_of(ErrorCode.REQUEST_UNAUTHENTICATED))
async def ticket(request: Request, caller: CallerOf) -> TicketResource:
    """Issues a ticket for `<img>` and `EventSource`: add `?ticket=…` to any GET. It allows reading only."""
    keys: KeyRing = request.app.state.keys
    good_until = datetime.now(UTC) + timedelta(seconds=TICKET_LIFETIME_S)
    return TicketResource(ticket=keys.issue_ticket(caller, time.monotonic()), good_until=good_until)
