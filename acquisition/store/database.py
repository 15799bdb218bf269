"""The database of one data folder: its connection, its migrations, and the event table, which serves as event bus.

One connection behind one lock suffices: the writers are the runner, the safety monitor and a few requests, and each
transaction takes a millisecond. A state is read and changed only inside one transaction. The event table's row number
is the event's id, so a reader that was disconnected continues after the last id it has read.
"""

import json
import sqlite3
import threading
import time
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from importlib import resources
from pathlib import Path
from typing import Any

from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.event_type import EventType
from acquisition.session_state import State
from acquisition.store.rows import Counts, Event

MIGRATIONS = (
    "schema_001.sql",
    "schema_002.sql",
    "schema_003.sql",
    "schema_004.sql",
    "schema_005.sql",
    "schema_006.sql",
    "schema_007.sql",
    "schema_008.sql",
    "schema_009.sql",
    "schema_010.sql",
)


class Database:
    """Connection, transactions and events; any thread may call any method."""

    def __init__(self, path: Path) -> None:
        """Opens or makes the file. Raises RigError store.corrupt, store.disk_full, store.unwritable."""
        self._lock = threading.RLock()
        self._event_added = threading.Condition()
        with _refusals():
            self._connection = sqlite3.connect(path, check_same_thread=False, isolation_level=None, timeout=10)
            try:
                self._prepare()
            except BaseException:
                self._connection.close()
                raise

    def close(self) -> None:
        """Closes the file."""
        with self._lock:
            self._connection.close()

    # --------------------------------------------------------------------------------------------------------- events

    def announce(self, session_id: str | None, type_: EventType, body: dict[str, Any]) -> None:
        """Appends an event that belongs to no other change."""
        with self._transaction() as connection:
            self._event(connection, session_id, type_, body)

    def events(
        self, after_id: int, limit: int = 500, session_id: str | None = None, types: Sequence[str] = ()
    ) -> list[Event]:
        """Returns events with ids above `after_id`, oldest first."""
        where, values = ["id > ?"], [after_id]
        conditions: list[Any] = list(values)
        if session_id is not None:
            where.append("session_id = ?")
            conditions.append(session_id)
        if types:
            where.append(f"type IN ({placeholders(types)})")
            conditions.extend(types)
        rows = self._all(
            f"SELECT * FROM event WHERE {' AND '.join(where)} ORDER BY id LIMIT ?",  # noqa: S608 - only placeholders
            *conditions,
            limit,
        )
        return [Event(row["id"], row["session_id"], row["type"], json.loads(row["body"]), row["at"]) for row in rows]

    def counts(self) -> Counts:
        """Returns how many sessions, images and events the journal holds."""
        states = self._all("SELECT state, count(*) AS count FROM session GROUP BY state")
        (shots,) = self._all("SELECT count(*) AS count FROM shot")
        by_state = {State(row["state"]): int(row["count"]) for row in states}
        return Counts(by_state, int(shots["count"]), self.last_event_id())

    def last_event_id(self) -> int:
        """Returns the newest event's id, 0 when there is none."""
        row = self._one("SELECT coalesce(max(id), 0) AS id FROM event")
        return 0 if row is None else int(row["id"])

    def wait_for_event(self, after_id: int, timeout_s: float) -> bool:
        """Blocks until there is an event with an id above `after_id` (True), or the time is over (False)."""
        deadline = time.monotonic() + timeout_s
        with self._event_added:
            while self.last_event_id() <= after_id:
                left = deadline - time.monotonic()
                if left <= 0:
                    return False
                self._event_added.wait(left)
        return True

    # ------------------------------------------------------------------------------------------------------ internals

    def _prepare(self) -> None:
        self._connection.row_factory = sqlite3.Row
        # SQLite's own lower() knows ASCII only, and labels are in any language.
        self._connection.create_function("casefold", 1, str.casefold, deterministic=True)
        self._connection.execute("PRAGMA journal_mode = WAL")
        self._connection.execute("PRAGMA synchronous = FULL")
        self._connection.execute("PRAGMA foreign_keys = ON")
        self._migrate()

    def _migrate(self) -> None:
        """Brings the schema up to date, one version per transaction, beside other processes that do the same."""
        while (version := self._schema()) < len(MIGRATIONS):
            script = resources.files("acquisition.store").joinpath(MIGRATIONS[version]).read_text(encoding="utf-8")
            with self._transaction() as connection:
                # The version is read again now that no other process can write: a migration must not be applied twice.
                if self._schema() == version:
                    for statement in _statements(script):
                        connection.execute(statement)
                    connection.execute(f"PRAGMA user_version = {version + 1}")

    def _schema(self) -> int:
        """Returns the version of the schema. Raises RigError store.corrupt for that of a newer release."""
        (version,) = self._connection.execute("PRAGMA user_version").fetchone()
        if version > len(MIGRATIONS):
            raise RigError(
                ErrorCode.STORE_CORRUPT,
                f"The database was written by a newer release (schema {version}): use that release",
                schema=version,
            )
        return int(version)

    @contextmanager
    def _transaction(self) -> Generator[sqlite3.Connection]:
        """A transaction under the lock. Raises RigError store.disk_full and store.unwritable."""
        with _refusals(), self._lock:
            self._connection.execute("BEGIN IMMEDIATE")
            try:
                yield self._connection
                self._connection.execute("COMMIT")
            except BaseException:
                if self._connection.in_transaction:  # SQLite itself rolls back when the disk is full
                    self._connection.execute("ROLLBACK")
                raise
        # After the lock is released: waiting readers query the table under that lock.
        with self._event_added:
            self._event_added.notify_all()

    def _event(
        self, connection: sqlite3.Connection, session_id: str | None, type_: EventType, body: dict[str, Any]
    ) -> None:
        connection.execute(
            "INSERT INTO event (session_id, type, body, at) VALUES (?, ?, ?, ?)",
            (session_id, type_, json.dumps(body), time.time()),
        )

    def _record_action(
        self, connection: sqlite3.Connection, session_id: str | None, action: str, actor: str, outcome: str
    ) -> None:
        connection.execute(
            "INSERT INTO action (session_id, action, actor, outcome, at) VALUES (?, ?, ?, ?, ?)",
            (session_id, action, actor, outcome, time.time()),
        )

    def _one(self, query: str, *values: Any) -> sqlite3.Row | None:
        with _refusals(), self._lock:
            return self._connection.execute(query, values).fetchone()

    def _all(self, query: str, *values: Any) -> list[sqlite3.Row]:
        with _refusals(), self._lock:
            return self._connection.execute(query, values).fetchall()


@contextmanager
def _refusals() -> Generator[None]:
    """Turns SQLite's errors into RigError: the disk is full or refuses, the file is damaged, a program holds it."""
    try:
        yield
    except sqlite3.DatabaseError as error:
        kind = getattr(error, "sqlite_errorcode", 0) & 0xFF
        if kind == sqlite3.SQLITE_FULL:
            raise RigError(ErrorCode.STORE_DISK_FULL, "No space left for the journal", file="rig.db") from error
        if kind in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB):
            raise RigError(ErrorCode.STORE_CORRUPT, f"The journal rig.db is damaged: {error}", file="rig.db") from error
        if not isinstance(error, sqlite3.OperationalError):
            raise
        detail = f"The journal cannot be written: {error}"
        raise RigError(ErrorCode.STORE_UNWRITABLE, detail, file="rig.db") from error


def _statements(script: str) -> Iterator[str]:
    """Yields the statements of an SQL script: `executescript` would end the transaction that it is called in."""
    statement = ""
    for line in script.splitlines(keepends=True):
        statement += line
        if sqlite3.complete_statement(statement):
            yield statement
            statement = ""
    if statement.strip():
        yield statement


def placeholders(values: Any) -> str:
    """Returns placeholders (question marks) for a list of values in SQL."""
    return ", ".join("?" for _ in values)
