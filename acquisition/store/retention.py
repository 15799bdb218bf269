"""Retention: deletion of old sessions.

Ended sessions are deleted by age, but the newest of them are kept at any age. Sessions that were created and never
started are deleted by age, unless they wait in the queue. A session that holds the rig is never deleted: its folder is
the only copy of what was captured. If completed sessions are pushed to an archive, one that the archive does not have
completely is never deleted either. The journal's entry is deleted first, in a transaction that checks the state again,
so that the folder of a session in use is never removed.
"""

import shutil
from dataclasses import dataclass
from pathlib import Path

from acquisition.models.errors import ErrorCode, RigError
from acquisition.session import ENDED, State
from acquisition.store.journal import Journal

SECONDS_PER_DAY = 86_400.0


@dataclass(frozen=True)
class PrunedSession:
    """One session that was, or would be, removed; `last_used_at` is its end, else its creation, s since 1970."""

    session_id: str
    started: bool
    last_used_at: float
    bytes: int


def prune(data: Path, *, older_than_days: float, keep: int, now: float, dry_run: bool) -> list[PrunedSession]:
    """Removes ended sessions older than `older_than_days` at `now` (s since 1970), except the newest `keep`.

    Also removes sessions of that age that were never started and are not queued. With `dry_run` nothing is removed. May
    run beside the service. Raises RigError request.not_found when the folder holds no journal.
    """
    database = data / "rig.db"
    if not database.is_file():
        raise RigError(ErrorCode.REQUEST_NOT_FOUND, f"{data} is not a data folder: it has no rig.db")
    journal = Journal(database)
    try:
        rows = journal.sessions(limit=2**31)
        ended = [row for row in rows if row.state in ENDED and row.ended_at is not None]
        queued = {entry.session_id for entry in journal.queue_entries(0)}
        unused = [row for row in rows if row.state is State.CREATED and row.id not in queued]
        needed = journal.not_yet_archived([row.id for row in rows])
        pruned: list[PrunedSession] = []
        for row in [*ended[keep:], *unused]:
            last_used_at = row.ended_at or row.created_at
            if row.id in needed or now - last_used_at < older_than_days * SECONDS_PER_DAY:
                continue
            folder = data / "sessions" / row.id
            size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
            if not dry_run:
                try:
                    journal.delete_session(row.id)
                except RigError as error:
                    if error.code is ErrorCode.SESSION_ACTION_NOT_ALLOWED:  # somebody has just started it
                        continue
                    raise
                if folder.exists():
                    shutil.rmtree(folder)
            pruned.append(PrunedSession(row.id, row.started_at is not None, last_used_at, size))
        return pruned
    finally:
        journal.close()
