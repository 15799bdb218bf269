"""The outbox: which completed sessions the archive has, up to which event, and why others wait.

A session is due when it is complete and has an event that the archive has not seen: its end, a further result, a new
label. Nothing is entered here when a session ends, so no session depends on the archive; the sender asks for what is
due.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass

from acquisition.models.event_type import EventType
from acquisition.store.queue_table import QueueTable
from acquisition.store.rows import SessionRow, session_from_row

ARCHIVED: EventType = "session.archived"
ARCHIVE_FAILED: EventType = "session.archive_failed"
"""Types of the events about archiving itself, which make no session due."""

LONGEST_WAIT_S = 3600.0
"""Longest time, s, from a failed push to the next try."""


@dataclass(frozen=True)
class Due:
    """A session to be pushed, its newest event, and the number of failed tries."""

    session: SessionRow
    event_id: int
    tries: int


@dataclass(frozen=True)
class OutboxStatus:
    """The archive's address (None: no archive), numbers of sessions, and the newest reason why one waits.

    `problem` is why the archive cannot be used, as its sender found last; times are s since 1970.
    """

    address: str | None
    archived: int
    waiting: int
    reason: str | None
    reason_at: float | None
    problem: str | None
    problem_at: float | None


class OutboxTable(QueueTable):
    """Reads and changes the outbox; any thread or process may call any method."""

    def set_archive(self, address: str | None) -> None:
        """Sets the archive that completed sessions are pushed to (None: no archive); a new one gets all of them."""
        with self._transaction() as connection:
            row = connection.execute("SELECT address FROM archive").fetchone()
            if (None if row is None else row["address"]) == address:
                return
            connection.execute("DELETE FROM archive")
            connection.execute("DELETE FROM outbox")
            if address is not None:
                connection.execute("INSERT INTO archive (id, address) VALUES (1, ?)", (address,))

    def set_archive_identity(self, identity: str) -> bool:
        """Records which archive is at the address, by its identity ('': it has none); returns whether it is another.

        Another one gets all sessions, as one at another address does.
        """
        with self._transaction() as connection:
            row = connection.execute("SELECT identity FROM archive").fetchone()
            if row is None or row["identity"] == identity:
                return False
            connection.execute("UPDATE archive SET identity = ?", (identity,))
            if row["identity"] is None:
                return False
            connection.execute("DELETE FROM outbox")
            return True

    def set_archive_problem(self, problem: str | None) -> bool:
        """Records why the archive cannot be used (None: it can); returns whether that is new.

        When it can be used again, all that waits for it is due at once.
        """
        with self._transaction() as connection:
            row = connection.execute("SELECT problem FROM archive").fetchone()
            if row is None or row["problem"] == problem:
                return False
            problem_at = None if problem is None else time.time()
            connection.execute("UPDATE archive SET problem = ?, problem_at = ?", (problem, problem_at))
            if problem is None:
                connection.execute("UPDATE outbox SET next_try_at = 0 WHERE state = 'waiting'")
            return True

    def due(self, now: float) -> Due | None:
        """Returns the session that has waited longest of those that may be tried at `now`, s since 1970, or None.

        One whose next try lies further ahead than LONGEST_WAIT_S may be tried too: the clock has been set back since.
        """
        row = self._one(
            "SELECT session.*, event_id, tries FROM awaiting_archive JOIN session ON session.id = session_id"
            " WHERE next_try_at <= ? OR next_try_at > ? ORDER BY session.ended_at LIMIT 1",
            now,
            now + LONGEST_WAIT_S,
        )
        return None if row is None else Due(session_from_row(row), int(row["event_id"]), int(row["tries"]))

    def archived(self, due: Due, key: str) -> None:
        """Records that the archive has a session with everything up to `due.event_id`."""
        self._put(due, "archived", key, 0, 0.0, None)

    def not_archived(self, due: Due, reason: str, next_try_at: float) -> None:
        """Records why a session could not be pushed, and when to try again, s since 1970."""
        self._put(due, "waiting", None, due.tries + 1, next_try_at, reason)

    def archived_as(self, session_id: str) -> tuple[str, str] | None:
        """Returns address of the archive and key of a session that counts as archived; None if it does not."""
        row = self._one(
            "SELECT address, key FROM outbox, archive WHERE session_id = ? AND state = 'archived'", session_id
        )
        return None if row is None else (str(row["address"]), str(row["key"]))

    def archive_again(self, session_id: str) -> None:
        """Has a session pushed again that counts as archived."""
        with self._transaction() as connection:
            connection.execute("DELETE FROM outbox WHERE session_id = ?", (session_id,))

    def outbox_status(self) -> OutboxStatus:
        """Returns how many sessions are archived and how many wait, and why."""
        archive = self._one("SELECT * FROM archive")
        waiting = self._one("SELECT count(*) AS count FROM awaiting_archive")
        archived = self._one("SELECT count(*) AS count FROM outbox WHERE state = 'archived'")
        reason = self._one(
            "SELECT reason, changed_at FROM outbox WHERE state = 'waiting' ORDER BY changed_at DESC LIMIT 1"
        )
        return OutboxStatus(
            address=None if archive is None else str(archive["address"]),
            archived=0 if archived is None else int(archived["count"]),
            waiting=0 if waiting is None or archive is None else int(waiting["count"]),
            reason=None if reason is None else str(reason["reason"]),
            reason_at=None if reason is None else float(reason["changed_at"]),
            problem=None if archive is None else archive["problem"],
            problem_at=None if archive is None else archive["problem_at"],
        )

    def not_yet_archived(self, session_ids: Sequence[str]) -> set[str]:
        """Returns those of the sessions that the archive lacks or has incompletely; empty if there is no archive."""
        if self._one("SELECT address FROM archive") is None:
            return set()
        rows = self._all("SELECT session_id FROM awaiting_archive")
        return {str(row["session_id"]) for row in rows} & set(session_ids)

    def _put(self, due: Due, state: str, key: str | None, tries: int, next_try_at: float, reason: str | None) -> None:
        with self._transaction() as connection:
            known = connection.execute("SELECT 1 FROM session WHERE id = ?", (due.session.id,)).fetchone()
            if known is None:  # deleted meanwhile
                return
            connection.execute(
                "INSERT OR REPLACE INTO outbox VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
                (due.session.id, state, due.event_id, key, tries, next_try_at, reason, time.time()),
            )
            body = {"key": key} if reason is None else {"reason": reason, "next_try_at": next_try_at}
            self._event(connection, due.session.id, ARCHIVED if reason is None else ARCHIVE_FAILED, body)
