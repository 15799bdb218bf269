"""Schemas of callers, their tickets, and the keys of the service: never a secret, and no hash of one."""

from datetime import datetime

from pydantic import Field

from api.rest.keys import Role
from api.rest.schemas import Resource


class CallerResource(Resource):
    """Who asks: without keys `operator`, whose role is operator."""

    name: str = Field(description="Name of the key; `operator` without keys")
    role: Role = Field(
        description="What the key may do; each role may do what those before it may: viewer, operator, admin"
    )


class TicketResource(Resource):
    """A short-lived permission to read, for addresses that a browser opens by itself."""

    ticket: str = Field(description="The secret: `?ticket=…` in an address")
    good_until: datetime = Field(description="Until when it is accepted, UTC: five minutes, or as long as its key")


class KeyResource(Resource):
    """A key of the service, without its secret."""

    name: str = Field(description="By which `lightpose keys revoke` revokes it")
    role: Role = Field(description="What the key may do")
    created: datetime = Field(description="When it was made, UTC")
    last_used: datetime | None = Field(
        description="Of its last request since the service was started, UTC; null: none yet"
    )
