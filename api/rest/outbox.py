"""Route of the archive that receives ended sessions: its progress and its obstacles."""

from datetime import datetime

from fastapi import APIRouter
from pydantic import Field

from api.rest.dependencies import ServiceOf
from api.rest.schemas import Resource, as_datetime

router = APIRouter(tags=["sessions"])


class ArchiveResource(Resource):
    """The archive of this service's ended sessions."""

    address: str | None = Field(description="Where it is; null: sessions are sent to none")
    archived: int = Field(ge=0, description="Number of sessions that it has")
    waiting: int = Field(ge=0, description="Number of ended sessions that it does not have yet, or not completely")
    reason: str | None = Field(description="The newest reason why one of these waits; null: no attempt has failed")
    reason_at: datetime | None = Field(description="When the attempt failed, UTC")
    problem: str | None = Field(
        None, description="Why the archive cannot be used, such as a disk that is not mounted; null: none is known"
    )
    problem_at: datetime | None = Field(None, description="Since when, UTC")


@router.get("/v1/archive")
def archive_status(service: ServiceOf) -> ArchiveResource:
    """Returns the address of the archive that receives ended sessions, and how many wait."""
    status = service.store.journal.outbox_status()
    return ArchiveResource(
        address=status.address,
        archived=status.archived,
        waiting=status.waiting,
        reason=status.reason,
        reason_at=None if status.reason_at is None else as_datetime(status.reason_at),
        problem=status.problem,
        problem_at=None if status.problem_at is None else as_datetime(status.problem_at),
    )
