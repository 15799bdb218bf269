"""Schemas of callers, tickets and keys. None of them holds the secret of a key or its hash."""

from datetime import datetime

from pydantic import Field

from api.rest.keys import Role
from api.rest.schemas import Resource


class CallerResource(Resource):
    """The caller of this request. Without keys its name and role are `operator`."""

    name: str = Field(description="Name of the key; `operator` without keys")
    role: Role = Field(
        description="What the key may do; each role may do what those before it may: viewer, operator, admin"
    )


class TicketResource(Resource):
    """A short-lived permission to read, for addresses that a browser requests by itself."""

    ticket: str = Field(description="The secret: `?ticket=…` in an address")
    good_until: datetime = Field(description="Until when it is accepted, UTC: five minutes, less if its key is revoked")


class KeyResource(Resource):
    """A key of the service, without its secret."""

    name: str = Field(description="Its name; `lightpose keys revoke` takes it")
    role: Role = Field(description="What the key may do")
    created: datetime = Field(description="When it was made, UTC")
    last_used: datetime | None = Field(
        description="Time of its last request since the service started, UTC; null: none yet"
    )
