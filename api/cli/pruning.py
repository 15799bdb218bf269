"""The work of `lightpose prune`, which asks the archive before it removes what the archive should have."""

import sys
import time
from collections.abc import Callable
from datetime import UTC, datetime
from functools import cache
from pathlib import Path

from acquisition.archive import answering
from acquisition.models.errors import ErrorCode, RigError
from acquisition.store import retention


def prune(data: Path, older_than_days: float, keep: int, *, dry_run: bool) -> bool:
    """Removes old sessions and prints them; returns False if some stay that the archive lacks or the journal lost."""
    pruned = retention.prune(
        data, older_than_days=older_than_days, keep=keep, now=time.time(), dry_run=dry_run, lacking=asking()
    )
    for item in pruned.removed:
        since = f"{datetime.fromtimestamp(item.last_used_at, UTC):%Y-%m-%d}"
        what = "ended" if item.started else "never started, since"
        print(f"{item.session_id}\t{what} {since}\t{item.bytes / 1e6:.1f} MB")
    megabytes = sum(item.bytes for item in pruned.removed) / 1e6
    print(f"{'would remove' if dry_run else 'removed'} {len(pruned.removed)} sessions, {megabytes:.1f} MB")
    if pruned.waiting:
        _say(f"kept {pruned.waiting} sessions that the archive does not have yet: `GET /v1/archive` says why")
    for session_id, lacked in pruned.kept.items():
        _say(f"kept {session_id}: the archive does not have all of it, so it is pushed again: {lacked}")
    for folder in pruned.unknown:
        _say(
            f"kept {folder}: the journal has no such session; push it to an archive or move it elsewhere, or delete it"
        )
    if pruned.archive_problem is not None:
        _say(f"kept {len(pruned.unconfirmed)} archived sessions: the archive cannot confirm that it has them")
        _say(f"{pruned.archive_problem}")
    return not pruned.kept and not pruned.unconfirmed and not pruned.unknown


def _say(sentence: str) -> None:
    print(sentence, file=sys.stderr)


def asking() -> retention.Lacking:
    """Returns the question what an archive lacks of a session; each archive is opened when it is asked first."""

    @cache
    def question(address: str) -> Callable[[str, Path], str | None]:
        answering.require_store(address)
        try:
            from acquisition.archive import reading  # noqa: PLC0415 - needs the extra `archive`
            from acquisition.archive.archive import ArchiveFiles  # noqa: PLC0415
        except ModuleNotFoundError as error:
            raise RigError(
                ErrorCode.CONFIG_INVALID, f"{error.name} is not installed: pip install 'lightpose[archive]'"
            ) from error
        files = ArchiveFiles(address)

        def lacking(key: str, folder: Path) -> str | None:
            try:
                results = reading.result_names(folder, key)
            except RigError as error:
                return error.detail  # the push, which reads the folder too, names it in `GET /v1/archive`
            return files.lacking(key, results)

        return lacking

    return lambda address, key, folder: question(address)(key, folder)
