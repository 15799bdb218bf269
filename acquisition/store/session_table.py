"""The table of sessions: one session by its id, lists by state, label and date, and a person's label and notes.

A recipe is kept unchanged in the journal and in the session's folder, whose manifest holds its hash. Label and notes
that a person corrects later have columns of their own.
"""

import re
import secrets
import sqlite3
import time
from contextlib import closing
from pathlib import Path
from typing import Any

from acquisition.models.calibration_recipe import AnyRecipe
from acquisition.models.errors import ErrorCode, RigError
from acquisition.session_state import RIG_HOLDING
from acquisition.store.database import Database, placeholders
from acquisition.store.rows import SessionFilter, SessionRow, session_from_row

_EVERY_SESSION = SessionFilter()


def new_session_id(now: float) -> str:
    """Returns a new session's identifier: date and time of `now` (s since 1970), and six random hexadecimal digits."""
    return time.strftime("%Y%m%d-%H%M%S-", time.gmtime(now)) + secrets.token_hex(3)


def is_session_id(name: str) -> bool:
    """Returns whether a folder is named as `new_session_id` names sessions."""
    return re.fullmatch(r"\d{8}-\d{6}-[0-9a-f]{6}", name) is not None


def corrections(journal: Path) -> dict[str, tuple[str | None, str | None]]:
    """Returns the labels and notes that people have corrected, by session (None: the recipe's). The journal stays as it
    is, also one of an earlier release. Raises sqlite3.Error when it cannot be read."""
    with closing(sqlite3.connect(f"{journal.resolve().as_uri()}?mode=ro", uri=True)) as connection:
        columns = {str(name) for _, name, *_ in connection.execute("PRAGMA table_info(session)")}
        if not {"label", "notes"} <= columns:
            return {}
        return {one: (label, notes) for one, label, notes in connection.execute("SELECT id, label, notes FROM session")}


class SessionTable(Database):
    """Reads and describes sessions; any thread may call any method."""

    def session(self, session_id: str) -> SessionRow:
        """Returns one session. Raises RigError session.not_found."""
        row = self._one("SELECT * FROM session WHERE id = ?", session_id)
        if row is None:
            raise RigError(ErrorCode.SESSION_NOT_FOUND, f"No session {session_id[:80]!r}", session_id=session_id[:80])
        return session_from_row(row)

    def session_of_key(self, idempotency_key: str | None, recipe: AnyRecipe) -> SessionRow | None:
        """Returns the session that was made with an idempotency key; None if there is none, or no key.

        Raises RigError request.invalid when it was made from another recipe.
        """
        known = self._one("SELECT * FROM session WHERE idempotency_key = ?", idempotency_key)
        if known is None:
            return None
        row = session_from_row(known)
        if row.recipe != recipe:
            message = "This Idempotency-Key was used for another recipe; choose a new key"
            errors = [{"field": "Idempotency-Key", "message": message}]
            raise RigError(ErrorCode.REQUEST_INVALID, message, session_id=row.id, errors=errors)
        return row

    def sessions(
        self, limit: int, before: int | None = None, wanted: SessionFilter = _EVERY_SESSION
    ) -> list[SessionRow]:
        """Returns the sessions that `wanted` selects, with numbers below `before`, newest first."""
        where: list[str] = ["number < ?"]
        values: list[Any] = [before if before is not None else 2**62]
        if wanted.states:
            where.append(f"state IN ({placeholders(wanted.states)})")
            values += wanted.states
        if wanted.label:
            where.append("instr(casefold(coalesce(label, json_extract(recipe, '$.label'), '')), ?) > 0")
            values.append(wanted.label.casefold())
        if wanted.since is not None:
            where.append("created_at >= ?")
            values.append(wanted.since)
        if wanted.until is not None:
            where.append("created_at < ?")
            values.append(wanted.until)
        query = f"SELECT * FROM session WHERE {' AND '.join(where)} ORDER BY number DESC LIMIT ?"  # noqa: S608 - see where
        return [session_from_row(row) for row in self._all(query, *values, limit)]

    def holder(self) -> SessionRow | None:
        """Returns the session that holds the rig, if any."""
        row = self._one(f"SELECT * FROM session WHERE state IN ({placeholders(RIG_HOLDING)})", *RIG_HOLDING)  # noqa: S608
        return None if row is None else session_from_row(row)

    def describe_session(self, session_id: str, label: str | None, notes: str | None, actor: str) -> None:
        """Replaces label or notes (None: unchanged) and records who did so. Raises RigError session.not_found."""
        with self._transaction() as connection:
            self.session(session_id)
            connection.execute(
                "UPDATE session SET label = coalesce(?, label), notes = coalesce(?, notes) WHERE id = ?",
                (label, notes, session_id),
            )
            changes = {"label": label, "notes": notes}
            body = {name: value for name, value in changes.items() if value is not None}
            self._record_action(connection, session_id, "describe", actor, ", ".join(body))
            self._event(connection, session_id, "session.described", {**body, "by": actor})
