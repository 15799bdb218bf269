"""Retention: deletion of old sessions.

Ended sessions are deleted by age, but the newest of them are kept at any age. Sessions that were created and never
started are deleted by age, unless they wait in the queue. A session that holds the rig is never deleted: its folder is
the only copy of what was captured. If completed sessions are pushed to an archive, one that the archive does not have
completely is never deleted either. Just before a deletion the archive itself is asked: that a session was pushed once
does not say that the archive is still there. The journal's entry is deleted first, in a transaction that checks the
state again, so that the folder of a session in use is never removed. A session's folder that the journal does not know
is named and stays: its entry was lost, or its deletion was broken off, and the folder may be all that is left.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from acquisition.formats.session_files import JOURNAL
from acquisition.models.errors import ErrorCode, RigError
from acquisition.session_state import ENDED, State
from acquisition.store.folder import remove
from acquisition.store.journal import Journal
from acquisition.store.session_table import is_session_id

SECONDS_PER_DAY = 86_400.0

Lacking = Callable[[str, str, Path], str | None]
"""Asks the archive at an address what it lacks of a session, by its key and folder; None: nothing. Raises RigError if
it cannot be asked."""


@dataclass(frozen=True)
class PrunedSession:
    """One session that was, or would be, removed; `last_used_at` is its end, else its creation, s since 1970."""

    session_id: str
    started: bool
    last_used_at: float
    bytes: int


@dataclass
class Pruning:
    """What was, or would be, removed, and what stays.

    `kept` are sessions that count as archived and that the archive does not have after all, each with what it lacks;
    `unconfirmed` those for which it could not be asked, because of `archive_problem`; `waiting` is the number of those
    that have not been pushed yet; `unknown` are folders of sessions that the journal does not know.
    """

    removed: list[PrunedSession] = field(default_factory=list[PrunedSession])
    kept: dict[str, str] = field(default_factory=dict[str, str])
    unconfirmed: list[str] = field(default_factory=list[str])
    archive_problem: RigError | None = None
    waiting: int = 0
    unknown: list[Path] = field(default_factory=list[Path])


def prune(
    data: Path, *, older_than_days: float, keep: int, now: float, dry_run: bool,
    lacking: Lacking,
) -> Pruning:  # fmt: skip
    """Removes ended sessions older than `older_than_days` at `now` (s since 1970), except the newest `keep`.

    Also removes sessions of that age that were never started and are not queued. With `dry_run` nothing is removed. May
    run beside the service. A session of which the archive is `lacking` something stays, and is pushed again. Folders
    that the journal does not know, and in which nothing was changed for that time, stay and are named.

    Raises RigError request.not_found when the folder holds no journal.
    """
    database = data / JOURNAL
    if not database.is_file():
        raise RigError(ErrorCode.REQUEST_NOT_FOUND, f"{data} is not a data folder: it has no rig.db")
    journal = Journal(database)
    try:
        folders = [path for path in (data / "sessions").glob("*") if is_session_id(path.name) and path.is_dir()]
        rows = journal.sessions(limit=2**31)
        ended = [row for row in rows if row.state in ENDED and row.ended_at is not None]
        queued = {entry.session_id for entry in journal.queue_entries(0)}
        unused = [row for row in rows if row.state is State.CREATED and row.id not in queued]
        needed = journal.not_yet_archived([row.id for row in rows])
        pruned = Pruning()
        for row in [*ended[keep:], *unused]:
            last_used_at = row.ended_at or row.created_at
            if now - last_used_at < older_than_days * SECONDS_PER_DAY:
                continue
            if row.id in needed:
                pruned.waiting += 1
                continue
            folder = data / "sessions" / row.id
            if _is_missed(journal, row.id, folder, lacking, pruned, dry_run=dry_run):
                continue
            size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
            if not dry_run:
                try:
                    journal.delete_session(row.id, unless_awaiting_archive=True)
                except RigError as error:
                    if error.code is ErrorCode.SESSION_ACTION_NOT_ALLOWED:
                        continue  # somebody has just started it, or added something that the archive does not have
                    raise
                remove(folder)
            pruned.removed.append(PrunedSession(row.id, row.started_at is not None, last_used_at, size))
        known = {row.id for row in journal.sessions(limit=2**31)}  # anew: a session's folder is made before its entry
        lost = [path for path in sorted(folders) if path.name not in known and path.is_dir()]
        pruned.unknown = [path for path in lost if now - path.stat().st_mtime >= older_than_days * SECONDS_PER_DAY]
        return pruned
    finally:
        journal.close()


def _is_missed(
    journal: Journal, session_id: str, folder: Path, lacking: Lacking, pruned: Pruning, *, dry_run: bool
) -> bool:
    """Asks the archive for a session that counts as archived; returns True if it stays, and enters why.

    An archive that could not be asked once is not asked again.
    """
    archived = journal.archived_as(session_id)
    if archived is None:
        return False
    lacked = None
    if pruned.archive_problem is None:
        try:
            lacked = lacking(*archived, folder)
        except RigError as error:
            pruned.archive_problem = error
    if pruned.archive_problem is not None:
        pruned.unconfirmed.append(session_id)
        return True
    if lacked is None:
        return False
    pruned.kept[session_id] = lacked
    if not dry_run:
        journal.archive_again(session_id)
    return True
