"""Tickets: how a page shows images and follows events, where the browser sends no key with the request."""

import time
from datetime import UTC, datetime, timedelta

from fastapi import APIRouter, Request

from acquisition.models.errors import ErrorCode
from api.rest import problems
from api.rest.context import CallerOf
from api.rest.keys import TICKET_S, KeyRing
from api.rest.schemas import TicketResource

router = APIRouter(tags=["rig"])


@router.post("/v1/tickets", status_code=201, responses=problems.declared(ErrorCode.REQUEST_UNAUTHENTICATED))
async def ticket(request: Request, caller: CallerOf) -> TicketResource:
    """A ticket for `<img>` and `EventSource`: add `?ticket=…` to any GET; it can look and nothing else."""
    keys: KeyRing = request.app.state.keys
    good_until = datetime.now(UTC) + timedelta(seconds=TICKET_S)
    return TicketResource(ticket=keys.issue_ticket(caller, time.monotonic()), good_until=good_until)
