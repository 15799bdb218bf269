"""The tables of the queue: entries in their order, and whether the queue goes on by itself.

Every change and the event that announces it, `queue.changed`, are one transaction, as with sessions.
"""

import json
import sqlite3
import time
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.recipe import Recipe
from acquisition.store.session_table import SessionTable

MAX_WAITING = 200
"""Entries that may wait at once; bounds the list."""


class QueueState(StrEnum):
    """Whether the queue begins sessions."""

    STOPPED = "stopped"
    RUNNING = "running"


class EntryState(StrEnum):
    """What became of an entry."""

    WAITING = "waiting"
    """Its session has not begun."""
    RUNNING = "running"
    """Its session has begun and not ended; it may be paused or interrupted."""
    DONE = "done"
    """Its session has completed."""
    FAILED = "failed"
    """Its session was stopped or has failed."""


@dataclass(frozen=True)
class QueueEntry:
    """One entry; times in s since 1970."""

    id: int
    object_name: str
    recipe: Recipe
    unattended: bool
    state: EntryState
    session_id: str | None
    added_by: str
    added_at: float
    ended_at: float | None


@dataclass(frozen=True)
class QueueStatus:
    """Whether the queue goes on by itself, who changed this and when, and the problem that stopped it."""

    state: QueueState
    reason: dict[str, Any] | None
    changed_by: str
    changed_at: float


class QueueTable(SessionTable):
    """Reads and changes the queue; any thread may call any method."""

    def queue_status(self) -> QueueStatus:
        """Returns whether the queue goes on by itself."""
        (row,) = self._all("SELECT * FROM queue")
        reason = None if row["reason"] is None else json.loads(row["reason"])
        return QueueStatus(QueueState(row["state"]), reason, row["changed_by"], row["changed_at"])

    def set_queue_status(self, state: QueueState, actor: str, reason: dict[str, Any] | None = None) -> None:
        """Starts or stops the queue; `reason` is a problem, or None for a person's wish or an empty queue."""
        with self._transaction() as connection:
            connection.execute(
                "UPDATE queue SET state = ?, reason = ?, changed_by = ?, changed_at = ?",
                (state, None if reason is None else json.dumps(reason), actor, time.time()),
            )
            body = {"state": state, "by": actor} | ({} if reason is None else {"reason": reason})
            self._event(connection, None, "queue.changed", body)

    def queue_entries(self, ended: int) -> list[QueueEntry]:
        """Returns the `ended` newest ended entries, oldest first, then the running one, then the others in order."""
        past = self._all(
            "SELECT * FROM queue_entry WHERE ended_at IS NOT NULL ORDER BY ended_at DESC, id DESC LIMIT ?", ended
        )
        live = self._all("SELECT * FROM queue_entry WHERE ended_at IS NULL ORDER BY state, place, id")
        return [_entry(row) for row in (*reversed(past), *live)]

    def queue_entry(self, entry_id: int) -> QueueEntry:
        """Returns one entry. Raises RigError request.not_found."""
        row = self._one("SELECT * FROM queue_entry WHERE id = ?", entry_id)
        if row is None:
            raise RigError(ErrorCode.REQUEST_NOT_FOUND, f"The queue has no entry {entry_id}")
        return _entry(row)

    def add_queue_entry(
        self, object_name: str, recipe: Recipe, actor: str, *, unattended: bool, idempotency_key: str | None
    ) -> tuple[QueueEntry, bool]:
        """Adds an entry at the end; returns it and True, or for a key used before, that entry and False.

        Raises RigError request.invalid when too many entries wait, or when the key was used for something else.
        """
        with self._transaction() as connection:
            if idempotency_key is not None:
                known = self._one("SELECT * FROM queue_entry WHERE idempotency_key = ?", idempotency_key)
                if known is not None:
                    entry = _entry(known)
                    if (entry.object_name, entry.recipe, entry.unattended) != (object_name, recipe, unattended):
                        raise RigError(
                            ErrorCode.REQUEST_INVALID,
                            "This Idempotency-Key was used for another entry; choose a new key",
                            entry=entry.id,
                        )
                    return entry, False
            (waiting,) = self._all("SELECT count(*) AS count FROM queue_entry WHERE state = ?", EntryState.WAITING)
            if waiting["count"] >= MAX_WAITING:
                raise RigError(ErrorCode.REQUEST_INVALID, f"The queue is full: {MAX_WAITING} entries are waiting")
            cursor = connection.execute(
                "INSERT INTO queue_entry (place, object_name, recipe, unattended, state, idempotency_key, added_by,"
                " added_at) VALUES ((SELECT coalesce(max(place), 0) + 1 FROM queue_entry), ?, ?, ?, ?, ?, ?, ?)",
                (object_name, recipe.model_dump_json(), unattended, EntryState.WAITING, idempotency_key, actor,
                 time.time()),
            )  # fmt: skip
            entry = self.queue_entry(int(cursor.lastrowid or 0))
            self._event(connection, None, "queue.changed", {"added": entry.id, "object_name": object_name, "by": actor})
            return entry, True

    def remove_queue_entry(self, entry_id: int, actor: str) -> None:
        """Removes an entry. Raises RigError queue.entry_begun while its session has begun and not ended."""
        with self._transaction() as connection:
            entry = self.queue_entry(entry_id)
            if entry.state is EntryState.RUNNING:
                raise RigError(
                    ErrorCode.QUEUE_ENTRY_BEGUN,
                    f"Entry {entry_id} has begun: stop session {entry.session_id} first",
                    session_id=entry.session_id,
                )
            connection.execute("DELETE FROM queue_entry WHERE id = ?", (entry_id,))
            self._event(connection, None, "queue.changed", {"removed": entry_id, "by": actor})

    def order_queue(self, entry_ids: Sequence[int], actor: str) -> None:
        """Puts the waiting entries into this order. Raises RigError request.invalid unless these are all of them."""
        with self._transaction() as connection:
            rows = self._all("SELECT id FROM queue_entry WHERE state = ? ORDER BY place, id", EntryState.WAITING)
            waiting = [int(row["id"]) for row in rows]
            if sorted(entry_ids) != sorted(waiting):
                raise RigError(
                    ErrorCode.REQUEST_INVALID,
                    f"The order must name each waiting entry once: {waiting}",
                    waiting=waiting,
                )
            for place, entry_id in enumerate(entry_ids):
                connection.execute("UPDATE queue_entry SET place = ? WHERE id = ?", (place, entry_id))
            self._event(connection, None, "queue.changed", {"order": list(entry_ids), "by": actor})

    def set_queue_entry(self, entry: QueueEntry, state: EntryState, session_id: str | None) -> None:
        """Records the state of an entry, and its session."""
        ended = time.time() if state in (EntryState.DONE, EntryState.FAILED) else None
        with self._transaction() as connection:
            connection.execute(
                "UPDATE queue_entry SET state = ?, session_id = ?, ended_at = ? WHERE id = ?",
                (state, session_id, ended, entry.id),
            )
            body = {"entry": entry.id, "object_name": entry.object_name, "entry_state": state, "session_id": session_id}
            self._event(connection, None, "queue.changed", body)


def _entry(row: sqlite3.Row) -> QueueEntry:
    return QueueEntry(
        id=row["id"],
        object_name=row["object_name"],
        recipe=Recipe.model_validate_json(row["recipe"]),
        unattended=bool(row["unattended"]),
        state=EntryState(row["state"]),
        session_id=row["session_id"],
        added_by=row["added_by"],
        added_at=row["added_at"],
        ended_at=row["ended_at"],
    )
