"""Lists and searches of the catalogue are answered from indexes, so that their time does not grow with the archive.

How long they take over millions of sessions: `python -m tests.acquisition.archive.measure_catalogue`.
"""

from pathlib import Path

import pytest
import sqlalchemy as sa
from sqlalchemy.dialects import postgresql, sqlite

from acquisition.archive.catalogue import NEWEST_FIRST, Catalogue, in_folder, session
from tests.acquisition.archive import machines

NEWEST = sa.select(session.c.key, session.c.object).order_by(*NEWEST_FIRST).limit(100)
BEGINNING = sa.select(session.c.key).where(session.c.session_id.startswith("20261121", autoescape=True))


def plan(catalogue: Catalogue, query: sa.Select[tuple[str, ...]], dialect: sa.Dialect, explain: str) -> str:
    """How the database would answer a query."""
    text = sa.text(f"{explain} {query.compile(dialect=dialect, compile_kwargs={'literal_binds': True})}")
    return str(catalogue.repeatedly(lambda connection: connection.execute(text).all()))


def test_sqlite_reads_the_newest_from_an_index(tmp_path: Path):
    catalogue = Catalogue(in_folder(tmp_path))
    steps = plan(catalogue, NEWEST, sqlite.dialect(), "EXPLAIN QUERY PLAN")
    catalogue.close()
    assert "ix_session_newest" in steps
    assert "TEMP B-TREE" not in steps


@pytest.mark.long
def test_postgres_reads_the_newest_and_beginnings_from_indexes():
    """Sorts and full scans are only left in a plan where no index would do."""
    with machines.postgres() as database:
        catalogue = Catalogue(f"{database.address}?options=-c%20enable_sort%3Doff%20-c%20enable_seqscan%3Doff")
        newest, beginning = (plan(catalogue, query, postgresql.dialect(), "EXPLAIN") for query in (NEWEST, BEGINNING))
        catalogue.close()
    assert "Index Scan using ix_session_newest_first" in newest
    assert "Sort" not in newest
    assert "Index Scan using ix_session_session_id" in beginning
    assert "Index Cond: " in beginning
