"""Pages of the archive's list: the search, and the position at which a page continues.

A page continues after the last session of the one before, named by time and key, not after a number of rows. Sessions
pushed meanwhile therefore shift nothing, and the thousandth page costs as much as the first.
"""

import math
from urllib.parse import urlencode

import sqlalchemy as sa

from acquisition.archive import where
from acquisition.archive.catalogue import SessionRow
from acquisition.archive.where import COLUMNS
from acquisition.models.errors import ErrorCode, RigError
from api.rest.archive_page.reading import ReadArchive
from api.rest.archive_page.schemas import ROOT, ArchivedSession
from api.rest.schemas import Page


def page(archive: ReadArchive, search: str, condition: str, limit: int, after: str) -> Page[ArchivedSession]:
    """Returns one page, newest captures first, sessions without an image last.

    Raises RigError archive.query_invalid for a condition, request.invalid for a cursor that cannot be read.
    """
    conditions = [where.parse(condition)] if condition else []
    if search:
        found = (COLUMNS[name].icontains(search, autoescape=True) for name in ("object", "id", "notes"))
        conditions.append(sa.or_(*found))
    if after:
        conditions.append(_after(after))
    rows = archive.archive().catalogue.sessions(sa.and_(sa.true(), *conditions), limit + 1)
    items, more = rows[:limit], len(rows) > limit
    query = {"limit": limit, "search": search, "where": condition, "after": _cursor(items[-1]) if more else ""}
    given = urlencode({name: value for name, value in query.items() if value})
    following = f"{ROOT}?{given}" if more else None
    return Page[ArchivedSession](items=[ArchivedSession.of(row) for row in items], next=following)


def _cursor(row: SessionRow) -> str:
    return f"{'' if row.captured_at is None else repr(row.captured_at)}_{row.key}"


def _after(cursor: str) -> sa.ColumnElement[bool]:
    """Returns the condition for the sessions that follow the one that a cursor names."""
    written, _, key = cursor.partition("_")
    captured, after = COLUMNS["captured"], COLUMNS["key"] > key
    if not written:
        return captured.is_(None) & after
    try:
        time = float(written)
    except ValueError:
        time = math.nan
    if not math.isfinite(time):
        raise RigError(ErrorCode.REQUEST_INVALID, f"after: {cursor[:100]!r} is not a cursor; take it from `next`")
    return captured.is_(None) | (captured < time) | ((captured == time) & after)
