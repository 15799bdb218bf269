"""Lists in parts: `?limit=&after=`, and the address of the next part in the answer."""

from collections.abc import Sequence
from typing import Annotated, Any, TypeVar

from fastapi import Query, Request

from api.rest.schemas import Page

ItemT = TypeVar("ItemT")

Limit = Annotated[int, Query(ge=1, le=200, description="The most items of one answer")]
Seen = Annotated[int, Query(ge=0, le=2**62, description="How many items have been seen; `next` says it")]


def page(request: Request, items: Sequence[ItemT], limit: int, after: int) -> Page[ItemT]:
    """The items of a whole list past the first `after`, at most `limit`."""
    end = after + limit
    more = f"{request.url.path}?limit={limit}&after={end}" if end < len(items) else None
    return Page[Any](items=list(items[after:end]), next=more)
