"""The catalogue: one row per session and per result, in SQLite beside the archive or in PostgreSQL for several cells.

Everything except the claims of running solves can be read from the archive's entries again. Tables and queries are
SQLAlchemy's, so that both databases see the same statements. A lost connection is replaced, and a statement that failed
with it is repeated; each is one transaction that may be repeated without harm.
"""

import sqlite3
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import sqlalchemy as sa
import sqlalchemy.event
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.exc import ArgumentError, DBAPIError, InterfaceError, OperationalError
from tenacity import Retrying, retry_if_exception_type, stop_after_delay, wait_random_exponential

from acquisition.archive.entries import ResultEntry, SessionEntry, version_order
from acquisition.models.errors import ErrorCode, RigError

FORMAT = 1
FILE = "catalogue.db"
PATIENCE_S = 60.0
"""Time, s, for which a statement is repeated while the database restarts, during a solve of the archive."""
CONNECT_S = 3
"""Time-out, s, of one connection and of the server's greeting."""
_ALIVE = {"keepalives_idle": 10, "keepalives_interval": 5, "keepalives_count": 4, "tcp_user_timeout": 30_000}
"""Options of libpq (s; ms): a machine that vanishes from an open connection is given up after half a minute."""
T = TypeVar("T")

_tables = sa.MetaData()
_by_bytes = sa.String().with_variant(sa.String(collation="C"), "postgresql")
"""Texts compared by their bytes; only in this order does PostgreSQL find the beginning of a text by an index."""
meta = sa.Table("meta", _tables, sa.Column("format", sa.Integer, primary_key=True))
_archive = sa.Table(
    "archive", _tables, sa.Column("one", sa.Integer, primary_key=True), sa.Column("identity", sa.String)
)
"""Identity of the catalogue's archive, in one row; earlier releases made catalogues without this table."""
session = sa.Table(
    "session",
    _tables,
    sa.Column("key", _by_bytes, primary_key=True),
    sa.Column("session_id", _by_bytes, nullable=False, index=True),
    sa.Column("object", sa.String, nullable=False, index=True),
    sa.Column("notes", sa.String, nullable=False),
    sa.Column("cell", sa.String, nullable=False, index=True),
    sa.Column("kind", sa.String, nullable=False),
    sa.Column("method", sa.String),
    sa.Column("lights", sa.Integer, nullable=False),
    sa.Column("width", sa.Integer, nullable=False),
    sa.Column("height", sa.Integer, nullable=False),
    sa.Column("bytes", sa.BigInteger, nullable=False),
    sa.Column("captured_at", sa.Double),
    sa.Column("pushed_at", sa.Double, nullable=False),
    sa.Column("calibration", sa.String, nullable=False, index=True),
    sa.Column("software", sa.String, nullable=False),
    # Figures of the newest solver's result, which are searched for most.
    sa.Column("solver", sa.String),
    sa.Column("solver_order", _by_bytes, index=True),
    sa.Column("sigma_deg", sa.Double, index=True),
)
NEWEST_FIRST = (session.c.captured_at.desc().nulls_last(), session.c.key)
"""Order of lists. SQLite accepts no position of nulls in an index; in descending order they are last anyway."""
sa.Index("ix_session_newest_first", *NEWEST_FIRST).ddl_if(dialect="postgresql")
sa.Index("ix_session_newest", session.c.captured_at.desc(), session.c.key).ddl_if(dialect="sqlite")
result = sa.Table(
    "result",
    _tables,
    sa.Column("session", _by_bytes, sa.ForeignKey("session.key", ondelete="CASCADE"), primary_key=True),
    sa.Column("solver", sa.String, primary_key=True),
    sa.Column("settings", sa.String(16), primary_key=True),
    sa.Column("last_pass", sa.Integer),  # none: the images of all passes
    sa.Column("state", sa.String, nullable=False),  # claimed, done, failed
    sa.Column("origin", sa.String, nullable=False),  # cell, archive
    sa.Column("owner", sa.String),
    sa.Column("call", sa.String),
    sa.Column("claimed_until", sa.Double),
    sa.Column("attempts", sa.Integer, nullable=False, server_default="0"),
    sa.Column("finishes", sa.Integer, nullable=False, server_default="0"),
    sa.Column("solved_at", sa.Double),
    sa.Column("sigma_deg", sa.Double),
    sa.Column("moved_mean_deg", sa.Double),
    sa.Column("moved_over_sigma", sa.Double),
    sa.Column("error", sa.String),
)


@dataclass(frozen=True)
class SessionRow:
    """One session as lists show it."""

    key: str
    session_id: str
    object: str
    notes: str
    cell: str
    kind: str
    method: str | None
    lights: int
    width: int
    height: int
    bytes: int
    captured_at: float | None
    pushed_at: float
    calibration: str
    software: str
    solver: str | None
    sigma_deg: float | None


@dataclass(frozen=True)
class ResultRow:
    """One result as lists show it."""

    session: str
    solver: str
    settings: str
    last_pass: int | None
    state: str
    origin: str
    attempts: int
    finishes: int
    solved_at: float | None
    sigma_deg: float | None
    moved_mean_deg: float | None
    moved_over_sigma: float | None
    error: str | None


class Catalogue:
    """The catalogue of one archive. Methods raise RigError archive.unreachable when the database stays away."""

    def __init__(self, address: str, patience_s: float = 0.0) -> None:
        """`address` is SQLAlchemy's: `sqlite:///FILE` or `postgresql://USER@HOST/NAME`.

        Raises RigError archive.address_invalid, archive.catalogue_newer, archive.unreachable.
        """
        self.address = address
        self._patience_s = patience_s
        try:
            url = sa.make_url(address)
        except ArgumentError as error:
            raise _invalid(address, "is not the address of a database") from error
        if url.get_backend_name() not in ("sqlite", "postgresql"):
            raise _invalid(address, "is neither SQLite nor PostgreSQL")
        if url.get_backend_name() == "postgresql":
            url = url.set(drivername="postgresql+psycopg")
            options: dict[str, Any] = {"connect_args": {"connect_timeout": CONNECT_S} | _ALIVE, "pool_pre_ping": True}
        else:
            # The rollback journal and not the write-ahead log: that one does not work on network folders.
            options = {"connect_args": {"timeout": 30}}
        self._engine = sa.create_engine(url, **options)
        if url.get_backend_name() == "sqlite":
            sqlalchemy.event.listen(self._engine, "connect", _configure_sqlite)
        self.repeatedly(self._prepare)

    def close(self) -> None:
        """Closes all connections."""
        self._engine.dispose()

    def repeatedly(self, work: Callable[[sa.Connection], T]) -> T:
        """Runs one transaction, and repeats it while the database does not answer, for at most `patience_s`."""
        trials = Retrying(
            retry=retry_if_exception_type((OperationalError, InterfaceError)),
            stop=stop_after_delay(self._patience_s),
            wait=wait_random_exponential(0.1, max=2),
            reraise=True,
        )
        try:
            for trial in trials:
                with trial, self._engine.begin() as connection:
                    return work(connection)
        except DBAPIError as error:
            sentence = str(error.orig).strip().partition("\n")[0]
            raise RigError(
                ErrorCode.ARCHIVE_UNREACHABLE, f"the catalogue {self._shown}: {sentence}", address=self._shown
            ) from error
        raise AssertionError("a trial returns or raises")

    def require_archive(self, identity: str | None, address: str) -> None:
        """Makes an empty catalogue that of an archive, for good; an archive without identity has one without.

        Raises RigError archive.address_invalid if it is the catalogue of another archive.
        """

        def work(connection: sa.Connection) -> str | None:
            known = self._identity(connection)
            if known is not None or identity is None or connection.scalar(sa.select(session.c.key).limit(1)):
                return known
            _archive.create(connection, checkfirst=True)
            statement = self.insert(_archive).values(one=1, identity=identity)
            connection.execute(statement.on_conflict_do_nothing())
            return self._identity(connection)

        if self.repeatedly(work) != identity:
            raise RigError(
                ErrorCode.ARCHIVE_ADDRESS_INVALID,
                f"the catalogue {self._shown} is that of another archive than {address}: name this archive's own, or "
                "an empty database, with --catalogue",
            )

    # --------------------------------------------------------------------------------------------------- entries

    def add(self, entry: SessionEntry, results: list[ResultEntry]) -> bool:
        """Enters a session and its results; returns whether it was new. Updates object and notes of a known one."""

        def work(connection: sa.Connection) -> bool:
            facts = entry.facts
            row = facts.model_dump() | {"key": entry.key, "bytes": entry.bytes, "pushed_at": time.time()}
            known = connection.execute(sa.select(session.c.key).where(session.c.key == entry.key)).first()
            changed = {"object": facts.object, "notes": facts.notes}
            statement = self.insert(session).values(row)
            connection.execute(statement.on_conflict_do_update(index_elements=[session.c.key], set_=changed))
            for item in results:
                _record(connection, self.insert(result), item)
            return known is None

        return self.repeatedly(work)

    def sessions(
        self, where: sa.ColumnElement[bool] | None = None, limit: int | None = None, offset: int = 0
    ) -> list[SessionRow]:
        """Returns the sessions that a condition (`where.parse`) selects, newest capture first."""
        columns = [session.c[name] for name in SessionRow.__dataclass_fields__]
        query = sa.select(*columns).order_by(*NEWEST_FIRST)
        query = query if where is None else query.where(where)
        query = query.limit(limit).offset(offset)
        rows = self.repeatedly(lambda connection: connection.execute(query).mappings().all())
        return [SessionRow(**row) for row in rows]

    def selected_keys(self, where: sa.ColumnElement[bool]) -> list[str]:
        """Returns the keys of the sessions that a condition selects, newest capture first."""
        query = sa.select(session.c.key).where(where).order_by(*NEWEST_FIRST)
        return list(self.repeatedly(lambda connection: connection.scalars(query).all()))

    def session_keys(self, prefix: str, limit: int = 3) -> list[str]:
        """Returns the keys of the sessions whose key or id begins with `prefix`."""
        condition = session.c.key.startswith(prefix, autoescape=True)
        condition |= session.c.session_id.startswith(prefix, autoescape=True)
        query = sa.select(session.c.key).where(condition).order_by(session.c.key).limit(limit)
        return list(self.repeatedly(lambda connection: connection.scalars(query).all()))

    def results(self, key: str) -> list[ResultRow]:
        """Returns the results of one session, the oldest first."""
        columns = [result.c[name] for name in ResultRow.__dataclass_fields__]
        query = sa.select(*columns).where(result.c.session == key).order_by(result.c.solved_at)
        rows = self.repeatedly(lambda connection: connection.execute(query).mappings().all())
        return [ResultRow(**row) for row in rows]

    def forget_result(self, lost: ResultRow) -> None:
        """Marks a done result as failed whose entry is lost, so that a push enters or a solve makes it again."""
        condition = (result.c.session == lost.session, result.c.solver == lost.solver,
                     result.c.settings == lost.settings, result.c.state == "done")  # fmt: skip
        # The call is that of no solve: claims leave what failed in their own, or in none, as it is.
        changed = {
            "state": "failed",
            "origin": "archive",
            "call": "verify",
            "error": "its entry in the archive is lost",
        }
        self.repeatedly(
            lambda connection: connection.execute(sa.update(result).where(*condition).values(changed)).close()
        )

    def insert(self, table: sa.Table) -> "sqlite.Insert | postgresql.Insert":
        """Returns an INSERT in this database's dialect, which knows ON CONFLICT."""
        return (postgresql if self._engine.dialect.name == "postgresql" else sqlite).insert(table)

    def now(self) -> sa.ColumnElement[float]:
        """Returns the database's own time, s since 1970: claims of several machines are compared by one clock."""
        if self._engine.dialect.name == "postgresql":
            return sa.cast(sa.extract("epoch", sa.func.clock_timestamp()), sa.Double)
        return (sa.func.julianday("now") - 2440587.5) * 86400.0

    # --------------------------------------------------------------------------------------------------- internals

    def _identity(self, connection: sa.Connection) -> str | None:
        """Returns the identity of the catalogue's archive; None if it has none yet."""
        there = sa.inspect(connection).has_table(_archive.name)
        return connection.scalar(sa.select(_archive.c.identity)) if there else None

    @property
    def _shown(self) -> str:
        return self._engine.url.render_as_string(hide_password=True)

    def _prepare(self, connection: sa.Connection) -> None:
        """Creates the tables unless they exist. Two callers may do so at once; the second one then finds them."""
        if self._engine.dialect.name == "postgresql":
            connection.execute(sa.text("SELECT pg_advisory_xact_lock(5031)"))
        if not sa.inspect(connection).has_table(meta.name):
            _tables.create_all(connection)
            connection.execute(self.insert(meta).values(format=FORMAT).on_conflict_do_nothing())
        found = connection.scalar(sa.select(sa.func.max(meta.c.format)))
        if found is None or found > FORMAT:
            raise RigError(
                ErrorCode.ARCHIVE_CATALOGUE_NEWER,
                f"the catalogue {self._shown} was made by a newer release (format {found}): use that release",
                format=found,
            )


def _configure_sqlite(connection: sqlite3.Connection, _: object) -> None:
    """Replaces SQLite's own lower(), which knows ASCII only, because objects are named in any language."""
    connection.create_function("lower", 1, _lower, deterministic=True)
    connection.execute("PRAGMA foreign_keys = ON")


def _lower(text: str | None) -> str | None:
    return None if text is None else text.lower()


def in_folder(folder: Path) -> str:
    """Returns the address of the SQLite catalogue of an archive that is a folder."""
    return f"sqlite:///{folder.absolute() / FILE}"


def _record(connection: sa.Connection, insert: "sqlite.Insert | postgresql.Insert", entry: ResultEntry) -> None:
    """Enters a result unless it is there, and shows it with its session unless a newer solver's is known."""
    row = {
        "session": entry.session,
        "solver": entry.solver,
        "settings": entry.identity.hash,
        "last_pass": entry.identity.last_pass,
        "state": "done",
        "origin": entry.origin,
        "solved_at": entry.solved_at,
        "sigma_deg": entry.sigma_deg,
        "finishes": 1,
    }
    keys = [result.c.session, result.c.solver, result.c.settings]
    changed = {name: row[name] for name in ("state", "origin", "solved_at", "sigma_deg", "finishes")}
    statement = insert.values(row)
    connection.execute(
        statement.on_conflict_do_update(index_elements=keys, set_=changed, where=result.c.state != "done")
    )
    make_newest(connection, entry)


def make_newest(connection: sa.Connection, entry: ResultEntry) -> None:
    """Shows a result's solver and σ with its session, unless those of a newer solver are shown."""
    order = version_order(entry.solver)
    older = sa.or_(session.c.solver_order.is_(None), session.c.solver_order <= order)
    if entry.identity.last_pass is not None:  # a result of some passes does not stand for the whole session
        older = session.c.solver_order.is_(None)
    connection.execute(
        sa.update(session)
        .where(session.c.key == entry.session, older)
        .values(solver=entry.solver, solver_order=order, sigma_deg=entry.sigma_deg)
    )


def _invalid(address: str, why: str) -> RigError:
    return RigError(ErrorCode.ARCHIVE_ADDRESS_INVALID, f"--catalogue {address} {why}; give postgresql://USER@HOST/NAME")
