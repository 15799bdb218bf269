"""Paging of lists by `?limit=&after=`, with the address of the next page in the answer."""

from collections.abc import Sequence
from typing import Annotated, Any, TypeVar

from fastapi import Query, Request

from api.rest.schemas import Page

ItemT = TypeVar("ItemT")

Limit = Annotated[int, Query(ge=1, le=200, description="Maximum number of items per page")]
Offset = Annotated[int, Query(ge=0, le=2**62, description="Number of items to skip; `next` holds it")]


def page(request: Request, items: Sequence[ItemT], limit: int, after: int) -> Page[ItemT]:
    """Returns one page of a list: at most `limit` items, after the first `after` of them."""
    end = after + limit
    more = f"{request.url.path}?limit={limit}&after={end}" if end < len(items) else None
    return Page[Any](items=list(items[after:end]), next=more)
