"""The journal: what happened, in one SQLite file; every change and its event are one transaction.

One connection behind one lock: the writers are the runner, the safety monitor and a few requests, each transaction
takes a millisecond, and a state is only ever read and changed inside the same transaction. The event table is the bus:
its row number is the event's id, so whoever was away reads on from the last number seen.
"""

import json
import secrets
import sqlite3
import threading
import time
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from importlib import resources
from pathlib import Path
from typing import Any

from acquisition.errors import ErrorCode, RigError
from acquisition.session import ENDED, HOLDS_THE_RIG, PassRecord, Record, State, Trigger, after, allowed
from acquisition.store.rows import Action, Artifact, Counts, Event, SessionRow, session_of
from acquisition.types import LightPlan, Recipe, Route, Shot

MIGRATIONS = ("schema_001.sql", "schema_002.sql")


class Journal:
    """The database of one data folder; any thread may call any method."""

    def __init__(self, path: Path) -> None:
        self._lock = threading.RLock()
        self._grown = threading.Condition()
        self._connection = sqlite3.connect(path, check_same_thread=False, isolation_level=None, timeout=10)
        self._connection.row_factory = sqlite3.Row
        self._connection.execute("PRAGMA journal_mode = WAL")
        self._connection.execute("PRAGMA synchronous = FULL")
        self._connection.execute("PRAGMA foreign_keys = ON")
        self._migrate()

    def close(self) -> None:
        """Closes the file."""
        with self._lock:
            self._connection.close()

    # ------------------------------------------------------------------------------------------------------- sessions

    def create_session(
        self, recipe: Recipe, cell: str, fingerprint: str, idempotency_key: str | None = None
    ) -> tuple[SessionRow, bool]:
        """Enters a new session; with a key that was used before, returns that session and False."""
        with self._transaction() as connection:
            if idempotency_key is not None:
                known = connection.execute(
                    "SELECT * FROM session WHERE idempotency_key = ?", (idempotency_key,)
                ).fetchone()
                if known is not None:
                    row = session_of(known)
                    if row.recipe != recipe:
                        raise RigError(
                            ErrorCode.REQUEST_INVALID,
                            "This Idempotency-Key was used for another recipe; choose a new key",
                            session_id=row.id,
                        )
                    return row, False
            (number,) = connection.execute("SELECT coalesce(max(number), 0) + 1 FROM session").fetchone()
            now = time.time()
            identity = time.strftime("%Y%m%d-%H%M%S-", time.gmtime(now)) + secrets.token_hex(3)
            connection.execute(
                "INSERT INTO session (id, number, state, recipe, cell, fingerprint, idempotency_key, created_at)"
                " VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
                (identity, number, State.CREATED, recipe.model_dump_json(), cell, fingerprint, idempotency_key, now),
            )
            self._event(connection, identity, "session.created", {"state": State.CREATED})
            return self.session(identity), True

    def session(self, session_id: str) -> SessionRow:
        """One session. Raises RigError session.not_found."""
        row = self._one("SELECT * FROM session WHERE id = ?", session_id)
        if row is None:
            raise RigError(ErrorCode.SESSION_NOT_FOUND, f"No session {session_id[:80]!r}", session_id=session_id[:80])
        return session_of(row)

    def sessions(self, limit: int, before: int | None = None) -> list[SessionRow]:
        """Sessions, newest first, with numbers below `before`."""
        rows = self._all(
            "SELECT * FROM session WHERE number < ? ORDER BY number DESC LIMIT ?",
            before if before is not None else 2**62,
            limit,
        )
        return [session_of(row) for row in rows]

    def holder(self) -> SessionRow | None:
        """The session that holds the rig, if any."""
        row = self._one(f"SELECT * FROM session WHERE state IN ({_marks(HOLDS_THE_RIG)})", *HOLDS_THE_RIG)  # noqa: S608
        return None if row is None else session_of(row)

    def trigger(
        self, session_id: str, trigger: Trigger, actor: str, reason: dict[str, Any] | None = None
    ) -> tuple[State, State]:
        """Changes a session's state by the table and returns (before, after), all in one transaction.

        Raises RigError session.action_not_allowed, rig.busy (naming the holder), session.not_found.
        """
        with self._transaction() as connection:
            row = self.session(session_id)
            then = after(row.state, trigger)
            if then is None:
                self._record_action(connection, session_id, trigger, actor, "refused")
                connection.execute("COMMIT")  # the refusal is kept although the call fails
                connection.execute("BEGIN IMMEDIATE")
                may = ", ".join(allowed(row.state)) or "nothing"
                raise RigError(
                    ErrorCode.SESSION_ACTION_NOT_ALLOWED,
                    f"A session that is {row.state} does not allow {trigger}; it allows {may}",
                    state=row.state,
                    allowed=[str(action) for action in allowed(row.state)],
                )
            self._record_action(connection, session_id, trigger, actor, str(then))
            if then is row.state:
                return row.state, then
            now = time.time()
            try:
                connection.execute(
                    "UPDATE session SET state = ?, reason = ?, started_at = coalesce(started_at, ?), ended_at = ?"
                    " WHERE id = ?",
                    (
                        then,
                        None if reason is None else json.dumps(reason),
                        now if trigger is Trigger.START else None,
                        now if then in ENDED else None,
                        session_id,
                    ),
                )
            except sqlite3.IntegrityError as error:
                holder = self.holder()
                raise RigError(
                    ErrorCode.RIG_BUSY,
                    f"Session {holder.id if holder else '?'} holds the rig",
                    holder=holder.id if holder else None,
                ) from error
            body: dict[str, Any] = {"from": row.state, "state": then, "by": actor}
            self._event(connection, session_id, "session.state", body | ({"reason": reason} if reason else {}))
            return row.state, then

    def delete_session(self, session_id: str) -> None:
        """Removes a session that does not hold the rig. Raises RigError session.action_not_allowed."""
        with self._transaction() as connection:
            row = self.session(session_id)
            if row.state in HOLDS_THE_RIG:
                raise RigError(
                    ErrorCode.SESSION_ACTION_NOT_ALLOWED,
                    f"A session that is {row.state} cannot be deleted; stop it first",
                    state=row.state,
                    allowed=[str(action) for action in allowed(row.state)],
                )
            connection.execute("DELETE FROM session WHERE id = ?", (session_id,))
            self._event(connection, None, "session.deleted", {"session_id": session_id})

    # ------------------------------------------------------------------------------------------------------- the work

    def add_shot(self, session_id: str, shot: Shot) -> None:
        """Enters an accepted frame whose file is already on the disk; this is what announces it."""
        with self._transaction() as connection:
            connection.execute(
                "INSERT INTO shot (session_id, pass_number, number, kind, body) VALUES (?, ?, ?, ?, ?)",
                (session_id, shot.key.pass_number, shot.key.number, shot.kind, shot.model_dump_json()),
            )
            body = {
                "pass": shot.key.pass_number,
                "number": shot.key.number,
                "kind": shot.kind,
                "exposure_s": shot.exposure_s,
                "light_number": shot.light_number,
                "attempt": shot.attempt,
            }
            self._event(connection, session_id, "shot.captured", body)

    def add_artifact(
        self, session_id: str, kind: str, number: int, path: str, sha256: str, body: dict[str, Any], event: str
    ) -> None:
        """Enters a plan, route or result whose file is already on the disk, with the event that announces it."""
        with self._transaction() as connection:
            self._add_artifact(connection, session_id, kind, number, path, sha256, body, event)

    def may_draw(self, session_id: str) -> SessionRow:
        """The session, when a region of interest could still guide its plan.

        Raises RigError session.action_not_allowed when it could not, session.not_found.
        """
        row = self.session(session_id)
        planned = any(item.number > 0 for item in self.artifacts(session_id, "plan"))
        if row.state not in (State.CREATED, State.PAUSED) or planned:
            raise RigError(
                ErrorCode.SESSION_ACTION_NOT_ALLOWED,
                "A region of interest is drawn before the start, or while the session is paused before its lights are "
                f"planned; this one is {row.state}{' and planned' if planned else ''}",
                state=row.state,
                allowed=[str(action) for action in allowed(row.state)],
            )
        return row

    def add_region(self, session_id: str, path: str, sha256: str, body: dict[str, Any], actor: str) -> None:
        """Enters a region of interest whose file is already on the disk; the newest one holds.

        Raises RigError as `may_draw`.
        """
        with self._transaction() as connection:
            row = self.may_draw(session_id)
            self._record_action(connection, session_id, "draw-region", actor, str(row.state))
            number = len(self.artifacts(session_id, "region"))
            self._add_artifact(connection, session_id, "region", number, path, sha256, body, "region.drawn")

    def artifacts(self, session_id: str, kind: str) -> list[Artifact]:
        """The artefacts of one kind, oldest first."""
        rows = self._all("SELECT * FROM artifact WHERE session_id = ? AND kind = ? ORDER BY id", session_id, kind)
        return [
            Artifact(row["kind"], row["number"], row["path"], row["sha256"], json.loads(row["body"]), row["created_at"])
            for row in rows
        ]

    def shots(self, session_id: str) -> list[Shot]:
        """All frames of a session, in the order taken."""
        rows = self._all("SELECT body FROM shot WHERE session_id = ? ORDER BY rowid", session_id)
        return [Shot.model_validate_json(row["body"]) for row in rows]

    def record(self, session_id: str, folder: Path) -> Record:
        """What `session.next_step` reads; plans and routes come from the files that the journal names."""
        with self._lock:
            row = self.session(session_id)
            plans = {item.number: item.path for item in self.artifacts(session_id, "plan")}
            routes = {item.number: item.path for item in self.artifacts(session_id, "route")}
            results = self.artifacts(session_id, "result")
            solved = {item.number for item in results if item.body.get("origin", "session") == "session"}
            shots = self.shots(session_id)
        passes = tuple(
            PassRecord(
                plan=LightPlan.model_validate_json((folder / plans[number]).read_bytes()),
                route=Route.model_validate_json((folder / routes[number]).read_bytes()) if number in routes else None,
                shots={
                    shot.light_number: shot
                    for shot in shots
                    if shot.key.pass_number == number and shot.kind == "light" and shot.light_number is not None
                },
                darks={
                    shot.exposure_s: shot for shot in shots if shot.key.pass_number == number and shot.kind == "dark"
                },
                solved=number in solved,
            )
            for number in sorted(plans)
        )
        return Record(session_id, row.recipe, row.state, passes)

    # --------------------------------------------------------------------------------------------- actions and safety

    def record_action(self, session_id: str | None, action: str, actor: str, outcome: str) -> None:
        """Enters who asked for what."""
        with self._transaction() as connection:
            self._record_action(connection, session_id, action, actor, outcome)

    def actions(self, session_id: str) -> list[Action]:
        """The history of a session's actions, oldest first."""
        rows = self._all(
            "SELECT session_id, action, actor, outcome, at FROM action WHERE session_id = ? ORDER BY id", session_id
        )
        return [Action(**dict(row)) for row in rows]

    def latch(self, code: str, detail: str) -> None:
        """Enters a safety fault that asks for acknowledgement."""
        with self._transaction() as connection:
            connection.execute("INSERT INTO safety (code, detail, since) VALUES (?, ?, ?)", (code, detail, time.time()))
            self._event(connection, None, "safety.changed", {"code": code, "detail": detail, "acknowledged": False})

    def acknowledge(self, actor: str) -> None:
        """Marks all latched faults as seen by a person."""
        with self._transaction() as connection:
            connection.execute(
                "UPDATE safety SET acknowledged_by = ?, acknowledged_at = ? WHERE acknowledged_at IS NULL",
                (actor, time.time()),
            )
            self._record_action(connection, None, "acknowledge", actor, "acknowledged")
            self._event(connection, None, "safety.changed", {"acknowledged": True, "by": actor})

    def latched(self) -> list[dict[str, Any]]:
        """The faults that nobody has acknowledged yet."""
        return [dict(row) for row in self._all("SELECT code, detail, since FROM safety WHERE acknowledged_at IS NULL")]

    # --------------------------------------------------------------------------------------------------------- events

    def announce(self, session_id: str | None, type_: str, body: dict[str, Any]) -> None:
        """Appends an event that belongs to no other change."""
        with self._transaction() as connection:
            self._event(connection, session_id, type_, body)

    def events(
        self, after_id: int, limit: int = 500, session_id: str | None = None, types: Sequence[str] = ()
    ) -> list[Event]:
        """Events with ids above `after_id`, oldest first."""
        where, values = ["id > ?"], [after_id]
        conditions: list[Any] = list(values)
        if session_id is not None:
            where.append("session_id = ?")
            conditions.append(session_id)
        if types:
            where.append(f"type IN ({_marks(types)})")
            conditions.extend(types)
        rows = self._all(
            f"SELECT * FROM event WHERE {' AND '.join(where)} ORDER BY id LIMIT ?",  # noqa: S608 - only marks
            *conditions,
            limit,
        )
        return [Event(row["id"], row["session_id"], row["type"], json.loads(row["body"]), row["at"]) for row in rows]

    def counts(self) -> Counts:
        """How much the journal holds."""
        states = self._all("SELECT state, count(*) AS count FROM session GROUP BY state")
        (shots,) = self._all("SELECT count(*) AS count FROM shot")
        by_state = {State(row["state"]): int(row["count"]) for row in states}
        return Counts(by_state, int(shots["count"]), self.last_event_id())

    def last_event_id(self) -> int:
        """The newest event's id, 0 when there is none."""
        row = self._one("SELECT coalesce(max(id), 0) AS id FROM event")
        return 0 if row is None else int(row["id"])

    def wait_for_event(self, after_id: int, timeout_s: float) -> bool:
        """Blocks until there is an event above `after_id` (True), or the time is over (False)."""
        deadline = time.monotonic() + timeout_s
        with self._grown:
            while self.last_event_id() <= after_id:
                left = deadline - time.monotonic()
                if left <= 0:
                    return False
                self._grown.wait(left)
        return True

    # ------------------------------------------------------------------------------------------------------ internals

    def _migrate(self) -> None:
        (version,) = self._connection.execute("PRAGMA user_version").fetchone()
        if version > len(MIGRATIONS):
            raise RigError(
                ErrorCode.STORE_CORRUPT,
                f"The database is of a newer release (schema {version}); use that release",
                schema=version,
            )
        for number, name in enumerate(MIGRATIONS[version:], start=version + 1):
            script = resources.files("acquisition.store").joinpath(name).read_text(encoding="utf-8")
            self._connection.executescript(f"BEGIN; {script}; PRAGMA user_version = {number}; COMMIT;")

    @contextmanager
    def _transaction(self) -> Generator[sqlite3.Connection]:
        with self._lock:
            self._connection.execute("BEGIN IMMEDIATE")
            try:
                yield self._connection
            except BaseException:
                self._connection.execute("ROLLBACK")
                raise
            self._connection.execute("COMMIT")
        # After the lock is free: whoever waits here reads the table under that lock.
        with self._grown:
            self._grown.notify_all()

    def _add_artifact(
        self, connection: sqlite3.Connection, session_id: str, kind: str, number: int, path: str, sha256: str,
        body: dict[str, Any], event: str,
    ) -> None:  # fmt: skip
        connection.execute(
            "INSERT INTO artifact (session_id, kind, number, path, sha256, body, created_at)"
            " VALUES (?, ?, ?, ?, ?, ?, ?)",
            (session_id, kind, number, path, sha256, json.dumps(body), time.time()),
        )
        self._event(connection, session_id, event, {"number": number, "path": path})

    def _event(self, connection: sqlite3.Connection, session_id: str | None, type_: str, body: dict[str, Any]) -> None:
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
        with self._lock:
            return self._connection.execute(query, values).fetchone()

    def _all(self, query: str, *values: Any) -> list[sqlite3.Row]:
        with self._lock:
            return self._connection.execute(query, values).fetchall()


def _marks(values: Any) -> str:
    return ", ".join("?" for _ in values)
