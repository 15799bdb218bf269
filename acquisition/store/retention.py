"""Retention: deletion of old sessions.

Only ended sessions are deleted, by age, and the newest ones are kept however old they are. A session that holds the rig
is never deleted: its folder is the only copy of what was captured. The journal's entry is deleted first, in a
transaction that checks the state again, so that the folder of a session in use is never removed.
"""

import shutil
from dataclasses import dataclass
from pathlib import Path

from acquisition.models.errors import ErrorCode, RigError
from acquisition.session import ENDED
from acquisition.store.journal import Journal

SECONDS_PER_DAY = 86_400.0


@dataclass(frozen=True)
class PrunedSession:
    """One session that was, or would be, removed: its id, when it ended (s since 1970), and its size."""

    session_id: str
    ended_at: float
    bytes: int


def prune(data: Path, *, older_than_days: float, keep: int, now: float, dry_run: bool) -> list[PrunedSession]:
    """Removes ended sessions older than `older_than_days` at `now` (s since 1970), but never the newest `keep`.

    With `dry_run` nothing is removed. May run beside the service. Raises RigError request.not_found when the folder
    holds no journal.
    """
    database = data / "rig.db"
    if not database.is_file():
        raise RigError(ErrorCode.REQUEST_NOT_FOUND, f"{data} is no data folder: it has no rig.db")
    journal = Journal(database)
    try:
        ended = [row for row in journal.sessions(limit=2**31) if row.state in ENDED and row.ended_at is not None]
        pruned: list[PrunedSession] = []
        for row in ended[keep:]:
            ended_at = row.ended_at or 0.0
            if now - ended_at < older_than_days * SECONDS_PER_DAY:
                continue
            folder = data / "sessions" / row.id
            size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
            if not dry_run:
                journal.delete_session(row.id)
                if folder.exists():
                    shutil.rmtree(folder)
            pruned.append(PrunedSession(row.id, ended_at, size))
        return pruned
    finally:
        journal.close()
