"""Size and speed of a catalogue of many years: `python -m tests.acquisition.archive.measure_catalogue [--rows N]`.

Fills a PostgreSQL catalogue with generated sessions, one result each (by default ten cells that capture 200 objects a
day for five years), and times what people and solves ask of it through the product's own code: median of five, with
the first time beside it, when nothing of it is in memory.
"""

import argparse
import statistics
import time
from collections.abc import Callable
from functools import partial

import sqlalchemy as sa

from acquisition.archive import claims, where
from acquisition.archive.catalogue import Catalogue, result, session
from acquisition.archive.entries import version_order
from tests.acquisition.archive import machines

ROWS = 10 * 200 * 365 * 5
REPEATS = 5
DAY_S = 86_400.0

FILL_SESSIONS = """
INSERT INTO session SELECT
  encode(sha256(i::text::bytea), 'hex'),
  to_char(to_timestamp(1.7e9 + i * 43.2), 'YYYYMMDD-HH24MISS') || '-' || left(md5(i::text), 6),
  (ARRAY['vase', 'bowl', 'coin', 'relief', 'tablet', 'seal', 'lamp', 'figure'])[1 + i % 8]
    || ' ' || left(md5('o' || i), 8),
  CASE WHEN i % 50 = 0 THEN 'chipped at the rim' ELSE '' END,
  'cell ' || i % 10, CASE WHEN i % 40 = 0 THEN 'calibrate_check' ELSE 'capture' END, 'near', 16, 4096, 3072,
  420000000, 1.7e9 + i * 43.2, 1.7e9 + i * 43.2 + 60, md5((i / 40000)::text), '0.' || 2 + i / 1000000,
  '0.' || 2 + i / 1000000, 'ORDER', .3 + (i % 997) / 500.0
FROM generate_series(1, :rows) AS i
"""
FILL_RESULTS = """
INSERT INTO result (session, solver, settings, state, origin, attempts, finishes, solved_at, sigma_deg)
SELECT key, solver, 'aaaaaaaaaaaaaaaa', 'done', 'cell', 0, 1, pushed_at, sigma_deg FROM session
"""


def fill(catalogue: Catalogue, rows: int) -> None:
    """Enters sessions and results, with the order of their solvers' versions."""

    def work(connection: sa.Connection) -> None:
        connection.execute(sa.text(FILL_SESSIONS), {"rows": rows})
        for (solver,) in connection.execute(sa.select(session.c.solver).distinct()).all():
            order = version_order(str(solver))
            connection.execute(sa.update(session).where(session.c.solver == solver).values(solver_order=order))
        connection.execute(sa.text(FILL_RESULTS))

    catalogue.repeatedly(work)


def timed(what: str, ask: Callable[[], object]) -> None:
    """Prints how long a question takes."""
    times: list[float] = []
    for _ in range(REPEATS):
        begun = time.monotonic()
        ask()
        times.append(time.monotonic() - begun)
    print(f"{what:60} first {times[0] * 1e3:8.1f} ms, median {statistics.median(times) * 1e3:8.1f} ms", flush=True)


def main() -> None:
    """Fills and measures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=ROWS)
    rows: int = parser.parse_args().rows
    with machines.postgres() as database:
        catalogue = Catalogue(database.address)
        begun = time.monotonic()
        fill(catalogue, rows)
        engine = sa.create_engine(database.address.replace("postgresql:", "postgresql+psycopg:"))
        with engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
            connection.execute(sa.text("VACUUM FULL ANALYZE"))
            print(f"{rows:,} sessions entered in {time.monotonic() - begun:.0f} s")
            for name in ("session", "result"):
                table, indexes = connection.execute(
                    sa.text("SELECT pg_table_size(:name), pg_indexes_size(:name)"), {"name": name}
                ).one()
                print(f"table {name}: {table / rows:.0f} bytes a row, its indexes {indexes / rows:.0f}; "
                      f"{table / 1e9:.2f} GB and {indexes / 1e9:.2f} GB")  # fmt: skip
            for index, size in connection.execute(
                sa.text("SELECT indexrelname, pg_relation_size(indexrelid) FROM pg_stat_user_indexes ORDER BY 2 DESC")
            ).all():
                print(f"  {index}: {size / 1e6:.0f} MB")
        engine.dispose()
        key = catalogue.sessions(limit=1)[0].key
        database.stop()
        database.start()
        timed("newest 100", lambda: catalogue.sessions(limit=100))
        timed("newest 100, page 50", lambda: catalogue.sessions(limit=100, offset=5000))
        timed("one session by the beginning of its key", lambda: catalogue.session_keys(key[:12]))
        timed("its results", lambda: catalogue.results(key))
        for condition in (
            "object ~ 'vase'", "object ~ 'deadbeef'", "notes ~ 'nothing has this'", "cell = 'cell 3' and sigma > 2.2",
            "solver < '0.3'", "captured >= '2026-01-01' and captured < '2026-01-02'", "sigma > 2.29",
        ):  # fmt: skip
            timed(condition, partial(catalogue.sessions, where.parse(condition), 100))
        every = where.COLUMNS["kind"] == "capture"
        timed("keys of all captures, to be solved", lambda: catalogue.selected_keys(every))
        number = iter(range(REPEATS))
        timed(
            "a claim of one solve",
            lambda: claims.claim(
                catalogue,
                claims.Claim(claims.SolveKey(key, f"9.{next(number)}", "aaaaaaaaaaaaaaaa"), "owner", "call"),
            ),
        )
        solved = sa.select(sa.func.count()).where(result.c.state == "done")
        timed("number of results", lambda: catalogue.repeatedly(lambda connection: connection.scalar(solved)))
        catalogue.close()


if __name__ == "__main__":
    main()
